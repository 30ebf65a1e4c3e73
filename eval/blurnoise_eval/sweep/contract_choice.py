"""Contracts of a run's detectors, chosen or doubted by comparing how its first pictures may enter them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from blurnoise_eval.datasets import PictureSet, sample
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.sweep.contract_checks import MOST_PICTURES, Comparison, compared
from blurnoise_eval.sweep.input_variants import Known
from blurnoise_eval.system.terminal import say_wrapped


def contracts_chosen(
    models: Sequence[Model], pictures: PictureSet, *, say: bool | None = None
) -> tuple[list[Model], dict[str, Comparison]]:
    """The models with the contracts that the pictures chose, and by name the comparison of each detector.

    pictures: of the whole run, so that each part of it chooses alike; rendered ones choose nothing. say: whether to
    write what was chosen or doubted, and what it cost, to standard error.
    """
    found, comparisons = list(models), dict[str, Comparison]()
    for place, model in enumerate(models):
        if not isinstance(model, Detector) or pictures.kind == "rendered":
            continue
        comparison = compared(model, known(model, pictures))
        comparisons[model.name] = comparison
        found[place] = model.with_contract(comparison.contract)
        if say:
            lines = [f"doubtful contract: {doubt}" for doubt in comparison.doubts]
            if any(
                source.startswith(("chosen", "assumed")) for source in comparison.contract.sources.values()
            ):
                lines.insert(0, comparison.text)
            for line in filter(None, lines):
                say_wrapped(f"{model.name}: {line}", hanging=2, error=True)
    return found, comparisons


def known(detector: Detector, pictures: PictureSet) -> Iterator[Known]:
    """At most 32 of the pictures, with those of their labels that the detector knows."""
    ids = {name: number for number, name in enumerate(detector.contract.classes)}
    for picture, image in sample(pictures, MOST_PICTURES):
        told = [each for each in picture.targets or () if each.label in ids and not each.crowd]
        labels = Detections(
            np.array([each.box_xyxy for each in told], np.float32),
            np.ones(len(told), np.float32),
            np.array([ids[each.label] for each in told], np.int64),
        )
        yield image, labels if told else None
