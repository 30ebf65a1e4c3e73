"""Engines: who computes a sweep's blocks. The rows are the same whatever the engine, its workers or their order.

Few blocks are in flight at a time, so that a sweep of any length takes the same memory. Closing what ``map``
returns ends the engine: no other block is begun, nobody is left behind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from blurnoise._core.checks import one_of
from blurnoise_eval.sweep.actors import RayEngine
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.flight import Answers
from blurnoise_eval.sweep.processes import ProcessEngine
from blurnoise_eval.sweep.threads import ThreadEngine
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.machine import usable_cores

__all__ = ["ENGINES", "Answers", "Engine", "ProcessEngine", "RayEngine", "ThreadEngine", "engine_of"]


class Engine(Protocol):
    """Something that computes blocks."""

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """Each block with its results, or with what a worker raised, in any order. Blocks are taken as needed.

        Beside them, with the block that it worked on, a :class:`~blurnoise_eval.sweep.flight.WorkerDied` for each
        worker that died: no answer yet.
        """


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
