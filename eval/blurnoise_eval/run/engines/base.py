"""Shared by all engines: answers, blocks in flight, the work of a worker process; and the engine of threads."""

from __future__ import annotations

import pickle
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice
from math import ceil
from typing import Protocol, Self, TypeVar

import cv2
import torch

from blurnoise_eval.datasets import UnreadablePicture
from blurnoise_eval.run.work import Block, Work, Worker
from blurnoise_eval.store.store import CellResult
from blurnoise_eval.system.machine import limited_threads

T = TypeVar("T")
Answers = Generator[tuple[Block, list[CellResult] | Exception], None, None]
BlockResult = tuple[list[CellResult], list[tuple[str, type[Warning]]]]
"""Results of a block, and the warnings that were given meanwhile."""

_PICTURES_HELD = 3  # by a worker process
_IN_FLIGHT = 2  # blocks for each thread: one that it works on, one that waits
_HELD_BESIDE = 2  # pictures, beside one for each thread: the next is prepared before the last one is done
_BLOCKS_READ = 8  # for each worker, before they are shared out
_BLOCKS_JOINED = 8  # at most: a worker that is killed loses the cells of one task

_worker: tuple[str, Worker] | None = None  # of this process: the key of the work that it has opened


class Engine(Protocol):
    """Something that computes blocks."""

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """Yield each block with its results, or with what a worker raised, in any order.

        Blocks are taken as needed, and may be joined with others of the same picture. For each worker that is seen
        to die a :class:`WorkerDied` is yielded with the block that it computed. Closing the generator ends the
        engine's work.
        """


class Staying(ABC):
    """An engine whose workers stay from one ``map`` to the next inside its context, else until a ``map`` ends."""

    _users = 0

    def __enter__(self) -> Self:
        self._users += 1
        return self

    def __exit__(self, *_: object) -> None:
        self._users -= 1
        if not self._users:
            self.stop()

    @abstractmethod
    def stop(self) -> None:
        """End all workers at once."""


class WorkerDied(Exception):
    """A worker died while it computed the block. No answer yet: the block comes again."""


def at_least_one(name: str, workers: int | None) -> None:
    """Raise ``ValueError`` for less than one worker."""
    if workers is not None and workers < 1:
        raise ValueError(f"{name} = {workers}: must be >= 1")


def given_up(block: Block) -> UnreadablePicture:
    """The answer for a picture on which two workers died, the second one with nothing else to do."""
    return UnreadablePicture(
        f"{block.picture.name}: the worker that computed it died, and so did the next one with nothing else to do "
        "(killed, out of memory, or a crash in native code)"
    )


def in_flight(
    submit: Callable[[Block], Future[T]], blocks: Iterator[Block], most: Callable[[], int]
) -> Iterator[tuple[Block, Future[T]]]:
    """Keep ``most`` blocks in flight. Yields those that are finished, of several in the order of their beginning."""
    flying: dict[Future[T], Block] = {}
    while True:
        while len(flying) < most() and (block := next(blocks, None)) is not None:
            flying[submit(block)] = block
        if not flying:
            return
        finished = wait(flying, return_when=FIRST_COMPLETED).done
        for future in [each for each in flying if each in finished]:
            yield flying.pop(future), future


def shared_out(blocks: Iterable[Block], workers: int) -> Iterator[Block]:
    """Join blocks of one picture, so that few workers prepare the same picture, which costs as much as a cell or two.

    A picture is split where it has many cells, or where there are fewer pictures than workers.
    """
    left = iter(blocks)
    while some := list(islice(left, _BLOCKS_READ * workers)):
        of_picture: dict[str, list[Block]] = {}
        for block in some:
            of_picture.setdefault(block.picture.name, []).append(block)
        for own in of_picture.values():
            size = min(ceil(len(own) * len(of_picture) / workers), _BLOCKS_JOINED)
            for start in range(0, len(own), size):
                yield Block.joined(own[start : start + size])


def pickled(value: Work | Block, dumps: Callable[[object], bytes] = pickle.dumps) -> bytes:
    """The value for another process, by ``dumps``. Raises ``ValueError`` that names what cannot be sent."""
    try:
        return dumps(value)
    except Exception as error:  # pickling runs anybody's code
        what = f"picture {value.picture.name!r}" if isinstance(value, Block) else "models"
        raise ValueError(
            f"engine: {what} cannot be sent to another process ({error}); use 'threads'"
        ) from None


def compute(key: str, opened: Callable[[], Work], block: bytes | None) -> BlockResult:
    """In a worker process: the results of a pickled block; None only opens the models.

    key: of the work, which ``opened`` gives where this process has not opened it yet.
    """
    global _worker
    results: list[CellResult] = []
    with warnings.catch_warnings(record=True) as caught:
        if _worker is None or _worker[0] != key:
            torch.set_num_threads(1)
            cv2.setNumThreads(1)
            _worker = None  # closes the models of the work before
            _worker = key, opened().open(_PICTURES_HELD)
        if block is not None:
            results = _worker[1].compute(pickle.loads(block))
    return results, [(str(each.message), each.category) for each in caught]


def results_of(block: BlockResult) -> list[CellResult]:
    """The results, once the warnings that came with them are given; Python gives each text once."""
    results, caught = block
    for text, category in caught:
        warnings.warn(text, category, stacklevel=2)
    return results


def raised(error: BaseException) -> Exception:
    """What a worker raised; an interrupt or an exit is raised here, too."""
    if not isinstance(error, Exception):
        raise error
    return error


def answer(future: Future[BlockResult]) -> list[CellResult] | Exception:
    """The results of a finished block, or what its worker raised."""
    error = future.exception()
    return results_of(future.result()) if error is None else raised(error)


@dataclass(frozen=True)
class ThreadEngine:
    """Threads of this process over each model's one session. Models and pictures need not pickle.

    PyTorch and OpenCV have one thread each meanwhile. Raises ``ValueError`` for less than one thread.
    """

    workers: int = 1

    def __post_init__(self) -> None:
        at_least_one("threads", self.workers)

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.run.engines.Engine`."""
        worker, most = work.open(self.workers + _HELD_BESIDE), _IN_FLIGHT * self.workers
        with limited_threads(1):
            pool = ThreadPoolExecutor(self.workers, initializer=torch.set_num_threads, initargs=(1,))

            def submit(block: Block) -> Future[BlockResult]:
                return pool.submit(lambda: (worker.compute(block), []))

            try:
                for block, future in in_flight(submit, iter(blocks), lambda: most):
                    yield block, answer(future)
            except BaseException:  # closed early, or an interrupt
                worker.interrupt()
                raise
            finally:
                pool.shutdown(cancel_futures=True)
