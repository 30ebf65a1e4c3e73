"""Tasks of Ray, one for each core of a cluster: cells travel to them, and rows back; models and pictures do not."""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import pickle
import socket
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from blurnoise_eval.run.engines import base
from blurnoise_eval.run.engines.base import Answers, BlockResult, WorkerDied
from blurnoise_eval.run.work import Block, Work
from blurnoise_eval.system.interrupts import taken_back
from blurnoise_eval.system.machine import versions

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
        """As of :class:`~blurnoise_eval.run.engines.Engine`."""
        todo = iter(blocks)
        if (first := next(todo, None)) is None:
            return
        ray, needed = _imported(), _bits_of(work)
        packed = base.pickled(work, ray.cloudpickle.dumps)  # the functions of a script, too
        with self:
            try:
                if not ray.is_initialized():
                    self._connected = True
                    _connect(ray, self.workers, self.address)
                shared = base.shared_out(chain([first], todo), self.workers or _cores(ray))
                yield from self._computed(ray, (ray.put(packed), needed), shared)
            except (ray.exceptions.RayError, ConnectionError, RuntimeError) as error:
                where = self.address or "this machine"
                line = next(iter(str(error).splitlines()), type(error).__name__)
                raise ChildProcessError(
                    f"engine = 'ray': no cluster at {where} ({line}); finished work is kept"
                ) from None

    def _computed(self, ray: Any, work: tuple[Any, ...], blocks: Iterable[Block]) -> Answers:
        task = ray.remote(num_cpus=1, max_retries=1, scheduling_strategy="SPREAD")(_compute)
        todo = iter(blocks)
        given_up = dict[str, Exception]()
        flying: dict[Any, Block] = {}
        try:
            while True:
                most = self.workers or max(_cores(ray), 1)
                while len(flying) < most and (block := next(todo, None)) is not None:
                    if block.picture.name in given_up:
                        yield block, given_up[block.picture.name]
                    else:
                        flying[task.remote(*work, base.pickled(block, ray.cloudpickle.dumps))] = block
                if not flying:
                    return
                done, _ = ray.wait(list(flying), timeout=self.patience_s)
                if not done and not _cores(ray):
                    raise ChildProcessError(
                        f"engine = 'ray': no worker was available for {self.patience_s} s; finished work is kept"
                    )
                for each in done:
                    block = flying.pop(each)
                    try:
                        yield block, base.results_of(ray.get(each))
                    except ray.exceptions.RayTaskError as error:  # its own text is a traceback
                        yield block, base.raised(error.cause or error)
                    except ray.exceptions.NodeDiedError:  # which is no fault of a picture
                        flying[task.remote(*work, base.pickled(block, ray.cloudpickle.dumps))] = block
                    except ray.exceptions.RayError:
                        for _ in range(2):
                            yield block, WorkerDied(block.picture.name)
                        given_up[block.picture.name] = base.given_up(block)
                        yield block, given_up[block.picture.name]
        finally:
            for each in flying:
                with suppress(ray.exceptions.RayError):
                    ray.cancel(each, force=True)


def _compute(packed: bytes, needed: Mapping[str, str], block: bytes) -> BlockResult:
    """In a worker of a node. Raises ``ValueError`` unless packages and models are those that are ``needed``."""

    def opened() -> Work:
        work: Work = pickle.loads(packed)
        if others := dict(_bits_of(work).items() - needed.items()):
            raise ValueError(
                f"engine = 'ray': node {socket.gethostname()} has {others}, which is not as on the driver"
            )
        return work

    return base.compute(hashlib.sha256(packed).hexdigest(), opened, block)


def _bits_of(work: Work) -> dict[str, str]:
    """The versions of packages and models, on which the bits of the rows depend."""
    return {**versions(), **{f"model {each.name}": each.sha256 for each in work.models}}


def _cores(ray: Any) -> int:
    return int(ray.cluster_resources().get("CPU", 0))


def _imported() -> Any:
    """The package; what it would print of deaths is reported by the engine."""
    os.environ.setdefault("RAY_DEDUP_LOGS_SKIP_REGEX", ".")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray

    return ray


def _connect(ray: Any, cores: int | None, address: str | None) -> None:
    """To the cluster at the address, or to one that is started here."""
    how: dict[str, Any] = {"address": address}
    if address is None:
        how = {"address": "local", "num_cpus": cores, "num_gpus": 0, "include_dashboard": False}
        how |= {"object_store_memory": _STORE_BYTES, "_node_ip_address": "127.0.0.1"}
    logging.getLogger("ray").setLevel(logging.ERROR)
    with taken_back():
        ray.init(**how, log_to_driver=False, logging_level=logging.ERROR)
