"""Words of the explorer: the sentence that answers, of a picture and a strip."""

from __future__ import annotations

from html import escape

from blurnoise.scene.plan import Plan
from blurnoise_eval.explorer.controls import Control
from blurnoise_eval.explorer.judging import Standard, keeps_most, works
from blurnoise_eval.explorer.looking import Seen, found
from blurnoise_eval.explorer.visit import Curve
from blurnoise_eval.grid.axes import EXPOSURE


def verdict(seen: Seen) -> str:
    """What the model makes of the picture, as HTML."""
    sight, standard = seen.sight, seen.standard
    if sight is None or standard is None:
        grey = next(each for each in seen.numbers if each.name == "snr_db")
        return f"18 % grey stands at <b>{escape(grey.text)}</b> of signal to noise."
    if sight.error:
        return f'<b class="no">The model fails</b> on this picture: {escape(sight.error[:160])}'
    scores, level = standard.scores(sight), standard.criterion.level
    if not scores:
        return '<b class="no">Nothing to judge by:</b> the model finds nothing in the original picture.'
    mean = sum(scores) / len(scores)
    value = standard.value(mean)
    hits, of = found(sight, standard.found_from)
    what = f"Keeps {standard.text(value)}" if standard.criterion.kept else f"{standard.title} {mean:.2f}"
    rest = f" of its {_noun(standard)} in the original ({mean:.2f} of {standard.original:.2f})"
    kind = "" if value >= level else ' class="no"'
    enough = "" if value >= level else f"; enough is {standard.text(level)}"
    return f"<b{kind}>{what}</b>{rest if standard.criterion.kept else ''}, {hits} of {of} found{enough}."


def instead(seen: Seen) -> str:
    """What to do where there is nothing to judge by, until a strip shows where it works; nothing else."""
    if seen.sight is None or seen.sight.error or seen.sight.targets:
        return ""
    return "Light, noise and blur are as told below; for an answer choose a model that knows what is in the picture."


def window(curve: Curve, along: Control, at: float, standard: Standard) -> str:
    """From where to where along the strip the model works, and which exposure keeps most."""
    kept = works(curve, standard.enough, at, logarithmic=along.logarithmic)
    what, level = along.title, standard.text(standard.criterion.level)
    asked = f"keeps {level} or more" if standard.criterion.kept else f"the mean is {level} or more"
    tried = [(stop, stop.mean) for stop in curve if stop.mean is not None]
    best, of_best = max(tried, key=lambda each: each[1], default=(None, 0.0))
    if along.name == EXPOSURE.name and (most := keeps_most(curve, standard)) is not None:
        best, of_best = most, most.mean or 0.0
    highest = f"{standard.text(standard.value(of_best))} at {along.text(best.value)}" if best else ""
    if kept is None:
        told = f"; most is {highest}" if best else ""
        failing = f"keeps {level}" if standard.criterion.kept else f"brings the mean to {level}"
        return f"None of the {len(tried)} values of {what.lower()} tried {failing}{told}."
    if along.choices:
        good = [along.choices[int(stop.value)] for stop, mean in tried if mean >= standard.enough]
        return f"{what}: {asked} with {', '.join(good)}."
    low, high = kept
    bounded = (low > curve[0].value, high < curve[-1].value)
    least, top = f"{low:.2g}", f"{high:.2g} {along.unit}".rstrip()
    if not any(bounded):
        where = "anywhere along the strip"
    elif all(bounded):
        where = f"from about {least} to {top}"
    elif bounded[1]:
        where = f"up to about {top}"
    else:
        where = f"from about {least} {along.unit}".rstrip()
    use = f"; most, {highest}" if along.name == EXPOSURE.name else ""
    return f"{what}: {asked} {where}{'' if low <= at <= high else ', not here'}{use}."


def _noun(standard: Standard) -> str:
    return standard.criterion.text.rpartition(" of its ")[2]


def conditions(seen: Seen) -> str:
    """How the picture is taken, briefly."""
    exposure = seen.frame.exposure
    if exposure is None:
        return ""
    return (
        f"{1e3 * exposure.exposure_s:.4g} ms, {exposure.illuminance_lux:.4g} lux, {seen.camera.name}, "
        f"gain {exposure.gain_db:.1f} dB"
    )


def left_out(plan: Plan) -> str:
    """How many parts of the chain would contribute and are left out."""
    without = sum(not each.kept and each.contribution_dn > 0 for each in plan.stages)
    none = sum(each.contribution_dn == 0 for each in plan.stages)
    return f"What the plan left out, and why: {without} of {len(plan.stages) - none} parts that contribute"
