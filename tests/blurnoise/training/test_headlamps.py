"""Light of headlamps through the doors for pictures: simulate, expose_pictures and RandomExposure."""

import pytest
import torch
from torch.testing import assert_close

from blurnoise import (
    AutoExposure,
    Camera,
    Exposure,
    RandomExposure,
    Scene,
    TakeOptions,
    expose_pictures,
    simulate,
    take,
)

CAMERA = Camera.preset("imx250")
PICTURES = torch.linspace(0.1, 0.6, 2 * 12 * 18).view(2, 1, 12, 18)
LUX = torch.zeros(2, 1, 12, 18)
LUX[0, :, 3:9, 4:11], LUX[1, :, 5:7] = 20.0, 3.0
MASKS = (LUX > 0).float()


def test_simulate_takes_a_plane():
    found = simulate(
        PICTURES,
        CAMERA,
        exposure_s=0.01,
        illuminance_lux=1.0,
        encoding="linear",
        generator=[1, 2],
        headlamp_lux=LUX,
    )
    exposure = Exposure(CAMERA, 0.01, 1.0, seed=[1, 2], headlamp="high")
    (right,) = take(Scene(PICTURES, headlamp_lux={"high": LUX}), exposure, TakeOptions(("raw",))).raw
    assert_close(found, right, rtol=0, atol=0)


@pytest.mark.parametrize("moves", ["all", "targets"])
def test_pictures_of_a_batch_have_the_beam_of_their_exposure(moves):
    """Alone and together, whole or cut into targets and background."""
    several = [
        Exposure(
            CAMERA, 0.01, 2.0, (400.0, 0.0), gain_db=AutoExposure(), moves=moves, seed=seed, headlamp=beam
        )
        for seed, beam in enumerate(("low", "off"))
    ]
    given = {"encoding": "linear", "masks": MASKS}
    together = expose_pictures(PICTURES, several, headlamp_lux={"low": LUX}, **given)
    lit = expose_pictures(
        PICTURES[:1], several[:1], headlamp_lux={"low": LUX[:1]}, encoding="linear", masks=MASKS[:1]
    )
    dark = expose_pictures(PICTURES[1:], several[1:], encoding="linear", masks=MASKS[1:])
    assert_close(together, torch.cat([lit, dark]), rtol=0, atol=0)
    # The meter counts the lit sign, so that its surroundings are darker than without headlamps.
    plain = expose_pictures(
        PICTURES[:1], Exposure(CAMERA, 0.01, 2.0, gain_db=AutoExposure()), encoding="linear"
    )
    assert lit[..., 11, :].mean() < 0.7 * plain[..., 11, :].mean()
    assert lit[..., 5, 7].mean() > 3 * lit[..., 11, 7].mean()


def test_a_beam_needs_its_planes():
    with pytest.raises(ValueError, match=r"^headlamp = 'low': needs headlamp_lux\['low'\]"):
        expose_pictures(PICTURES, Exposure(CAMERA, 0.01, 1.0, headlamp="low"))


def test_random_exposures_add_a_plane_and_replay_it():
    expose = RandomExposure(
        "imx250", exposure_s=0.01, illuminance_lux=2.0, speed_px_s=0.0, gain_db=20.0, encoding="linear", p=1.0
    )
    lit = expose(PICTURES, headlamp_lux=LUX)
    assert_close(expose(PICTURES, params=expose._params), lit, rtol=0, atol=0)
    dark = expose(
        PICTURES, params={name: value for name, value in expose._params.items() if name != "headlamp_lux"}
    )
    assert_close(lit[0, :, 0], dark[0, :, 0], rtol=0, atol=0)
    assert lit[0, 0, 6, 7] > 3 * dark[0, 0, 6, 7]
