"""Words of the explorer: the sentence that answers, of a picture and a strip."""

from __future__ import annotations

from html import escape

from blurnoise.error_budget import Plan
from blurnoise_eval.explorer.controls import Control
from blurnoise_eval.explorer.looking import Seen, found, works
from blurnoise_eval.explorer.visit import Curve


def verdict(seen: Seen) -> str:
    """What the model makes of the picture, as HTML."""
    sight, threshold = seen.sight, seen.state.threshold
    if sight is None or seen.clean is None:
        white = next(each for each in seen.numbers if each.name == "snr_db")
        return f"18 % grey stands at <b>{escape(white.text)}</b> of signal to noise."
    if sight.error:
        return f'<b class="no">The model fails</b> on this picture: {escape(sight.error[:160])}'
    hits, of = found(sight, threshold)
    if not of:
        return '<b class="no">Nothing to judge by:</b> the model finds nothing in the untouched picture.'
    held = seen.confidence or 0.0
    rows = [row["confidence"] for row in sight.targets]
    what = f"{hits} of {of}" if of > 1 else ("Found" if hits else "Not found")
    kind = "" if hits == of else ' class="no"'
    verb = " found" if of > 1 else ""
    spread = f", {min(rows):.2f} to {max(rows):.2f}" if of > 1 else ""
    enough = "" if hits == of else f"; enough is {threshold:.2f}"
    return f"<b{kind}>{what}{verb}</b> at confidence {held:.2f}{spread}{enough}."


def instead(seen: Seen) -> str:
    """What to do where there is nothing to judge by, until a strip tells where it works; nothing else."""
    if seen.sight is None or seen.sight.error or seen.sight.targets:
        return ""
    return "Light, noise and blur are as told below; for an answer choose a model that knows what is in the picture."


def window(curve: Curve, along: Control, at: float, threshold: float) -> str:
    """From where to where along the strip it works."""
    kept = works(curve, threshold, at)
    what = along.title
    if kept is None:
        tried = [stop for stop in curve if stop.mean is not None]
        best = max(tried, key=lambda stop: stop.mean or 0.0, default=None)
        told = f" (highest {best.mean:.2f}, at {along.text(best.value)})" if best else ""
        return f"None of the {len(tried)} tried along {what.lower()} brings the mean to {threshold:.2f} here{told}."
    if along.choices:
        good = [along.choices[int(stop.value)] for stop in curve if (stop.mean or 0.0) >= threshold]
        return f"The mean stays at {threshold:.2f} or above with {what.lower()}: {', '.join(good)}."
    low, high = kept
    bounded = (low > curve[0].value, high < curve[-1].value)
    least, most = f"{low:.2g}", f"{high:.2g} {along.unit}".rstrip()
    if not any(bounded):
        where = "anywhere along the strip"
    elif all(bounded):
        where = f"from about {least} to {most}"
    elif bounded[1]:
        where = f"up to about {most}"
    else:
        where = f"from about {least} {along.unit}".rstrip()
    return f"{what}: the mean stays at {threshold:.2f} or above {where}{'' if low <= at <= high else ', not here'}."


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
