"""Bits that depend on nothing around a call: not on gradients, not on autocast."""

import pytest
import torch
from exposed_frames import batched

import blurnoise
from blurnoise import Camera
from blurnoise.camera.camera_files import PRESETS

PICTURES = torch.rand(2, 3, 20, 27, generator=torch.Generator().manual_seed(1))
LIT = {"exposure_s": 0.01, "illuminance_lux": 100.0}
HDR = Camera.preset("ar0132x3")
LAYER = blurnoise.Layer(torch.full((3, 9, 7), 0.4), torch.ones(9, 7), (80.0, 0.0), (5, 6))


def taken(pictures, camera="imx250c", **fields):
    fields = {"velocity_px_s": (600.0, -350.0), "seed": 5} | fields
    camera = Camera.preset(camera) if isinstance(camera, str) else camera
    return blurnoise.expose_pictures(pictures, blurnoise.Exposure(camera, **LIT, **fields))


def simulated(pictures, camera="imx250c", generator=(5, 6)):
    return blurnoise.simulate(
        pictures, Camera.preset(camera), **LIT, velocity_px_s=(300.0, -500.0), generator=generator
    )


DOORS = {
    "simulate": simulated,
    "expose_pictures": taken,
    "take": lambda pictures: (
        blurnoise.take(
            blurnoise.Scene(pictures), blurnoise.Exposure(HDR, **batched(LIT, 2), seed=[5, 6])
        ).picture
    ),
    "develop": lambda pictures: blurnoise.develop(pictures[:, :1] * 3000, Camera.preset("imx250c")),
    "motion_blur": lambda pictures: blurnoise.motion_blur(pictures, (5.3, -2.0)),
    "expose_layers": lambda pictures: blurnoise.expose_layers(
        pictures, [LAYER], exposure_s=0.05, velocity_px_s=(0.0, 9.0)
    ),
}


@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_gradients_and_autocast_change_no_bit(door):
    alone = door(PICTURES)
    followed = door(PICTURES.clone().requires_grad_())
    with torch.autocast("cpu", dtype=torch.bfloat16):
        cast = door(PICTURES)
    assert followed.requires_grad
    assert torch.equal(followed, alone)
    assert cast.dtype == alone.dtype
    assert torch.equal(cast, alone)


@pytest.mark.parametrize("name", PRESETS)
def test_no_camera_has_other_bits_with_gradients(name):
    camera = Camera.preset(name)
    pictures = PICTURES[:, :1] if camera.sensor.cfa == "mono" else PICTURES
    shutters = (
        [camera]
        if camera.sensor.captures
        else [camera, camera.with_figures(shutter="rolling", row_time_s=2e-5)]
    )
    for each in shutters:
        followed = taken(pictures.clone().requires_grad_(), each)
        assert torch.equal(followed, taken(pictures, each))


def test_a_generator_advances_as_far_with_gradients_as_without():
    drawn = []
    for pictures in (PICTURES, PICTURES.clone().requires_grad_()):
        generator = torch.Generator().manual_seed(3)
        drawn.append([simulated(pictures, generator=generator).detach() for _ in range(2)])
    assert all(torch.equal(*pair) for pair in zip(*drawn, strict=True))
