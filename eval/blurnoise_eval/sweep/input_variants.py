"""Variants of a detector's input, and what is found again with each in pictures that are mirrored and cropped.

Domain: 8-bit RGB pictures; colour order, value range with mean and standard deviation, and resize are varied.

A network that is fed wrongly finds nothing, or much at random. So each picture is shown as it is and mirrored,
cropped and thereby enlarged, and what is found in both counts: the same class, boxes that overlap by half. Labels,
where there are any, are one more view of the picture. With A, the sum of scores times overlaps that agree, and F, the
sum of scores found, the merit of a variant in a picture is sqrt(max(0, A - F/10)). Variants are compared by the mean
difference of their merits over the pictures, with Student's t.

Measured with YOLOX-Nano and FastestDet behind ten inputs and 35 photographs: garbage that finds 4600 objects agrees
to 91, the right variant finds 374 and agrees to 155. Of 100 others the right one is surely better than 98 from 24
pictures on, 89 from 10, 60 from 4. Differences of AP50 are half as significant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from blurnoise_eval.detectors.contract import INPUT_VALUES, Contract, ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import FOUND_SCORE, MATCH_IOU, Targets
from blurnoise_eval.scoring.precision import precision

Image = NDArray[np.uint8]
Known = tuple[Image, Detections | None]
"""A picture and its labels, with scores of 1; None where it has none."""
FACTORS: dict[str, tuple[str, ...]] = {
    "colour": ("colour",),
    "values": ("value_range", "mean", "std"),
    "resize": ("resize",),
}
"""What is varied, to the fields of a contract."""
_AP_SCORE = 0.01  # answers from here on count for AP50
_VIEWS = (  # shares cut off (left, top, right, bottom), less than 0: added in grey; whether it is mirrored
    ((0.04, 0.08, 0.08, 0.04), True),
    ((-0.1, -0.04, -0.04, -0.08), False),
)
_ONE_VIEW_FROM = 4  # pictures; of fewer both views are compared
_SURE = 0.995  # one-sided level of Student's t
_FEWEST = 4  # pictures for Student's t to make a variant surely better
_FAR_RATIO, _FAR_LEAST = (
    3.0,
    2.0,
)  # so many times as much agreement, and at least so much, is sure in any number


@dataclass
class Variant:
    """A contract that is compared.

    agreed, found: sums of each picture shown so far. seen: what was found in the pictures as they are.
    """

    contract: Contract
    agreed: list[float] = field(default_factory=list)
    found: list[float] = field(default_factory=list)
    seen: list[Detections] = field(default_factory=list)
    given_up: bool = False

    @property
    def merits(self) -> NDArray[np.float64]:
        """Of each picture."""
        return np.sqrt(np.maximum(0.0, np.array(self.agreed) - 0.1 * np.array(self.found)))

    @property
    def merit(self) -> float:
        """The mean over the pictures; 0 of none."""
        return float(self.merits.mean()) if self.agreed else 0.0

    @property
    def counted(self) -> list[Detections]:
        """What was found in each picture with a score that counts."""
        return [each[each.scores >= FOUND_SCORE] for each in self.seen]

    def differs(self, other: Variant, factor: str) -> bool:
        """Whether the fields of one of ``FACTORS`` differ."""
        return any(getattr(self.contract, name) != getattr(other.contract, name) for name in FACTORS[factor])

    def show(self, detector: Detector, pictures: Sequence[Known]) -> int:
        """Show it those of the pictures that it has not seen; returns how many inferences that took."""
        views = _VIEWS[: 1 if len(pictures) >= _ONE_VIEW_FROM else None]
        new = pictures[len(self.agreed) :]
        for image, labels in new:
            self.seen.append(_found(detector, self.contract, image, _AP_SCORE))
            found = self.counted[-1]
            pairs = [
                (_seen_in(found, image, *view), _found(detector, self.contract, _view(image, *view)))
                for view in views
            ]
            if labels is not None:
                pairs.append((found[np.isin(found.class_ids, labels.class_ids)], labels))
            self.agreed.append(sum(agreement(*pair) for pair in pairs) / len(pairs))
            scores = sum(float(each.scores.sum()) for pair in pairs for each in pair)
            self.found.append(scores / 2 / len(pairs))
        return len(new) * (1 + len(views))

    def lead(self, other: Variant, level: float) -> float:
        """How much its mean merit is above the other's at least, by the pictures that both have seen."""
        count = min(len(self.agreed), len(other.agreed))
        more = self.merits[:count] - other.merits[:count]
        if not more.any():
            return 0.0
        if count < 2:
            return -np.inf
        return float(more.mean() - stdtrit(count - 1, level) * more.std(ddof=1) / np.sqrt(count))

    def surely_beats(self, other: Variant) -> bool:
        """Whether its merit is surely above the other's."""
        count = min(len(self.agreed), len(other.agreed))
        more, less = (float((each.merits[:count] ** 2).sum()) for each in (self, other))
        far = more >= max(_FAR_LEAST, _FAR_RATIO * less)
        return far or (count >= _FEWEST and self.lead(other, _SURE) > 0)

    def ap50(self, pictures: Sequence[Known]) -> NDArray[np.float64] | None:
        """AP50 in the labelled ones of the pictures that it was shown, then without each; None without any."""
        known = [
            (found, labels)
            for found, (_, labels) in zip(self.seen, pictures, strict=False)
            if labels is not None
        ]
        if not known:
            return None
        places = np.arange(len(known))
        sides = np.concatenate([labels.boxes_xyxy for _, labels in known]).astype(float)
        sides[:, 2:] -= sides[:, :2]
        targets = Targets(
            np.repeat(places, [len(labels) for _, labels in known]),
            sides,
            sides[:, 2:].prod(axis=1),
            np.zeros(len(sides), bool),
            np.concatenate([labels.class_ids for _, labels in known]),
            range(len(self.contract.classes)),
        )
        answers = Answers.of([(str(place), 0, found) for place, (found, _) in enumerate(known)])
        own = {place: place for place in targets.categories}
        return precision(answers, places, targets, own, len(known), ap50_only=True).precision[:, 0, 0]

    def __str__(self) -> str:
        return input_text(self.contract)


