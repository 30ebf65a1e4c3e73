"""Threads of this process: one session of each model, and pictures that need not travel."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import torch

from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.engines.base import Answers, at_least_one, in_flight, raised
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.threads import limited_threads

_IN_FLIGHT = 2  # blocks for each thread: one that it works on, one that waits
_PICTURES_HELD = 2  # beside one for each thread: the next is prepared before the last one is done


@dataclass(frozen=True)
class ThreadEngine:
    """Threads of this process over each model's one session. Models and pictures need not pickle.

    PyTorch and OpenCV have one thread each meanwhile. Raises ``ValueError`` for less than one thread.
    """

    threads: int = 1

    def __post_init__(self) -> None:
        at_least_one("threads", self.threads)

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.sweep.engines.Engine`."""
        worker = work.open(self.threads + _PICTURES_HELD)
        with limited_threads(1):
            pool = ThreadPoolExecutor(self.threads, initializer=torch.set_num_threads, initargs=(1,))
            try:
                most = _IN_FLIGHT * self.threads
                submitted = in_flight(
                    lambda block: pool.submit(worker.compute, block), iter(blocks), lambda: most
                )
                for block, future in submitted:
                    yield block, raised(future.exception()) or future.result()
            except BaseException:  # closed early, or an interrupt
                worker.interrupt()
                raise
            finally:
                pool.shutdown(cancel_futures=True)
