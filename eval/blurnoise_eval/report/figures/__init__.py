"""The figures of a run for print: curves, example pictures with boxes, latency against robustness.

Every function takes the run and returns a matplotlib ``Figure``; none keeps global state. Figures hold at
most ``MAX_PANELS`` panels and ``MAX_LINES`` lines each and say so when they leave some out.
"""

from blurnoise_eval.report.figures.curves import (
    confidence_axis,
    confidence_blur,
    confidence_exposure,
    confidence_speed,
    score_moves,
)
from blurnoise_eval.report.figures.panels import MAX_LINES, MAX_PANELS
from blurnoise_eval.report.figures.pictures import gain_snr_brightness
from blurnoise_eval.report.figures.sheet import contact_sheet
from blurnoise_eval.report.figures.tradeoff import latency_robustness

__all__ = [
    "MAX_LINES",
    "MAX_PANELS",
    "confidence_axis",
    "confidence_blur",
    "confidence_exposure",
    "confidence_speed",
    "contact_sheet",
    "gain_snr_brightness",
    "latency_robustness",
    "score_moves",
]
