"""Threads of PyTorch and OpenCV in this process: a number for a while, then what was set before.

onnxruntime has no such setting of the process: a session is opened with its own (one core each).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import torch


@contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """PyTorch and OpenCV with ``count`` threads inside, as before outside."""
    before = torch.get_num_threads(), cv2.getNumThreads()
    torch.set_num_threads(count)
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before[0])
        cv2.setNumThreads(before[1])
