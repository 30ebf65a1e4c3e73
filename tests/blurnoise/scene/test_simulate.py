"""The whole chain: units, per-picture arguments, randomness, gradients, limits; anchors and automatic exposure."""

import math
import weakref
from typing import Any

import pytest
import torch
from exposed_frames import BUSY, batched
from hypothesis import given
from hypothesis import strategies as st
from torch.nn.functional import avg_pool2d

from blurnoise import (
    Camera,
    Exposure,
    Layer,
    RandomExposure,
    Scene,
    TakeOptions,
    Trajectory,
    develop,
    photoelectrons,
    simulate,
    take,
)
from blurnoise.camera import PRESETS
from blurnoise.camera.colour import linear_from_srgb, srgb_from_linear
from blurnoise.scene.metering import AutoExposure, GreyAnchor, anchored, mean_luma

CAMERA = Camera.preset("imx250")
SMOOTH = BUSY.with_figures(dark_current_e_s=200.0)
LIT: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 60.0}
MEAN: dict[str, Any] = {"noise": False, "quantised": False, "fidelity": "full"}


def picture(*shape):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(8))


def test_mean_follows_light_and_exposure():
    """Black + K rho n_e, n = 90000, within 5 standard errors; the sRGB code is linearised first."""
    linear = torch.full((1, 1, 300, 300), 0.18)
    white_e = photoelectrons(CAMERA, 40.0, 0.02)
    expected = CAMERA.sensor.black_level_dn + CAMERA.sensor.system_gain_dn_per_e * 0.18 * white_e
    error = 5 * CAMERA.sensor.system_gain_dn_per_e * math.sqrt((0.18 * white_e + 7) / 90000)
    for image, encoding in ((linear, "linear"), (srgb_from_linear(linear), "srgb")):
        dn = simulate(image, CAMERA, exposure_s=0.02, illuminance_lux=40.0, encoding=encoding, generator=[5])
        assert float(dn.double().mean()) == pytest.approx(expected, abs=error)


def test_fixed_pattern_belongs_to_the_camera():
    camera = CAMERA.with_figures(prnu=0.1)
    image = torch.full((1, 1, 64, 64), 0.5)
    arguments = {"exposure_s": 0.02, "illuminance_lux": 50.0}
    one, two = (simulate(image, camera, **arguments, generator=[seed]) for seed in (1, 2))
    other = simulate(image, camera, **arguments, generator=[3], pattern_seed=1)
    same = float(torch.corrcoef(torch.stack([one.flatten(), two.flatten()]))[0, 1])
    different = float(torch.corrcoef(torch.stack([one.flatten(), other.flatten()]))[0, 1])
    assert same > 0.7
    assert abs(different) < 5 / 64


