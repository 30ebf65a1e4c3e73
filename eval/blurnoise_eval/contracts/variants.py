"""Variants of a contract: other inputs, and other readings of outputs, each shown pictures and their mirrored crops.

Domain: 8-bit RGB pictures (h, w, 3); scores 0 to 1. The merit of a variant is defined in :mod:`.comparison`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from blurnoise_eval.contracts.mirrored_views import agreement, detected, mirrored_view
from blurnoise_eval.detectors.contract import INPUT_VALUES, Contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Detections

Image = NDArray[np.uint8]
Known = tuple[Image, Detections | None]
"""A picture and its labels, with scores of 1; None where it has none."""
FACTORS: dict[str, tuple[str, ...]] = {
    "colour": ("colour",),
    "values": ("value_range", "mean", "std"),
    "resize": ("resize",),
    "outputs": ("outputs",),
}
"""What is varied, to the fields of a contract."""
_SURE, _LIKELY, PROBABLE = 0.995, 0.975, 0.84  # one-sided levels of Student's t
_FEWEST = 4  # pictures for Student's t to make a variant surely better
_FAR_RATIO, _FAR_LEAST = 3.0, 2.0  # so many times as much agreement, at least so much, is always sure
# Of so many objects in a picture as many would agree by chance. The sign detector fed with values to 255 found 240 in
# each of 32 photographs without a sign, and a quarter of them again.
_CROWD = 1000.0
_MATTERS = 0.05  # relative gain in merit; another resize that may gain more is a doubt
_SAME = 0.98  # of what two variants find, from where on it does not matter which one is right


@dataclass
class Variant:
    """A contract that is compared.

    By picture: agreed, found, sums of scores; seen, the detections; problems, texts of what must be wrong, or "".
    """

    contract: Contract
    agreed: list[float] = field(default_factory=list)
    found: list[float] = field(default_factory=list)
    seen: list[Detections] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    given_up: bool = False

    @property
    def merits(self) -> NDArray[np.float64]:
        """Of each picture; 0 of all where no more agrees in all of them than by chance."""
        found = np.array(self.found)
        more = np.array(self.agreed) - found * (0.1 + found / _CROWD)
        return np.sqrt(np.maximum(0.0, more if more.sum() > 0 else np.zeros_like(more)))

    @property
    def merit(self) -> float:
        """The mean over the pictures; 0 of none."""
        return float(self.merits.mean()) if self.agreed else 0.0

    def differs(self, other: Variant) -> list[str]:
        """Those of ``FACTORS`` in which the contracts differ."""
        one, two = self.contract, other.contract
        return [f for f, names in FACTORS.items() if any(getattr(one, n) != getattr(two, n) for n in names)]

    def show(self, detector: Detector, pictures: Sequence[Known]) -> int:
        """Detect in those of the pictures that are new to it; returns the number of inferences."""
        new = pictures[len(self.agreed) :]
        detector = detector.with_contract(self.contract)
        for image, labels in new:
            found, problem = detected(detector, image)
            view, seen = mirrored_view(image, found)
            pairs = [(seen, detected(detector, view)[0])]
            if labels is not None:
                pairs.append((found[np.isin(found.class_ids, labels.class_ids)], labels))
            self.seen.append(found)
            self.problems.append(problem)
            self.agreed.append(sum(agreement(*pair) for pair in pairs) / len(pairs))
            scores = sum(float(each.scores.sum()) for pair in pairs for each in pair)
            self.found.append(scores / 2 / len(pairs))
        return 2 * len(new)

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

    def standing(self, final: Variant, *, stated: bool) -> str:
        """How it stands to the final one: surely "worse", "less likely", a "rival" that may be right, or "open".

        It is open where it finds the same, or is another resize that gains little. stated: whether it would replace a
        field that somebody stated; then it has to be probably better. Else it is a rival unless the final one is
        probably better. With 8 photographs it had to be surely so, and half of the right contracts were doubted.
        """
        if self.given_up or final.surely_beats(self):
            return "worse"
        resized = self.differs(final) == ["resize"]
        level = PROBABLE if min(len(self.agreed), len(final.agreed)) >= _FEWEST else _LIKELY
        gain = self.lead(final, _LIKELY) if stated or resized else -final.lead(self, level)
        least = _MATTERS * final.merit if resized else 0
        every = sum(float(each.scores.sum()) for variant in (self, final) for each in variant.seen) / 2
        same = sum(map(agreement, self.seen, final.seen)) / max(every, 1e-9)
        if same < _SAME and gain > least:
            return "rival"
        return "open" if same >= _SAME or stated or resized else "less likely"


def factors(contract: Contract, *statuses: str) -> list[str]:
    """Those of ``FACTORS`` that were "chosen", or are "assumed"."""
    sources = contract.sources
    return [f for f, names in FACTORS.items() if any(sources[name].startswith(statuses) for name in names)]


def other_inputs(detector: Detector) -> list[Contract]:
    """Contracts under which a picture enters otherwise, at the same size."""
    own = detector.contract
    turn = -1 if own.colour == "bgr" else 1  # values in the order of rgb
    of_own = own.value_range, *(each and each[::turn] for each in (own.mean, own.std))
    found = [own]
    grey: tuple[tuple[Any, int], ...] = (("grey", 1),)
    for colour, turn in grey if own.colour == "grey" else (("rgb", 1), ("bgr", -1)):
        for span, *values in (*(() if detector.takes_bytes else INPUT_VALUES.values()), of_own):
            mean, std = (each and each[::turn] for each in values)
            fields: dict[str, Any] = {"colour": colour, "value_range": span, "mean": mean, "std": std}
            other = replace(own, **fields)
            if not any(other.colour == each.colour and _enters_alike(other, each) for each in found):
                found.append(other)
    return found[1:]


def _enters_alike(one: Contract, other: Contract) -> bool:
    """Whether black and white enter alike, to within a hundredth of the range."""
    ends, others = (
        (np.outer((0, 255 if each.value_range == "0-255" else 1), (1, 1, 1)) - (each.mean or 0))
        / (each.std or 1)
        for each in (one, other)
    )
    return np.allclose(ends, others, rtol=0.01, atol=0.01 * float(np.ptp(ends)))
