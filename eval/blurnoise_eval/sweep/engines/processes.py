"""Processes of this machine, each with sessions and prepared pictures of its own."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for_any
from typing import Self, cast

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
    under ``if __name__ == "__main__"``, as for everything that starts processes. Used as a context manager, the
    processes stay from one :meth:`map` to the next of the same work. Raises ``ValueError`` for less than one process
    and for what does not pickle, ``ChildProcessError`` where processes die before they have opened the models.

    When a process dies, all are replaced, and what they were computing is computed again, one block at a time. If a
    process dies again, on one block alone, the block's picture is given up.
    """

    processes: int = 1
    _pool: _Pool | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.processes < 1:
            raise ValueError(f"processes = {self.processes}: must be >= 1")

    def __enter__(self) -> Self:
        check_not_a_worker()
        return super().__enter__()

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.sweep.engines.Engine`."""
        pickled = base.pickled(_NAME, "models", lambda: pickle.dumps(work))
        with self:
            yield from self._computed(pickled, base.shared_out(blocks, self.processes))

    def _computed(self, work: bytes, blocks: Iterator[Block]) -> Answers:
        warned, flying = base.Warnings(), dict[Future[BlockResult], Block]()
        suspects, lost = deque[Block](), dict[str, Exception]()
        try:
            while True:
                alone = bool(suspects)
                while len(flying) < (1 if alone else self.processes + 1):  # one more waits
                    block = suspects.popleft() if alone else next(blocks, None)
                    if block is None:
                        break
                    if block.picture.name in lost:
                        yield block, lost[block.picture.name]
                        alone = bool(suspects)
                        continue
                    flying[self._of(work, warned).submit(block)] = block
                if not flying:
                    return
                done = wait(flying, return_when=FIRST_COMPLETED).done
                if any(isinstance(future.exception(), BrokenProcessPool) for future in done):
                    done = wait(flying).done  # all that is in flight has failed
                for future, block in [(each, flying[each]) for each in flying if each in done]:
                    del flying[future]
                    error = future.exception()
                    if not isinstance(error, BrokenProcessPool):
                        yield block, _raised(error) or warned.results(future.result())
                        continue
                    if self._pool is not None:
                        self.stop()
                        yield block, WorkerDied(block.picture.name)
                    if alone:
                        lost[block.picture.name] = base.given_up(block.picture.name)
                    suspects.append(block)
        finally:
            if flying:
                self.stop()

    def _of(self, work: bytes, warned: base.Warnings) -> _Pool:
        """Processes for this work, one of which has opened its models."""
        if self._pool is not None and self._pool.work == work:
            return self._pool
        self.stop()
        for _ in range(_OPENINGS):
            self._pool = _Pool(work, self.processes)
            try:
                warned.results(self._pool.submit(None).result())
            except BrokenProcessPool:
                self.stop()
            else:
                return self._pool
        raise ChildProcessError(
            f"engine = {_NAME!r}: {_OPENINGS} workers one after the other died before they had opened the models "
            "(killed, or out of memory, or the program that was started has no if __name__ == '__main__':); what was "
            "finished is kept"
        )

    def stop(self) -> None:
        """End all processes at once, whatever they are computing."""
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
        data = None if block is None else base.pickled_block(_NAME, block)
        try:
            with _interrupts_held():  # a process that begins now would get them, too
                return self._executor.submit(_compute, data)
        except BrokenProcessPool as error:  # a process has died that had nothing to do
            failed = Future[BlockResult]()
            failed.set_exception(error)
            return failed

    def stop(self) -> None:
        self._open_here.close()
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._held_by_workers.close()


def _raised(error: BaseException | None) -> Exception | None:
    if error is not None and not isinstance(error, Exception):  # an interrupt, an exit
        raise error
    return error


def check_not_a_worker() -> None:
    """End this process quietly if it is a worker that is still importing the program that started it.

    That is so where the program has no ``if __name__ == "__main__"``. The error is raised where it was started.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)


_key, _work = "", b""  # of this process, if it is a worker


def _begin(until: Connection, work: bytes) -> None:
    """In a worker, first of all: leave interrupts to the process that started it, and end when that has ended."""
    global _key, _work
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    parent = multiprocessing.parent_process()

    def end() -> None:
        wait_for_any(
            [until, *([] if parent is None else [parent.sentinel])]
        )  # nothing is sent: the pipe is closed
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()
    _key, _work = hashlib.sha256(work).hexdigest(), work


def _compute(block: bytes | None) -> BlockResult:
    return base.compute(_key, lambda: cast(Work, pickle.loads(_work)), block)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Defer interrupts until the context ends; processes started inside get none before they allow them."""
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield  # Windows, or a thread that no interrupt reaches
        return
    resource_tracker.ensure_running()  # of multiprocessing: begun inside, it would lift the mask below
    came: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))  # other threads may take it
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # what processes begun here inherit
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)
