"""Comparison of the ways in which a picture may enter a detector: which one its answers support.

Domain: 8-bit RGB pictures; colour order, value range with mean and standard deviation, and resize are varied.

A network that is fed wrongly finds nothing, or much at random. So each picture is shown twice, as it is and mirrored,
cropped and thereby enlarged, and what counts is what is found in both: the same class, boxes that overlap by half.
Of a way's answers let A be the sum of scores and overlaps that agree and F the sum of scores found; its agreement is
A²/F, the share that agrees times how much. Labels, where there are any, are one more view of the picture.

Measured with YOLOX-Nano and FastestDet behind five to six kinds of preprocessing, 35 photographs: garbage that finds
5000 objects agrees to 16, the right way finds 380 and agrees to 77; red and blue swapped, it agrees to three quarters
of that. Centred and top-left letterboxes cannot be told apart, nor need they be (AP50 .410 and .407).
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import EXPORTER, INPUT_VALUES, Contract, ModelError
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Detections

MOST_PICTURES = 10
COUNTED_SCORE = 0.25
"""Answers from here on are compared."""
Image = NDArray[np.uint8]
Known = tuple[Image, Detections | None]
"""A picture and its labels, with scores of 1; None where it has none."""

_ROUNDS = (2, 4, MOST_PICTURES)  # pictures after which the ways that are surely worse are given up
_VIEWS = (  # shares cut off (left, top, right, bottom), less than 0: added in grey; whether it is mirrored
    ((0.04, 0.08, 0.08, 0.04), True),
    ((-0.1, -0.04, -0.04, -0.08), False),
)
_ONE_VIEW_FROM = 4  # pictures; of fewer both views are compared
_T_975 = {4: 3.18, 5: 2.78, 6: 2.57, 7: 2.45, 8: 2.36, 9: 2.31, 10: 2.26}  # Student's, by pictures
_PROBABLY_PICTURES = 8  # from here on one standard error suffices to prefer a way where nothing states any
_LEAST_RATIO = 1.2  # below, a difference is no reason to read a model otherwise, however sure
_FAR_RATIO, _FAR_LEAST = (
    3.0,
    2.0,
)  # an agreement so many times as large, and at least so large, is sure in any number
_DOUBT_RATIO, _DOUBT_LEAST, _DOUBT_PICTURES = 2.0, 1.0, 2  # from here on a doubt is said that is not sure
_GARBAGE_SHARE, _GARBAGE_FOUND = (
    0.15,
    1.0,
)  # of what is found agrees less, though so much is found in a picture
_RARE = "-1 to 1"
_FACTORS: dict[str, tuple[str, ...]] = {
    "colour": ("colour",),
    "values": ("value_range", "mean", "std"),
    "resize": ("resize",),
}


@dataclass
class Way:
    """A contract that is compared. agreed, found: sums of each picture shown so far; class_ids: those found."""

    contract: Contract
    agreed: list[float] = field(default_factory=list)
    found: list[float] = field(default_factory=list)
    class_ids: set[int] = field(default_factory=set)
    beaten: bool = False

    def agreement(self, among: NDArray[np.int64] | slice = slice(None)) -> float:
        """A²/F over pictures."""
        agreed, found = np.array(self.agreed)[among].sum(), np.array(self.found)[among].sum()
        return float(agreed**2 / found) if found > 0 else 0.0

    def __str__(self) -> str:
        return input_text(self.contract)


@dataclass(frozen=True)
class Comparison:
    """What comparing told. contract: the detector's, with what was chosen and where from; doubts: sentences.

    pictures, inferences, seconds: what it cost. ways: a row for each, the best first.
    """

    contract: Contract
    doubts: tuple[str, ...] = ()
    pictures: int = 0
    inferences: int = 0
    seconds: float = 0.0
    ways: tuple[dict[str, Any], ...] = ()

    @property
    def text(self) -> str:
        """What was chosen, or that nothing was, and the cost, in a sentence; nothing where nothing was compared."""
        if not self.ways:
            return ""
        chosen = [name for name, source in self.contract.sources.items() if source.startswith("chosen")]
        names = ", ".join(name for name, fields in _FACTORS.items() if set(fields) & set(chosen))
        cost = f"{len(self.ways)} variants on {_pictures(self.pictures)}"
        cost += f" ({self.inferences} inferences, {self.seconds:.1f} s)"
        told = f"{names} chosen by comparing" if names else "compared"
        open_ = ", ".join(
            factor
            for factor, fields in _FACTORS.items()
            if any(self.contract.sources[name].startswith("assumed") for name in fields)
        )
        untold = f", which do not tell {open_}" if open_ else ""
        return f"input {input_text(self.contract)}; {told} {cost}{untold}"

    def row(self) -> dict[str, Any]:
        """As a run records it."""
        return {name: value for name, value in asdict(self).items() if name not in ("contract", "doubts")}


def input_text(contract: Contract) -> str:
    """How a picture enters: "rgb, 0-1, mean and std of ImageNet, letterbox"."""
    values = _values_text(contract)
    return f"{contract.colour}, {values}, {contract.resize}"


def output_problems(detector: Detector, image: Image) -> list[str]:
    """What in the answer to one RGB picture (h, w, 3) shows that contract or export are wrong, whatever is seen.

    NaN or infinite outputs, scores that are all exactly 0, or above 1. Costs one inference.
    """
    blob, placement = detector.prepare(image)
    outputs = detector.run(blob)
    if count := sum(int(output.size - np.isfinite(output).sum()) for output in outputs):
        return [f"the outputs hold {count} values that are NaN or infinite"]
    # Graphs that suppress double answers themselves pad with zeros, or answer nothing.
    if detector.contract.nms_iou is not None and detector.top_score(outputs) == 0:
        return [
            "every score is exactly 0: is it an int8 export whose one output scale rounds all scores away?"
        ]
    try:
        detector.decode(outputs, placement, min_score=COUNTED_SCORE)
    except ModelError as error:
        return [str(error)]
    return []


def compared(detector: Detector, pictures: Iterable[Known]) -> Comparison:
    """Compare a detector's contract with the other ways in which pictures may enter it, on up to ten pictures.

    Fields that nothing stated are chosen by it, where the pictures tell; others are never changed: where another way
    surely agrees better, that is a doubt. What an exporter's code fixes, as its metadata say, is not questioned. The
    same pictures give the same choice. Costs two inferences for each picture and way that is still in question, some
    100 to 200.
    """
    began = time.perf_counter()
    shown = list(pictures)[:MOST_PICTURES]
    doubts = _common_problems(detector, shown)
    own = detector.contract
    if not shown or any(EXPORTER in own.sources[name] for name in ("colour", "value_range")):
        return Comparison(own, tuple(doubts), len(shown), len(shown), time.perf_counter() - began)
    ways = [Way(own), *(Way(other) for other in _others(detector))]
    inferences = len(shown)
    for upto in _ROUNDS:
        left = [way for way in ways if not way.beaten]
        inferences += sum(_look(detector, way, shown[:upto]) for way in left)
        best = max(left, key=Way.agreement)
        for way in left:
            way.beaten = way.contract is not own and way is not best and _surely(best, way)
    best = _likelier(best, [way for way in ways if not way.beaten])
    if own.resize != "none" and len(shown) >= _PROBABLY_PICTURES:
        other = Way(replace(best.contract, resize=_other_resize(best.contract.resize)))
        inferences += _look(detector, other, shown)
        ways.append(other)
        best = other if _surely(other, best) else best
    contract, told = _judged(ways, best, len(shown))
    ways.sort(key=lambda way: -way.agreement(slice(len(way.agreed))) / max(1, len(way.agreed)))
    return Comparison(
        contract,
        (*doubts, *told),
        len(shown),
        inferences,
        time.perf_counter() - began,
        tuple(map(_row, ways)),
    )


def _likelier(best: Way, left: Sequence[Way]) -> Way:
    """Of -1 to 1, which few detectors take, and another way that it is not surely better than, the other."""
    rivals = [
        way
        for way in left
        if way.contract.colour == best.contract.colour
        and _values_text(way.contract) != _RARE
        and not _surely(best, way)
    ]
    rare = _values_text(best.contract) == _RARE
    return max(rivals, key=Way.agreement) if rare and rivals else best


def _others(detector: Detector) -> list[Contract]:
    """Contracts under which a picture enters otherwise."""
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


def _in(colour: str, values: tuple[float, ...] | None) -> Any:
    return values[::-1] if values and colour == "bgr" else values


def _alike(one: Contract, other: Contract) -> bool:
    """Whether a picture enters alike, to within a hundredth of its range."""
    if one.colour != other.colour:
        return False
    ends, others = (
        np.array(
            [
                (np.array([0.0, 1.0]) * (255 if way.value_range == "0-255" else 1) - mean) / std
                for mean, std in zip(way.mean or (0,) * 3, way.std or (1,) * 3, strict=True)
            ]
        )
        for way in (one, other)
    )
    return bool(np.allclose(ends, others, rtol=0.01, atol=0.01 * float(np.ptp(ends))))


def _other_resize(resize: str) -> Any:
    return "letterbox" if resize == "stretch" else "stretch"


def _look(detector: Detector, way: Way, shown: Sequence[Known]) -> int:
    """Show a way the pictures that it has not seen; returns how many inferences that took."""
    views = _VIEWS[: 1 if len(shown) >= _ONE_VIEW_FROM else None]
    todo = shown[len(way.agreed) :]
    for image, labels in todo:
        found = _found(detector, way.contract, image)
        way.class_ids |= set(found.class_ids.tolist())
        pairs = [
            (_seen_in(found, image, *view), _found(detector, way.contract, _view(image, *view)))
            for view in views
        ]
        if labels is not None:
            pairs.append((found[np.isin(found.class_ids, labels.class_ids)], labels))
        way.agreed.append(sum(_agreed(*pair) for pair in pairs) / len(pairs))
        way.found.append(sum(float(each.scores.sum()) for pair in pairs for each in pair) / 2 / len(pairs))
    return len(todo) * (1 + len(views))


def _found(detector: Detector, contract: Contract, image: Image) -> Detections:
    """What is found with a contract; nothing where it makes the outputs impossible."""
    blob, placement = detector.prepare(image, contract=contract)
    outputs = detector.run(blob)
    try:
        if all(np.isfinite(output).all() for output in outputs):
            return detector.decode(outputs, placement, min_score=COUNTED_SCORE).leading
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


def _agreed(one: Detections, other: Detections) -> float:
    """The sum over pairs of one class, the best first, of the lower score times the overlap, from a half on."""
    low = np.maximum(one.boxes_xyxy[:, None, :2], other.boxes_xyxy[None, :, :2])
    high = np.minimum(one.boxes_xyxy[:, None, 2:], other.boxes_xyxy[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    union = _areas(one.boxes_xyxy)[:, None] + _areas(other.boxes_xyxy) - shared
    overlap = shared / np.maximum(union, 1e-9)
    overlap[(one.class_ids[:, None] != other.class_ids) | (overlap < 0.5)] = 0
    total = 0.0
    while overlap.size and overlap.max() > 0:
        row, column = np.unravel_index(overlap.argmax(), overlap.shape)
        total += float(min(one.scores[row], other.scores[column]) * overlap[row, column])
        overlap[row], overlap[:, column] = 0, 0
    return total


def _surely(one: Way, other: Way, *, probably: bool = False) -> bool:
    """Whether one way surely agrees better, by the pictures that both have seen; or only probably."""
    count = min(len(one.agreed), len(other.agreed))
    more, less = one.agreement(slice(count)), other.agreement(slice(count))
    if more >= max(_FAR_LEAST, _FAR_RATIO * less):
        return True
    fewest, ratio = (_PROBABLY_PICTURES, 1.0) if probably else (min(_T_975), _LEAST_RATIO)
    if count < fewest or more <= ratio * less:
        return False
    places = np.arange(count)
    without = [
        one.agreement(kept) - other.agreement(kept) for kept in (places[places != out] for out in places)
    ]
    error = float(np.sqrt((count - 1) * np.var(without)))  # the jackknife's
    return more - less > (1.0 if probably else _T_975[count]) * error


def _judged(ways: Sequence[Way], best: Way, count: int) -> tuple[Contract, list[str]]:
    """The contract with what the pictures chose, and the doubts that they raise."""
    own = ways[0]
    differing = [
        name
        for names in _FACTORS.values()
        for name in names
        if getattr(own.contract, name) != getattr(best.contract, name)
    ]
    surely = best is not own and _surely(best, own)
    sources = dict(own.contract.sources)
    doubts: list[str] = []
    final = own
    nothing_states = all(sources[name].startswith("assumed") for name in differing)
    if nothing_states and best is not own and _surely(best, own, probably=True):
        final = best
    elif surely or (
        count >= _DOUBT_PICTURES and best.agreement() >= max(_DOUBT_LEAST, _DOUBT_RATIO * own.agreement())
    ):
        whence = "; ".join(dict.fromkeys(sources[name] for name in differing))
        again = ("surely more" if surely else "more") + " is found again"
        doubts.append(
            f"read as {best} instead of {own} ({whence}), {again} where {_pictures(count)} are mirrored and cropped: "
            f"{sum(best.agreed):.3g} of {sum(best.found):.3g} in sum of scores, instead of {sum(own.agreed):.3g} of "
            f"{sum(own.found):.3g}" + ("" if surely else "; more pictures would tell")
        )
    found, agreed = sum(final.found), sum(final.agreed)
    if not doubts and found >= _GARBAGE_FOUND * count and agreed < _GARBAGE_SHARE * found:
        doubts.append(
            f"what it finds ({found:.3g} in sum of scores) is not found again when {_pictures(count)} are mirrored "
            f"and cropped ({agreed / found:.0%} is): family, input or export are probably wrong"
        )
    for factor, names in _FACTORS.items():
        for name in names:
            if sources[name].startswith("assumed"):
                sources[name] = _source(sources[name], ways, best, final, factor, count)
    return replace(final.contract, sources=sources), doubts


def _source(source: str, ways: Sequence[Way], best: Way, final: Way, factor: str, count: int) -> str:
    """Where a field comes from that nothing states."""
    names = _FACTORS[factor]
    rivals = [
        way for way in ways if any(getattr(way.contract, n) != getattr(best.contract, n) for n in names)
    ]
    untold = [way for way in rivals if not way.beaten and not _surely(best, way)]
    compared = f"{len(ways)} variants on {_pictures(count)}"
    if rivals and not untold and final is best:
        return f"chosen by comparing {compared}"
    if final is not best:
        return f"{source}; {compared} do not tell it from {_part(best.contract, factor)}"
    if not untold:
        return source
    near = _part(max(untold, key=Way.agreement).contract, factor)
    if final is ways[0]:
        return f"{source}; {compared} do not tell it from {near}"
    return f"assumed: best of {compared}, not surely better than {near}"


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


def _part(contract: Contract, factor: str) -> str:
    return _values_text(contract) if factor == "values" else repr(getattr(contract, factor))


def _pictures(count: int) -> str:
    return f"{count} picture{'s' if count > 1 else ''}"


def _row(way: Way) -> dict[str, Any]:
    contract = way.contract.to_dict()
    return {
        **{name: contract[name] for names in _FACTORS.values() for name in names},
        "pictures": len(way.agreed),
        "found": sum(way.found),
        "agreed": sum(way.agreed),
        "classes": len(way.class_ids),
    }


def _common_problems(detector: Detector, shown: Sequence[Known]) -> list[str]:
    """Problems of the outputs that at least half of the pictures show, each in the words of the first."""
    raised: dict[str, list[str]] = {}
    for image, _ in shown:
        try:
            problems = output_problems(detector, image)
        except ModelError:
            continue
        for text in problems:
            raised.setdefault(text.split()[0], []).append(text)
    return [
        f"{len(texts)} of {_pictures(len(shown))}: {texts[0]}"
        for texts in raised.values()
        if 2 * len(texts) >= len(shown)
    ]
