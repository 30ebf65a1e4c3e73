"""Lights and scores in the sentences of programs and of caps."""

from __future__ import annotations

from collections.abc import Sequence

from blurnoise_eval.report.words import counted
from blurnoise_eval.scoring.uncertainty import FEWEST


def lux_text(light_lux: float, digits: int = 4) -> str:
    """So many digits, without powers of ten.

    >>> lux_text(69823.4), lux_text(0.31623, 2)
    ('69820', '0.32')
    """
    return f"{float(f'{light_lux:.{digits}g}'):.8g}"


def lights_text(lights_lux: Sequence[float]) -> str:
    """'From 5 to 500 lux', or 'At 50 lux' for a single one; from dark to bright.

    >>> lights_text([5.0, 50.0, 500.0]), lights_text([50.0])
    ('From 5 to 500 lux', 'At 50 lux')
    """
    dark, bright = lux_text(lights_lux[0]), lux_text(lights_lux[-1])
    return f"At {dark} lux" if dark == bright else f"From {dark} to {bright} lux"


def too_few(pictures: int) -> str:
    """The beginning of a sentence on pictures.

    >>> too_few(1), too_few(7), too_few(10)
    ('1 picture is too few', '7 pictures are too few', '10 pictures of unequal weight are too few')
    """
    weight = " of unequal weight" if pictures >= FEWEST else ""
    return f"{counted(pictures, 'picture')}{weight} {'is' if pictures == 1 else 'are'} too few"


def score_text(value: float | None) -> str:
    """Three decimals, or '-' for what is unknown.

    >>> score_text(0.9254), score_text(None)
    ('0.925', '-')
    """
    return "-" if value is None else f"{value:.3f}"
