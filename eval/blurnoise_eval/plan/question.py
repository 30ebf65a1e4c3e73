"""The question of a run: what score is enough, and which pictures count as one.

Domain: ``threshold`` and ``keep`` are shares, 0 to 1; scores are those of
:func:`blurnoise_eval.answers.criterion.names`. What is left out follows from models and pictures, see
:func:`blurnoise_eval.answers.criterion.criterion_for`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Self

from annotated_types import Ge, Gt, Le

from blurnoise_eval.plan.settings import Settings, Text, setting


@dataclass(frozen=True)
class Question(Settings):
    """Which exposures work: the required score, or the required share of the score on the original pictures.

    threshold: the required score. keep: in place of it, the share that is required of the score of the same model on
    the original pictures, above 0. score: its name. cluster: a regular expression; pictures in whose names it finds
    the same text (its first group, if it has one) count as one, such as the frames of one drive.

    Raises ``ValueError`` for both a threshold and a share, and for a value outside 0-1.

    >>> Question(keep=0.8, score="ap50").filled_from(Question(threshold=0.5, cluster="tour-[0-9]+"))
    Question(keep=0.8, threshold=None, score='ap50', cluster='tour-[0-9]+')
    """

    keep: Annotated[float | None, Gt(0), Le(1)] = setting(
        None,
        "required share of the score on the original pictures (default: 0.9 for your own pictures)",
        "SHARE",
    )
    threshold: Annotated[float | None, Ge(0), Le(1)] = setting(
        None, "required score, instead of a required share (default: 0.6 for rendered pictures)", "C"
    )
    score: Text | None = setting(
        None,
        "score to judge by, such as target_confidence, detection_rate, recall@0.1 (recall at 0.1 false positives per "
        "original picture), ap50, ap, or exact_match for text (default: target_confidence; exact_match for your own "
        "texts)",
        "NAME",
    )
    cluster: Text | None = setting(
        None,
        "regular expression; pictures with the same match form a cluster, such as the frames of one drive",
        "REGEX",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.threshold is not None and self.keep is not None:
            raise ValueError(
                f"keep = {self.keep!r}: cannot be combined with threshold = {self.threshold!r}; specify one"
            )

    @property
    def is_open(self) -> bool:
        """Whether neither a score nor a share is required yet."""
        return self.threshold is None and self.keep is None

    def filled_from(self, earlier: Self) -> Question:
        """This question; where it leaves something open, that of an earlier one. A threshold replaces a share."""
        level = earlier if self.is_open else self
        return Question(
            keep=level.keep,
            threshold=level.threshold,
            score=self.score or earlier.score,
            cluster=earlier.cluster if self.cluster is None else self.cluster,
        )