def test_motion_is_to_the_right_and_down():
    """A spot that moves 20 px to the right and 10 down is a streak from up left to down right about its place."""
    y, x = torch.meshgrid(torch.arange(61.0) - 30, torch.arange(81.0) - 40, indexing="ij")
    image = torch.exp(-(x * x + y * y) / 8)[None, None]
    at = {"exposure_s": 0.02, "illuminance_lux": 50.0, "velocity_px_s": (1000.0, 500.0), **MEAN}
    light = simulate(image, CAMERA, encoding="linear", **at)[0, 0] - CAMERA.sensor.black_level_dn
    found = [float((light * by).sum() / light.sum()) for by in (x, y, x * x, y * y, x * y)]
    assert found == pytest.approx([0, 0, 4 + 400 / 12, 4 + 100 / 12, 200 / 12], abs=0.1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"illuminance_lux": [1.0, 2.0, 3.0]}, "illuminance_lux"),
        ({"velocity_px_s": [(1.0, 0.0)] * 3}, r"velocity_px_s: shape must be \(2,\) or \(1, 2\), got \(3, 2\)"),
        ({"velocity_px_s": torch.zeros(2, 3, 4)}, r"velocity_px_s: shape must be \(2, 3, 3\) or \(1, 2, 3, 3\)"),
        ({"velocity_px_s": torch.full((2, 3, 3), math.nan)}, "velocity_px_s: contains NaN"),
        ({"velocity_px_s": (1e17, 0.0)}, r"velocity_px_s.*<= 1e\+07"),
        ({"velocity_px_s": (9e6, 0.0), "exposure_s": 1.0}, r"displacement_px.*<= 100000"),
        ({"image": torch.full((1, 1, 3, 3), 255.0)}, r"\[0, 1\]"),
        ({"grey_anchor": "mean"}, "grey_anchor = mean: is black"),
        ({"grey_anchor": "0,0,20,30"}, "outside the picture of 3 x 3 px"),
        ({"camera": PRESETS["imx250c"], "image": torch.zeros(1, 3, 1, 5)}, "image: 5 x 1 px; behind cfa = 'RGGB' mu"),
    ],
)  # fmt: skip
def test_bad_input_is_named(changes, words):
    good = {"image": torch.zeros(1, 1, 3, 3), "camera": CAMERA, **LIT}
    with pytest.raises(ValueError, match=words):
        simulate(**{**good, **changes})
    if "camera" in changes:
        with pytest.raises(ValueError, match=words):
            RandomExposure(changes["camera"], p=1.0)(changes["image"])


def test_srgb_round_trip_and_known_values():
    """IEC 61966-2-1: 0.5 codes 0.21404 of linear light; both directions are inverse to 1e-6."""
    coded = torch.linspace(0, 1, 4001, dtype=torch.float64)
    torch.testing.assert_close(srgb_from_linear(linear_from_srgb(coded)), coded, atol=1e-6, rtol=0)
    assert float(linear_from_srgb(torch.tensor(0.5))) == pytest.approx(0.214041, abs=1e-5)
    assert float(srgb_from_linear(torch.tensor(0.18))) == pytest.approx(0.461356, abs=1e-5)
    rest = torch.zeros(1, requires_grad=True)
    srgb_from_linear(rest).backward()
    assert float(rest.grad) == pytest.approx(12.92)


def test_decoding_rounds_alike_wherever_a_value_lies():
    """A transform spreads a value's last bit over the whole picture, so decoding may not depend on its place."""
    coded = picture(1, 3, 37, 41)
    pieces = torch.cat([linear_from_srgb(piece.clone()) for piece in coded.flatten().split(13)])
    assert torch.equal(linear_from_srgb(coded).flatten(), pieces)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_light_at_rest_is_not_written_to(name):
    """Effects that have nothing to do hand their input on, which is the caller's picture."""
    light, camera = torch.full((1, 3, 16, 20), 0.5), Camera.preset(name).with_figures(captures=())
    for velocity in (torch.zeros(2), torch.zeros(2, 16, 20)):
        at = {"velocity_px_s": velocity, "generator": [1], **LIT}
        first = simulate(light, camera, encoding="linear", fidelity="full", **at)
        assert bool((light == 0.5).all())
        scene = Scene(light)
        for _ in range(2):
            exposure = Exposure(camera, **batched(LIT, 1), velocity_px_s=velocity, seed=[1])
            assert torch.equal(take(scene, exposure, TakeOptions(("raw",), fidelity="full")).raw[0], first)


def test_a_scene_is_freed_at_once():
    """Without waiting for the collector of cycles: training makes one for every batch."""
    scene = Scene(torch.rand(1, 3, 16, 20))
    take(scene, Exposure(Camera.preset("imx250"), 0.01, 50.0, seed=1))
    gone = weakref.ref(scene)
    del scene
    assert gone() is None


INPUTS = {
    "exposure_s": 0.01,
    "illuminance_lux": 40.0,
    "velocity_px_s": (230.0, -110.0),
    "temperature_c": 35.0,
}


