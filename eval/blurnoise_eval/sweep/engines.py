"""Engines: who computes a sweep's blocks. The rows are the same whatever the engine, its workers or their order.

Few blocks are in flight at a time, so that a sweep of any length takes the same memory. Closing what ``map``
returns ends the engine: blocks begun are finished, no other is begun, nobody is left behind.
"""

from __future__ import annotations

import multiprocessing
import pickle
import warnings
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Protocol, TypeVar

import torch

from blurnoise._core.checks import one_of
from blurnoise._core.orphans import interrupts_held
from blurnoise_eval.store.store import CellResult
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.sweep.worker_process import Told, begin, compute
from blurnoise_eval.system.threads import limited_threads

Answers = Generator[tuple[Block, list[CellResult] | Exception], None, None]
_IN_FLIGHT = 2  # blocks for each worker: one that it works on, one that waits
_PICTURES_HELD = 2  # beside one for each thread: the next is prepared before the last one is done

T = TypeVar("T")


class Engine(Protocol):
    """Something that computes blocks."""

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """Each block with its results, or with what a worker raised, in any order. Blocks are taken as needed."""


@dataclass(frozen=True)
class ThreadEngine:
    """Threads of this process over each model's one session. Models and pictures need not pickle.

    PyTorch and OpenCV have one thread each meanwhile. Raises ``ValueError`` for less than one thread.
    """

    threads: int = 1

    def __post_init__(self) -> None:
        _at_least_one("threads", self.threads)

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`Engine`."""
        worker = work.open(self.threads + _PICTURES_HELD)
        with limited_threads(1):
            pool = ThreadPoolExecutor(self.threads, initializer=torch.set_num_threads, initargs=(1,))
            try:
                begun = _fly(lambda block: pool.submit(worker.compute, block), blocks, self.threads)
                for block, future in begun:
                    error = _error(future)
                    yield block, error or future.result()
            finally:
                pool.shutdown(wait=True, cancel_futures=True)


@dataclass(frozen=True)
class ProcessEngine:
    """Processes, each with sessions and prepared pictures of its own.

    Models and pictures must pickle: those of this package do. As everywhere where processes are spawned, a
    program that uses it keeps its own work under ``if __name__ == "__main__"``. Raises ``ValueError`` for less
    than one process and for what does not pickle, ``ChildProcessError`` that names the picture on which a
    process died.
    """

    processes: int = 1

    def __post_init__(self) -> None:
        _at_least_one("processes", self.processes)

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`Engine`. What workers warn of is warned of here, each text once."""
        sent, told = _pickled("models", work), set[str]()
        with ExitStack() as stack:
            # A pool for each process: the first block of a pool that breaks is the one on which it died.
            spawn = multiprocessing.get_context("spawn")
            pools = [ProcessPoolExecutor(1, spawn, begin, (sent,)) for _ in range(self.processes)]
            for pool in pools:
                stack.callback(pool.shutdown, wait=True, cancel_futures=True)
            for block, future in _fly(_Shared(pools).submit, blocks, self.processes):
                error = _error(future)
                if isinstance(error, BrokenProcessPool):
                    raise ChildProcessError(
                        f"engine = 'processes': the process that worked on picture {block.picture.name!r} died "
                        "(killed, or out of memory); what was finished is kept"
                    )
                if error:
                    yield block, error
                    continue
                results, warned = future.result()
                for text, category in warned:
                    if text not in told:
                        told.add(text)
                        warnings.warn(text, category, stacklevel=2)
                yield block, results


ENGINES: dict[str, Callable[[int], Engine]] = {"threads": ThreadEngine, "processes": ProcessEngine}


def engine_of(name: str, workers: int) -> Engine:
    """The engine of that name. Raises ``ValueError`` for another name, or for less than one worker."""
    one_of("engine", name, ENGINES)
    return ENGINES[name](workers)


class _Shared:
    """Hands blocks to the pools, each to the one with the least to do."""

    def __init__(self, pools: list[ProcessPoolExecutor]) -> None:
        self._flying: dict[ProcessPoolExecutor, list[Future[Told]]] = {pool: [] for pool in pools}

    def submit(self, block: Block) -> Future[Told]:
        for pool, flying in self._flying.items():
            self._flying[pool] = [future for future in flying if not future.done()]
        pool, flying = min(self._flying.items(), key=lambda item: len(item[1]))
        data = _pickled(f"picture {block.picture.name!r}", block)
        try:
            with interrupts_held():
                future = pool.submit(compute, data)
        except BrokenProcessPool as error:  # found out only now; blocks handed in before will tell first
            future = Future()
            future.set_exception(error)
        flying.append(future)
        return future


def _fly(
    submit: Callable[[Block], Future[T]], blocks: Iterable[Block], workers: int
) -> Generator[tuple[Block, Future[T]], None, None]:
    """Blocks as they are finished; of those finished at a time, in the order of their beginning."""
    flying: dict[Future[T], Block] = {}

    def landed() -> list[tuple[Block, Future[T]]]:
        finished = wait(flying, return_when=FIRST_COMPLETED).done
        return [(flying.pop(future), future) for future in list(flying) if future in finished]

    for block in blocks:
        flying[submit(block)] = block
        while len(flying) >= _IN_FLIGHT * workers:
            yield from landed()
    while flying:
        yield from landed()


def _error(future: Future[T]) -> Exception | None:
    """What the worker raised; an interrupt or an exit is raised here."""
    error = future.exception()
    if error is None or isinstance(error, Exception):
        return error
    raise error


def _pickled(what: str, value: object) -> bytes:
    try:
        return pickle.dumps(value)
    except Exception as error:  # all sorts
        raise ValueError(
            f"engine = 'processes': {what} cannot be sent to another process ({error}); use 'threads'"
        ) from None


def _at_least_one(name: str, workers: int) -> None:
    if workers < 1:
        raise ValueError(f"{name} = {workers}: must be >= 1")