def input_text(contract: Contract) -> str:
    """How a picture enters: "rgb, 0-1, mean and std of ImageNet, letterbox"."""
    return f"{contract.colour}, {_values_text(contract)}, {contract.resize}"


def _values_text(contract: Contract) -> str:
    for name, (span, mean, std) in INPUT_VALUES.items():
        if (contract.value_range, contract.mean, contract.std) == (
            span,
            _in(contract.colour, mean),
            _in(contract.colour, std),
        ):
            return name
    parts = [
        f"{name} {list(value)}" for name, value in (("mean", contract.mean), ("std", contract.std)) if value
    ]
    return " ".join([contract.value_range, *parts])


def part_text(contract: Contract, factor: str) -> str:
    """What it states of one of ``FACTORS``."""
    return _values_text(contract) if factor == "values" else repr(getattr(contract, factor))


def other_inputs(detector: Detector) -> list[Contract]:
    """Contracts under which a picture enters otherwise, at the same size."""
    own = detector.contract
    found: list[Contract] = []
    for colour in ("rgb", "bgr"):
        if detector.takes_bytes:
            variants = [replace(own, colour=colour)]
        else:
            variants = [
                replace(own, colour=colour, value_range=span, mean=_in(colour, mean), std=_in(colour, std))
                for span, mean, std in INPUT_VALUES.values()
            ]
            if own.mean or own.std:  # those of its own, with the other order
                turned = colour != own.colour
                mean, std = (each and (each[::-1] if turned else each) for each in (own.mean, own.std))
                variants.append(replace(own, colour=colour, mean=mean, std=std))
        found += [each for each in variants if not any(_alike(each, other) for other in (own, *found))]
    return found


