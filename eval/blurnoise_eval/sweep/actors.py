"""Actors of Ray, one for each core of a cluster: cells travel to them, and rows back; pictures do not.

Ray starts and watches them; it repeats nothing, see :mod:`blurnoise_eval.sweep.flight`.
"""

from __future__ import annotations

import importlib.util
import logging
import os
import socket
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from blurnoise_eval.sweep import worker_process
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.crews import Crew, Hand, pickled, sent
from blurnoise_eval.sweep.flight import Answers, fly_once
from blurnoise_eval.sweep.parcel import Parcel
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.sweep.worker_process import Told
from blurnoise_eval.system.machine import versions

_NAME = "ray"
_HINT = "; one that asks for a token, as Ray's own do from 2.60 on, needs RAY_AUTH_MODE=token here, too"
_REACHED_S = 10.0
_STORE_BYTES = 100_000_000  # shared memory of a local cluster, which only Ray itself uses


@dataclass(frozen=True)
class RayEngine:
    """Actors of Ray, each with a core, sessions and prepared pictures of its own.

    workers: how many; None: one for each core of the cluster. address: of a cluster that runs, as ``ray.init`` takes
    it; None: the one that this process is connected to, else one on this machine, started and stopped again.
    patience_s: how long to wait while there is no worker at all. Every node has this package in the same version, and
    reads pictures by the same names. Raises ``ValueError`` for less than one worker, without the package ray, and for
    what does not pickle; ``ChildProcessError`` where no worker can be had.
    """

    workers: int | None = None
    address: str | None = None
    patience_s: float = 300.0

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise ValueError(f"ray = {self.workers}: must be >= 1")
        if importlib.util.find_spec("ray") is None:
            raise ValueError("engine = 'ray': needs the package ray: pip install 'blurnoise[ray]'")

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.sweep.engines.Engine`."""
        return fly_once(self.crew(work), blocks)

    def crew(self, work: Work) -> Crew:
        """Actors for this work; the first connects to the cluster."""
        return _Actors(self, sent(_NAME, "models", lambda: Parcel.of(work)))


class RayWorker:
    """What stands in an actor's process."""

    def open(self, parcel: Parcel, contents: Sequence[Any], wanted: Mapping[str, str]) -> None:
        """Open the work's models. contents: a reference to the files of these, which is followed only where they
        differ here. Raises ``ValueError`` unless the packages are those ``wanted``: other bits may come of others."""
        found = versions()
        if found != wanted:
            others = [
                f"{name} {found[name]}, not {wanted[name]}" for name in wanted if found[name] != wanted[name]
            ]
            raise ValueError(f"engine = 'ray': node {socket.gethostname()} has {', '.join(others)} as here")
        import ray

        with parcel.opened(lambda: ray.get(contents[0])) as work:
            worker_process.open_work(lambda: work)

    def compute(self, block: bytes) -> Told:
        """As :func:`blurnoise_eval.sweep.worker_process.compute`."""
        return worker_process.compute(block)


@contextmanager
def local_cluster(cores: int) -> Iterator[None]:
    """A cluster of so many cores on this machine inside, for every :class:`RayEngine` without an address."""
    _connect(cores, None)
    try:
        yield
    finally:
        _imported().shutdown()


def _imported() -> Any:
    """The package; what it would say of deaths on standard output is told by the engine."""
    os.environ.setdefault("RAY_DEDUP_LOGS_SKIP_REGEX", ".")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray

    return ray


def _connect(cores: int | None, address: str | None) -> None:
    """To the cluster at the address, or to one that is started here. Raises ``ChildProcessError``."""
    if address is not None:
        _check_reached(address)
    ray = _imported()
    logging.getLogger("ray").setLevel(logging.ERROR)
    here: dict[str, Any] = {
        "address": "local",
        "num_cpus": cores,
        "num_gpus": 0,
        "include_dashboard": False,
        "object_store_memory": _STORE_BYTES,
        "_node_ip_address": "127.0.0.1",
    }
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    for tries_left in (
        (1, 0) if address is None else (0,)
    ):  # Ray gives its own node 30 s, few where others compute
        try:
            ray.init(**(here if address is None else {"address": address}), **quiet)
            return
        except BaseException as error:
            ray.shutdown()
            if not isinstance(error, Exception):
                raise
            if not tries_left:
                hint = "" if address is None else _HINT
                raise ChildProcessError(
                    f"engine = 'ray': no cluster at {address or 'this machine'} ({_line(error)}){hint}"
                ) from None


def _check_reached(address: str) -> None:
    """Raise ``ChildProcessError`` where nobody listens: Ray itself would try for minutes."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon or not port.isdecimal():  # "auto", which Ray finds by its files
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), _REACHED_S).close()
    except (OSError, OverflowError) as error:
        raise ChildProcessError(f"engine = 'ray': no cluster at {address} ({_line(error)})") from None


class _Actors(Crew):
    """Actors of the cluster, to which the first one connects."""

    name = _NAME

    def __init__(self, engine: RayEngine, parcel: Parcel) -> None:
        super().__init__()
        self.patience_s = engine.patience_s
        self._engine, self._parcel = engine, parcel
        self._connected = False  # by us

    @property
    def size(self) -> int:
        cores = self._ray.cluster_resources().get("CPU", 1)  # connects
        return self._engine.workers or max(int(cores), 1)

    def begin(self) -> Hand:
        errors = self._ray.exceptions
        try:
            opening = self._parcel, [self._contents], versions()
            return _Actor(self._ray, self._kind.remote(), opening)
        except errors.RayError as error:
            raise ChildProcessError(
                f"engine = 'ray': the cluster is gone ({_line(error)}); what was finished is kept"
            ) from None

    def is_death(self, error: BaseException) -> bool:
        errors = self._ray.exceptions
        return isinstance(error, errors.RayError) and not isinstance(error, errors.RayTaskError)

    def raised(self, error: BaseException) -> BaseException:
        cause = getattr(error, "cause", None)  # of a RayTaskError, whose text is a traceback
        return cause if isinstance(cause, BaseException) else error

    def leave(self) -> None:
        """All go; a cluster that was started here is stopped, and no connection stays that was not there before."""
        super().leave()
        if self._connected:
            self._connected = False
            self._ray.shutdown()
            for name in ("_ray", "_kind", "_contents"):  # those of the next cluster are others
                self.__dict__.pop(name, None)

    @cached_property
    def _ray(self) -> Any:
        """Ray, connected."""
        ray = _imported()
        if not ray.is_initialized():
            _connect(self._engine.workers, self._engine.address)
            self._connected = True
        return ray

    @cached_property
    def _contents(self) -> Any:
        """Reference to the models' files: a node fetches them once, and only if it has to."""
        return self._ray.put(self._parcel.contents())

    @cached_property
    def _kind(self) -> Any:
        alone = {"num_cpus": 1, "max_restarts": 0, "max_task_retries": 0, "scheduling_strategy": "SPREAD"}
        return self._ray.remote(**alone)(RayWorker)


class _Actor:
    """One actor, which may have to wait for a core."""

    def __init__(self, ray: Any, actor: Any, opening: tuple[Any, ...]) -> None:
        self._ray, self._actor = ray, actor
        self.opened: Future[None] = actor.open.remote(*opening).future()

    def compute(self, block: Block) -> Future[Told]:
        told: Future[Told] = self._actor.compute.remote(
            pickled(_NAME, f"picture {block.picture.name!r}", block)
        ).future()
        return told

    def dismiss(self) -> None:
        with suppress(self._ray.exceptions.RayError):
            self._ray.kill(self._actor)


def _line(error: BaseException) -> str:
    """The first line of what is wrong."""
    return next(iter(str(error).splitlines()), type(error).__name__)
