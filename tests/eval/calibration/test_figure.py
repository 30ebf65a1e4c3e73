"""Photon transfer of simulated flat fields against the linear model, and as figures."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import made_frames
import numpy as np
import pytest
import torch
from blurnoise_eval.calibration import figure as figures
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.levels import columns
from commands import main

from blurnoise import Camera
from blurnoise.optics.camera import PRESETS
from blurnoise.sensor import readout as sensor

DARK = replace(  # every noise there is, and a gain at which rounding is white
    PRESETS["imx250"], name="dark", dark_current_e_s=2000.0, prnu=0.02, dsnu_e=4.0, black_level_dn=40.0
)
N = figures.FRAME_PX**2
CAMERAS = [*PRESETS.values(), DARK]


def expected_dn2(camera: Camera, photo_e: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Temporal variance by the linear model."""
    dark_dn2 = camera.dark_variance_dn2(camera.dark_current_e_s * figures.EXPOSURE_S)
    return dark_dn2 + camera.system_gain_dn_per_e**2 * photo_e


def unclipped(camera: Camera, photo_e: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Levels whose pixels stay, to four standard deviations, above 0 and below the highest value."""
    electrons = photo_e + camera.dark_current_e_s * figures.EXPOSURE_S
    mean_dn = camera.black_level_dn + camera.system_gain_dn_per_e * electrons
    spread_dn = 4 * np.sqrt(expected_dn2(camera, photo_e))
    return (mean_dn - spread_dn >= 0) & (mean_dn + spread_dn <= camera.clip_dn)


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_levels_lie_on_the_models_line(camera: Camera) -> None:
    """Five standard errors; a read noise, or a gain, 5 % off lies outside them.

    The difference of two frames has the excess kurtosis of one, at most 1 / N of N photo-electrons, halved; half its
    variance over n pixels scatters by sqrt((2 + kurtosis) / n) of itself. Bringing a level to the first frame's
    light adds less than 1/n. The mean of 2n pixels scatters by sqrt(var / 2n), that of the dark as well.
    """
    dark, flat, _ = figures.simulated(camera)
    photo_e = np.array([0.0, *figures.flat_levels(camera)])
    whole = unclipped(camera, photo_e)
    assert whole.sum() >= 10
    mean_dn, seen = columns([dark, *flat], "mean_dn", "variance_dn2")

    def deviations(model: Camera) -> np.ndarray[Any, Any]:
        line, kurtosis = expected_dn2(model, photo_e), 0.5 / np.maximum(photo_e, camera.read_noise_e**2)
        return np.abs((seen - line) / line / np.sqrt((2 + kurtosis) / N))[whole].max()

    assert deviations(camera) < 5
    gain = camera.system_gain_dn_per_e
    assert deviations(replace(camera, system_gain_dn_per_e=1.05 * gain, black_level_dn=0.0)) > 5
    if not whole[0]:  # a dark that clips has no mean to count from, nor read noise
        assert camera.name == "lin2024"
        return
    assert deviations(replace(camera, read_noise_e=1.05 * camera.read_noise_e)) > 5
    line = expected_dn2(camera, photo_e)
    error = np.sqrt((line + line[0]) / (2 * N)) + camera.prnu * gain * photo_e / math.sqrt(N)
    assert np.all(np.abs(mean_dn - mean_dn[0] - gain * photo_e)[whole] <= 5 * error[whole])


def test_levels_reach_from_the_dark_beyond_saturation() -> None:
    photo_e, (_, flat, _) = figures.flat_levels(PRESETS["imx250"]), figures.simulated(PRESETS["imx250"])
    assert len(photo_e) == len(flat) == figures.LEVELS - 1
    assert np.all(np.diff(photo_e) > 0)
    assert photo_e[-1] > PRESETS["imx250"].saturation_e
    assert flat[-1].variance_dn2 < 0.01 * max(level.variance_dn2 for level in flat)


@pytest.mark.parametrize("name", ["imx250", "imx249", "mt9m034"])
def test_snr_is_one_at_the_threshold(name: str) -> None:
    """At saturation less the dynamic range; the SNR of n pixels scatters by sqrt(1.5 / n), the dark's 1 / n."""
    camera = PRESETS[name]
    threshold_e = camera.saturation_e / 10 ** (camera.dynamic_range_db / 20)
    taken: Any = {"exposure_s": 0.0, "temperature_c": 20.0}
    dark, lit = (
        sensor.read_out(torch.full((1, 1, 600, 600), level), camera, generator=seed, **taken).double()
        for seed, level in enumerate((0.0, threshold_e))
    )
    snr = float(lit.mean() - dark.mean()) / float(lit.std())
    assert snr == pytest.approx(1, abs=5 * math.sqrt(2.5 / lit.numel()))


def test_figure_of_a_camera_holds_levels_and_what_a_fit_finds() -> None:
    """The gain to 1 %: 24 levels of 0.55 % each."""
    camera = PRESETS["imx250"]
    figure = figures.draw_camera(camera)
    transfer, _ = figure.axes
    lines = {str(line.get_label()): line for line in transfer.lines}
    _, flat, _ = figures.simulated(camera)
    used = len(lines["flat"].get_ydata())
    np.testing.assert_array_equal(lines["flat"].get_ydata(), columns(flat[:used], "variance_dn2")[0])
    text = next(label for label in lines if label.startswith("K "))
    assert float(text.split()[1]) == pytest.approx(camera.system_gain_dn_per_e, rel=0.01)
    title = figure.get_suptitle()
    for word in ("K 0.3816", "read noise 2.45", "10715 e", "SNR max 40.3 dB", "70.7 dB", "SNR 1 at 3.11"):
        assert word in title


def test_figure_of_frames_holds_their_levels(tmp_path: Path) -> None:
    camera = made_frames.drawn_camera(3)
    found = measure(made_frames.save(tmp_path / "f", made_frames.exposed(camera, 3, size=(64, 81))))
    axes = figures.draw_fit(found, "mine").axes
    assert len(axes) == 3
    dark, flat = axes[0].lines[:2]
    assert len(dark.get_ydata()) == len(found.dark)
    assert len(flat.get_ydata()) == len(found.used)
    assert "off the line" in axes[2].get_title()


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_plot(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"camera.{suffix}"
    assert main(["cameras", "imx250", "--plot", str(path)]) == 0
    assert {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[suffix] in path.read_bytes()[:100]
    assert suffix != "png" or cv2.imread(str(path)).shape[0] > 500


def test_plot_of_a_camera_that_always_clips() -> None:
    odd = replace(
        PRESETS["imx250"], bit_depth=1, system_gain_dn_per_e=0.1, black_level_dn=0.0, read_noise_e=0.0
    )
    assert figures.draw_camera(odd).axes
