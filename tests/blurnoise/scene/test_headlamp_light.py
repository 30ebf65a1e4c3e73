"""Light of headlamps in pictures: what it adds, and that it is counted wherever light is."""

import numpy as np
import pytest
import torch
from torch.testing import assert_close

from blurnoise import (
    AutoExposure,
    Camera,
    Capture,
    Exposure,
    Layer,
    Pwm,
    Scene,
    TakeOptions,
    plan,
    take,
    take_each,
)
from blurnoise.camera.distortion import Distortion
from blurnoise.camera.radiometry import photoelectrons
from blurnoise.scene.cutting import cut_out
from blurnoise.scene.metering import mean_luma

CAMERA = Camera.preset("imx250")
MEAN = TakeOptions(("raw",), fidelity="full", noise=False, quantised=False)
NOISY = TakeOptions(("raw",))
SIZE = (13, 17)
LIGHT = torch.linspace(0.05, 0.8, 13 * 17, dtype=torch.float64).view(1, 1, *SIZE)
SIGN = torch.zeros(1, 1, *SIZE, dtype=torch.float64)
SIGN[..., 4:9, 5:12] = 20.0
BOTH = {"low": SIGN, "high": 3 * SIGN}


def electrons(scene, camera=CAMERA, **exposure):
    """Mean electrons (B, 1, H, W)."""
    given = {"exposure_s": 0.01, "illuminance_lux": 1.0} | exposure
    (raw,) = take(scene, Exposure(camera, **given), MEAN).raw
    return (raw - camera.sensor.black_level_dn) / camera.sensor.system_gain_dn_per_e


def test_a_surface_has_the_light_of_both():
    """Electrons of light l under E lux, lit by X lux more, are those of l (E + X)."""
    found = electrons(Scene(LIGHT, headlamp_lux=BOTH), illuminance_lux=2.0, headlamp="low")
    white = photoelectrons(CAMERA, illuminance_lux=1.0, exposure_s=0.01)
    assert_close(found, LIGHT * (2.0 + SIGN) * white, rtol=1e-9, atol=1e-9)


def test_the_exposure_chooses_the_beam():
    scene = Scene(LIGHT, headlamp_lux=BOTH)
    off, low, high = (electrons(scene, headlamp=beam) for beam in ("off", "low", "high"))
    assert_close(high - off, 3 * (low - off))
    assert_close(off, electrons(Scene(LIGHT)), rtol=0, atol=0)


def test_numbers_do_not_depend_on_batch_or_sharing():
    """Of exposures that differ in light, of which some share it."""
    scene = Scene(LIGHT.float(), headlamp_lux={"low": SIGN.float()})
    every = [
        Exposure(CAMERA, 0.01, lux, velocity_px_s=(300.0, 0.0), seed=seed, headlamp=beam)
        for seed, (lux, beam) in enumerate([(1.0, "low"), (5.0, "low"), (1.0, "off"), (1.0, "low")])
    ]
    alone = [take(scene, one, NOISY).raw[0] for one in every]
    shared = [frames.raw[0] for frames in take_each(scene, every, NOISY)]
    of_lamp = [every[item] for item in (0, 1, 3)]
    together = take(
        Scene(LIGHT.float().expand(3, -1, -1, -1), headlamp_lux=scene.headlamp_lux),
        Exposure.stack(of_lamp),
        NOISY,
    )
    for found, right in zip(
        [*shared, *together.raw[0].split(1)], [*alone, alone[0], alone[1], alone[3]], strict=True
    ):
        assert_close(found, right, rtol=0, atol=0)


def test_pictures_of_a_batch_have_planes_of_their_own():
    planes = torch.cat([SIGN, 0 * SIGN, SIGN.flip(-1)])
    scene = Scene(LIGHT.expand(3, -1, -1, -1), headlamp_lux={"low": planes})
    found = electrons(scene, illuminance_lux=torch.tensor([1.0, 2.0, 3.0]), seed=[1, 2, 3], headlamp="low")
    for item, plane in enumerate(planes.split(1)):
        alone = electrons(
            Scene(LIGHT, headlamp_lux={"low": plane}), illuminance_lux=1.0 + item, headlamp="low"
        )
        assert_close(found[item : item + 1], alone, rtol=0, atol=0)


