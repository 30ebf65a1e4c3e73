"""Adapters to MAITE's protocols for object detection: a data set, a model, and the exposure as an augmentation.

Domain: pictures (C, H, W), uint8, or float in [0, 1]; boxes x0, y0, x1, y1 in px; labels are indices into
``index2label``. The protocols are structural (MAITE 0.10), so that this module needs no package of theirs.

What MAITE's own evaluation sees through :class:`MaiteExposure` are the pictures of a sweep: the same camera, the same
light, and noise that depends on the seed and on the datum's id, not on batches or their order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise import Exposure, expose_numpy, labels_numpy
from blurnoise_eval.datasets import PictureSet, eight_bit
from blurnoise_eval.detectors.detector import MIN_SCORE, Detector
from blurnoise_eval.plan.conditions import cell_seed

Batch = tuple[Sequence[Any], Sequence[Any], Sequence[Mapping[str, Any]]]


@dataclass(frozen=True, eq=False)
class MaiteTarget:
    """Boxes (N, 4), labels (N,) and scores (N,) of one picture."""

    boxes: NDArray[np.float32]
    labels: NDArray[np.int64]
    scores: NDArray[np.float32]


class MaiteDataset:
    """A set of labelled pictures.

    index2label: names of the classes by number; by default the set's own, from 0 on. Give a model's, where a metric
    compares numbers. Targets of other classes are left out, as are crowds. Raises ``ValueError`` for pictures
    without labels.

    >>> from blurnoise_eval import datasets
    >>> signs = MaiteDataset(datasets.rendered_signs((80,), count=2))
    >>> picture, target, metadata = signs[0]
    >>> picture.shape, target.boxes.shape, signs.metadata["index2label"]
    ((3, 320, 320), (1, 4), {0: 'stop sign'})
    """

    def __init__(self, pictures: PictureSet, index2label: Mapping[int, str] | None = None) -> None:
        if unlabelled := [picture.name for picture in pictures if picture.targets is None]:
            raise ValueError(f"pictures: {unlabelled[0]!r} has no labels; MAITE's data sets need them")
        self.pictures = pictures
        self._classes = dict(index2label or enumerate(pictures.categories))
        self.metadata = {"id": str(pictures.source), "index2label": self._classes}

    def __len__(self) -> int:
        return len(self.pictures)

    def __getitem__(self, index: int) -> tuple[NDArray[np.uint8], MaiteTarget, dict[str, Any]]:
        if not 0 <= index < len(self):
            raise IndexError(f"index = {index}: must be from 0 to {len(self) - 1}")
        picture = self.pictures.pictures[index]
        numbers = {name: number for number, name in self._classes.items()}
        kept = [each for each in picture.targets or () if each.label in numbers and not each.crowd]
        target = MaiteTarget(
            np.array([each.box_xyxy for each in kept], np.float32).reshape(-1, 4),
            np.array([numbers[each.label] for each in kept], np.int64),
            np.ones(len(kept), np.float32),
        )
        return eight_bit(picture.load()).transpose(2, 0, 1), target, {"id": picture.name}


class MaiteModel:
    """A detector. min_score: of the detections that are returned.

    >>> from blurnoise_eval import STOP_SIGN, datasets
    >>> model = MaiteModel(Detector(STOP_SIGN))
    >>> picture, *_ = MaiteDataset(datasets.rendered_signs((80,), count=1))[0]
    >>> model.metadata["index2label"], bool(model([picture])[0].scores.max() > 0.5)
    ({0: 'stop sign'}, True)
    """

    def __init__(self, detector: Detector, *, min_score: float = MIN_SCORE) -> None:
        self.detector, self.min_score = detector, min_score
        self.metadata = {"id": detector.name, "index2label": dict(enumerate(detector.contract.classes))}

    def __call__(self, batch: Sequence[Any]) -> list[MaiteTarget]:
        """The detections in each picture of a batch. Raises ``TypeError`` or ``ValueError`` for other pictures."""
        found = [self.detector.detect(_bytes(picture), min_score=self.min_score) for picture in batch]
        return [MaiteTarget(each.boxes_xyxy, each.class_ids, each.scores) for each in found]


class MaiteExposure:
    """An exposure as an augmentation: each picture is taken by the camera, and boxes follow.

    exposure: the camera, time, light and motion; its seed and the datum's id give the noise. options: those of
    :func:`blurnoise.expose_numpy`.

    >>> from blurnoise import Camera
    >>> from blurnoise_eval import datasets
    >>> dusk = MaiteExposure(Exposure(Camera.preset("imx250c"), 0.01, 5.0))
    >>> data = MaiteDataset(datasets.rendered_signs((80,), count=2))
    >>> pictures, targets, metadata = dusk(tuple(zip(*(data[index] for index in range(2)))))
    >>> pictures[0].shape, bool(pictures[0].mean() < data[0][0].mean())
    ((3, 320, 320), True)
    """

    def __init__(self, exposure: Exposure, **options: Any) -> None:
        self.exposure, self.options = exposure, options
        at = f"{1000 * exposure.exposure_s:g} ms, {exposure.illuminance_lux:g} lux"
        self.metadata = {"id": f"blurnoise: {exposure.camera.name}, {at}, seed {exposure.seed}"}

    def __call__(self, batch: Batch) -> tuple[list[NDArray[Any]], list[Any], list[Mapping[str, Any]]]:
        """Pictures, targets and metadata of a batch, in its order; arrays of the pictures' own type."""
        pictures, targets, metadata = batch
        seen, moved = [], []
        for picture, target, about in zip(pictures, targets, metadata, strict=True):
            one = replace(self.exposure, seed=cell_seed(self.exposure.seed, str(about["id"]), 0))
            image = np.moveaxis(np.asarray(picture), 0, -1)
            seen.append(np.moveaxis(expose_numpy(image, one, **self.options), -1, 0))
            boxes = np.asarray(target.boxes, np.float64).reshape(-1, 4)
            after = labels_numpy(image.shape, one, boxes=boxes).boxes
            moved.append(
                MaiteTarget(
                    np.asarray(after, np.float32), np.asarray(target.labels), np.asarray(target.scores)
                )
            )
        return seen, moved, list(metadata)


def _bytes(picture: Any) -> NDArray[np.uint8]:
    """A picture (C, H, W) as (H, W, C), 8 bit."""
    image = np.moveaxis(np.asarray(picture), 0, -1)
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    if not np.issubdtype(image.dtype, np.floating) or not 0 <= image.min() <= image.max() <= 1:
        raise TypeError(
            f"picture: must be uint8 or float in [0, 1], got {image.dtype} from {image.min()} to {image.max()}"
        )
    return np.ascontiguousarray((255 * image).round().astype(np.uint8))
