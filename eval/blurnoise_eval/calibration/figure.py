"""Figure of a measurement: photon transfer, linearity, and what each leaves of the other."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from blurnoise_eval.calibration.checks import Z
from blurnoise_eval.calibration.fit import Measurement
from blurnoise_eval.calibration.levels import columns
from blurnoise_eval.plots.style import COLOURS, GREY, tidy
from blurnoise_eval.system.terminal import plain

_FLAT, _DARK, _LEFT_OUT = COLOURS[0], "black", COLOURS[1]
_HOLLOW: Any = {"ms": 5.0, "mfc": "white", "mew": 1.3}


def draw(found: Measurement, name: str) -> Figure:
    """Variance over mean with its residuals, signal over light with its deviation from the line."""
    figure = Figure(figsize=(11.4, 7.2), layout="constrained")
    (transfer, linear), (residuals, deviation) = figure.subplots(2, 2, height_ratios=(2, 1))
    _transfer(transfer, residuals, found)
    _linearity(linear, deviation, found)
    figure.suptitle(f"{plain(name)}: photon transfer of {found.frames}", fontsize=11, parse_math=False)
    return figure


def _transfer(above: Axes, below: Axes, found: Measurement) -> None:
    black, dark = found.fit.dark.offset, found.dark
    used = [found.flat[place] for place in found.used]
    out = [level for level in found.flat if level not in used]
    for levels, colour, label in (
        (dark, _DARK, "dark"), (used, _FLAT, "flat"), (out, _LEFT_OUT, "flat, left out of the fit")
    ):  # fmt: skip
        if levels:
            mean, variance = columns(levels, "mean_dn", "variance_dn2")
            above.plot(mean - black, variance, "o", color=colour, label=label, **_HOLLOW)
    gain, read = (found.estimates[each] for each in ("system_gain_dn_per_e", "read_noise_e"))
    signal = np.geomspace(0.1, max(level.mean_dn for level in found.flat) - black, 200)
    line = (gain.value * read.value) ** 2 + 1 / 12 + gain.value * signal
    label = (
        f"K {gain.value:.4g} ({gain.low:.4g}-{gain.high:.4g}) DN/e⁻\n"
        f"read noise {read.value:.3g} ({read.low:.3g}-{read.high:.3g}) e⁻"
    )
    above.plot(signal, line, color=GREY, lw=1.2, zorder=1, label=label)
    above.set_xscale("symlog", linthresh=1.0)
    above.set_yscale("log")
    above.legend(fontsize=8, frameon=False, loc="upper left")
    tidy(above, x="Mean above the black level / DN", y="Temporal variance / DN²")
    variance, error = columns([*dark, *used], "variance_dn2", "variance_error_dn2")
    off = (variance - found.fit.expected_dn2) / np.maximum(error, 1e-9)
    places = np.arange(1, len(off) + 1)
    below.plot(places[: len(dark)], off[: len(dark)], "o", ms=4, color=_DARK)
    below.plot(places[len(dark) :], off[len(dark) :], "o", ms=4, color=_FLAT)
    below.axhspan(-Z, Z, color="0.94", zorder=0)
    tidy(below, x="Level, dark ones first (grey: 95 %)", y="Residual / standard deviations")


def _linearity(above: Axes, below: Axes, found: Measurement) -> None:
    linear = found.linearity
    tidy(above, below)
    if linear is None:
        for axes in (above, below):
            text = "too few levels for linearity"
            axes.text(0.5, 0.5, text, ha="center", fontsize=9, transform=axes.transAxes)
        return
    scale, label = (1.0, "Light / photons per pixel") if linear.by_photons else (1e3, "Exposure / ms")
    x, line = scale * linear.x, linear.slope * linear.x + linear.offset
    above.plot(x, line * (1 + linear.deviation), "o", color=_FLAT, **_HOLLOW)
    above.plot(x, line, color=GREY, lw=1.2, zorder=1)
    below.plot(x, 100 * linear.deviation, "o", ms=4, color=_FLAT)
    below.axhline(0, color=GREY, lw=1)
    reach = 300 * max(linear.error.value, 1e-4)  # levels that saturate are far below
    below.set_ylim(-reach, reach)
    tidy(above, x=label, y="Signal / DN")
    tidy(below, x=label, y="Off the line / %")
