"""Threads of this process: one session of each model, and pictures that need not travel."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass

import torch

from blurnoise_eval.store.store import CellResult
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.engines.base import Answers
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.threads import limited_threads

_IN_FLIGHT = 2  # blocks for each thread: one that it works on, one that waits
_POLL_S = 0.2
_PICTURES_HELD = 2  # beside one for each thread: the next is prepared before the last one is done


@dataclass(frozen=True)
class ThreadEngine:
    """Threads of this process over each model's one session. Models and pictures need not pickle.

    PyTorch and OpenCV have one thread each meanwhile. Raises ``ValueError`` for less than one thread.
    """

    threads: int = 1

    def __post_init__(self) -> None:
        if self.threads < 1:
            raise ValueError(f"threads = {self.threads}: must be >= 1")

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.sweep.engines.Engine`."""
        worker = work.open(self.threads + _PICTURES_HELD)
        with limited_threads(1):
            pool = ThreadPoolExecutor(self.threads, initializer=torch.set_num_threads, initargs=(1,))
            flying: dict[Future[list[CellResult]], Block] = {}
            try:
                for block in blocks:
                    flying[pool.submit(worker.compute, block)] = block
                    while len(flying) >= _IN_FLIGHT * self.threads:
                        yield from _landed(flying)
                while flying:
                    yield from _landed(flying)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                while running := [each for each in flying if not each.done()]:  # closed early
                    worker.interrupt()
                    wait(running, _POLL_S)
                pool.shutdown(wait=True)


def _landed(
    flying: dict[Future[list[CellResult]], Block],
) -> Generator[tuple[Block, list[CellResult] | Exception], None, None]:
    """Blocks as they are finished; of those finished at a time, in the order of their beginning."""
    finished = wait(flying, return_when=FIRST_COMPLETED).done
    for future, block in [(future, block) for future, block in flying.items() if future in finished]:
        del flying[future]
        error = future.exception()
        if error is not None and not isinstance(error, Exception):  # an interrupt, an exit
            raise error
        yield block, error or future.result()
