"""Processes of this machine, each with sessions and prepared pictures of its own."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from blurnoise_eval.sweep import worker_process
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.crews import Crew, Hand, pickled
from blurnoise_eval.sweep.flight import Answers, fly_once
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.sweep.worker_process import Told

_NAME = "processes"


@dataclass(frozen=True)
class ProcessEngine:
    """Processes, each with sessions and prepared pictures of its own.

    Models and pictures must pickle: those of this package do. As everywhere where processes are spawned, a
    program that uses it keeps its own work under ``if __name__ == "__main__"``. Where a process dies, another takes
    its place, see :mod:`blurnoise_eval.sweep.flight`. Raises ``ValueError`` for less than one process and for what
    does not pickle, ``ChildProcessError`` where processes die before they have opened the models.
    """

    processes: int = 1

    def __post_init__(self) -> None:
        if self.processes < 1:
            raise ValueError(f"processes = {self.processes}: must be >= 1")

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.sweep.engines.Engine`."""
        return fly_once(self.crew(work), blocks)

    def crew(self, work: Work) -> Crew:
        """Processes for this work."""
        return _Processes(pickled(_NAME, "models", work), self.processes)


class _Processes(Crew):
    name = _NAME

    def __init__(self, work: bytes, size: int) -> None:
        super().__init__()
        self._work, self._size = work, size

    @property
    def size(self) -> int:
        return self._size

    def begin(self) -> Hand:
        return _Process(self._work)

    def is_death(self, error: BaseException) -> bool:
        return isinstance(error, BrokenProcessPool)


class _Process:
    """One process. A pool of its own: one that breaks is that process's death."""

    def __init__(self, work: bytes) -> None:
        spawn = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(1, spawn, worker_process.begin)
        self._pid = self._pool.submit(os.getpid)
        self.opened: Future[None] = self._pool.submit(worker_process.open_pickled, work)
        self._last: Future[Any] = self.opened

    def compute(self, block: Block) -> Future[Told]:
        data = pickled(_NAME, f"picture {block.picture.name!r}", block)
        try:
            self._last = told = self._pool.submit(worker_process.compute, data)
            return told
        except BrokenProcessPool as error:  # found out only now
            dead = Future[Told]()
            dead.set_exception(error)
            return dead

    def dismiss(self) -> None:
        if not self._last.done():  # nobody waits for it
            with suppress(Exception):  # it has died, or never began
                os.kill(self._pid.result(), signal.SIGTERM)
        self._pool.shutdown(wait=True, cancel_futures=True)
