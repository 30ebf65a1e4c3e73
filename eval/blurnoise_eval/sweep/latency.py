"""How long one picture takes a model: picture in, answer out, nothing else running."""

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


def measure(model: Model, pictures: PictureSet) -> dict[str, Any]:
    """Median and 95th percentile, ms, over a few pictures in turns, one at a time on one thread.

    Includes what brings the picture into the network and its answer out: all that a caller waits for.
    Empty where no picture can be read, or the model fails on one.
    """
    prepared = [(image, _boxes(picture, image)) for picture, image in sample(pictures, _PICTURES)]
    if not prepared:
        return {}
    times: list[float] = []
    started = time.perf_counter()
    try:
        with limited_threads(1):
            for image, boxes in cycle(prepared):
                begun = time.perf_counter()
                if isinstance(model, Detector):
                    model.detect(image)
                else:
                    model.read(image, boxes)
                times.append(1e3 * (time.perf_counter() - begun))
                enough = time.perf_counter() - started > _SECONDS and len(times) >= _WARM_UP + _FEWEST
                if enough or len(times) == _WARM_UP + _MOST:
                    break
    except ModelError:
        return {}
    median, p95 = np.percentile(times[_WARM_UP:], (50, 95))
    return {
        "median_ms": float(median),
        "p95_ms": float(p95),
        "threads": 1,
        "runs": len(times) - _WARM_UP,
        "pictures": len(prepared),
    }


def _boxes(picture: Picture, image: Picture8) -> list[tuple[float, float, float, float]]:
    whole = (0.0, 0.0, float(image.shape[1]), float(image.shape[0]))
    return [target.box_xyxy for target in picture.targets or () if target.text is not None] or [whole]
