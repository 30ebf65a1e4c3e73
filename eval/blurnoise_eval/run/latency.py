"""Latency of the models of a run: the CPU time that one picture takes a model, from the picture to its answer."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np

from blurnoise_eval.contracts.comparison import ContractComparison
from blurnoise_eval.datasets import Picture, PictureSet, sample
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.scoring.on_picture import Model, Picture8
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.machine import limited_threads

_PICTURES, _WARM_UP, _FEWEST, _MOST, _SECONDS = 8, 3, 10, 60, 3.0  # pictures, runs, seconds


def note_models(
    store: Store,
    models: Sequence[Model],
    pictures: PictureSet,
    comparisons: Mapping[str, ContractComparison],
    *,
    computed: int,
) -> None:
    """Add each model's latency to the run's manifest, once, and the doubts about its contract.

    computed: the number of cells that were computed now. Without any, a model that has a latency keeps its notes: a
    run that is only opened again measures nothing.
    """
    manifest = store.about("manifest")
    for model, about in zip(models, manifest["models"], strict=True):
        if not computed and "latency" in about:
            continue
        about["latency"] = about.get("latency") or latency(model, pictures)
        if model.name in comparisons:
            about["suspicions"] = list(comparisons[model.name].doubts)
    store.set_about("manifest", manifest)


def latency(model: Model, pictures: PictureSet) -> dict[str, Any]:
    """CPU time, ms, median and 95th percentile over a few pictures in turns, one at a time on one thread.

    Preparing the picture and decoding the outputs are included. Empty where no picture can be read, or the model
    fails on one.
    """
    prepared = [(image, _boxes(picture, image)) for picture, image in sample(pictures, _PICTURES)]
    if not prepared:
        return {}
    warm_up, times_s = max(_WARM_UP, len(prepared)), list[float]()
    try:
        with limited_threads(1):
            for count, (image, boxes) in enumerate(cycle(prepared), start=1 - warm_up):
                started_s = time.process_time()
                if isinstance(model, Detector):
                    model.detect(image)
                else:
                    model.read(image, boxes)
                times_s.append(time.process_time() - started_s)
                if count == _MOST or (count >= _FEWEST and sum(times_s[warm_up:]) > _SECONDS):
                    break
    except ModelError:
        return {}
    median_ms, p95_ms = 1e3 * np.percentile(times_s[warm_up:], (50, 95))
    return {
        "median_ms": float(median_ms),
        "p95_ms": float(p95_ms),
        "threads": 1,
        "runs": len(times_s) - warm_up,
        "pictures": len(prepared),
    }


def _boxes(picture: Picture, image: Picture8) -> list[tuple[float, float, float, float]]:
    whole = (0.0, 0.0, float(image.shape[1]), float(image.shape[0]))
    return [target.box_xyxy for target in picture.targets or () if target.text is not None] or [whole]
