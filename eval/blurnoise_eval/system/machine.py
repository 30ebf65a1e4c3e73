"""This machine: processor, usable cores, operating system, versions of packages, threads of PyTorch and OpenCV."""

from __future__ import annotations

import hashlib
import os
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from importlib.resources import files
from pathlib import Path
from typing import Any

_PACKAGES = ("blurnoise", "torch", "kornia", "onnxruntime", "numpy")


def hardware() -> dict[str, Any]:
    """Processor, usable cores, operating system, Python.

    >>> sorted(hardware())
    ['cores', 'processor', 'python', 'system']
    """
    info = Path("/proc/cpuinfo")
    named = re.search(r"^model name\s*:\s*(.+)$", info.read_text() if info.is_file() else "", re.MULTILINE)
    return {
        "processor": named[1].strip() if named else platform.processor() or platform.machine(),
        "cores": usable_cores(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def versions() -> dict[str, str]:
    """The versions of packages on which the bits of a result depend, and the hash of the :func:`sources`.

    >>> "torch" in versions()
    True
    """
    import cv2

    installed = {name: metadata.version(name) for name in _PACKAGES}
    return {**installed, "opencv": str(cv2.__version__), "sources": sources()}


@cache
def sources() -> str:
    """A hash of the Python files of simulator and harness: it distinguishes commits of the same version.

    >>> len(sources())  # letters of a hash
    12
    """
    digest = hashlib.blake2b(digest_size=6)
    for package in ("blurnoise", "blurnoise_eval"):
        folder = Path(str(files(package)))
        for file in sorted(folder.rglob("*.py")):
            # A checkout on Windows is the same software.
            text = file.read_bytes().replace(b"\r\n", b"\n")
            digest.update(f"{package} {file.relative_to(folder).as_posix()} {len(text)}\n".encode() + text)
    return digest.hexdigest()


def usable_cores() -> int:
    """The number of cores that this process may use.

    >>> usable_cores() >= 1
    True
    """
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """Limit PyTorch and OpenCV to ``count`` threads. Sessions of onnxruntime have threads of their own.

    >>> import torch
    >>> with limited_threads(1):
    ...     torch.get_num_threads()
    1
    """
    import cv2
    import torch

    before = torch.get_num_threads(), cv2.getNumThreads()
    torch.set_num_threads(count)
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before[0])
        cv2.setNumThreads(before[1])


def is_out_of_memory(error: BaseException) -> bool:
    """Whether memory ran out: Python and NumPy raise ``MemoryError``, PyTorch a plain ``RuntimeError``.

    >>> is_out_of_memory(MemoryError()), is_out_of_memory(RuntimeError("shapes differ"))
    (True, False)
    """
    return isinstance(error, MemoryError) or "can't allocate memory" in str(error)