def inputs():
    image = 0.1 + 0.8 * torch.rand(1, 1, 9, 11, generator=torch.Generator().manual_seed(1)).double()
    return {"image": image, **{name: torch.tensor(value).double() for name, value in INPUTS.items()}}


def frame(camera=SMOOTH, **given):
    return simulate(camera=camera, encoding="linear", generator=[7], **given)


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("name", ["image", *INPUTS])
def test_gradients_are_those_of_finite_differences(name, noise):
    given = inputs()
    varied = given.pop(name)[..., :5, :6].contiguous() if name == "image" else given.pop(name)
    at = {"noise": noise, "quantised": False, **given}
    varied.requires_grad_()
    wanted = {"eps": 1e-6, "atol": 1e-3, "rtol": 1e-3}
    assert torch.autograd.gradcheck(lambda value: frame(**at, **{name: value}), (varied,), **wanted)


def test_rounding_lets_gradients_through_and_clipping_does_not():
    given = inputs()
    image = given["image"].requires_grad_()
    (rounded,) = torch.autograd.grad(frame(**given).sum(), image)
    assert float(rounded.abs().min()) > 0
    (clipped,) = torch.autograd.grad(frame(**given | {"illuminance_lux": 1e6}).sum(), image)
    assert float(clipped.abs().max()) == 0


@pytest.mark.parametrize("read_noise_e", [0.0, 0.1, 0.24])
def test_gradients_stay_finite_without_light_or_read_noise(read_noise_e):
    given = inputs() | {"image": torch.zeros(1, 1, 9, 11, dtype=torch.float64)}
    values = [given[name].requires_grad_() for name in given if name != "temperature_c"]
    camera = SMOOTH.with_figures(read_noise_e=read_noise_e, dark_current_e_s=0.0)
    assert all(
        torch.isfinite(each).all() for each in torch.autograd.grad(frame(camera, **given).sum(), values)
    )


def smooth(seed, height=41, width=53):
    generator = torch.Generator().manual_seed(seed)
    return avg_pool2d(torch.rand(1, 1, height, width, dtype=torch.float64, generator=generator), 5, 1, 2)


@pytest.mark.parametrize("layers", [False, True])
@pytest.mark.parametrize("shutter", ["global", "rolling", "global-reset"])
@pytest.mark.parametrize("moving", ["straight", "path", "both", "flow"])
def test_exposure_has_the_gradient_of_what_it_sees(moving, shutter, layers):
    """Contrast over the exposure falls by 27 000 per second of straight motion; against frames without gradients,
    which other ways may have made.
    """
    camera = CAMERA.with_figures(row_time_s=2e-6 * (shutter != "global"), shutter=shutter)
    still, velocity = smooth(3), torch.tensor([300.0, -200.0]).double() * (moving != "path")
    block = Layer(smooth(2, 12, 14)[0], torch.ones(12, 14).double(), (500.0, 100.0), (20, 14))
    if moving == "flow":
        velocity = velocity[:, None, None] * torch.linspace(0.5, 1.5, 53).double().expand(2, 41, 53)
    path = Trajectory.sinusoid(3.0, 80.0, 0.1, direction_deg=20.0) if moving in ("path", "both") else None
    given = {"velocity_px_s": velocity, "trajectory": path, "layers": [block] if layers else ()}
    given |= {**MEAN, "encoding": "linear", "illuminance_lux": 50.0}

    def mean(exposure_s):
        light = simulate(still, camera, exposure_s=exposure_s, **given) - camera.sensor.black_level_dn
        return ((still - 0.5) * light / exposure_s).mean()

    exposure = torch.tensor(0.01, dtype=torch.float64, requires_grad=True)
    (found,) = torch.autograd.grad(mean(exposure), exposure)
    above, below = (float(mean(exposure.detach() + step)) for step in (1e-4, -1e-4))
    assert float(found) == pytest.approx((above - below) / 2e-4, abs=400.0)


