"""A binned camera's pictures are the averages of the camera's own: mean, noise and blur."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from blurnoise_eval.explorer.binning import _BINNED, binned
from torch.nn.functional import avg_pool2d

from blurnoise import Camera, simulate
from blurnoise.light.effects import EFFECTS
from blurnoise.optics.lens import Distortion, Lens, Mtf
from blurnoise.sensor.stages import STAGES

CAMERA = replace(
    Camera.preset("imx250"), prnu=0.03, dsnu_e=4.0, dark_current_e_s=400.0, defocus_radius_px=3.0
)
MEAN_FRAME = {
    "exposure_s": 0.01,
    "illuminance_lux": 20.0,
    "noise": False,
    "quantised": False,
    "encoding": "linear",
}
READING = replace(Camera.preset("imx250"), read_noise_e=12.0, black_level_dn=100.0)


@pytest.mark.parametrize(("n", "camera", "lux"), [(2, CAMERA, 3.0), (3, CAMERA, 3.0), (2, READING, 0.01)])
def test_mean_and_variance_are_those_of_averages(n: int, camera: Camera, lux: float) -> None:
    """Of a grey picture. Of 6 n^2 x 18000 pixels a variance is known to k sqrt(2 / 18000) = 5.3 %, k = 5."""
    grey = torch.full((1, 1, 120 * n, 150 * n), 0.4)
    taken = {"exposure_s": 0.02, "illuminance_lux": lux, "fidelity": "full", "generator": [3]}
    full = simulate(grey, camera, **taken).double()
    small = simulate(grey[..., :120, :150], binned(camera, n), **taken).double()
    averages = avg_pool2d(full, n)
    noise = float(averages.std() / averages.numel() ** 0.5)
    assert float(small.mean()) == pytest.approx(float(averages.mean()), abs=5 * 2**0.5 * noise)
    rounding = (1 - 1 / n**2) / 12  # of which the average of n^2 has less
    assert float(small.var()) - rounding == pytest.approx(float(averages.var()), rel=2**0.5 * 0.053)


def test_every_figure_of_the_sensor_and_every_length_in_pixels_is_binned() -> None:
    """What a new effect or stage brings is not forgotten: of the lens's own figures the lens takes care."""
    lengths = {figure for effect in EFFECTS for figure in effect.figures if figure.endswith("_px")}
    assert lengths | {figure for stage in STAGES for figure in stage.figures} <= set(_BINNED)


def test_blur_shrinks_with_the_picture() -> None:
    edge = torch.zeros(1, 1, 64, 128)
    edge[..., 64:] = 1
    quiet = replace(CAMERA, prnu=0.0, dsnu_e=0.0)
    full = avg_pool2d(simulate(edge, quiet, velocity_px_s=(1600.0, 0.0), **MEAN_FRAME), 2)
    small = simulate(avg_pool2d(edge, 2), binned(quiet, 2), velocity_px_s=(800.0, 0.0), **MEAN_FRAME)
    assert float((full - small).abs().max()) < 0.02 * float(full.max())


@pytest.mark.parametrize(
    "lens",
    [
        Lens(distortion=Distortion("opencv", (-0.05, 0.01, 0.0, 0.0), (160.0, 160.0), (70.5, 40.5))),
        Lens(mtf=Mtf((0.0, 0.1, 0.5), (1.0, 0.5, 0.02), "cycles/px")),
    ],
    ids=["calibrated distortion", "MTF in cycles/px"],
)
def test_a_lens_in_pixels_shrinks_with_them(lens: Lens) -> None:
    """Bars stand where the averages have them, and are as sharp."""
    quiet = replace(
        Camera.preset("imx250"), read_noise_e=0.0, lens=lens, width_px=256, height_px=128, hfov_deg=60.0
    )
    bars = torch.zeros(1, 1, 128, 256)
    bars[..., 32:64], bars[..., 160:224] = 1.0, 1.0
    full = avg_pool2d(simulate(bars, quiet, **MEAN_FRAME), 2)
    small = simulate(avg_pool2d(bars, 2), binned(quiet, 2), **MEAN_FRAME)
    assert float((full - small)[..., 4:-4, 4:-4].abs().mean()) < 0.01 * float(full.max())


def test_one_is_the_camera_itself_and_none_is_refused() -> None:
    assert binned(CAMERA, 1) is CAMERA
    with pytest.raises(ValueError, match="n = 0"):
        binned(CAMERA, 0)
