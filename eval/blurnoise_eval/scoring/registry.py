"""The scores of a model under a condition, one table: columns and what a page can show follow it.

Domain: shares in [0, 1] where the scale is "share", numbers from 0 up where it is "count".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from blurnoise_eval.scoring.estimates import Estimate
from blurnoise_eval.scoring.judged import Judged

DETECTOR = frozenset({"detector"})
READER = frozenset({"reader"})
BOTH = DETECTOR | READER


@dataclass(frozen=True)
class Score:
    """A column of scores: its name there, its title, which way is better, its scale, which models it judges.

    kinds: of "detector" and "reader", as a run's manifest names them. of: its estimate, or a number without an
    interval, None where it is undefined. charted: whether the page draws it.
    """

    name: str
    title: str
    better: Literal["higher", "lower"]
    scale: Literal["share", "count"]
    kinds: frozenset[str]
    of: Callable[[Judged], Estimate | float | None]
    charted: bool = False

    @property
    def within(self) -> tuple[float, float | None]:
        """The least and the greatest value, None for one without."""
        return 0.0, 1.0 if self.scale == "share" else None

    def row(self, judged: Judged) -> dict[str, float | None]:
        """Its columns: the value and its 95 % interval over clusters of pictures."""
        found = self.of(judged)
        estimate = found if isinstance(found, Estimate) else Estimate(found)
        return estimate.columns(self.name, self.within)


def _mean(column: str) -> Callable[[Judged], Estimate]:
    return lambda judged: judged.mean(column)


def _coco(name: str) -> Callable[[Judged], Estimate]:
    return lambda judged: judged.coco[name]


def _false_per_image(judged: Judged) -> Estimate | None:
    return None if judged.alarms is None else judged.alarms.false_per_image


def _calibration(judged: Judged) -> Estimate | None:
    return None if judged.alarms is None else judged.alarms.calibration_error


SCORES: tuple[Score, ...] = (
    Score("target_confidence", "Target confidence", "higher", "share", BOTH, _mean("target_confidence")),
    Score(
        "detection_rate", "Detection rate", "higher", "share", DETECTOR, _mean("detection_rate"), charted=True
    ),
    Score(
        "confidence_when_found",
        "Confidence when found",
        "higher",
        "share",
        BOTH,
        _mean("confidence_when_found"),
    ),
    Score(
        "target_confidence_swept",
        "Target confidence, swept box",
        "higher",
        "share",
        DETECTOR,
        _mean("target_confidence_swept"),
    ),
    Score(
        "detection_rate_swept",
        "Detection rate, swept box",
        "higher",
        "share",
        DETECTOR,
        _mean("detection_rate_swept"),
        charted=True,
    ),
    Score("ap", "AP", "higher", "share", DETECTOR, _coco("ap"), True),
    Score("ap50", "AP50", "higher", "share", DETECTOR, _coco("ap50"), True),
    Score("ap75", "AP75", "higher", "share", DETECTOR, _coco("ap75")),
    Score(
        "ap50_swept", "AP50, swept box", "higher", "share", DETECTOR, lambda judged: judged.swept_ap50, True
    ),
    Score("ap_small", "AP, small", "higher", "share", DETECTOR, _coco("ap_small")),
    Score("ap_medium", "AP, medium", "higher", "share", DETECTOR, _coco("ap_medium")),
    Score("ap_large", "AP, large", "higher", "share", DETECTOR, _coco("ap_large")),
    Score("ar100", "AR100", "higher", "share", DETECTOR, _coco("ar100")),
    Score(
        "false_positives_per_image",
        "False positives per picture",
        "lower",
        "count",
        DETECTOR,
        _false_per_image,
        charted=True,
    ),
    Score("calibration_error", "Calibration error", "lower", "share", DETECTOR, _calibration, True),
    Score(
        "read_confidence",
        "Confidence, right or wrong",
        "higher",
        "share",
        READER,
        _mean("read_confidence"),
        charted=True,
    ),
    Score("exact_match", "Exact match", "higher", "share", READER, _mean("exact_match"), True),
    Score(
        "character_error_rate",
        "Character error rate",
        "lower",
        "count",
        READER,
        _mean("character_error_rate"),
        charted=True,
    ),
)
