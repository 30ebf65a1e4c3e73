"""Words of the explorer: the sentence that answers, of a picture and a strip."""

from __future__ import annotations

from html import escape

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
    return f"<b{kind}>{what}{verb}</b> at confidence {held:.2f}{spread}."


def window(curve: Curve, along: Control, at: float, threshold: float) -> str:
    """From where to where along the strip it works."""
    kept = works(curve, threshold, at)
    what = along.title
    if kept is None:
        return f"No value of {what.lower()} reaches {threshold:.2f} here."
    stops = [value for value, _ in curve]
    if along.choices:
        good = [along.choices[int(value)] for value, held in curve if held is not None and held >= threshold]
        return f"{what} that works here: {', '.join(good)}."
    low, high = kept
    ends = (low > stops[0], high < stops[-1])
    inside = low <= at <= high
    if not any(ends):
        told = f"Any {what.lower()} from {along.text(low)} to {along.text(high)} works here"
    elif all(ends):
        told = f"{what} works from about {along.text(low)} to {along.text(high)} here"
    elif ends[1]:
        told = f"{what} works up to about {along.text(high)} here"
    else:
        told = f"{what} works from about {along.text(low)} here"
    return f"{told}{'' if inside else f'; it stands at {along.text(at)}'}."
