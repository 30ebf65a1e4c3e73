"""Answers and failure points in words, for the terminal and the page.

Domain: exposures in s, written in ms; blur in px; values in the criterion's unit. Texts are plain, never markup. An
interval is in brackets behind its value: "3.9 (3.1–4.6)", "26 (> 24)" where its other end lies outside the tested
range. It is rounded outward, so that the printed interval holds the exact one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.exposure_window import CANNOT_TELL, NONE_WORKS
from blurnoise_eval.answers.uncertainty import FEW, FEWEST
from blurnoise_eval.grid.axes import EXPOSURE, milliseconds
from blurnoise_eval.plots.annotate import OTHER_SCORE
from blurnoise_eval.system.tables import finite

_MANY_SATURATED = 0.01  # of the picture's values: so many at a limit of the sensor are reported
Row = dict[str, Any]


def reached_text(value: str, criterion: Criterion) -> str:
    """What is reached, with or without its interval: 'keeps 0.68 (0.61–0.74) of its confidence'."""
    return f"keeps {value} of its {criterion.noun}" if criterion.kept else f"reaches {criterion.noun} {value}"


def title_text(criterion: Criterion) -> str:
    """What the values are, as a title: 'Mean confidence', 'Kept AP50'."""
    return criterion.title[0].upper() + criterion.title[1:]


def value_text(value: float, low: float | None = None, high: float | None = None) -> str:
    """'0.68 (0.61–0.74)', without an interval '0.68'."""
    if low is None or high is None:
        return f"{value:.2f}"
    return f"{value:.2f} ({_outward(low, -1, 0.01):.2f}–{_outward(high, 1, 0.01):.2f})"


def counted(count: int, noun: str) -> str:
    """'1 picture', '24 pictures'."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def limit_text(limit: str) -> str:
    """What limits, as the rows have it: 'motion blur and noise'."""
    return " and ".join("motion blur" if each == "blur" else each for each in limit.split(" and "))


