"""The whole chain: order, units, per-image arguments, randomness, limits."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from blurnoise import Camera, ExposedScene, Exposure, photoelectrons, simulate
from blurnoise.blur import convolution
from blurnoise.optics.colour import linear_from_srgb, srgb_from_linear
from blurnoise.optics.transfer import Optics
from blurnoise.picture.develop import develop
from blurnoise.sensor import readout as sensor

CAMERA = Camera.preset("imx250")


def picture(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(8))


def test_integral_digital_numbers_of_the_same_shape() -> None:
    for channels in (1, 3):
        image = picture(2, channels, 13, 21)
        dn = simulate(image, CAMERA, exposure_s=0.01, illuminance_lux=50.0, generator=[1, 2])
        assert dn.shape == image.shape
        assert torch.equal(dn, dn.round())
        assert 0 <= float(dn.min()) <= float(dn.max()) <= 4095


def test_mean_follows_light_and_exposure() -> None:
    """Black + K rho n_e, n = 90000, within 5 standard errors; the sRGB code is linearised first."""
    linear = torch.full((1, 1, 300, 300), 0.18)
    white_e = photoelectrons(CAMERA, 40.0, 0.02)
    expected = CAMERA.black_level_dn + CAMERA.system_gain_dn_per_e * 0.18 * white_e
    error = 5 * CAMERA.system_gain_dn_per_e * math.sqrt((0.18 * white_e + 7) / 90000)
    for image, encoding in ((linear, "linear"), (srgb_from_linear(linear), "srgb")):
        dn = simulate(image, CAMERA, exposure_s=0.02, illuminance_lux=40.0, encoding=encoding, generator=[5])
        assert float(dn.double().mean()) == pytest.approx(expected, abs=error)


def test_chain_in_order() -> None:
    """Two routes: simulate, and its own steps one after the other."""
    image = picture(1, 3, 20, 30)
    camera = replace(CAMERA, defocus_radius_px=1.3)
    dn = simulate(
        image, camera, exposure_s=0.02, illuminance_lux=30.0, velocity_px_s=(300.0, -150.0), generator=[3]
    )
    moved = convolution.exposure_blur(linear_from_srgb(image), (6.0, -3.0), Optics(defocus_radius_px=1.3))
    by_hand = sensor.read_out(
        moved * photoelectrons(camera, 30.0, 0.02),
        camera,
        exposure_s=0.02,
        temperature_c=25.0,
        generator=[3],
    )
    torch.testing.assert_close(dn, by_hand, atol=1, rtol=0)
    assert float((dn != by_hand).float().mean()) < 1e-2


def test_one_value_per_image() -> None:
    images = picture(3, 1, 16, 18)
    numbers = {"exposure_s": [0.001, 0.01, 0.1], "illuminance_lux": torch.tensor([100.0, 10.0, 5.0])}
    velocities = torch.tensor([[0.0, 0.0], [400.0, 0.0], [30.0, 30.0]])
    together = simulate(images, CAMERA, **numbers, velocity_px_s=velocities, generator=[7, 8, 9])
    for i in range(3):
        alone = simulate(
            images[i : i + 1],
            CAMERA,
            exposure_s=numbers["exposure_s"][i],
            illuminance_lux=float(numbers["illuminance_lux"][i]),
            velocity_px_s=velocities[i],
            generator=[7 + i],
        )
        assert torch.equal(together[i : i + 1], alone)


def test_same_generator_same_bits() -> None:
    image = picture(2, 1, 9, 9)
    arguments = {"exposure_s": 0.01, "illuminance_lux": 20.0}
    first = simulate(image, CAMERA, **arguments, generator=torch.Generator().manual_seed(1))
    again = simulate(image, CAMERA, **arguments, generator=torch.Generator().manual_seed(1))
    other = simulate(image, CAMERA, **arguments, generator=torch.Generator().manual_seed(2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_no_generator_follows_torchs_default() -> None:
    image = picture(1, 1, 9, 9)
    state = torch.get_rng_state()
    first = simulate(image, CAMERA, exposure_s=0.01, illuminance_lux=20.0)
    torch.set_rng_state(state)
    again = simulate(image, CAMERA, exposure_s=0.01, illuminance_lux=20.0)
    assert torch.equal(first, again)
    assert not torch.equal(first, simulate(image, CAMERA, exposure_s=0.01, illuminance_lux=20.0))


def test_motion_is_to_the_right_and_down() -> None:
    """A dot that moves 20 px along x is a row of 20; its centroid stays."""
    image = torch.zeros(1, 1, 31, 61)
    image[..., 15, 30] = 1
    dn = simulate(
        image, CAMERA, exposure_s=0.02, illuminance_lux=50.0, velocity_px_s=(1000.0, 0.0), encoding="linear"
    )
    lit = (dn[0, 0] > 60).nonzero()
    assert set(lit[:, 0].tolist()) == {15}
    assert sorted(lit[:, 1].tolist())[0] in range(19, 23)
    assert sorted(lit[:, 1].tolist())[-1] in range(38, 42)


def test_bright_scenes_saturate_and_dark_ones_are_black() -> None:
    image = torch.ones(1, 1, 8, 8)
    bright = simulate(image, CAMERA, exposure_s=1.0, illuminance_lux=1e4)
    assert bright.unique().tolist() == [4095.0]
    assert float(develop(bright, CAMERA).min()) == 1
    dark = simulate(image, CAMERA, exposure_s=0.0, illuminance_lux=1e4)
    assert float((dark - CAMERA.black_level_dn).abs().max()) < 8 * CAMERA.read_noise_e


def test_good_light_gives_the_picture_back() -> None:
    """At 90 % of full well the developed picture is within noise of the scene scaled by that exposure."""
    image = picture(1, 3, 40, 50) * 0.8 + 0.1
    exposure = 0.9 * CAMERA.full_well_e / photoelectrons(CAMERA, 100.0, 1.0)
    dn = simulate(image, CAMERA, exposure_s=exposure, illuminance_lux=100.0, generator=[1])
    seen = develop(dn, CAMERA, encoding="linear")
    scene = 0.9 * linear_from_srgb(image)
    assert float((seen - scene).square().mean().sqrt()) < 1.05 * math.sqrt(
        float(scene.mean()) / CAMERA.full_well_e
    )


def test_fixed_pattern_belongs_to_the_camera() -> None:
    camera = replace(CAMERA, prnu=0.1)
    image = torch.full((1, 1, 64, 64), 0.5)
    arguments = {"exposure_s": 0.02, "illuminance_lux": 50.0}
    one, two = (simulate(image, camera, **arguments, generator=[seed]) for seed in (1, 2))
    other = simulate(image, camera, **arguments, generator=[3], pattern_seed=1)
    same = float(torch.corrcoef(torch.stack([one.flatten(), two.flatten()]))[0, 1])
    different = float(torch.corrcoef(torch.stack([one.flatten(), other.flatten()]))[0, 1])
    assert same > 0.7
    assert abs(different) < 5 / 64


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"exposure_s": -0.01}, "exposure_s"),
        ({"exposure_s": math.nan}, "exposure_s"),
        ({"illuminance_lux": [1.0, 2.0, 3.0]}, "illuminance_lux"),
        ({"illuminance_lux": math.inf}, "illuminance_lux"),
        ({"velocity_px_s": (math.nan, 0.0)}, "velocity_px_s"),
        (
            {"velocity_px_s": [(1.0, 0.0)] * 3},
            r"velocity_px_s: shape must be \(2,\) or \(1, 2\), got \(3, 2\)",
        ),
        ({"velocity_px_s": (1e17, 0.0)}, r"velocity_px_s.*<= 1e\+07"),
        ({"velocity_px_s": (9e6, 0.0), "exposure_s": 1.0}, r"displacement_px.*<= 100000"),
        ({"illuminance_lux": 1e300}, r"illuminance_lux = 1e\+300: must be finite and >= 0 and <= 1e\+09"),
        ({"exposure_s": 10**400}, "exposure_s"),
        ({"tolerance_dn": -1.0}, "tolerance_dn"),
        ({"border": "mirror"}, "border"),
        ({"temperature_c": -300.0}, "temperature_c"),
        ({"encoding": "gamma"}, "encoding"),
        ({"illuminant": "candle"}, "illuminant"),
        ({"image": torch.full((1, 1, 3, 3), 255.0)}, r"\[0, 1\]"),
        ({"image": torch.full((1, 1, 3, 3), math.nan)}, "NaN"),
    ],
)
def test_bad_input_is_named(changes: dict[str, object], words: str) -> None:
    good = {"image": torch.zeros(1, 1, 3, 3), "exposure_s": 0.01, "illuminance_lux": 10.0}
    arguments = {**good, **changes}
    with pytest.raises(ValueError, match=words):
        simulate(arguments.pop("image"), CAMERA, **arguments)


def test_frames_are_of_one_picture() -> None:
    scene = ExposedScene(torch.rand(2, 1, 8, 9))
    with pytest.raises(ValueError, match="light: has 2 pictures; must be one"):
        next(scene.frames([Exposure(Camera.preset("imx250"), 0.01, 50.0)]))


def test_srgb_round_trip_and_known_values() -> None:
    """IEC 61966-2-1: 0.5 codes 0.21404 of linear light; both directions are inverse to 1e-6."""
    coded = torch.linspace(0, 1, 4001, dtype=torch.float64)
    torch.testing.assert_close(srgb_from_linear(linear_from_srgb(coded)), coded, atol=1e-6, rtol=0)
    assert float(linear_from_srgb(torch.tensor(0.5))) == pytest.approx(0.214041, abs=1e-5)
    assert float(srgb_from_linear(torch.tensor(0.18))) == pytest.approx(0.461356, abs=1e-5)
    rest = torch.zeros(1, requires_grad=True)
    srgb_from_linear(rest).backward()
    assert float(rest.grad) == pytest.approx(12.92)


def test_decoding_rounds_alike_wherever_a_value_lies() -> None:
    """A transform spreads a value's last bit over the whole picture, so decoding may not depend on its place."""
    coded = picture(1, 3, 37, 41)
    pieces = torch.cat([linear_from_srgb(piece.clone()) for piece in coded.flatten().split(13)])
    assert torch.equal(linear_from_srgb(coded).flatten(), pieces)