def resized(best: Variant, variants: Sequence[Variant]) -> list[Variant]:
    """The best variant with stretch instead of letterbox, or the reverse, unless it is compared already.

    Whether a letterbox is centred hardly matters: AP50 .410 and .407.
    """
    if best.contract.resize == "none":
        return []
    resize: Any = "letterbox" if best.contract.resize == "stretch" else "stretch"
    other = Variant(replace(best.contract, resize=resize))
    return [] if any(each.contract == other.contract for each in variants) else [other]


def _in(colour: str, values: tuple[float, ...] | None) -> Any:
    return values[::-1] if values and colour == "bgr" else values


def _alike(one: Contract, other: Contract) -> bool:
    """Whether a picture enters alike, to within a hundredth of its range."""
    if one.colour != other.colour:
        return False
    ends, others = (
        np.array(
            [
                (np.array([0.0, 1.0]) * (255 if each.value_range == "0-255" else 1) - mean) / std
                for mean, std in zip(each.mean or (0,) * 3, each.std or (1,) * 3, strict=True)
            ]
        )
        for each in (one, other)
    )
    return bool(np.allclose(ends, others, rtol=0.01, atol=0.01 * float(np.ptp(ends))))


def _found(
    detector: Detector, contract: Contract, image: Image, min_score: float = FOUND_SCORE
) -> Detections:
    """What is found with a contract; nothing where it makes the outputs impossible."""
    blob, placement = detector.prepare(image, contract=contract)
    outputs = detector.run(blob)
    try:
        if all(np.isfinite(output).all() for output in outputs):
            return detector.decode(outputs, placement, min_score=min_score).leading
    except ModelError:
        pass
    return Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0))  # type: ignore[arg-type]


def _edges(image: Image, shares: tuple[float, ...]) -> tuple[int, int, int, int]:
    """A view's left, top, right and bottom edge in the picture, px."""
    height, width = image.shape[:2]
    left, top, right, bottom = shares
    return round(left * width), round(top * height), round((1 - right) * width), round((1 - bottom) * height)


def _view(image: Image, shares: tuple[float, ...], mirrored: bool) -> Image:
    height, width = image.shape[:2]
    left, top, right, bottom = _edges(image, shares)
    added = (max(0, -top), max(0, bottom - height), max(0, -left), max(0, right - width))
    wide = cv2.copyMakeBorder(image, *added, cv2.BORDER_CONSTANT, value=(114,) * 3)
    seen = wide[max(0, top) :, max(0, left) :][: bottom - top, : right - left]
    return np.ascontiguousarray(seen[:, ::-1] if mirrored else seen)


def _seen_in(found: Detections, image: Image, shares: tuple[float, ...], mirrored: bool) -> Detections:
    """Of what was found in the picture that of which a view shows at least half, in the view's px."""
    left, top, right, bottom = _edges(image, shares)
    boxes = np.clip(found.boxes_xyxy, (left, top) * 2, (right, bottom) * 2)
    kept = 2 * _areas(boxes) >= _areas(found.boxes_xyxy)
    boxes = boxes - np.array((left, top) * 2, np.float32)
    if mirrored:
        boxes[:, [0, 2]] = right - left - boxes[:, [2, 0]]
    return Detections(boxes, found.scores, found.class_ids)[kept]


def _areas(boxes: NDArray[Any]) -> NDArray[Any]:
    return np.asarray((boxes[:, 2:] - boxes[:, :2]).prod(axis=1))


def agreement(one: Detections, other: Detections) -> float:
    """The sum over pairs of one class, the best first, of the lower score times the overlap, from a half on."""
    overlap = iou(one.boxes_xyxy, other.boxes_xyxy)
    overlap[(one.class_ids[:, None] != other.class_ids) | (overlap < MATCH_IOU)] = 0
    total = 0.0
    while overlap.size and overlap.max() > 0:
        row, column = np.unravel_index(overlap.argmax(), overlap.shape)
        total += float(min(one.scores[row], other.scores[column]) * overlap[row, column])
        overlap[row], overlap[:, column] = 0, 0
    return total
