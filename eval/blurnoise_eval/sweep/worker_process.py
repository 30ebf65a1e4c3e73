"""A worker process: what an engine runs in each of its processes, on this machine or another.

It opens the work that it is sent, then computes blocks one after the other.
"""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Callable

import cv2
import torch

from blurnoise._core.worker_lifetime import end_with_parent
from blurnoise_eval.store.store import CellResult
from blurnoise_eval.sweep.work import Work, Worker

Told = tuple[list[CellResult], list[tuple[str, type[Warning]]]]  # results, and what was warned of meanwhile
_PICTURES_HELD = 3
_worker: Worker | None = None  # each process has its own
_warned: list[tuple[str, type[Warning]]] = []  # on opening; told with the first block


def begin() -> None:
    """In a process spawned here, first of all: it ends with the one that began it, and leaves interrupts to it."""
    end_with_parent()


def open_pickled(work: bytes) -> None:
    """Take the pickled work, and open its models. Raises what that raises."""
    open_work(lambda: pickle.loads(work))


def open_work(received: Callable[[], Work]) -> None:
    """Take the work, whose models are opened as it is received, for :func:`compute`."""
    global _worker
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    with warnings.catch_warnings(record=True) as told:
        _worker = received().open(_PICTURES_HELD)
    _warned.extend((str(each.message), each.category) for each in told)


def compute(block: bytes) -> Told:
    """The results of a pickled block. Raises what :meth:`Worker.compute` raises."""
    if _worker is None:
        raise RuntimeError("a block came before the work")
    with warnings.catch_warnings(record=True) as told:
        results = _worker.compute(pickle.loads(block))
    warned = [*_warned, *((str(each.message), each.category) for each in told)]
    _warned.clear()
    return results, warned
