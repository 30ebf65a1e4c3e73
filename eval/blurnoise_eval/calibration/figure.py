"""Figures of photon transfer, temporal variance over mean: of measured frames, and of a camera's simulated ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from blurnoise.metrics.values import Estimate
from blurnoise.optics.camera import Camera
from blurnoise.sensor.readout import read_out
from blurnoise_eval.calibration.fit import Measurement
from blurnoise_eval.calibration.frames import Floats, Frame
from blurnoise_eval.calibration.levels import Level, columns, dark_pattern, level_of
from blurnoise_eval.calibration.transfer import Transfer, fit
from blurnoise_eval.plots.style import COLOURS, GREY, small_multiples, tidy
from blurnoise_eval.system.terminal import plain

LEVELS = 32
FRAME_PX = 256
EXPOSURE_S = 0.01
USED = 0.7  # of saturation: the levels that EMVA 1288 fits


def draw_fit(found: Measurement, name: str) -> Figure:
    """Of frames: variance over mean, SNR over electrons, and signal over light."""
    used = [found.flat[place] for place in found.used]
    out = [level for level in found.flat if level not in used]
    figure, panels = _transfer(found.dark, used, out, found.fit, found.estimates, 3 if found.linearity else 2)
    if linear := found.linearity:
        scale, label = (1.0, "Light / photons per pixel") if linear.by_photons else (1e3, "Exposure / ms")
        line = linear.slope * linear.x + linear.offset
        panels[2].plot(scale * linear.x, line * (1 + linear.deviation), "o", color=COLOURS[0], **_HOLLOW)
        panels[2].plot(scale * linear.x, line, color=GREY, lw=1.2, zorder=1)
        title = f"at most {100 * linear.error.value:.2g} % off the line"
        tidy(panels[2], title=title, x=label, y="Signal / DN")
    figure.suptitle(f"{plain(name)}: photon transfer of {found.frames}", fontsize=11, parse_math=False)
    return figure


def draw_camera(camera: Camera) -> Figure:
    """Of a camera's simulated flat fields: variance over mean, SNR over electrons, and a fit to them."""
    dark, flat, mean = simulated(camera)
    photo_e = flat_levels(camera)
    used = [level for level, light in zip(flat, photo_e, strict=True) if light < USED * camera.saturation_e]
    found = fit([dark], used, dark_pattern(mean, [dark]))
    figure, panels = _transfer([dark], used, flat[len(used) :], found, found.estimates(dark.pixels), panels=2)
    for panel, per_e in zip(panels, (camera.system_gain_dn_per_e, 1.0), strict=True):
        panel.axvline(per_e * camera.saturation_e, color=COLOURS[1], lw=1)
    title = (
        f"{plain(camera.name)}: K {camera.system_gain_dn_per_e:.4g} DN/e⁻, read noise {camera.read_noise_e:.3g} e⁻, "
        f"saturation {camera.saturation_e:.0f} e⁻\nSNR max {camera.snr_max_db:.1f} dB, SNR 1 at "
        f"{camera.threshold_e:.3g} e⁻, {camera.dynamic_range_db:.1f} dB dynamic range"
    )
    figure.suptitle(title, fontsize=10, parse_math=False)
    return figure


def flat_levels(camera: Camera) -> Floats:
    """Photo-electrons of ``LEVELS`` - 1 flat fields, from half an electron up to beyond saturation."""
    full_e = camera.saturation_e
    last = full_e + np.sqrt(full_e) * np.array([-1.0, 0.0, 1.0, 2.0, 4.0])  # a shot noise apart
    return np.concatenate([np.geomspace(min(0.5, full_e / 100), 0.9 * full_e, LEVELS - 6), last])


def simulated(camera: Camera) -> tuple[Level, list[Level], Floats]:
    """The dark level, those of :func:`flat_levels`, and the dark mean (H, W), of two simulated frames each.

    Frames of ``FRAME_PX`` squared, ``EXPOSURE_S`` at the dark current's reference temperature, fixed pattern
    included. The same camera gives the same numbers.
    """
    shape = (1, FRAME_PX, FRAME_PX)
    pattern = camera.fixed_pattern(shape, seed=0)
    levels, means = list[Level](), list[Floats]()
    for number, electrons in enumerate([0.0, *flat_levels(camera)]):
        pair = read_out(
            torch.full((2, *shape), float(electrons)),
            camera,
            exposure_s=EXPOSURE_S,
            temperature_c=camera.dark_reference_c,
            generator=[2 * number, 2 * number + 1],
            fixed_pattern=pattern,
        )
        frame = Frame(file=Path(), kind="flat" if number else "dark", exposure_s=EXPOSURE_S)
        dark_dn = levels[0].mean_dn if levels else 0.0
        level, mean = level_of(pair[:, 0].numpy().astype(np.uint16), frame, dark_dn)
        levels.append(level)
        means.append(mean)
    return levels[0], levels[1:], means[0] - levels[0].mean_dn


_HOLLOW: Any = {"ms": 5, "mfc": "white", "mew": 1.3}


def _transfer(
    dark: Sequence[Level], used: Sequence[Level], out: Sequence[Level], found: Transfer,
    estimates: dict[str, Estimate], panels: int,
) -> tuple[Figure, list[Axes]]:  # fmt: skip
    """Levels and the fit of the linear model: variance over mean, SNR over electrons."""
    figure, every = small_multiples(panels, panels, (5.4, 4.6), (0.0, 0.4))
    transfer, snr = every[:2]
    most = max(level.mean_dn for level in [*used, *out]) - found.dark.offset
    signal = np.geomspace(0.1, max(most, 1.0), 200)
    line = found.read_dn2 + 1 / 12 + found.gain * signal
    for label, colour, levels in (
        ("dark", "black", dark), ("flat", COLOURS[0], used), ("flat, left out of the fit", COLOURS[1], out)
    ):  # fmt: skip
        mean, variance = columns(
            [level for level in levels if level.variance_dn2 > 0], "mean_dn", "variance_dn2"
        )
        above = mean - found.dark.offset
        transfer.plot(above, variance, "o", color=colour, label=label, **_HOLLOW)
        if label != "dark":
            snr.plot(above / found.gain, above / np.sqrt(variance), "o", color=colour, label=label, **_HOLLOW)
    gain, read = estimates["system_gain_dn_per_e"], estimates["read_noise_e"]
    text = (
        f"K {gain.value:.4g} ({gain.low:.4g}-{gain.high:.4g}) DN/e⁻\n"
        f"read noise {read.value:.3g} ({read.low:.3g}-{read.high:.3g}) e⁻"
    )
    transfer.plot(signal, line, color=GREY, lw=1.2, zorder=1, label=text)
    electrons, modelled = signal / found.gain, signal / np.sqrt(line)
    snr.plot(electrons, modelled, color=GREY, lw=1.2, zorder=1, label="linear model of EMVA 1288")
    snr.plot(electrons, np.sqrt(electrons), color=GREY, lw=1, ls="--", zorder=1, label="shot noise alone")
    transfer.set_xscale("symlog", linthresh=1.0)
    transfer.set(yscale="log", ylim=(line[0] / 3, 5 * line[-1]))
    snr.set(xscale="log", yscale="log", ylim=(modelled[0] / 2, 8 * modelled[-1]))
    tidy(transfer, x="Mean above the black level / DN", y="Temporal variance / DN²")
    tidy(snr, x="Signal / e⁻", y="Temporal SNR")
    for axes in (transfer, snr):
        axes.legend(fontsize=8, frameon=False, loc="upper left")
    return figure, every
