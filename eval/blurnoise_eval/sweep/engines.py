"""Engines: who computes a sweep's blocks. The rows are the same whatever the engine, its workers or their order.

Few blocks are in flight at a time, so that a sweep of any length takes the same memory. Closing what ``map``
returns ends the engine: no other block is begun, nobody is left behind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Protocol, cast

from blurnoise._core.checks import one_of
from blurnoise_eval.sweep.actors import RayEngine
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.crews import Crew
from blurnoise_eval.sweep.flight import Answers, fly
from blurnoise_eval.sweep.processes import ProcessEngine
from blurnoise_eval.sweep.threads import ThreadEngine
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.machine import usable_cores

__all__ = [
    "ENGINES",
    "Answers",
    "Engine",
    "ProcessEngine",
    "RayEngine",
    "ThreadEngine",
    "engine_of",
    "staying",
]


class Engine(Protocol):
    """Something that computes blocks."""

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """Each block with its results, or with what a worker raised, in any order. Blocks are taken as needed.

        Beside them, with the block that it worked on, a :class:`~blurnoise_eval.sweep.flight.WorkerDied` for each
        worker that died: no answer yet.
        """


class CrewEngine(Engine, Protocol):
    """An engine whose workers are processes that have to be begun."""

    def crew(self, work: Work) -> Crew:
        """Workers for this work, none of them begun."""


@contextmanager
def staying(engine: Engine) -> Iterator[Engine]:
    """The engine; its workers, if they are processes, stay from one ``map`` to the next of the same work."""
    if not hasattr(engine, "crew"):
        yield engine
        return
    stayed = _Staying(cast(CrewEngine, engine))
    try:
        yield stayed
    finally:
        stayed.leave()


class _Staying:
    def __init__(self, engine: CrewEngine) -> None:
        self._engine = engine
        self._crew: tuple[Work, Crew] | None = None

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        if self._crew is None or self._crew[0] != work:
            self.leave()
            self._crew = work, self._engine.crew(work)
        return fly(self._crew[1], blocks)

    def leave(self) -> None:
        if self._crew is not None:
            self._crew[1].leave()
            self._crew = None


ENGINES: dict[str, Callable[[int], Engine]] = {
    "threads": ThreadEngine,
    "processes": ProcessEngine,
    "ray": RayEngine,
}


def engine_of(name: str, workers: int | None, address: str | None = None) -> Engine:
    """The engine of that name. address: of a Ray cluster; then workers None are one for each of its cores.

    Raises ``ValueError`` for another name, for less than one worker, and for an address that goes with no engine.
    """
    one_of("engine", name, ENGINES)
    if address is not None:
        if name != "ray":
            raise ValueError(f"address = {address!r}: goes with engine 'ray', not {name!r}")
        return RayEngine(workers, address)
    return ENGINES[name](usable_cores() if workers is None else workers)