def test_layers_are_lit_by_planes_of_their_own():
    """A still layer shows its own light and lux, whatever is behind it."""
    layer = Layer(
        torch.full((1, 3, 4), 0.5, dtype=torch.float64),
        torch.ones(3, 4, dtype=torch.float64),
        place_px=(6, 5),
    )
    lit = Layer(
        layer.light, layer.alpha, place_px=(6, 5), headlamp_lux={"low": torch.full((1, 3, 4), 7.0).double()}
    )
    found = electrons(Scene(LIGHT, layers=[lit], headlamp_lux=BOTH), headlamp="low")
    behind = electrons(Scene(LIGHT, headlamp_lux=BOTH), headlamp="low")
    assert_close(
        found[0, 0, 5:8, 6:10], torch.full((3, 4), 0.5 * 8.0).double() * photoelectrons(CAMERA, 1.0, 0.01)
    )
    assert_close(found[0, 0, :5], behind[0, 0, :5])
    with pytest.raises(ValueError, match="a layer of the scene has no headlamp_lux of this beam"):
        electrons(Scene(LIGHT, layers=[layer], headlamp_lux=BOTH), headlamp="low")


def test_what_is_cut_out_is_lit_as_the_picture():
    """A sign that is lit alone: its layer carries the lux, and the background that was behind it has none."""
    matte = (SIGN[0, 0] > 0).float().numpy()
    cut = cut_out(LIGHT.float(), [matte], [(0.0, 0.0)], headlamp_lux={"low": SIGN.float()})
    assert not cut.headlamp_lux["low"].any()
    assert cut.layers[0].headlamp_lux["low"].numpy() == pytest.approx(20.0)
    scene = Scene(cut.background, layers=cut.layers, headlamp_lux=cut.headlamp_lux)
    whole = Scene(LIGHT.float(), headlamp_lux={"low": SIGN.float()})
    inside = np.s_[..., 5:8, 6:11]  # one pixel from the sign's edge, where colours come from further inside
    assert_close(electrons(scene, headlamp="low")[inside], electrons(whole, headlamp="low")[inside])


def test_distortion_and_later_captures_move_the_light_of_headlamps_with_the_layer():
    """Of a picture without layers they move it with the light."""
    bent = CAMERA.with_figures(
        distortion=Distortion("opencv", (-0.2, 0.0, 0.0, 0.0)), captures=(Capture(), Capture(16.0))
    )
    lit = Layer(LIGHT[0], torch.ones(SIZE).double(), headlamp_lux={"low": SIGN[0]})
    exposure = Exposure(bent, 0.01, 1.0, velocity_px_s=(50.0, 0.0), headlamp="low")
    as_layer = Scene(
        torch.zeros_like(LIGHT), layers=[Layer(LIGHT[0] * (1 + SIGN[0]), lit.alpha, (50.0, 0.0))]
    )
    planes = {"low": torch.zeros_like(SIGN)}
    moving = Layer(lit.light, lit.alpha, (50.0, 0.0), headlamp_lux=lit.headlamp_lux)
    found = take(Scene(torch.zeros_like(LIGHT), layers=[moving], headlamp_lux=planes), exposure, MEAN).raw
    right = take(as_layer, Exposure(bent, 0.01, 1.0, velocity_px_s=(50.0, 0.0)), MEAN).raw
    for one, other in zip(found, right, strict=True):
        assert_close(one, other)


@pytest.mark.parametrize("mask", [None, (SIGN[0, 0] > 0).double()])
def test_a_pulsed_lamp_leaves_the_headlamps_on(mask):
    """In an exposure without a pulse there is light of headlamps, and ambient light that is not the lamp's."""
    dark = Pwm(90.0, 0.1, 0.5)  # the pulse is over, and the next one comes later than the exposure
    scene = Scene(LIGHT, headlamp_lux=BOTH, lamp_mask=mask)
    lit_by_lamp = 1.0 if mask is None else mask
    found = electrons(scene, exposure_s=0.001, lamp=dark, headlamp="low")
    white = photoelectrons(CAMERA, 1.0, 0.001)
    assert_close(found, LIGHT * (1 - lit_by_lamp + SIGN) * white, rtol=1e-9, atol=1e-9)
    layered = Scene(
        0 * LIGHT,
        layers=[Layer(LIGHT[0], torch.ones(SIZE).double(), headlamp_lux={"low": SIGN[0]})],
        headlamp_lux={"low": 0 * SIGN},
        lamp_mask=mask,
    )
    assert_close(electrons(layered, exposure_s=0.001, lamp=dark, headlamp="low"), found, rtol=1e-9, atol=1e-9)


def test_captures_of_less_light_have_the_same_share_of_headlamps():
    camera = CAMERA.with_figures(captures=(Capture(), Capture(sensitivity=0.25)))
    scene, exposure = Scene(LIGHT, headlamp_lux=BOTH), Exposure(camera, 0.01, 1.0, headlamp="low")
    first, second = (raw - CAMERA.sensor.black_level_dn for raw in take(scene, exposure, MEAN).raw)
    assert_close(second, 0.25 * first)