def joined(names: Sequence[str]) -> str:
    """'a, b and c'."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def window_text(answer: Row) -> str:
    """The exposure windows with the intervals of their ends: '≤ 1 (shortest tested) to 22 (19–26) ms'.

    Those of the mean curve; whether they can be relied upon is the verdict's.
    """
    if not answer["windows_s"]:
        return NONE_WORKS
    if len(answer["exposures_s"]) == 1:
        return f"at {EXPOSURE.text(answer['exposures_s'][0])} (the only exposure tested)"
    bounds = zip(answer["windows_low_s"], answer["windows_high_s"], strict=True)
    ends = [
        [milliseconds(end) + _bracketed(*interval) for end, interval in zip(window, both, strict=True)]
        for window, both in zip(answer["windows_s"], bounds, strict=True)
    ]
    if answer["open_low"]:
        ends[0][0] = f"≤ {ends[0][0]} (shortest tested)"
    if answer["open_high"]:
        ends[-1][1] = f"≥ {ends[-1][1]} (longest tested)"
    return ", and ".join(low if low == high else f"{low} to {high}" for low, high in ends) + " ms"


def _bracketed(low_s: float | None, high_s: float | None) -> str:
    low, high = (
        "" if end is None else milliseconds(_outward(end, side, 10.0 ** (math.floor(math.log10(end)) - 1)), 2)
        for end, side in ((low_s, -1), (high_s, 1))
    )
    if low and high:
        return f" ({low}–{high})"
    return f" (> {low})" if low else f" (< {high})" if high else ""


def _outward(value: float, side: int, step: float) -> float:
    """The multiple of a step at the value, or next to it: above for side 1, below for -1."""
    return side * math.ceil(side * value / step - 1e-6) * step


def verdict_text(answer: Row) -> str:
    """The verdict; of 'cannot tell' 'cannot tell from 12 pictures; 3 to 40 times as many would'."""
    if answer["verdict"] != CANNOT_TELL:
        return str(answer["verdict"])
    return f"{CANNOT_TELL} from {pictures_text(answer)}; {needed_text(answer)}"


def needed_text(answer: Row) -> str:
    """How many pictures would tell, in half of such cases and in nine of ten: '3.3 to 40 times as many would',
    'at least 3 more would', 'very many more would'."""
    n, wanted = answer["n_pictures"], [answer["pictures_to_tell"], answer.get("pictures_to_tell_mostly")]
    if wanted[0] is not None:
        times = [f"{each / n:.2g}" for each in wanted if each is not None]
        return f"{' to '.join(times) if len(times) > 1 else f'at least {times[0]}'} times as many would"
    lacking = math.ceil(FEWEST * n / (answer["effective_pictures"] or 1.0)) - n
    return f"at least {lacking} more would" if lacking > 0 else "very many more would"


def pictures_text(answer: Row) -> str:
    """'1 picture', '24 pictures'; '24 pictures, which count as 17' where that takes intervals away, or makes them
    few."""
    n, effective = answer["n_pictures"], answer["effective_pictures"]
    text = counted(n, "picture")
    less = any(effective < bound <= n for bound in (FEWEST, FEW))
    return f"{text}, which count as {math.floor(effective)}" if less else text


def confidence_text(answer: Row) -> str:
    """The value at the recommended exposure, with its interval: '0.93 (0.90–0.96)'."""
    names = "confidence_at_recommended", "recommended_low", "recommended_high"
    return value_text(*(answer[name] for name in names))


def best_text(answer: Row) -> str:
    """The best tested exposure: 'best 10 ms: 0.52 (0.44–0.61), limited by motion blur'."""
    value = value_text(answer["best_value"], answer["best_low"], answer["best_high"])
    text = f"best {EXPOSURE.text(answer['best_s'])}: {value}"
    return f"{text}, limited by {limit_text(answer['limited_by'])}" if answer["limited_by"] else text


def reservations(answer: Row) -> list[str]:
    """What else must be known of an answer: few pictures, saturated values, an end of the tested range."""
    found = []
    if answer["few_pictures"] and answer["verdict"] != CANNOT_TELL:
        found.append(f"few: {pictures_text(answer)}")
    chosen, tested = answer["recommended_s"], answer["exposures_s"]
    if chosen is None:
        return found
    share = answer["saturated_at_recommended"]
    if share is not None and share > _MANY_SATURATED:
        found.append(f"{100 * share:.0f} % of the picture saturated")
    if len(tested) > 1 and chosen == tested[0] and answer["open_low"]:
        found.append("the shortest tested: what lies below is not known")
    if len(tested) > 1 and chosen == tested[-1] and answer["open_high"]:
        found.append("the longest tested: what lies above is not known")
    return found


def failure_texts(curve: Row) -> list[str]:
    """Where a curve over blur fails: '12.1 px', 'beyond 24 px' or 'below throughout'; then what else is known of it:
    the 95 % interval, where it says more than the point, the area under the curve, and whether it had come back."""
    low, high, auc = curve["fails_low"], curve["fails_high"], finite(curve["auc"])
    text = "below throughout" if curve["fails_at"] == curve["x"][0] else f"{curve['fails_at'] or 0.0:.3g} px"
    texts = [text if curve["fails_at"] is not None else f"beyond {curve['x'][-1]:.3g} px"]
    if low is not None and low != high:
        texts.append(f"95 %: from {low:.3g} px" if high is None else f"95 %: {low:.3g} to {high:.3g} px")
    if auc is not None:
        texts.append(f"AUC {value_text(auc, curve['auc_low'], curve['auc_high'])}")
    return texts + ["non-monotonic"] * curve["non_monotonic"]


def outcome_text(example: Row, threshold: float) -> str:
    """How many of the example's targets were found, and their mean confidence; or what was read in them."""
    if example["error"] is not None:
        return f"the model failed: {example['error']}"
    targets = example["targets"]
    if not targets:
        count = sum(detection["score"] >= OTHER_SCORE for detection in example["detections"])
        return f"no target in the picture, {count} detections"
    if any(target["text"] is not None for target in targets):
        return "; ".join(map(_reading_text, targets))
    confidences = [target["confidence"] for target in targets]
    found = sum(confidence >= threshold for confidence in confidences)
    if len(confidences) == 1:
        return f"{'found' if found else 'missed'}, confidence {confidences[0]:.2f}"
    return f"{found} of {len(confidences)} found, mean confidence {np.mean(confidences):.2f}"


def missed(example: Row, threshold: float) -> bool:
    """Whether any of the example's targets was missed, or read wrongly."""
    return any(
        target["confidence"] <= 0 if target["text"] is not None else target["confidence"] < threshold
        for target in example["targets"]
    )


def _reading_text(target: Row) -> str:
    verdict = f"confidence {target['confidence']:.2f}" if target["confidence"] > 0 else "wrong"
    return f"read “{target['text']}”, {verdict}" if target["text"] else "read nothing"
