"""The scores of a model, one table: columns, the page's charts, the table of models and criteria follow from it.

Domain: shares in [0, 1] where the scale is "share", numbers from 0 up where it is "count".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.scoring.uncertainty import ClusterEstimate

if TYPE_CHECKING:  # heavy, and names of scores are completed in a shell
    from blurnoise_eval.scoring.evaluated import Evaluated
    from blurnoise_eval.store.columns import WithInterval
    from blurnoise_eval.store.queries import TargetColumns

DETECTOR = frozenset({"detector"})
READER = frozenset({"reader"})
BOTH = DETECTOR | READER
NEITHER: frozenset[str] = frozenset()
_CURVES = "needs targets at two or more of them"
_UNKNOWN = "no labelled target that the model knows"
_NO_TEXT = "no text to read"


@dataclass(frozen=True)
class Score:
    """One score: its column, title, which way is better (None: neither), its scale, and which models it judges.

    kinds: of "detector" and "reader", as a run's manifest names them. A score has exactly one of four functions.
    of_targets: from rows of targets to the values that it is the mean of, NaN where a row has none. by_size: its
    estimate of the answers under one condition, for targets of one of ``SIZES``, with the influence of each cluster.
    of: its estimate of the answers, or a number without an interval, None where undefined. of_model: its value in a
    row of the table of models, of a model as a whole.
    charted: whether the page draws it. of_models: of which kinds the table of models has it, of the original
    pictures; meaning: what it is, there, missing: why it may have no value, digits: how it is written. criterion:
    what it is called where a share of it is kept, and where it reaches a level: so ``--score`` takes it.

    Raises ``ValueError`` for none or several functions, and for a criterion without ``of_targets`` or ``by_size``.

    >>> Score("half", "Half", of_targets=lambda rows: rows.confidence / 2, criterion=("half", "half")).most
    1.0
    """

    name: str
    title: str
    kinds: frozenset[str] = BOTH
    of: Callable[[Evaluated], ClusterEstimate | float | None] | None = None
    better: Literal["higher", "lower"] | None = "higher"
    scale: Literal["share", "count"] = "share"
    of_targets: Callable[[TargetColumns], NDArray[np.float64]] | None = None
    by_size: Callable[[Evaluated, str], ClusterEstimate] | None = None
    of_model: Callable[[Any], WithInterval | float | None] | None = None
    charted: bool = False
    of_models: frozenset[str] = NEITHER
    meaning: str = ""
    missing: str = ""
    digits: str = ".3f"
    criterion: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        given = [of for of in (self.of, self.of_targets, self.by_size, self.of_model) if of is not None]
        if len(given) != 1:
            must = "must have one of of, of_targets, by_size and of_model"
            raise ValueError(f"score {self.name!r}: has {len(given)} functions: {must}")
        if self.criterion and not (self.of_targets or self.by_size):
            must = "must have of_targets or by_size, which answer for each size of targets"
            raise ValueError(f"score {self.name!r}: criterion = {self.criterion!r}: {must}")

    @property
    def most(self) -> float:
        """The greatest value."""
        return 1.0 if self.scale == "share" else math.inf

    @property
    def of_pictures(self) -> bool:
        """Whether it scores the answers under a condition, rather than a model as a whole."""
        return self.of_model is None

    def estimate(self, evaluated: Evaluated) -> ClusterEstimate:
        """The score of answers under one condition, undefined where there is nothing to score."""
        if self.by_size is not None:
            return self.by_size(evaluated, "all")
        value = evaluated.mean(self.name) if self.of is None else self.of(evaluated)
        return value if isinstance(value, ClusterEstimate) else ClusterEstimate(value)


def of_conditions() -> list[Score]:
    """Scores of the answers under each condition: the columns of scores.csv.

    >>> "ap50" in [score.name for score in of_conditions()]
    True
    """
    return [score for score in SCORES if score.of_pictures]


def of_models(kind: str) -> list[Score]:
    """Scores in the table of models.

    >>> [score.name for score in of_models("reader")][:2]
    ['p', 'mpc']
    """
    return [score for score in SCORES if kind in score.of_models]


def criteria(kind: str) -> list[Score]:
    """Scores that ``--score`` accepts.

    >>> [score.name for score in criteria("detector")]
    ['target_confidence', 'detection_rate', 'ap', 'ap50']
    """
    return [score for score in SCORES if score.criterion and kind in score.kinds]


def _found(confidence: NDArray[np.float64]) -> NDArray[np.float64]:
    from blurnoise_eval.scoring.matching import FOUND_SCORE  # heavy

    return np.where(np.isnan(confidence), np.nan, confidence >= FOUND_SCORE)


def _precision(evaluated: Evaluated, size: str, first: int = 0, last: int = 10) -> ClusterEstimate:
    """COCO's average precision over some of its ten IoUs."""
    return evaluated.average(size, slice(first, last))


