"""The scores that a report names: columns of a condition's row, and the rows of the table of models."""

from __future__ import annotations

from typing import Literal, NamedTuple

from blurnoise_eval.scoring.registry import BOTH, DETECTOR, READER, SCORES

_CURVES = "needs targets at two or more of them"
_UNKNOWN = "no labelled target that the model knows"


class ModelScore(NamedTuple):
    """A row of the table of models: its column, why a value may be missing, what it means, its title.

    better: None without a best.
    """

    name: str
    missing: str
    meaning: str
    title: str
    digits: str = ".3f"
    better: Literal["higher", "lower"] | None = "higher"
    kinds: frozenset[str] = BOTH


CHOICES = tuple(score for score in SCORES if score.charted)
"""What the page can draw besides the confidence in targets."""


def _of_untouched(
    name: str, missing: str, meaning: str = "", kinds: frozenset[str] | None = None
) -> ModelScore:
    score = next(score for score in SCORES if score.name == name)
    title = f"{score.title}, untouched"
    return ModelScore(name, missing, meaning, title, better=score.better, kinds=kinds or score.kinds)


MODEL_SCORES = (
    ModelScore("p", _UNKNOWN, "AP (IoU 0.50 to 0.95) on the untouched pictures", "P", kinds=DETECTOR),
    ModelScore("p", "no text to read", "exact matches on the untouched pictures", "P", kinds=READER),
    ModelScore(
        "mpc", "no condition scored",
        "mean of the same over all conditions but the untouched, each weighted alike", "mPC",
    ),
    ModelScore(
        "mpc_uniform", "no condition scored",
        "mean of the same over light x time and motion, log-uniform over what was tested, whatever the grid",
        "mPC, uniform",
    ),
    ModelScore("rpc", "needs mPC, and P above 0", "mPC / P", "rPC"),
    ModelScore(
        "auc_exposure", _CURVES,
        "mean over all curves of the area under mean confidence, divided by the range of exposures",
        "AUC over exposure",
    ),
    ModelScore(
        "auc_blur", _CURVES, "the same over motion blur in px, at each exposure", "AUC over blur"
    ),
    _of_untouched("ap50", _UNKNOWN),
    _of_untouched("ar100", _UNKNOWN, "recall with 100 detections a picture"),
    _of_untouched("target_confidence", "no target", kinds=DETECTOR),  # of a reader: as read
    _of_untouched(
        "false_positives_per_image", "not scored", "detections from 0.25 on that answer for no target"
    ),
    _of_untouched(
        "calibration_error", "nothing detected",
        "of detections from 0.25 on: |score - share of right ones|, ten bins",
    ),
    _of_untouched("character_error_rate", "no text to read", "edits / characters"),
    _of_untouched("read_confidence", "no text to read", "of what was read"),
    ModelScore(
        "latency_ms", "not measured", "CPU time of one picture on one thread, from picture to answer",
        "Latency, median", ".3g", "lower",
    ),
    ModelScore("latency_p95_ms", "not measured", "", "Latency, 95th percentile", ".3g", "lower"),
    ModelScore("latency_threads", "not measured", "", "Threads for the latency", "d", None),
)  # fmt: skip