def scene():
    """Linear light, (1, 3, 41, 67), colours unlike each other."""
    light = torch.rand(1, 3, 41, 67, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    return light * torch.tensor([0.9, 0.6, 0.3], dtype=torch.float64)[:, None, None]


def photograph(stops_darker):
    """The scene as an 8-bit sRGB picture of an exposure that is so many stops shorter."""
    return (srgb_from_linear(scene() / 2**stops_darker) * 255).round() / 255


@pytest.mark.parametrize("anchor", ["mean", "p50", "p99.5", "12,5,40,30"])
def test_a_scene_photographed_darker_gives_the_same_frame(anchor):
    """Up to what 8 bits leave of it: half a code is 1/510 of the coded range, times at most 2.4, the slope of sRGB's
    decoding at white, in light; of the darker picture 2^stops of that; times the anchor's own scale.
    """
    bright, dark = (simulate(photograph(each), CAMERA, **LIT, **MEAN, grey_anchor=anchor) for each in (0, 2))
    white = simulate(torch.ones(1, 3, 4, 4), CAMERA, **LIT, **MEAN)
    white_dn = float(white.mean()) - CAMERA.sensor.black_level_dn
    scale = GreyAnchor.parse(anchor).scale(scene()[0])
    assert float((bright - dark).abs().max()) < 2.4 / 510 * (1 + 2**2) * scale * white_dn
    both = torch.cat([photograph(0), photograph(2)])
    given = {"grey_anchor": anchor, "generator": [3, 3], **LIT}
    assert torch.equal(
        simulate(both, CAMERA, **given)[1:], simulate(both[1:], CAMERA, **given | {"generator": [3]})
    )


def test_what_is_anchored_is_18_percent():
    light = scene()
    weights = torch.tensor([0.2126, 0.7152, 0.0722], dtype=torch.float64)
    luminance = torch.einsum("c,chw->hw", weights, light[0])
    every = luminance.flatten().sort().values
    for anchor, grey in (
        ("mean", luminance.mean()),
        ("p90", every[round(0.9 * (len(every) - 1))]),
        ("12,5,40,30", luminance[5:30, 12:40].mean()),
    ):
        torch.testing.assert_close(anchored(light, anchor), light * 0.18 / grey, rtol=1e-3, atol=0)


def test_more_than_white_stays():
    """A lamp of 3.6 times white is as many electrons, not white's; and auto leaves out nothing of it."""
    light = torch.full((1, 1, 40, 60), 0.05, dtype=torch.float64)
    light[..., 10:20, 20:40] = 1.0
    given = {"exposure_s": 1e-4, "illuminance_lux": 60.0, "encoding": "linear", **MEAN}
    frame = simulate(light, CAMERA, **given, grey_anchor="0,0,10,40") - CAMERA.sensor.black_level_dn
    white = simulate(torch.ones(1, 1, 4, 4), CAMERA, **given) - CAMERA.sensor.black_level_dn
    assert float(frame[..., 15, 30].mean() / white.mean()) == pytest.approx(3.6, rel=1e-6)
    given |= {
        "velocity_px_s": (900.0, 0.0),
        "grey_anchor": "0,0,10,40",
    }  # too little for white, not for the lamp
    auto, full = (simulate(light, CAMERA, **given | {"fidelity": fidelity}) for fidelity in ("auto", "full"))
    assert float((auto - full).square().mean().sqrt()) <= 0.1


def test_anchors_are_read_written_and_of_codes_as_of_light():
    for text in ("mean", "p5", "p99.5", "0,0,10,20", " MEAN "):
        anchor = GreyAnchor.parse(text)
        assert str(anchor) == text.strip().lower()
        assert GreyAnchor.parse(str(anchor)) == anchor
    for text in ("", "p0", "p101", "median", "1,2,3", "5,5,5,9", "-1,0,4,4", "0,0,1.5,2", "9" * 10**5):
        with pytest.raises(ValueError, match=r"grey_anchor = .*must be mean, pNN") as told:
            GreyAnchor.parse(text)
        assert len(str(told.value)) < 300
    coded = (photograph(2)[0].permute(1, 2, 0) * 255).round().byte().numpy()
    expected = anchored(linear_from_srgb(photograph(2).float()), "p50")
    torch.testing.assert_close(Scene.of_picture(coded, "p50").light, expected, rtol=1e-5, atol=1e-7)


LUX = st.floats(1e-4, 1e6)


@given(LUX, st.floats(0.01, 1.0))
def test_time_first_then_gain(lux, light):
    ae = AutoExposure()
    setting = ae.setting(CAMERA, mean_light=light, illuminance_lux=lux)
    assert setting.exposure_s <= 1 / 30
    if setting.gain_db > 1e-9:
        assert setting.exposure_s == 1 / 30
    if setting.gain_db < CAMERA.sensor.gain_max_db:
        assert setting.reading == pytest.approx(0.18)
    else:
        assert setting.reading <= 0.18 * (1 + 1e-12)


@given(LUX, st.sampled_from([0.0, 50.0, 60.0]), st.sampled_from([0.0, 1e-5, 2.41e-5]))
def test_periods_and_rows_are_whole(lux, mains_hz, row_time_s):
    ae = AutoExposure(mains_hz=mains_hz, row_time_s=row_time_s)
    exposure_s = ae.setting(CAMERA, mean_light=0.2, illuminance_lux=lux).exposure_s
    if mains_hz and not row_time_s and exposure_s >= 1 / (2 * mains_hz):
        periods = exposure_s * 2 * mains_hz
        assert periods == pytest.approx(round(periods), abs=1e-9)
    if row_time_s:
        assert exposure_s / row_time_s == pytest.approx(max(1, round(exposure_s / row_time_s)), abs=1e-6)
    if not (mains_hz and row_time_s):  # where both count, rows cut periods short
        assert ae.allowed_s(exposure_s) == pytest.approx(exposure_s)  # twice is once


def test_the_meter_reads_what_the_mean_frame_has():
    rows = torch.linspace(0.05, 0.4, 60)[None, None, :, None].expand(1, 3, 60, 80)
    light = rows * torch.tensor([1.0, 0.7, 0.3])[None, :, None, None]
    mean = float(mean_luma(light)[0])
    assert mean == pytest.approx(0.225 * (0.2126 + 0.7 * 0.7152 + 0.3 * 0.0722), rel=1e-5)
    at = {"exposure_s": 0.004, "illuminance_lux": 20.0}
    camera, digital_db = CAMERA.at_gain(AutoExposure().setting(CAMERA, mean_light=mean, **at).gain_db)
    dn = simulate(light, camera, encoding="linear", noise=False, **at)
    seen = develop(dn, camera, encoding="linear", gain_db=digital_db)
    assert float(mean_luma(seen)[0]) == pytest.approx(0.18, abs=1 / 4095)


def test_automatic_exposures_that_cannot_be_are_named():
    for figures, said in (
        ({"mains_hz": 55.0}, "mains_hz = 55.0: must be 0, 50 or 60"),
        ({"readout_s": 0.04}, "readout_s = 0.04: must be < 1 / frame_rate_hz"),
        ({"row_time_s": 0.5}, "row_time_s = 0.5: must be <= limit_s"),
    ):
        with pytest.raises(ValueError, match=said):
            AutoExposure(**figures)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_picture_is_metered_alike_alone_and_in_a_batch(channels):
    """Values of float16, whose sums round differently in another order."""
    light = torch.rand(5, channels, 301, 403, generator=torch.Generator().manual_seed(1)).half().float()
    alone = torch.cat([mean_luma(picture) for picture in torch.split(light, 1)])
    assert torch.equal(mean_luma(light), alone)