def test_auto_exposure_meters_headlamps():
    """As it meters the light of the whole scene under the sum of both."""
    scene = Scene(LIGHT, headlamp_lux=BOTH)
    automatic = {"exposure_s": float("nan"), "gain_db": AutoExposure()}
    found = take(scene, Exposure(CAMERA, illuminance_lux=4.0, headlamp="low", **automatic), NOISY).exposure
    (mean,) = mean_luma(LIGHT * (1 + SIGN / 4.0)).tolist()
    setting = AutoExposure().setting(CAMERA, mean_light=mean, illuminance_lux=4.0)
    assert (found.exposure_s, found.gain_db) == pytest.approx((setting.exposure_s, setting.gain_db), rel=1e-9)
    assert (
        found.gain_db
        < take(scene, Exposure(CAMERA, illuminance_lux=4.0, **automatic), NOISY).exposure.gain_db - 3
    )


def test_the_plan_names_beam_and_lux_and_counts_the_brightest_surface():
    scene = Scene(torch.ones_like(LIGHT), headlamp_lux=BOTH)
    moved = {"velocity_px_s": (3.0, 0.0)}
    off = {row.name: row for row in plan(Exposure(CAMERA, 1e-3, 1.0, **moved), scene).stages}
    low = {row.name: row for row in plan(Exposure(CAMERA, 1e-3, 1.0, headlamp="low", **moved), scene).stages}
    assert (off["headlamps"].kept, off["headlamps"].how) == (False, "none here")
    assert (low["headlamps"].kept, low["headlamps"].how) == (True, "low beam, X 0 to 20 lux")
    white_dn = photoelectrons(CAMERA, 1.0, 1e-3) * CAMERA.sensor.system_gain_dn_per_e
    rms_lux = float(SIGN.square().mean().sqrt())
    assert low["headlamps"].contribution_dn == pytest.approx(rms_lux * white_dn, rel=1e-6)
    assert low["motion"].contribution_dn == pytest.approx(21 * off["motion"].contribution_dn, rel=1e-6)


def test_gradients_reach_planes_illuminance_and_light():
    lux = torch.tensor([2.0], dtype=torch.float64, requires_grad=True)
    light, plane = LIGHT.clone().requires_grad_(), SIGN.clone().requires_grad_()
    found = electrons(
        Scene(light, headlamp_lux={"low": plane}), illuminance_lux=lux, seed=[1], headlamp="low"
    )
    found.sum().backward()
    white = photoelectrons(CAMERA, 1.0, 0.01)
    assert_close(light.grad, (2.0 + SIGN) * white)
    assert_close(plane.grad, LIGHT * white)
    assert_close(lux.grad, (LIGHT * white).sum()[None])


@pytest.mark.parametrize(
    ("lux", "message"),
    [
        ({"mid": SIGN}, "headlamp_lux = 'mid': must be one of 'low', 'high'"),
        ({"low": SIGN - 1}, "headlamp_lux\\['low'\\]: values span \\[-1, 19\\] lux"),
        ({"low": SIGN[..., 1:]}, "headlamp_lux\\['low'\\]: shape is"),
        ({"low": SIGN * torch.nan}, "headlamp_lux\\['low'\\]: contains NaN or Inf"),
    ],
)
def test_planes_are_checked(lux, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        Scene(LIGHT, headlamp_lux=lux)


@pytest.mark.parametrize("lux", [0.0, torch.tensor([1.0, 0.0])])
def test_headlamps_need_some_other_light(lux):
    two = Scene(LIGHT.expand(2, -1, -1, -1), headlamp_lux=BOTH)
    with pytest.raises(
        ValueError, match=r"^headlamp = 'low': needs illuminance_lux >= 1e-06; moonlight is 0.3$"
    ):
        electrons(two, illuminance_lux=lux, seed=[1, 2], headlamp="low")


def test_a_beam_that_the_scene_has_no_plane_of_is_refused():
    with pytest.raises(ValueError, match=r"^headlamp = 'high': the scene has no headlamp_lux of this beam"):
        electrons(Scene(LIGHT, headlamp_lux={"low": SIGN}), headlamp="high")


def test_the_plan_counts_light_on_layers():
    """Of a lit sign before a dark background, which alone has no light of headlamps."""
    alpha = (SIGN[0, 0] > 0).double()
    sign = Layer(torch.ones(1, *SIZE).double(), alpha, headlamp_lux={"low": SIGN[0]})
    planes = {"low": torch.zeros_like(SIGN)}
    apart = Scene(torch.ones_like(LIGHT), layers=[sign], headlamp_lux=planes)
    whole = Scene(torch.ones_like(LIGHT), headlamp_lux={"low": SIGN})
    exposure = Exposure(CAMERA, 1e-3, 1.0, headlamp="low")
    rows = [plan(exposure, scene).stages[0] for scene in (apart, whole)]
    assert rows[0] == rows[1]
    assert rows[0].kept
