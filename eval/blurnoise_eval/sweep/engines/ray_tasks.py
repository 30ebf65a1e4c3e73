"""Tasks of Ray, one for each core of a cluster: cells travel to them, and rows back; models and pictures do not."""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import pickle
import socket
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.engines import base
from blurnoise_eval.sweep.engines.base import Answers, BlockResult, WorkerDied
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.machine import versions

_NAME = "ray"
_HINT = "; one that asks for a token, as Ray's own do from 2.60 on, needs RAY_AUTH_MODE=token here, too"
_REACHED_S = 10.0
_LOOK_S = 1.0  # between looks at which nodes there are
_STORE_BYTES = 100_000_000  # shared memory of a local cluster, which only Ray itself uses


@dataclass
class RayEngine(base.Staying):
    """Tasks of Ray, each on a core, with sessions and prepared pictures of its own.

    workers: how many at a time; None: one for each core of the cluster. address: of a cluster that runs, as
    ``ray.init`` takes it; None: the one that this process is connected to, else one on this machine, started and
    stopped again. patience_s: how long to wait while no node has a core. Every node has this package in the same
    version, and reads models and pictures by the same names. Used as a context manager, the connection stays from one
    :meth:`map` to the next. Raises ``ChildProcessError`` where no worker is available.

    Ray computes a block whose worker died once more, on another one that has nothing else to do. If that dies, too,
    the block's picture is given up.
    """

    workers: int | None = None
    address: str | None = None
    patience_s: float = 300.0
    _connected: bool = field(default=False, init=False, repr=False, compare=False)  # by this engine

    def __post_init__(self) -> None:
        base.at_least_one("ray", self.workers)
        if importlib.util.find_spec("ray") is None:
            raise ValueError("engine = 'ray': needs the package ray: pip install 'blurnoise[ray]'")

    def stop(self) -> None:
        """Stop a cluster that was started here; no connection stays that was not there before."""
        if self._connected:
            self._connected = False
            _imported().shutdown()

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.sweep.engines.Engine`."""
        packed = base.pickled(_NAME, work)
        todo = iter(blocks)
        first = next(todo, None)
        if first is None:
            return
        needed = _bits_of(work)
        with self:
            ray = _imported()
            if not ray.is_initialized():
                _connect(ray, self.workers, self.address)
                self._connected = True
            try:
                yield from self._computed(ray, packed, needed, chain([first], todo))
            except ray.exceptions.RayError as error:
                raise ChildProcessError(
                    f"engine = {_NAME!r}: the cluster is gone ({_line(error)}); what was finished is kept"
                ) from None

    def _computed(
        self, ray: Any, packed: bytes, needed: Mapping[str, str], blocks: Iterable[Block]
    ) -> Answers:
        task = ray.remote(num_cpus=1, max_retries=1, scheduling_strategy="SPREAD")(_compute)
        work = ray.put(packed), needed

        def submit(block: Block) -> Any:
            return task.remote(*work, base.pickled(_NAME, block))

        todo = base.shared_out(blocks, self.workers or _cores(ray))
        lost = dict[str, Exception]()
        flying: dict[Any, Block] = {}
        last_core_s = time.monotonic()
        try:
            while True:
                cores = _cores(ray)
                while len(flying) < (self.workers or max(cores, 1)) and (block := next(todo, None)):
                    if block.picture.name in lost:
                        yield block, lost[block.picture.name]
                    else:
                        flying[submit(block)] = block
                if not flying:
                    return
                done, _ = ray.wait(list(flying), timeout=_LOOK_S)
                if done or cores:
                    last_core_s = time.monotonic()
                elif time.monotonic() - last_core_s > self.patience_s:
                    raise ChildProcessError(
                        f"engine = {_NAME!r}: no worker was available for {self.patience_s} s; "
                        "what was finished is kept"
                    )
                for each in done:
                    block = flying.pop(each)
                    try:
                        yield block, base.results_of(ray.get(each))
                    except ray.exceptions.RayTaskError as error:  # its own text is a traceback
                        yield block, base.raised(error.cause) or error
                    except ray.exceptions.NodeDiedError:  # which is no fault of a picture
                        flying[submit(block)] = block
                    except ray.exceptions.RayError:
                        for _ in range(2):
                            yield block, WorkerDied(block.picture.name)
                        lost[block.picture.name] = base.given_up(block.picture.name)
                        yield block, lost[block.picture.name]
        finally:
            for each in flying:
                with suppress(ray.exceptions.RayError):
                    ray.cancel(each, force=True)


def _compute(packed: bytes, needed: Mapping[str, str], block: bytes) -> BlockResult:
    """In a worker of a node. Raises ``ValueError`` unless packages and models are those that are ``needed``."""

    def opened() -> Work:
        work: Work = pickle.loads(packed)
        found = _bits_of(work)
        others = [
            f"{name} {found.get(name)}, not {it}" for name, it in needed.items() if found.get(name) != it
        ]
        if others:
            node = socket.gethostname()
            raise ValueError(f"engine = {_NAME!r}: node {node} has {', '.join(others)} as here")
        return work

    return base.compute(hashlib.sha256(packed).hexdigest(), opened, block)


def _bits_of(work: Work) -> dict[str, str]:
    """The versions of packages and models, on which the bits of the rows depend."""
    return {**versions(), **{f"model {each.name}": each.sha256 for each in work.models}}


def _cores(ray: Any) -> int:
    return int(ray.cluster_resources().get("CPU", 0))


def _imported() -> Any:
    """The package; what it would print of deaths is told by the engine."""
    os.environ.setdefault("RAY_DEDUP_LOGS_SKIP_REGEX", ".")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray

    return ray


def _connect(ray: Any, cores: int | None, address: str | None) -> None:
    """To the cluster at the address, or to one that is started here. Raises ``ChildProcessError``."""
    logging.getLogger("ray").setLevel(logging.ERROR)
    how: dict[str, Any] = {"address": address}
    if address is None:
        how = {"address": "local", "num_cpus": cores, "num_gpus": 0, "include_dashboard": False}
        how |= {"object_store_memory": _STORE_BYTES, "_node_ip_address": "127.0.0.1"}
    else:
        _check_reached(address)
    try:
        ray.init(**how, log_to_driver=False, logging_level=logging.ERROR)
    except BaseException as error:
        ray.shutdown()
        if not isinstance(error, Exception):
            raise
        hint = "" if address is None else _HINT
        raise ChildProcessError(
            f"engine = {_NAME!r}: no cluster at {address or 'this machine'} ({_line(error)}){hint}"
        ) from None


def _check_reached(address: str) -> None:
    """Raise ``ChildProcessError`` where nobody listens: Ray itself would try for minutes."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    try:
        if colon and port.isdecimal():  # not "auto", which Ray finds by its files
            socket.create_connection((host.strip("[]"), int(port)), _REACHED_S).close()
    except (OSError, OverflowError) as error:
        raise ChildProcessError(f"engine = {_NAME!r}: no cluster at {address} ({_line(error)})") from None


def _line(error: BaseException) -> str:
    """The first line of what is wrong."""
    return next(iter(str(error).splitlines()), type(error).__name__)
