"""Engines: who computes a sweep's blocks. The rows are the same whatever the engine, its workers or their order.

Few blocks are in flight at a time, so that a sweep of any length takes the same memory. Closing what ``map``
returns ends the engine: no other block is begun, nobody is left behind.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from blurnoise._core.checks import one_of
from blurnoise_eval.run.engines.base import Answers, Engine, Staying, ThreadEngine, WorkerDied
from blurnoise_eval.run.engines.processes import ProcessEngine
from blurnoise_eval.run.engines.ray_tasks import RayEngine
from blurnoise_eval.system.machine import usable_cores

__all__ = ["ENGINES", "Answers", "Engine", "ProcessEngine", "RayEngine", "ThreadEngine", "WorkerDied"]
__all__ += ["engine_facts", "engine_of", "staying"]

ENGINES: dict[str, Callable[[int], Engine]] = {
    "threads": ThreadEngine,
    "processes": ProcessEngine,
    "ray": RayEngine,
}


def staying(engine: Engine) -> AbstractContextManager[Engine]:
    """The engine; its workers, if they are processes, stay from one ``map`` to the next of the same work."""
    return engine if isinstance(engine, Staying) else nullcontext(engine)


def engine_of(name: str, workers: int | None = None, address: str | None = None) -> Engine:
    """The engine of that name, by default with a worker per core of this machine, or of the cluster at ``address``.

    Raises ``ValueError`` for another name, for less than one worker, and for an address with another engine.
    """
    one_of("engine", name, ENGINES)
    if address is None:
        return ENGINES[name](usable_cores() if workers is None else workers)
    if name != "ray":
        raise ValueError(f"address = {address!r}: needs engine 'ray', not {name!r}")
    return RayEngine(workers, address)


def engine_facts(engine: Engine) -> dict[str, Any]:
    """What a run notes of who computed it."""
    name = next((name for name, kind in ENGINES.items() if kind is type(engine)), None)
    workers: int | None = getattr(engine, "workers", None)
    return {"engine": repr(engine)} if None in (name, workers) else {"engine": name, "threads": workers}
