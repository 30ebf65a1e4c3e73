"""Processes of this machine, each with sessions and prepared pictures of its own."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for_any
from typing import cast

from blurnoise_eval.store.store import CellResult
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.engines import base
from blurnoise_eval.sweep.engines.base import Answers, BlockResult, WorkerDied
from blurnoise_eval.sweep.work import Work

_NAME = "processes"
_OPENINGS = 2  # workers that may die one after the other before one has opened the models


@dataclass
class ProcessEngine(base.Staying):
    """Processes, each with sessions and prepared pictures of its own.

    Models and pictures must pickle: those of this package do. A program that uses this engine keeps its own work
    under ``if __name__ == "__main__"``. Used as a context manager, the processes stay from one :meth:`map` to the
    next of the same work. Raises ``ChildProcessError`` where processes die before they have opened the models.

    When a process dies, all are replaced, and their blocks are computed again, one at a time. If one dies again, the
    picture of its block is given up.
    """

    processes: int = 1
    _pool: _Pool | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        base.at_least_one("processes", self.processes)

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.sweep.engines.Engine`."""
        pickled = base.pickled(_NAME, work)
        with self:
            try:
                yield from self._computed(pickled, base.shared_out(blocks, self.processes))
            except BaseException:  # closed early, or an interrupt
                self.stop()
                raise

    def _computed(self, work: bytes, blocks: Iterator[Block]) -> Answers:
        lost = dict[str, Exception]()

        def submit(block: Block) -> Future[BlockResult]:
            if block.picture.name in lost:
                return _failed(lost[block.picture.name])
            return self._of(work).submit(block)

        def answer(future: Future[BlockResult]) -> list[CellResult] | Exception:
            return base.raised(future.exception()) or base.results_of(future.result())

        suspects: list[Block] = []
        while True:
            flying = base.in_flight(submit, blocks, lambda: 0 if suspects else self.processes + 1)
            for block, future in flying:
                if isinstance(future.exception(), BrokenProcessPool):  # so fails all that is in flight
                    suspects.append(block)
                else:
                    yield block, answer(future)
            if not suspects:
                return
            self.stop()
            yield suspects[0], WorkerDied(suspects[0].picture.name)
            for block in suspects:
                name, future = block.picture.name, submit(block)
                if isinstance(future.exception(), BrokenProcessPool):
                    self.stop()
                    lost[name] = base.given_up(name)
                    yield block, WorkerDied(name)
                    yield block, lost[name]
                else:
                    yield block, answer(future)
            suspects.clear()

    def _of(self, work: bytes) -> _Pool:
        """Processes for this work, one of which has opened its models."""
        if self._pool is not None and self._pool.work == work:
            return self._pool
        for _ in range(_OPENINGS):
            self.stop()
            self._pool = _Pool(work, self.processes)
            try:
                base.results_of(self._pool.submit(None).result())
            except BrokenProcessPool:
                continue
            return self._pool
        self.stop()
        raise ChildProcessError(
            f"engine = {_NAME!r}: {_OPENINGS} workers one after the other died before they had opened the models "
            "(killed, out of memory, or a program that has no if __name__ == '__main__':); what was finished is kept"
        )

    def stop(self) -> None:
        """End all processes at once."""
        if self._pool is not None:
            pool, self._pool = self._pool, None
            pool.stop()


class _Pool:
    """An executor whose processes end as soon as it is stopped, or this process has ended."""

    def __init__(self, work: bytes, processes: int) -> None:
        self.work = work
        spawn = multiprocessing.get_context("spawn")
        self._held_by_workers, self._open_here = spawn.Pipe(duplex=False)
        self._executor = ProcessPoolExecutor(processes, spawn, _begin, (self._held_by_workers, work))

    def submit(self, block: Block | None) -> Future[BlockResult]:
        """Compute the block, or only open the models."""
        data = None if block is None else base.pickled(_NAME, block)
        try:
            with _interrupts_ignored():
                return self._executor.submit(_compute, data)
        except BrokenProcessPool as error:  # a process has died that had nothing to do
            return _failed(error)

    def stop(self) -> None:
        self._open_here.close()
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._held_by_workers.close()


def _failed(error: Exception) -> Future[BlockResult]:
    future = Future[BlockResult]()
    future.set_exception(error)
    return future


_key, _work = "", b""  # of this process, if it is a worker


def _begin(until: Connection, work: bytes) -> None:
    """In a worker, first of all: end when the process that started it closes the pipe, or has ended."""
    global _key, _work
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def end() -> None:
        wait_for_any([until, *([] if parent is None else [parent.sentinel])])
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()
    _key, _work = hashlib.sha256(work).hexdigest(), work


def _compute(block: bytes | None) -> BlockResult:
    return base.compute(_key, lambda: cast(Work, pickle.loads(_work)), block)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Processes that are started inside leave interrupts to this one, from their first moment on."""
    if threading.current_thread() is not threading.main_thread():  # which alone may say so
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
