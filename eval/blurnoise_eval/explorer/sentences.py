"""Sentences of the explorer: what a model makes of a picture, and of a curve."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from blurnoise_eval.explorer.controls import Control
from blurnoise_eval.explorer.judging import Point, Standard, keeps_most, works
from blurnoise_eval.explorer.rendered import Rendered
from blurnoise_eval.grid.axes import EXPOSURE


def verdict(found: Rendered) -> str:
    """What the model makes of the picture, as HTML."""
    sight, standard = found.sight, found.standard
    if sight is None or standard is None:
        grey = next(each for each in found.numbers if each.name == "snr_db")
        return f"18 % grey stands at <b>{escape(grey.text)}</b> of signal to noise."
    if sight.error:
        return f'<b class="no">The model fails</b> on this picture: {escape(sight.error[:160])}'
    scores, level = standard.scores(sight), standard.criterion.level
    if not scores:
        return '<b class="no">Nothing to judge by:</b> the model finds nothing in the original picture.'
    mean = sum(scores) / len(scores)
    value = standard.value(mean)
    hits = sum(row["confidence"] >= standard.found_from for row in sight.targets)
    what, rest = f"{standard.title} {mean:.2f}", ""
    if standard.criterion.kept:
        what = f"Keeps {standard.text(value)}"
        rest = f" of its {standard.criterion.noun} in the original ({mean:.2f} of {standard.original:.2f})"
    kind, enough = ("", "") if value >= level else (' class="no"', f"; enough is {standard.text(level)}")
    return f"<b{kind}>{what}</b>{rest}, {hits} of {len(scores)} found{enough}."


def window(curve: Sequence[Point], along: Control, at: float, standard: Standard) -> str:
    """From where to where along the curve the model works, and which exposure keeps most."""
    if not curve:
        return ""
    window = works(curve, standard.enough, at, logarithmic=along.logarithmic)
    what, level = along.title, standard.text(standard.criterion.level)
    asked = f"keeps {level} or more" if standard.criterion.kept else f"the mean is {level} or more"
    of_exposure = along.name == EXPOSURE.name
    best = keeps_most(curve, standard) if of_exposure else max(curve, key=lambda point: point.mean)
    most = f"{standard.text(standard.value(best.mean))} at {along.text(best.value)}"
    if window is None:
        failing = f"keeps {level}" if standard.criterion.kept else f"brings the mean to {level}"
        return f"None of the {len(curve)} values of {what.lower()} tried {failing}; most is {most}."
    if along.choices:
        good = [along.choices[int(point.value)] for point in curve if point.mean >= standard.enough]
        return f"{what}: {asked} with {', '.join(good)}."
    low, high = window
    ends = [f"from about {low:.2g}"] if low > curve[0].value else []
    ends += [f"{'to' if ends else 'up to about'} {high:.2g}"] if high < curve[-1].value else []
    where = f"{' '.join(ends)} {along.unit}".rstrip() if ends else "at every value tried"
    here = "" if low <= at <= high else ", not here"
    return f"{what}: {asked} {where}{here}{f'; most, {most}' if of_exposure else ''}."


def conditions(found: Rendered) -> str:
    """How the picture is taken, briefly."""
    exposure = found.exposure
    return (
        f"{1e3 * exposure.exposure_s:.4g} ms, {exposure.illuminance_lux:.4g} lux, {found.camera.name}, "
        f"gain {exposure.gain_db:.1f} dB"
    )


def left_out(found: Rendered) -> str:
    """How many parts of the chain would contribute and are left out."""
    contributing = [each for each in found.plan.stages if each.contribution_dn > 0]
    without = sum(not each.kept for each in contributing)
    return f"What the plan left out, and why: {without} of {len(contributing)} parts that contribute"


INSTEAD = "Light, noise and blur are as given below; for an answer choose a model that knows what is in the picture."
"""What to do where there is nothing to judge by."""