SCORES: tuple[Score, ...] = (
    Score(
        "p", "P", DETECTOR, of_model=attrgetter("p"), of_models=DETECTOR, missing=_UNKNOWN,
        meaning="AP (IoU 0.50 to 0.95) on the original pictures",
    ),
    Score(
        "p", "P", READER, of_model=attrgetter("p"), of_models=READER, missing=_NO_TEXT,
        meaning="exact matches on the original pictures",
    ),
    Score(
        "mpc", "mPC", of_model=attrgetter("mpc"), of_models=BOTH, missing="no condition scored",
        meaning="mean of the same over all conditions but the original pictures, each weighted alike",
    ),
    Score(
        "rpc", "rPC", of_model=attrgetter("rpc"), of_models=BOTH, missing="needs mPC, and P above 0",
        meaning="mPC / P",
    ),
    Score(
        "auc_exposure", "AUC over exposure", of_model=attrgetter("auc_exposure"), of_models=BOTH, missing=_CURVES,
        meaning="mean over all curves of the area under mean confidence, divided by the range of exposures",
    ),
    Score(
        "auc_blur", "AUC over blur", of_model=attrgetter("auc_blur"), of_models=BOTH, missing=_CURVES,
        meaning="the same over motion blur in px, at each exposure",
    ),
    Score(
        "target_confidence", "Target confidence", BOTH,
        of_targets=attrgetter("confidence"), of_models=DETECTOR, missing="no target",  # of a reader: as read
        criterion=("confidence", "mean confidence"),
    ),
    Score(
        "detection_rate", "Detection rate", DETECTOR,
        of_targets=lambda rows: _found(rows.confidence), charted=True,
        criterion=("detection rate", "detection rate"),
    ),
    Score(
        "target_confidence_swept", "Target confidence, swept box", DETECTOR,
        of_targets=attrgetter("confidence_swept"),
    ),
    Score(
        "detection_rate_swept", "Detection rate, swept box", DETECTOR,
        of_targets=lambda rows: _found(rows.confidence_swept), charted=True,
    ),
    Score("ap", "AP", DETECTOR, by_size=_precision, charted=True, criterion=("AP", "AP")),
    Score(
        "ap50", "AP50", DETECTOR, by_size=partial(_precision, last=1), charted=True, of_models=DETECTOR,
        missing=_UNKNOWN, criterion=("AP50", "AP50"),
    ),
    Score("ap75", "AP75", DETECTOR, lambda evaluated: _precision(evaluated, "all", 5, 6)),
    Score("ap50_swept", "AP50, swept box", DETECTOR, attrgetter("swept_ap50"), charted=True),
    Score("ap_small", "AP, small", DETECTOR, lambda evaluated: _precision(evaluated, "small")),
    Score("ap_medium", "AP, medium", DETECTOR, lambda evaluated: _precision(evaluated, "medium")),
    Score("ap_large", "AP, large", DETECTOR, lambda evaluated: _precision(evaluated, "large")),
    Score(
        "ar100", "AR100", DETECTOR, attrgetter("recall"), of_models=DETECTOR, missing=_UNKNOWN,
        meaning="recall with 100 detections a picture",
    ),
    Score(
        "false_positives_per_image", "False positives per picture", DETECTOR,
        attrgetter("alarms.false_per_image"), "lower", "count", charted=True,
        of_models=DETECTOR, missing="not scored",
        meaning="detections from 0.25 on that answer for no target",
    ),
    Score(
        "calibration_error", "Calibration error", DETECTOR, attrgetter("alarms.calibration_error"), "lower",
        charted=True, of_models=DETECTOR, missing="nothing detected",
        meaning="of detections from 0.25 on: |score - share of right ones|, ten bins",
    ),
    Score(
        "read_confidence", "Confidence, right or wrong", READER,
        of_targets=attrgetter("read_confidence"), charted=True, of_models=READER, missing=_NO_TEXT,
        meaning="of what was read",
    ),
    Score(
        "exact_match", "Exact match", READER, of_targets=attrgetter("exact"), charted=True,
        criterion=("exact matches", "share of exact matches"),
    ),
    Score(
        "character_error_rate", "Character error rate", READER, None, "lower", "count",
        of_targets=attrgetter("character_error_rate"), charted=True, of_models=READER, missing=_NO_TEXT,
        meaning="edits / characters",
    ),
    Score(
        "latency_ms", "Latency, median", of_model=attrgetter("latency_ms"), better="lower", of_models=BOTH,
        missing="not measured", digits=".3g",
        meaning="CPU time of one picture on one thread, from picture to answer",
    ),
    Score(
        "latency_p95_ms", "Latency, 95th percentile", of_model=attrgetter("latency_p95_ms"), better="lower",
        of_models=BOTH, missing="not measured", digits=".3g",
    ),
    Score(
        "latency_threads", "Threads for the latency", of_model=attrgetter("latency_threads"), better=None,
        of_models=BOTH, missing="not measured", digits="d",
    ),
)  # fmt: skip
