"""A worker process: what :class:`blurnoise_eval.sweep.engines.ProcessEngine` runs in each of its processes.

It ends with the process that began it, however that ended, and leaves interrupts to it.
"""

from __future__ import annotations

import pickle
import warnings
from functools import cache

import cv2
import torch

from blurnoise._core.orphans import end_with_parent
from blurnoise_eval.store.store import CellResult
from blurnoise_eval.sweep.work import Work, Worker

Told = tuple[list[CellResult], list[tuple[str, type[Warning]]]]  # results, and what was warned of meanwhile
_PICTURES_HELD = 3
_work = b""  # pickled; each process has its own


def begin(work: bytes) -> None:
    """Take the pickled ``work``. It is opened by the first block, so that what fails then is told as its error."""
    global _work
    _work = work
    end_with_parent()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)


def compute(block: bytes) -> Told:
    """The results of a pickled block. Raises what :meth:`Worker.compute` and opening the models raise."""
    with warnings.catch_warnings(record=True) as told:
        results = _worker().compute(pickle.loads(block))
    return results, [(str(each.message), each.category) for each in told]


@cache
def _worker() -> Worker:
    work: Work = pickle.loads(_work)
    return work.open(_PICTURES_HELD)
