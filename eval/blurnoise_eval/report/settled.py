"""Whether recommended exposures are settled, in words for the terminal and the page.

Domain: exposures in s, written in ms; gains in the criterion's unit. Texts are plain, never markup.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from blurnoise_eval.answers.rows import RecommendationRow
from blurnoise_eval.answers.settling import SETTLED
from blurnoise_eval.plan.axes import EXPOSURE, milliseconds
from blurnoise_eval.report.words import joined

MOST_LIGHTS = 4
"""Whose exposures that score alike are listed; of more the table has them."""


def settled_text(
    rows: Sequence[RecommendationRow],
    at: Callable[[RecommendationRow], str],
    pictures: Callable[[RecommendationRow], str],
) -> str:
    """' This is settled: ...' of one exposure, or ' 2 of these 3 are settled. 20 pictures cannot tell ...' of one for
    each light; "" from too few pictures, or where nothing is to decide.

    at: ' at 400 lux' of a row, or "". pictures: '20 pictures' of a row.
    """
    if any(row.settled is None for row in rows):
        return ""
    of, unsure = len(rows), [row for row in rows if not row.settled]
    if not unsure:
        every = {1: "This is", 2: "Both are"}.get(of, f"All {of} are")
        promised = any(row.untested_gain is not None for row in rows)
        rest = ", and by the search none that was not tested" * promised
        return f" {every} settled: no other tested exposure gains more than {SETTLED:g}{rest}."
    row = max(unsure, key=lambda row: row.rival_gain_95 or 0.0)
    known = of - len(unsure)
    some = f" {known or 'None'} of these {of} {'is' if known < 2 else 'are'} settled." * (of > 1)
    two = f"{EXPOSURE.text(row.exposure_s)} from {EXPOSURE.text(row.rival_s or 0.0)}"
    # To two digits: nobody knows it better.
    needed = None if row.pictures_to_settle is None else int(float(f"{row.pictures_to_settle:.2g}"))
    return f"{some} {pictures(row)} cannot tell {two}{at(row)}{'' if needed is None else f'; about {needed} would'}."


def alike_text(row: RecommendationRow) -> str:
    """'0.5 to 0.8 ms', the exposures that score nearly the same, ≤ and ≥ where the next one was not tested.

    "" where that is the chosen one alone.
    """
    if row.alike_from_s == row.alike_to_s:
        return ""
    low, high = milliseconds(row.alike_from_s), milliseconds(row.alike_to_s)
    return f"{'≤ ' * row.alike_from_open}{low} to {'≥ ' * row.alike_to_open}{high} ms"


def all_alike(rows: Sequence[RecommendationRow], at: Callable[[RecommendationRow], str]) -> str:
    """' 0.5 to 0.8 ms score alike, within 0.03.' of one exposure; of one for each light with where. "" where no other
    exposure does, or for more lights than one reads."""
    texts = [f"{text}{at(row)}" for row in rows if (text := alike_text(row))]
    if not texts or len(rows) > MOST_LIGHTS:
        return ""
    return f" {joined(texts)} score alike, within {SETTLED:g}."


def use_text(row: RecommendationRow) -> str:
    """'4 ms', or '4 (or 8) ms' where the pictures cannot tell which is better."""
    if row.settled is not False or row.rival_s is None:
        return EXPOSURE.text(row.exposure_s)
    return f"{milliseconds(row.exposure_s)} (or {milliseconds(row.rival_s)}) ms"


def settled_legend(rows: Iterable[RecommendationRow]) -> str:
    """What two exposures in one entry of a table mean; "" where none has two."""
    unsure = any(row.settled is False for row in rows)
    return "; 1 (or 2) ms: the pictures cannot tell which is better" * unsure
