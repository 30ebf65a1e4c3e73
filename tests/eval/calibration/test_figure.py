"""Photon transfer of the simulator's flat fields, and the figure of measured frames."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import made_frames
import pytest
import torch
from blurnoise_eval.calibration.figure import draw_fit
from blurnoise_eval.calibration.fit import measure

from blurnoise.optics.camera import PRESETS
from blurnoise.sensor import readout as sensor


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


def test_figure_of_frames_shows_their_levels(tmp_path: Path) -> None:
    camera = made_frames.drawn_camera(3)
    found = measure(made_frames.save(tmp_path / "f", made_frames.exposed(camera, 3, size=(64, 81))))
    axes = draw_fit(found, "mine").axes
    assert len(axes) == 2
    dark, flat = axes[0].lines[:2]
    assert len(dark.get_ydata()) == len(found.dark)
    assert len(flat.get_ydata()) == len(found.used)
    assert "off the line" in axes[1].get_title()
