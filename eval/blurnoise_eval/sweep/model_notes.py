"""What a run notes of its models once it is computed: latency, limits baked into a graph, doubts of a contract."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

from blurnoise_eval.datasets import PictureSet, sample
from blurnoise_eval.detectors.baked import baked
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import latency
from blurnoise_eval.sweep.contract_checks import Comparison

_BAKED_PICTURES = 8  # by which limits baked into a graph are measured


def note_models(
    store: Store,
    models: Sequence[Model],
    pictures: PictureSet,
    comparisons: Mapping[str, Comparison],
    *,
    computed: int,
) -> None:
    """Add to the run's manifest each model's latency, once, its limits, and what comparing its contract told.

    computed: cells, now; where there are none, a model of which these are noted keeps its notes.
    """
    manifest = store.about("manifest")
    for model, about in zip(models, manifest["models"], strict=True):
        if not computed and "latency" in about:
            continue
        if not about.get("latency"):
            about["latency"] = measured = latency.measure(model, pictures)
            if measured.get("clock_ratio", 1.0) > latency.BUSY:
                warnings.warn(
                    f"{model.name}: the machine was busy while latency was measured, {measured['clock_ratio']:.1f} "
                    "times as long by the clock as in CPU time, which is reported",
                    RuntimeWarning,
                    stacklevel=2,
                )
        if isinstance(model, Detector):
            some = [image for _, image in sample(pictures, _BAKED_PICTURES)]
            if model.name in comparisons:
                about["suspicions"] = list(comparisons[model.name].doubts)
                about["contract_comparison"] = comparisons[model.name].row()
            about["baked"] = baked(model, some)
    store.set_about("manifest", manifest)
