"""Latency: the CPU time that one picture takes a model, from the picture to its answer."""

from __future__ import annotations

import time
from itertools import cycle
from typing import Any

import numpy as np

from blurnoise_eval.datasets import Picture, PictureSet, sample
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.scoring.on_picture import Model, Picture8
from blurnoise_eval.system.threads import limited_threads

_PICTURES, _WARM_UP, _FEWEST, _MOST, _SECONDS = 8, 3, 10, 60, 3.0
BUSY = 1.25


def measure(model: Model, pictures: PictureSet) -> dict[str, Any]:
    """CPU time, ms, median and 95th percentile over a few pictures in turns, one at a time on one thread.

    CPU time, because the clock also counts what other programs do meanwhile; ``clock_ratio`` is the time by the clock
    over the CPU time, from ``BUSY`` on of a machine with other work. Includes what brings the picture into
    the network and its answer out: all that a caller waits for. Every picture is taken once before the measurement.
    Empty where no picture can be read, or the model fails on one.
    """
    prepared = [(image, _boxes(picture, image)) for picture, image in sample(pictures, _PICTURES)]
    if not prepared:
        return {}
    warm_up = max(_WARM_UP, len(prepared))
    cpu_ms: list[float] = []
    clock_ms: list[float] = []
    measured_from = 0.0
    try:
        with limited_threads(1):
            for count, (image, boxes) in enumerate(cycle(prepared), start=1 - warm_up):
                clock_s, cpu_s = time.perf_counter(), time.process_time()
                if isinstance(model, Detector):
                    model.detect(image)
                else:
                    model.read(image, boxes)
                if count < 1:
                    measured_from = time.perf_counter()
                    continue
                cpu_ms.append(1e3 * (time.process_time() - cpu_s))
                clock_ms.append(1e3 * (time.perf_counter() - clock_s))
                if count == _MOST or (count >= _FEWEST and time.perf_counter() - measured_from > _SECONDS):
                    break
    except ModelError:
        return {}
    median, p95 = np.percentile(cpu_ms, (50, 95))
    return {
        "median_ms": float(median),
        "p95_ms": float(p95),
        "clock_ratio": sum(clock_ms) / max(sum(cpu_ms), 1e-9),
        "threads": 1,
        "runs": len(cpu_ms),
        "pictures": len(prepared),
    }


def _boxes(picture: Picture, image: Picture8) -> list[tuple[float, float, float, float]]:
    whole = (0.0, 0.0, float(image.shape[1]), float(image.shape[0]))
    return [target.box_xyxy for target in picture.targets or () if target.text is not None] or [whole]
