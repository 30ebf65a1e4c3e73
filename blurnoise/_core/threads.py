"""Routes on the CPU: whether they apply, jobs on threads that are kept, and working memory that is kept.

New threads begin with memory of their own to fetch, and fresh pages cost more than the arithmetic done in them.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack
from functools import wraps
from typing import ParamSpec, TypeVar

import torch
from torch import Tensor

Job = TypeVar("Job")
P = ParamSpec("P")
R = TypeVar("R")
_AUTOCAST = ("cpu", "cuda", "mps", "xpu")
WORTH_IT = 1 << 18
"""Values of a picture from which threads are worth waking."""
_PIECE = 1 << 17  # values: they stay in a core's cache, and threads seldom wait for each other's Python
_pools: dict[int, ThreadPoolExecutor] = {}
_lock = threading.Lock()
_state = threading.local()


def _forget_pools() -> None:
    """Clear the pools in a forked process, which inherits them without their threads."""
    global _lock
    _lock = threading.Lock()
    _pools.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_pools)


def differentiable(*tensors: Tensor) -> bool:
    """Whether results computed from the tensors now carry gradients.

    >>> weight = torch.ones(1, requires_grad=True)
    >>> with torch.no_grad():
    ...     inside = differentiable(weight)
    >>> differentiable(weight), inside
    (True, False)
    """
    return torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)


def plain(*tensors: Tensor) -> bool:
    """Whether NumPy and OpenCV can process the tensors: on the CPU, without gradients.

    >>> plain(torch.ones(1)), plain(torch.ones(1, requires_grad=True))
    (True, False)
    """
    return tensors[0].device.type == "cpu" and not differentiable(*tensors)


def threads_for(picture: Tensor) -> int:
    """Number of threads: torch's, or one for work that is shorter than waking others.

    >>> threads_for(torch.zeros(8, 8))  # waking others takes longer
    1
    """
    return torch.get_num_threads() if picture.numel() >= WORTH_IT else 1


def no_torch_compile(function: Callable[P, R]) -> Callable[P, R]:
    """``function``, which ``torch.compile`` leaves alone: threads, seeds and plans are Python.

    >>> no_torch_compile(lambda light: light + 1)(torch.ones(1))
    tensor([2.])
    """

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        if torch.compiler.is_compiling():  # the compiler is slow to import, hence not before
            disabled: Callable[P, R] = torch.compiler.disable(function)  # type: ignore[no-untyped-call]
            return disabled(*args, **kwargs)
        return function(*args, **kwargs)

    return run


def same_bits(function: Callable[P, Tensor]) -> Callable[P, Tensor]:
    """``function``, whose bits depend neither on ``torch.compile``, nor on autocast, nor on gradients.

    ``torch.compile`` leaves it alone: threads, seeds and plans are Python. Where a result carries gradients, they are
    those of the differentiable route, which rounds elsewhere and also models what is negligible; the values are those
    of the route without gradients.

    >>> root = same_bits(torch.sqrt)
    >>> with_gradient = root(torch.tensor([2.0], requires_grad=True))
    >>> bool(with_gradient.requires_grad), bool((with_gradient == root(torch.tensor([2.0]))).all())
    (True, True)
    """

    @no_torch_compile
    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> Tensor:
        with ExitStack() as precise:
            for kind in filter(torch.is_autocast_enabled, _AUTOCAST):
                precise.enter_context(torch.autocast(kind, enabled=False))
            if not torch.is_grad_enabled() or getattr(_state, "differentiates", False):
                return function(*args, **kwargs)
            draws = _generator(kwargs)
            before = draws.get_state()
            _state.differentiates = True
            try:
                found = function(*args, **kwargs)
            finally:
                _state.differentiates = False
            if not found.requires_grad:
                return found
            after = draws.get_state()
            draws.set_state(before)
            with torch.no_grad():
                values = function(*args, **kwargs)
            draws.set_state(after)
            return values + (found - found.detach())

    return run


def _generator(arguments: Mapping[str, object]) -> torch.Generator:
    """The one that a call draws its seeds from, if any."""
    given = arguments.get("generator")
    return given if isinstance(given, torch.Generator) else torch.default_generator


def _mark_worker() -> None:
    _state.working = True


def side_by_side(work: Callable[[Job], object], jobs: Iterable[Job], threads: int) -> None:
    """``work(job)`` for every job, on up to ``threads`` threads; in turn within a job, or where one is enough.

    The first exception of a job is raised, after all have ended.

    >>> done = []
    >>> side_by_side(done.append, range(3), 2)
    >>> sorted(done)
    [0, 1, 2]
    """
    todo = list(jobs)
    # A job that waited for others of its own pool could wait for ever, so jobs start none.
    if threads <= 1 or len(todo) < 2 or getattr(_state, "working", False):
        for job in todo:
            work(job)
        return

    with _lock:
        if threads not in _pools:
            _pools[threads] = ThreadPoolExecutor(threads, initializer=_mark_worker)
        pool = _pools[threads]
    futures = [pool.submit(work, job) for job in todo]
    try:
        wait(futures)
    except BaseException:  # an interrupt
        for future in futures:
            future.cancel()
        raise
    for future in futures:
        future.result()


def in_pieces(work: Callable[[slice], object], values: int, threads: int) -> None:
    """``work(piece)`` for consecutive slices of ``values`` values, so that what it makes stays in the cache.

    >>> pieces = []
    >>> in_pieces(pieces.append, 300_000, threads=1)
    >>> [piece.stop - piece.start for piece in pieces]
    [131072, 131072, 131072]
    """
    pieces = [slice(start, start + _PIECE) for start in range(0, values, _PIECE)]
    side_by_side(work, pieces, threads if values >= WORTH_IT else 1)
