"""A criterion: what of a detector's performance is enough.

Domain: levels are shares, 0 to 1. Scores: ``SCORES_OF`` by kind of model; "recall@0.1" is the recall at
the confidence at which the untouched pictures give 0.1 false alarms each, the same under every condition.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from blurnoise._core.checks import in_range

CONFIDENCE, RATE, MATCHES = "target_confidence", "detection_rate", "exact_match"
RECALL = "recall@"
PRECISIONS = ("ap50", "ap")
"""Of all targets of a size together, never of one target: they have groups of their own."""
SCORES_OF = {
    "detector": (CONFIDENCE, RATE, f"{RECALL}RATE", *PRECISIONS),
    "reader": (CONFIDENCE, MATCHES),
}
KEPT, ENOUGH = 0.9, 0.6
"""What is enough unless stated: the share kept on pictures of one's own, confidence in rendered signs and texts."""
_MOST_ALARMS = 1e3
_WORDS = {
    CONFIDENCE: ("confidence", "mean confidence"),
    RATE: ("detection rate", "detection rate"),
    MATCHES: ("exact matches", "share of exact matches"),
    "ap50": ("AP50", "AP50"),
    "ap": ("AP", "AP"),
}


@dataclass(frozen=True)
class Criterion:
    """Enough is ``level`` of a score or, where it is ``kept``, that share of what the same model reaches with the
    same targets in the untouched pictures.

    score: a name in ``SCORES_OF``. Raises ``ValueError`` for a level outside 0-1, a share of 0, or another score.
    """

    level: float
    kept: bool
    score: str = CONFIDENCE

    def __post_init__(self) -> None:
        in_range("keep" if self.kept else "threshold", self.level, 0.0, 1.0, above=self.kept)
        if self.score not in _WORDS and not (self.alarms_per_picture or 0) > 0:
            listed = dict.fromkeys(name for names in SCORES_OF.values() for name in names)
            raise ValueError(
                f"score = {self.score!r}: must be one of {', '.join(listed)}, RATE as in recall@0.1"
            )

    @property
    def alarms_per_picture(self) -> float | None:
        """At which rate of false alarms recall is asked for; None of another score, or for what is no rate."""
        try:
            rate = float(self.score.removeprefix(RECALL)) if self.score.startswith(RECALL) else math.nan
        except ValueError:
            return None
        return rate if 0 < rate <= _MOST_ALARMS else None

    def row(self) -> dict[str, Any]:
        """As tables and JSON have it."""
        return {"text": self.text, "level": self.level, "kept": self.kept, "score": self.score}

    @property
    def text(self) -> str:
        """'keeps 0.9 of its confidence', 'mean confidence 0.6'."""
        rate = self.alarms_per_picture
        words = _WORDS.get(self.score) or (f"recall at {rate:g} false alarms per picture",) * 2
        return f"keeps {self.level:g} of its {words[0]}" if self.kept else f"{words[1]} {self.level:g}"

    @property
    def title(self) -> str:
        """What curves show: 'kept confidence', 'mean confidence'."""
        name = self.text.rpartition(" of its ")[2] if self.kept else self.text.rpartition(" ")[0]
        return f"kept {name}" if self.kept else name


def stated(
    threshold: float | None = None,
    keep: float | None = None,
    score: str | None = None,
    *,
    rendered: bool,
    reads: bool,
    labelled: bool = True,
) -> Criterion:
    """The criterion of a run: as stated, else ``KEPT`` of what the untouched pictures give, and ``ENOUGH`` for
    ``rendered`` pictures, whose every target a model should find.

    reads: of text; on pictures of one's own such models are asked for exact matches. labelled: whether the pictures
    say what is in them. Raises ``ValueError`` for both a threshold and a share to keep, or a score that such models
    do not have, or not on such pictures.
    """
    if threshold is not None and keep is not None:
        raise ValueError(f"keep = {keep!r}: cannot go with threshold = {threshold!r}; state one of them")
    kept = keep is not None or (threshold is None and not rendered)
    level = next(level for level in (keep, threshold, KEPT if kept else ENOUGH) if level is not None)
    found = Criterion(level, kept, score or (MATCHES if reads and kept and not rendered else CONFIDENCE))
    known = SCORES_OF["reader" if reads else "detector"]
    if found.score not in known and (reads or found.alarms_per_picture is None):
        kind = "text recognisers" if reads else "detectors"
        raise ValueError(f"score = {score!r}: must be one of {', '.join(known)} for {kind}")
    if found.alarms_per_picture is not None and not labelled:
        raise ValueError(f"score = {score!r}: needs pictures with labels, which tell false alarms")
    return found
