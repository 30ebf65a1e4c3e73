"""Wall time of calls, by turns; and the machine that it was measured on."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Hashable, Mapping
from importlib.metadata import version
from typing import Any, TypeVar

import numpy as np

from blurnoise_eval.system.machine import hardware

K = TypeVar("K", bound=Hashable)
_LIBRARIES = ("blurnoise", "torch", "kornia", "numpy", "opencv-contrib-python-headless")


def in_turns_ms(
    calls: Mapping[K, Callable[[], object]],
    *,
    fewest: int,
    most: int,
    seconds: float,
    progress: Callable[[float], object],
) -> dict[K, list[float]]:
    """Times of each call, ms, taken in turns, so that a change of the machine's load meets all alike.

    A call is repeated as often as fits into ``seconds``, from ``fewest`` to ``most`` times, spread evenly over
    the turns, after one that does not count. ``progress`` is told each turn's share of the number of calls.
    """
    counts = {
        name: int(np.clip(1e3 * seconds / _time_ms(call), fewest, most)) for name, call in calls.items()
    }
    times: dict[K, list[float]] = {name: [] for name in calls}
    for turn in range(1, most + 1):
        for name, call in calls.items():
            if turn * counts[name] // most > len(times[name]):
                times[name].append(_time_ms(call))
        progress(len(calls) / most)
    return times


def machine(threads: int) -> dict[str, Any]:
    """The machine in words, how busy it was, the threads used, and the versions of what is measured."""
    return {
        **hardware(),
        "threads": threads,
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "versions": {name: version(name) for name in _LIBRARIES},
    }


def _time_ms(call: Callable[[], object]) -> float:
    started = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - started)
