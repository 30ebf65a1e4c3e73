"""A camera's photon transfer, simulated, against the linear model of EMVA 1288.

Measured as EMVA 1288 does: two frames of a flat field at every level; half the variance of their difference is the
temporal variance, free of the fixed pattern.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera
from blurnoise.sensor.readout import read_out
from blurnoise_eval.plots.style import COLOURS, GREY, tidy
from blurnoise_eval.system.files import plot_suffix, write_figure
from blurnoise_eval.system.terminal import plain

Floats = NDArray[np.float64]
LEVELS = 32
FRAME_PX = 256
EXPOSURE_S = 0.01
_MEASURED, _MODEL, _MARK = COLOURS[0], "black", COLOURS[1]


class PhotonTransfer(NamedTuple):
    """Mean and temporal variance of flat fields, one entry per level.

    photo_e: mean photo-electrons. signal_dn: mean above that in the dark. variance_dn2: temporal.
    """

    photo_e: Floats
    signal_dn: Floats
    variance_dn2: Floats

    @property
    def snr(self) -> Floats:
        """Signal over temporal noise; infinite where nothing varies."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.signal_dn / np.sqrt(self.variance_dn2)


def expected(camera: Camera, photo_e: Floats) -> PhotonTransfer:
    """The linear model's line, which knows no saturation: variance = that in the dark + K signal."""
    signal_dn = camera.system_gain_dn_per_e * photo_e
    dark_dn2 = camera.dark_variance_dn2(camera.dark_current_e_s * EXPOSURE_S)
    return PhotonTransfer(photo_e, signal_dn, dark_dn2 + camera.system_gain_dn_per_e * signal_dn)


def measured(camera: Camera) -> PhotonTransfer:
    """From pairs of simulated flat fields: in the dark, from half an electron up, and beyond saturation.

    ``LEVELS`` levels, frames of ``FRAME_PX`` squared, ``EXPOSURE_S`` at the dark current's reference
    temperature, fixed pattern included. The same camera gives the same numbers.
    """
    full_e = camera.saturation_e
    last = full_e + np.sqrt(full_e) * np.array([-1.0, 0.0, 1.0, 2.0, 4.0])  # a shot noise apart
    photo_e = np.concatenate([[0.0], np.geomspace(min(0.5, full_e / 100), 0.9 * full_e, LEVELS - 6), last])
    shape = (1, FRAME_PX, FRAME_PX)
    pattern = camera.fixed_pattern(shape, seed=0)
    means, variances = np.empty(LEVELS), np.empty(LEVELS)
    for level, electrons in enumerate(photo_e):
        pair = read_out(
            torch.full((2, *shape), float(electrons)),
            camera,
            exposure_s=EXPOSURE_S,
            temperature_c=camera.dark_reference_c,
            generator=[2 * level, 2 * level + 1],
            fixed_pattern=pattern,
        ).double()
        means[level] = float(pair.mean())
        variances[level] = float((pair[0] - pair[1]).var()) / 2
    return PhotonTransfer(photo_e, means - means[0], variances)


def unclipped(camera: Camera, photo_e: Floats) -> NDArray[np.bool_]:
    """Levels whose pixels stay, to four standard deviations, above 0 and below the highest value."""
    line = expected(camera, photo_e)
    dark_dn = camera.system_gain_dn_per_e * camera.dark_current_e_s * EXPOSURE_S
    mean_dn, spread_dn = camera.black_level_dn + dark_dn + line.signal_dn, 4 * np.sqrt(line.variance_dn2)
    return np.asarray((mean_dn - spread_dn >= 0) & (mean_dn + spread_dn <= camera.clip_dn), np.bool_)


def fitted(camera: Camera, points: PhotonTransfer) -> tuple[float, float]:
    """Gain in DN/e- and read noise in e- by ``points``, as EMVA 1288 reads them off.

    The gain is the slope of the variance up to 70 % of saturation, each level weighted by its precision,
    and NaN where fewer than two such levels are free of clipping; so is the read noise.
    """
    low = unclipped(camera, points.photo_e) & (points.photo_e < 0.7 * camera.saturation_e)
    if low.sum() < 2:
        return math.nan, math.nan
    signal, variance = points.signal_dn[low], points.variance_dn2[low]
    gain = float(np.polyfit(signal, variance, 1, w=1 / np.maximum(variance, 1 / 12))[0])
    read_e2 = (points.variance_dn2[0] - 1 / 12) / gain**2 - camera.dark_current_e_s * EXPOSURE_S
    return gain, math.sqrt(max(0.0, float(read_e2)))


