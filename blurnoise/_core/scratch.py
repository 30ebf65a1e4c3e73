"""Working memory that is kept: fresh pages cost more than the arithmetic done in them, threads or not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_KEEP_BYTES = 1 << 26
_free: list[NDArray[np.uint8]] = []


@contextmanager
def borrowed(shapes: Sequence[tuple[int, ...]], dtype: DTypeLike) -> Iterator[list[NDArray[Any]]]:
    """Arrays of ``shapes`` with arbitrary contents, to be used within the context only. Safe among threads."""
    kind = np.dtype(dtype)
    sizes = [math.prod(shape) * kind.itemsize for shape in shapes]
    taken = [_take(size) for size in sizes]
    try:
        yield [
            memory[:size].view(kind).reshape(shape)
            for memory, size, shape in zip(taken, sizes, shapes, strict=True)
        ]
    finally:
        for memory in taken:
            _give_back(memory)


def _take(size: int) -> NDArray[np.uint8]:
    for _ in range(len(_free)):
        try:
            memory = _free.pop()
        except IndexError:  # another thread took it
            break
        if size <= memory.size <= 4 * size + 4096:
            return memory
        _free.insert(0, memory)
    return np.empty(size, np.uint8)


def _give_back(memory: NDArray[np.uint8]) -> None:
    _free.append(memory)
    while sum(kept.size for kept in list(_free)) > _KEEP_BYTES:
        try:
            _free.pop(0)
        except IndexError:
            break
