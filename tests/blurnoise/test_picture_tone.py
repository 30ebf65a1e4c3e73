"""A picture's own tone curve, taken out before it is exposed: against curves written out here."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from blurnoise import Camera, RandomExposure, Scene, simulate
from blurnoise.camera.colour import toned, untoned

CAMERA_TONES = Path(__file__).parents[1] / "data" / "camera_tones.csv"
LIGHT = np.linspace(0.0, 1.0, 201)
POINTS = (
    (0.0, 0.0),
    (0.1, 0.4),
    (0.5, 0.4),
    (0.8, 1.0),
    (1.0, 1.0),
)  # level in the middle and where it clips


def srgb(light):
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def filmic(light):
    """Brooks et al. 2019, eq. 5: a smoothstep of the coded value."""
    value = srgb(light)
    return 3 * value**2 - 2 * value**3


CURVES: list[Any] = [("srgb", srgb), ("filmic", filmic), ("linear", lambda light: light)]


@pytest.mark.parametrize(("name", "coded"), CURVES)
def test_a_pictures_light_is_that_of_its_curve(name, coded):
    """In double precision to 1e-7, in 8 bits to what one of them is worth; and a frame is that of its light."""
    values = torch.from_numpy(coded(LIGHT))
    assert np.abs(untoned(values, name).numpy() - LIGHT).max() < 1e-7
    if name != "linear":
        assert toned(torch.from_numpy(LIGHT), name).numpy() == pytest.approx(coded(LIGHT), abs=1e-7)
    picture = np.rint(255 * coded(LIGHT)).astype(np.uint8).reshape(3, 67, 1).repeat(3, 2)
    seen = Scene.of_picture(picture, encoding=name).light[0, 0].flatten().numpy()
    assert np.abs(coded(seen) - coded(LIGHT)).max() < 0.51 / 255
    given: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 60.0, "noise": False, "quantised": False}
    camera = Camera.preset("imx250")
    image, light = values.float().view(1, 1, 3, 67), torch.from_numpy(LIGHT).float().view(1, 1, 3, 67)
    frame = simulate(image, camera, encoding=name, **given)
    assert torch.allclose(frame, simulate(light, camera, encoding="linear", **given), rtol=1e-4)


def test_the_typical_curve_is_the_median_of_the_measured_cameras():
    """At each value the light relative to that of 128, in stops; the file has two decimals, the curve four."""
    with CAMERA_TONES.open() as lines:
        cameras = list(csv.DictReader(lines))
    values = list(cameras[0])[3:]
    measured = [np.median([float(camera[value]) for camera in cameras if camera[value]]) for value in values]
    coded = torch.tensor(
        [255.0 if value == "clip" else float(value) for value in values], dtype=torch.float64
    )
    stops = torch.log2(untoned(coded / 255, "typical") / untoned(coded[values.index("128")] / 255, "typical"))
    assert stops.tolist() == pytest.approx(measured, abs=0.04)
    assert len(cameras) == 15


def test_points_are_inverted_and_level_parts_are_their_least_light():
    coded = torch.tensor([0.0, 0.2, 0.4, 0.7, 1.0], dtype=torch.float64)
    assert untoned(coded, POINTS).tolist() == pytest.approx([0.0, 0.05, 0.1, 0.65, 0.8])
    rising = ((0.0, 0.02), (0.2, 0.5), (1.0, 0.9))
    light = torch.from_numpy(LIGHT)
    assert untoned(toned(light, rising), rising).numpy() == pytest.approx(LIGHT)
    beyond = torch.tensor([0.0, 1.0], dtype=torch.float64)
    assert untoned(beyond, rising).tolist() == pytest.approx([0.0, 1.0])


@pytest.mark.parametrize(
    ("encoding", "kind"),
    [("gamma", ValueError), (3, TypeError), ([[0, 0]], ValueError), ([[0, 0], [0.5, 1]], ValueError)],
)
def test_what_is_no_curve_is_named(encoding, kind):
    for use in (
        lambda: simulate(torch.zeros(1, 1, 4, 4), Camera.preset("imx250"), encoding=encoding, exposure_s=1e-2,
                         illuminance_lux=1.0),
        lambda: RandomExposure(encoding=encoding),
    ):  # fmt: skip
        with pytest.raises(kind, match="encoding = "):
            use()


def test_training_pictures_leave_their_curve_and_get_the_cameras():
    """Noise is 1 % of white here: the mean of 1e4 pixels is right to 1e-3."""
    camera = Camera.from_dict({"base": "imx250", "tone": [[0, 0], [0.25, 0.6], [1, 1]]})
    image = torch.full((1, 3, 100, 100), float(filmic(np.array(0.2))))
    white = {"exposure_s": (0.01, 0.01), "illuminance_lux": (155.0, 155.0), "speed_px_s": (0.0, 0.0)}
    seen = RandomExposure(camera, encoding="filmic", p=1.0, **white)(image)
    electrons = 0.2 * 155.0 * 0.01 * 6906.0  # of the preset, tests/blurnoise/camera/test_camera_files.py
    share = electrons * camera.sensor.system_gain_dn_per_e / (4095 - camera.sensor.black_level_dn)
    assert float(seen.mean()) == pytest.approx(np.interp(share, [0, 0.25, 1], [0, 0.6, 1]), abs=2e-3)
