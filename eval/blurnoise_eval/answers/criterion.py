"""The criterion: the score from which on an exposure works.

Domain: levels are shares, 0 to 1. Scores: :func:`names` by kind of model; "recall@0.1" is the recall at the
confidence at which the original pictures give 0.1 false alarms each, the same under every condition.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from blurnoise._core.checks import in_range
from blurnoise_eval.plan.question import Question
from blurnoise_eval.scoring.scores import BOTH, Score, criteria

CONFIDENCE, RATE, MATCHES = "target_confidence", "detection_rate", "exact_match"
RECALL = "recall@"
KEPT, ENOUGH = 0.9, 0.6
"""The default: the share kept on the user's pictures, confidence in rendered signs and texts."""
_MOST_ALARMS = 1e3


def names(kind: str) -> list[str]:
    """The scores that may be a criterion, of "detector" or "reader".

    >>> names("reader")
    ['target_confidence', 'exact_match']
    """
    every = [score.name for score in criteria(kind)]
    return every if kind == "reader" else [*every, f"{RECALL}RATE"]


@dataclass(frozen=True)
class Criterion:
    """The score that counts as working: an absolute value or a kept share.

    level: the absolute value or, if ``kept``, the share of the same model's score on the same targets in the original
    pictures. score: one of :func:`names`. cluster: the pattern by which pictures count as one, see
    :func:`blurnoise_eval.answers.clusters.cluster_of`. Raises ``ValueError`` for a level outside 0-1, a share of 0,
    or another score.

    >>> Criterion(0.9, kept=True).text, Criterion(0.6, kept=False).text
    ('keeps 0.9 of its confidence', 'mean confidence 0.6')
    """

    level: float
    kept: bool
    score: str = CONFIDENCE
    cluster: str | None = None

    def __post_init__(self) -> None:
        # A share of 0 is kept by a model that finds nothing.
        in_range("keep" if self.kept else "threshold", self.level, 0.0, 1.0, above=self.kept)
        if self.of is None and self.alarms_per_picture is None:
            listed = ", ".join(dict.fromkeys(name for kind in ("detector", "reader") for name in names(kind)))
            raise ValueError(f"score = {self.score!r}: must be one of {listed}, RATE as in recall@0.1")

    @property
    def of(self) -> Score | None:
        """The score; None of a recall at a rate of false alarms."""
        every = (score for kind in sorted(BOTH) for score in criteria(kind))
        return next((score for score in every if score.name == self.score), None)

    @property
    def of_sizes(self) -> bool:
        """Whether it is a score of all targets of a size together, whose groups are sizes."""
        return self.of is not None and self.of.by_size is not None

    @property
    def alarms_per_picture(self) -> float | None:
        """The rate of false alarms of a recall; None of another score, or for what is no rate."""
        try:
            rate = float(self.score.removeprefix(RECALL)) if self.score.startswith(RECALL) else math.nan
        except ValueError:
            return None
        return rate if 0 < rate <= _MOST_ALARMS else None

    def row(self) -> dict[str, Any]:
        """As tables and JSON have it."""
        return {"text": self.text, "level": self.level, "kept": self.kept, "score": self.score}

    @property
    def noun(self) -> str:
        """The score in words: of its 'confidence' where a share is kept, else 'mean confidence'."""
        if self.of is None or self.of.criterion is None:
            return f"recall at {self.alarms_per_picture:g} false alarms per picture"
        of_kept, of_itself = self.of.criterion
        return of_kept if self.kept else of_itself

    @property
    def text(self) -> str:
        """'keeps 0.9 of its confidence', 'mean confidence 0.6'."""
        return f"keeps {self.level:g} of its {self.noun}" if self.kept else f"{self.noun} {self.level:g}"

    @property
    def title(self) -> str:
        """What curves show: 'kept confidence', 'mean confidence'."""
        return f"kept {self.noun}" if self.kept else self.noun


def criterion_for(question: Question, *, rendered: bool, reads: bool, labelled: bool = True) -> Criterion:
    """The criterion of a run, for a question.

    Where the question leaves the level open, it is ``KEPT`` of the score on the original pictures, or ``ENOUGH`` for
    ``rendered`` pictures, in which a model should find every target. reads: the models read text; on the user's
    pictures their default score is exact matches. labelled: whether the pictures have labels. Raises ``ValueError``
    for a score that such models do not have, or not on such pictures.

    >>> criterion_for(Question(score="ap50"), rendered=False, reads=False).text
    'keeps 0.9 of its AP50'
    """
    score = question.score
    kept = question.keep is not None or (question.threshold is None and not rendered)
    default = (KEPT if kept else ENOUGH), (MATCHES if reads and kept and not rendered else CONFIDENCE)
    level = question.keep if question.keep is not None else question.threshold
    criterion = Criterion(
        default[0] if level is None else level, kept, score or default[1], cluster=question.cluster
    )
    known = names("reader" if reads else "detector")
    if criterion.score not in known and (reads or criterion.alarms_per_picture is None):
        kind = "text recognisers" if reads else "detectors"
        raise ValueError(f"score = {score!r}: must be one of {', '.join(known)} for {kind}")
    if criterion.alarms_per_picture is not None and not labelled:
        raise ValueError(f"score = {score!r}: needs pictures with labels, to count false alarms")
    return criterion
