"""Independent jobs side by side on threads that are kept: new threads start with memory of their own to fetch."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch
from torch import Tensor

Job = TypeVar("Job")
WORTH_IT = 1 << 18
"""Values of a picture from which threads are worth waking."""
_PIECE = 1 << 17  # values: they stay in a core's cache, and threads seldom wait for each other's Python
_pools: dict[int, ThreadPoolExecutor] = {}
_pools_lock = threading.Lock()
_state = threading.local()


def _forget_pools() -> None:
    """In a forked process, which has the pools, but not their threads."""
    global _pools_lock
    _pools_lock = threading.Lock()
    _pools.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_pools)


def differentiable(*tensors: Tensor) -> bool:
    """Whether what is made of them now carries gradients."""
    return torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)


def plain(*tensors: Tensor) -> bool:
    """Whether NumPy and OpenCV may compute with them: on the CPU, without gradients."""
    return tensors[0].device.type == "cpu" and not differentiable(*tensors)


def threads_for(picture: Tensor) -> int:
    """As many as torch has, or one where waking others takes longer than the work."""
    return torch.get_num_threads() if picture.numel() >= WORTH_IT else 1


def side_by_side(work: Callable[[Job], object], jobs: Iterable[Job], threads: int) -> None:
    """``work(job)`` for every job, on up to ``threads`` threads; in turn within a job, or where one is enough.

    The first exception of a job is raised, after all have ended.
    """
    todo = list(jobs)
    if threads <= 1 or len(todo) < 2 or getattr(_state, "working", False):
        for job in todo:
            work(job)
        return

    def marked(job: Job) -> None:
        _state.working = True
        work(job)

    with _pools_lock:
        if threads not in _pools:
            _pools[threads] = ThreadPoolExecutor(threads)
        pool = _pools[threads]
    futures = [pool.submit(marked, job) for job in todo]
    errors = [future.exception() for future in futures]
    for error in errors:
        if error is not None:
            raise error


def in_pieces(work: Callable[[slice], object], values: int, threads: int) -> None:
    """``work(piece)`` for consecutive slices of ``values`` values, so that what it makes stays in the cache."""
    starts = range(0, values, _PIECE)
    side_by_side(
        work, [slice(start, start + _PIECE) for start in starts], threads if values >= WORTH_IT else 1
    )
