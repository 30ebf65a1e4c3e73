"""This machine: its processor, the cores that may be used, its system."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

_PACKAGES = ("blurnoise", "torch", "kornia", "onnxruntime", "numpy", "opencv-contrib-python-headless")


def hardware() -> dict[str, Any]:
    """The machine in words: processor, usable cores, operating system, Python."""
    return {
        "processor": _processor(),
        "cores": usable_cores(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }


def versions() -> dict[str, str]:
    """Versions of the packages on which the bits of a result depend."""
    return {name: metadata.version(name) for name in _PACKAGES}


def usable_cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def is_out_of_memory(error: BaseException) -> bool:
    """Whether memory ran out: Python and NumPy raise ``MemoryError``, PyTorch a ``RuntimeError`` like any other."""
    return isinstance(error, MemoryError) or "can't allocate memory" in str(error)


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
