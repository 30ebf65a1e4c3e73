"""The Kornia augmentation with cameras that have a gain, and colours: what is drawn, metered and given back."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from batches import pictures

from blurnoise import AutoExposure, Camera
from blurnoise.training.augmentation import RandomExposure, expose_pictures
from blurnoise.training.ranges import ExposureRanges

TWO = ("imx250", "ar0237")
_RANGES = ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg", "temperature_c")


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("encoding", ["srgb", "linear"])
def test_colour_cameras_return_the_shape_they_got(encoding: Any, channels: int) -> None:
    """A camera each: with filters, of one plane, with a sensor for each colour; one plane comes out grey."""
    mono = replace(Camera.preset("imx250"), cfa="mono")
    cameras = (Camera.preset("imx250c"), mono, Camera.preset("imx250"))
    image = pictures(channels=channels)[:1].expand(3, -1, -1, -1)
    given: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 80.0, "encoding": encoding}
    seen = expose_pictures(image, cameras, generator=[4, 5, 6], **given)
    assert seen.shape == image.shape
    for index, camera in enumerate(cameras):
        alone = expose_pictures(image[:1], camera, generator=[4 + index], **given)
        assert torch.equal(alone[0], seen[index])
    assert torch.equal(seen[1, 0], seen[1, -1])
    assert torch.equal(seen[0, 0], seen[0, -1]) == torch.equal(seen[2, 0], seen[2, -1]) == (channels == 1)
    aug = RandomExposure(cameras, encoding=encoding, p=1.0)
    assert aug(image).shape == image.shape
    assert torch.equal(aug(image, params=aug._params), aug(image, params=aug._params))


def test_automatic_gain_makes_the_brightness_the_targets() -> None:
    """18 % of full scale by the mean frame; noise of the mean of n pixels, five of them, and the tables' rounding."""
    flat = torch.full((4, 3, 60, 80), 0.4)
    lux = torch.tensor([0.5, 4.0, 32.0, 1e5])
    seen = expose_pictures(
        flat, "imx250", exposure_s=0.004, illuminance_lux=lux, gain_db=AutoExposure(), generator=[1, 2, 3, 4],
        encoding="linear",
    )  # fmt: skip
    means = seen.mean(dim=(1, 2, 3)).tolist()
    spread = [5 / math.sqrt(0.4 * 0.004 * float(each) * 6906 * 3 * 4800) + 5e-4 for each in lux]
    dark = 0.4 * 0.004 * 0.5 * 6906 / 10715 * 10 ** (48 / 20)  # the gain ends at 48 dB
    assert means[0] == pytest.approx(min(dark, 0.18), rel=0.1)  # clipped at 0 and 1 by noise and gain
    for mean, tolerance in zip(means[1:3], spread[1:3], strict=True):
        assert mean == pytest.approx(0.18, rel=tolerance + 0.01)
    assert means[3] == pytest.approx(1.0)  # in bright light gain cannot help


def test_automatic_gain_meters_what_each_camera_makes_of_colours() -> None:
    """Red: luma of a mosaic's pictures, the one plane of grey ones; 0.18 to the converter's rounding and noise."""
    flat = torch.tensor([0.6, 0.2, 0.1]).view(1, 3, 1, 1).expand(2, -1, 90, 110)
    cameras = (Camera.preset("imx250c"), replace(Camera.preset("imx250"), cfa="mono"))
    seen = expose_pictures(
        flat, cameras, exposure_s=0.01, illuminance_lux=60.0, gain_db=AutoExposure(), generator=[1, 2],
        encoding="linear",
    )  # fmt: skip
    luma = torch.einsum("c,bchw->b", torch.tensor([0.2126, 0.7152, 0.0722]), seen) / (90 * 110)
    assert luma.tolist() == pytest.approx([0.18, 0.18], rel=0.01)


def test_gain_is_drawn_in_its_range_and_replayed() -> None:
    aug = RandomExposure(TWO, gain_db=(3.0, 30.0), p=1.0)
    torch.manual_seed(8)
    seen = aug(pictures())
    gains = aug._params["gain_db"]
    assert bool(((gains >= 3) & (gains <= 30)).all())
    assert len(gains.unique()) == len(gains)
    assert torch.equal(aug(pictures(), params=aug._params), seen)
    fixed = expose_pictures(
        pictures(), [TWO[i] for i in aug._params["camera_index"]],
        **{name: aug._params[name] for name in (*_RANGES, "gain_db")},
        generator=aug._params["noise_seed"].tolist(),
    )  # fmt: skip
    assert torch.equal(fixed, seen)


def test_a_fixed_gain_changes_no_other_draw() -> None:
    without, with_gain = ExposureRanges(TWO), ExposureRanges(TWO, gain_db=6.0)
    assert without.draws == with_gain.draws == ExposureRanges(TWO, gain_db="auto").draws == 6
    assert ExposureRanges(TWO, gain_db=(0.0, 6.0)).draws == 7


@pytest.mark.parametrize("gain_db", [(0.0, 60.0), 49.0, "automatic", (6.0, 3.0), None])
def test_gains_that_a_camera_has_not_are_named(gain_db: object) -> None:
    with pytest.raises((TypeError, ValueError), match="gain_db"):
        RandomExposure(TWO, gain_db=gain_db)  # type: ignore[arg-type]
