"""The scores of a model under a condition, one table: columns, tables of models and what a page can show follow it.

Domain: shares in [0, 1] where the scale is "share", numbers from 0 up where it is "count".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

DETECTOR = frozenset({"detector"})
READER = frozenset({"reader"})
BOTH = DETECTOR | READER


@dataclass(frozen=True)
class Score:
    """A column of scores: its name there, its title, which way is better, its scale, which models it judges.

    kinds: of "detector" and "reader", as a run's manifest names them. charted: whether the page draws it.
    """

    name: str
    title: str
    better: Literal["higher", "lower"]
    scale: Literal["share", "count"]
    kinds: frozenset[str]
    charted: bool = False


SCORES: tuple[Score, ...] = (
    Score("target_confidence", "Target confidence", "higher", "share", BOTH),
    Score("detection_rate", "Detection rate", "higher", "share", DETECTOR, charted=True),
    Score("confidence_when_found", "Confidence when found", "higher", "share", BOTH),
    Score("ap", "AP", "higher", "share", DETECTOR, charted=True),
    Score("ap50", "AP50", "higher", "share", DETECTOR, charted=True),
    Score("ap75", "AP75", "higher", "share", DETECTOR),
    Score("ap_small", "AP, small", "higher", "share", DETECTOR),
    Score("ap_medium", "AP, medium", "higher", "share", DETECTOR),
    Score("ap_large", "AP, large", "higher", "share", DETECTOR),
    Score("ar100", "AR100", "higher", "share", DETECTOR),
    Score("false_positives_per_image", "False positives per picture", "lower", "count", DETECTOR, charted=True),
    Score("calibration_error", "Calibration error", "lower", "share", DETECTOR, charted=True),
    Score("read_confidence", "Confidence, right or wrong", "higher", "share", READER, charted=True),
    Score("exact_match", "Exact match", "higher", "share", READER, charted=True),
    Score("character_error_rate", "Character error rate", "lower", "count", READER, charted=True),
)  # fmt: skip