def draw(camera: Camera) -> Figure:
    """The photon-transfer plot, variance over mean, beside the SNR over photo-electrons; both measured."""
    points, full_e = measured(camera), camera.saturation_e
    line = expected(camera, np.geomspace(points.photo_e[1] / 1.5, full_e, 200))
    figure = Figure(figsize=(11.4, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    _points(left, points.signal_dn, points.variance_dn2, unclipped(camera, points.photo_e))
    _points(right, points.photo_e, points.snr, unclipped(camera, points.photo_e))
    left.loglog(line.signal_dn, line.variance_dn2, **_LINE)
    right.loglog(line.photo_e, line.snr, **_LINE)
    tidy(left, x="Mean above the dark / DN", y="Temporal variance / DN²")
    tidy(right, x="Photo-electrons N", y="Temporal SNR")
    _explain_transfer(left, camera, line, fitted(camera, points))
    _explain_snr(right, camera, line)
    for axes, at in ((left, float(line.signal_dn[-1])), (right, full_e)):
        axes.axvline(at, color=_MARK, lw=1)
        axes.annotate(
            f"saturation, {full_e:.0f} e⁻", (at, 0.5), xycoords=("data", "axes fraction"), xytext=(5, 0),
            textcoords="offset points", rotation=90, ha="left", va="center", color=_MARK, fontsize=8.5,
        )  # fmt: skip
        axes.legend(loc="upper left", fontsize=8.5, frameon=False)
    title = f"{plain(camera.name)}: photon transfer, from pairs of simulated flat fields at {LEVELS} levels"
    figure.suptitle(title, fontsize=11, parse_math=False)
    return figure


def write(camera: Camera, path: Path) -> None:
    """Write :func:`draw`'s figure as PNG, SVG or PDF. Raises ``ValueError`` (suffix) or ``OSError``."""
    plot_suffix(path)  # raises before anything is drawn
    write_figure(path, draw(camera), dpi=150)


_LINE = {"color": _MODEL, "lw": 1.3, "zorder": 3, "label": "linear model of EMVA 1288"}


def _points(axes: Axes, x: Floats, y: Floats, whole: NDArray[np.bool_]) -> None:
    """The measured points that logarithmic axes have a place for, those of clipped levels apart."""
    shown = (x > 0) & (y > 0) & np.isfinite(y)
    for kept, colour, label in (
        (shown & whole, _MEASURED, "measured"),
        (shown & ~whole, _MARK, "measured where pixels clip"),
    ):
        axes.loglog(x[kept], y[kept], "o", ms=5, mfc="white", mew=1.3, color=colour, zorder=4, label=label)


def _explain_transfer(axes: Axes, camera: Camera, line: PhotonTransfer, fit: tuple[float, float]) -> None:
    gain, dark_dn2 = camera.system_gain_dn_per_e, float(expected(camera, np.zeros(1)).variance_dn2[0])
    right = float(line.signal_dn[-1])
    shot = gain * line.signal_dn
    axes.loglog(line.signal_dn, shot, color=GREY, lw=1, ls=(0, (5, 3)), label="shot noise alone")
    axes.axhline(dark_dn2, color=GREY, lw=1, ls=(0, (1, 2)), label="in the dark")
    axes.set_xlim(float(line.signal_dn[0]), 2.5 * right)
    axes.set_ylim(dark_dn2 / 5, 8 * float(line.variance_dn2[-1]))
    middle = gain * float(np.sqrt(dark_dn2 / gain * right))
    note = "" if unclipped(camera, np.zeros(1))[0] else ", since the dark clips"
    _say(axes, (right, middle), (-10, -8), f"K = {gain:.4g} DN/e⁻\nmeasured {fit[0]:.4g}", "right")
    floor = f"read noise {camera.read_noise_e:.3g} e⁻\nmeasured {fit[1]:.3g}{note}"
    _say(axes, (right, dark_dn2), (-10, -6), floor, "right")


def _explain_snr(axes: Axes, camera: Camera, line: PhotonTransfer) -> None:
    first, full, low = float(line.photo_e[0]), camera.saturation_e, camera.threshold_e
    bottom = float(line.snr[0]) / 4
    axes.loglog(line.photo_e, np.sqrt(line.photo_e), color=GREY, lw=1, ls=(0, (5, 3)), label="ideal, √N")
    axes.plot([first, low, low], [1, 1, bottom], color=GREY, lw=1, ls=(0, (1, 2)))
    axes.set_xlim(first, 2.5 * full)
    axes.set_ylim(bottom, 3 * full**0.5)
    height = bottom * 1.7
    axes.annotate("", (low, height), (full, height), arrowprops={"arrowstyle": "<->", "color": GREY, "lw": 1})
    reach = f"{camera.dynamic_range_db:.1f} dB dynamic range"
    _say(axes, (float(np.sqrt(low * full)), height), (0, 4), reach, "center", "bottom")
    _say(axes, (low, 1), (8, -3), f"SNR 1 at {low:.3g} e⁻")
    _say(axes, (full, full**0.5), (-10, 8), f"SNR max {camera.snr_max_db:.1f} dB", "right", "bottom")


def _say(
    axes: Axes, at: tuple[float, float], offset_pt: tuple[float, float], text: str,
    ha: str = "left", va: str = "top",
) -> None:  # fmt: skip
    axes.annotate(
        text, at, xytext=offset_pt, textcoords="offset points", ha=ha, va=va, fontsize=8.5, color="0.2",
    )  # fmt: skip
