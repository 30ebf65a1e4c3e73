"""Numbers and intervals in words, for the terminal and the page.

Domain: exposures in s, written in ms; values in the criterion's unit. Texts are plain, never markup. An interval is
in brackets after its value: "3.9 (3.1–4.6)", "26 (> 24)" where its other end lies outside the tested range. It is
rounded outward, so that the printed interval includes the exact one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.exposure_window import CANNOT_TELL, NONE_WORKS, WORKS
from blurnoise_eval.answers.rows import AnswerRow
from blurnoise_eval.plan.axes import EXPOSURE, milliseconds
from blurnoise_eval.plots.annotate import OTHER_SCORE
from blurnoise_eval.scoring.uncertainty import FEW, FEWEST
from blurnoise_eval.store.columns import WithInterval
from blurnoise_eval.store.rows import Example, TargetAnswer

_MANY_SATURATED = 0.01  # of the picture's values: so many at a limit of the sensor are reported


def keeps(criterion: Criterion) -> str:
    """The verb for a score: of a kept share 'keeps'.

    >>> keeps(Criterion(0.9, kept=True)), keeps(Criterion(0.6, kept=False))
    ('keeps', 'reaches')
    """
    return "keeps" if criterion.kept else "reaches"


def reached_text(value: str, criterion: Criterion) -> str:
    """A score in a sentence: 'keeps 0.68 (0.61–0.74) of its confidence', 'reaches mean confidence 0.68'.

    >>> reached_text("0.68", Criterion(0.9, kept=True))
    'keeps 0.68 of its confidence'
    """
    return f"keeps {value} of its {criterion.noun}" if criterion.kept else f"reaches {criterion.noun} {value}"


def counted(count: int, noun: str) -> str:
    """'1 picture', '24 pictures'.

    >>> counted(1, "picture"), counted(24, "picture")
    ('1 picture', '24 pictures')
    """
    return f"{count} {noun if count == 1 else plural(noun)}"


def plural(noun: str) -> str:
    """'pictures' of 'picture'.

    >>> plural("light"), plural("spectrum")
    ('lights', 'spectra')
    """
    return f"{noun[:-2]}a" if noun.endswith("um") else f"{noun}s"


def limit_text(limit: str) -> str:
    """A limit of the rows in words: 'motion blur and noise'.

    >>> limit_text("blur and noise")
    'motion blur and noise'
    """
    return " and ".join("motion blur" if each == "blur" else each for each in limit.split(" and "))


def joined(names: Sequence[str]) -> str:
    """'a, b and c'.

    >>> joined(["a"]), joined(["a", "b", "c"])
    ('a', 'a, b and c')
    """
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def value_text(score: WithInterval) -> str:
    """'0.68 (0.61–0.74)', without an interval '0.68'.

    >>> value_text(WithInterval(0.68, 0.614, 0.736)), value_text(WithInterval(0.68))  # rounded outward
    ('0.68 (0.61–0.74)', '0.68')
    """
    _, low, high = score
    if low is None or high is None:
        return f"{score.known:.2f}"
    return f"{score.known:.2f} ({_outward(low, -1, 0.01):.2f}–{_outward(high, 1, 0.01):.2f})"


def _outward(value: float, side: int, step: float) -> float:
    """The multiple of a step at the value, or next to it: above for side 1, below for -1."""
    # The slack keeps 0.74 from becoming 0.75 by its last binary digit.
    return side * math.ceil(side * value / step - 1e-6) * step


def _end_text(end_s: float, low_s: float | None, high_s: float | None) -> str:
    """The end of a window in ms, with its interval."""
    low, high = (
        "" if end is None else milliseconds(_outward(end, side, 10.0 ** (math.floor(math.log10(end)) - 1)), 2)
        for end, side in ((low_s, -1), (high_s, 1))
    )
    interval = (
        f" ({low}–{high})" if low and high else f" (> {low})" if low else f" (< {high})" if high else ""
    )
    return milliseconds(end_s) + interval


def window_text(answer: AnswerRow) -> str:
    """The exposure windows of the mean with the intervals of their ends: '≤ 1 to 22 (19–26) ms', ≤ and ≥ at the
    ends of the tested range."""
    rows = zip(answer.windows_s, answer.windows_low_s, answer.windows_high_s, strict=True)
    ends = [[_end_text(low, *of_low), _end_text(high, *of_high)] for (low, high), of_low, of_high in rows]
    if ends and answer.window_from_open:
        ends[0][0] = f"≤ {ends[0][0]}"
    if ends and answer.window_to_open:
        ends[-1][1] = f"≥ {ends[-1][1]}"
    return ", and ".join(low if low == high else f"{low} to {high}" for low, high in ends) + " ms"


def answer_lines(answer: AnswerRow) -> list[str]:
    """An answer, most important first: '4 ms → 0.93 (0.90–0.96)', the window, the regret, reservations."""
    verdict, chosen = answer.verdict, answer.recommended_s
    works = verdict == WORKS
    lines = {CANNOT_TELL: [f"{CANNOT_TELL} from {pictures_text(answer)}: {needed_text(answer)}"]}
    found = lines.get(verdict, [] if works else [str(verdict)])
    if chosen is None or verdict == NONE_WORKS:
        best = value_text(answer.best_score)
        limit = f", limited by {limit_text(answer.best_limited_by)}" if answer.best_limited_by else ""
        return [*found, f"best {EXPOSURE.text(answer.best_s)}: {best}{limit}"]
    found += [f"{EXPOSURE.text(chosen)} → {value_text(answer.score_at_recommended)}"]
    found += [window_text(answer) if works else f"window of the mean: {window_text(answer)}"]
    if works and answer.regret_95 is not None:
        found.append(f"regret at most {answer.regret_95:.3f}")
    if works and answer.few_pictures:
        found.append(f"only {pictures_text(answer)}")
    share = answer.saturated_share_at_recommended
    return found + [f"{100 * (share or 0):.0f} % of the picture saturated"] * ((share or 0) > _MANY_SATURATED)


def needed_text(answer: AnswerRow) -> str:
    """How many pictures a verdict needs: 'about 80 pictures are needed', 'at least 3 more pictures are needed'."""
    n, needed = answer.n_pictures, answer.pictures_needed
    if needed is not None:
        return f"about {max(int(float(f'{needed:.2g}')), n + 1)} pictures are needed"
    lacking = math.ceil(FEWEST * n / (answer.effective_pictures or 1.0)) - n
    return f"at least {lacking} more pictures are needed" if lacking > 0 else "very many pictures are needed"


def pictures_text(answer: AnswerRow) -> str:
    """'24 pictures'; '24 pictures, which count as 17' where unequal weights leave too few for an interval."""
    n, effective = answer.n_pictures, answer.effective_pictures
    less = any(effective < bound <= n for bound in (FEWEST, FEW))
    return f"{counted(n, 'picture')}{f', which count as {math.floor(effective)}' if less else ''}"


def outcome_text(example: Example, threshold: float) -> str:
    """How many of the example's targets were found, and their mean confidence; or what was read in them."""
    if example.cell.error is not None:
        return f"the model failed: {example.cell.error}"
    targets = example.targets
    if not targets:
        count = sum(detection.score >= OTHER_SCORE for detection in example.detections)
        return f"no target in the picture, {counted(count, 'detection')}"
    if any(target.text is not None for target in targets):
        return "; ".join(map(_reading_text, targets))
    confidences = [target.confidence for target in targets]
    found = sum(confidence >= threshold for confidence in confidences)
    return f"{found} of {len(confidences)} found, mean confidence {np.mean(confidences):.2f}"


def _reading_text(target: TargetAnswer) -> str:
    verdict = f"confidence {target.confidence:.2f}" if target.confidence > 0 else "wrong"
    return f"read “{target.text}”, {verdict}" if target.text else "read nothing"
