"""Processes of this machine, each with sessions and prepared pictures of its own."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for_any

from blurnoise_eval.run.engines import base
from blurnoise_eval.run.engines.base import Answers, BlockResult, WorkerDied
from blurnoise_eval.run.work import Block, Work

_OPENINGS = 2  # pools that may break one after the other before a worker has opened the models


@dataclass
class ProcessEngine(base.Staying):
    """Processes, each with sessions and prepared pictures of its own.

    Models and pictures must pickle: those of this package do. A program that uses this engine keeps its own work
    under ``if __name__ == "__main__"``. Used as a context manager, the processes stay from one :meth:`map` to the
    next of the same work. Raises ``ChildProcessError`` where processes die before they have opened the models.

    When a process dies, all are replaced, and their blocks are computed again, one at a time. If one dies again, the
    picture of its block is given up.
    """

    workers: int = 1
    _pool: _Pool | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        base.at_least_one("processes", self.workers)

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.run.engines.Engine`."""
        pickled = base.pickled(work)
        with self:
            try:
                yield from self._computed(pickled, base.shared_out(blocks, self.workers))
            except BaseException:  # closed early, or an interrupt
                self.stop()
                raise

    def _computed(self, work: bytes, blocks: Iterator[Block]) -> Answers:
        given_up = dict[str, Exception]()
        suspects: list[Block] = []

        def submit(block: Block) -> Future[BlockResult]:
            if block.picture.name in given_up:
                return _failed(given_up[block.picture.name])
            return self._pool_of(work).submit(block)

        while True:
            flying = base.in_flight(submit, blocks, lambda: 0 if suspects else self.workers + 1)
            for block, future in flying:
                if isinstance(future.exception(), BrokenProcessPool):  # so fails all that is in flight
                    suspects.append(block)
                else:
                    yield block, base.answer(future)
            if not suspects:
                return
            self.stop()
            yield suspects[0], WorkerDied(suspects[0].picture.name)
            for block in suspects:
                future = submit(block)
                if isinstance(future.exception(), BrokenProcessPool):
                    self.stop()
                    yield block, WorkerDied(block.picture.name)
                    given_up[block.picture.name] = base.given_up(block)
                    future = submit(block)
                yield block, base.answer(future)
            suspects.clear()

    def _pool_of(self, work: bytes) -> _Pool:
        """Processes for this work, one of which has opened its models."""
        if self._pool is not None and self._pool.work == work:
            return self._pool
        for _ in range(_OPENINGS):
            self.stop()
            self._pool = _Pool(work, self.workers)
            opened = self._pool.submit(None)
            if not isinstance(opened.exception(), BrokenProcessPool):
                base.results_of(opened.result())
                return self._pool
        self.stop()
        raise ChildProcessError(
            f"engine = 'processes': {_OPENINGS} workers one after the other died before they had opened the models "
            "(killed, out of memory, or a program that has no if __name__ == '__main__':); finished work is kept"
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
        """Compute the block, or only open the models. Processes that begin leave interrupts to this one."""
        data = None if block is None else base.pickled(block)
        before = signal.pthread_sigmask(
            signal.SIG_BLOCK, [signal.SIGINT]
        )  # inherited, and never unblocked there
        try:
            return self._executor.submit(_compute, data)
        except BrokenProcessPool as error:  # a process has died that had nothing to do
            return _failed(error)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def stop(self) -> None:
        self._open_here.close()
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._held_by_workers.close()


def _failed(error: Exception) -> Future[BlockResult]:
    future = Future[BlockResult]()
    future.set_exception(error)
    return future


_work = b""  # of this process, if it is a worker


def _begin(until: Connection, work: bytes) -> None:
    """In a worker, first of all: end when the process that started it closes the pipe, or has ended."""
    global _work
    parent = multiprocessing.parent_process()

    def end() -> None:
        wait_for_any([until, *([] if parent is None else [parent.sentinel])])
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()
    _work = work


def _compute(block: bytes | None) -> BlockResult:
    return base.compute("", lambda: pickle.loads(_work), block)
