"""Spectra and named lights in training: what is drawn, what it does to pictures, and replays."""

import json

import pytest
import torch

from blurnoise import Curve, Exposure, RandomExposure
from blurnoise.camera import Camera
from blurnoise.camera.radiometry import filter_electrons
from blurnoise.light.lights import Light
from blurnoise.training.pictures import expose_pictures
from blurnoise.training.ranges import ExposureRanges
from blurnoise.training.table import ExposureTable

STILL = {"exposure_s": 0.01, "speed_px_s": 0.0, "gain_db": 0.0}
GREY = torch.full((6, 3, 16, 24), 0.5)


def drawn(count=200, **ranges):
    source = ExposureRanges("imx250c", **{**STILL, **ranges})
    uniform = torch.rand(count, source.draws, generator=torch.Generator().manual_seed(3))
    return source.exposures(source.conditions(uniform))


def test_spectra_are_equally_likely():
    names = [one.illuminant for one in drawn(300, illuminant=["D65", "sodium", "planck:2856"])]
    counts = [names.count(name) for name in ("D65", "sodium", "planck:2856")]
    assert sum(counts) == 300
    assert max(abs(count - 100) for count in counts) < 5 * (300 * 2 / 9) ** 0.5  # binomial, 5 sigma


def test_one_spectrum_draws_nothing_more():
    one, two = (ExposureRanges(**STILL, illuminant=name).draws for name in ("sodium", ["sodium", "D65"]))
    assert two == one + 1 == ExposureRanges(**STILL).draws + 1


def test_a_light_is_drawn_with_its_lux_and_spectrum():
    found = {(one.illuminance_lux, one.illuminant) for one in drawn(light="street,sodium-street,lit-street")}
    assert found == {(1.0, "led-4000"), (20.0, "sodium"), (20.0, "led-4000")}


def test_own_lights_and_curves():
    lamp = Curve((400.0, 700.0), (1.0, 2.0))
    assert {one.illuminant for one in drawn(illuminant=lamp)} == {lamp}
    assert {one.illuminance_lux for one in drawn(light=[Light("yard", 7.0, "halogen")])} == {7.0}


def test_electrons_are_those_of_the_drawn_spectrum():
    """white_e is of the strongest filter under each spectrum, so sodium needs fewer or more lux than daylight."""
    camera = Camera.preset("imx250c")
    for one in drawn(20, white_e=1000.0, illuminant=["D55", "sodium"]):
        electrons = max(filter_electrons(camera, one.illuminant).values())
        assert one.illuminance_lux * one.exposure_s * electrons == pytest.approx(1000.0, rel=1e-5)


def test_each_picture_has_the_bits_of_its_own_spectrum():
    exposures = [
        Exposure(Camera.preset("imx250c"), 0.01, 50.0, seed=item, illuminant=name)
        for item, name in enumerate(["D55", "sodium", "D55", "led-4000", "sodium", "D55"])
    ]
    together = expose_pictures(GREY, exposures)
    for item, one in enumerate(exposures):
        assert torch.equal(expose_pictures(GREY[item : item + 1], [one])[0], together[item])
    assert not torch.equal(together[0], together[1])


def test_a_replay_has_the_same_bits_and_a_seed_the_same_draws():
    expose = RandomExposure("imx250c", p=1.0, **{**STILL, "light": "street,sodium-street,dusk"})
    torch.manual_seed(4)
    first = expose(GREY)
    assert torch.equal(expose(GREY, params=expose._params), first)
    torch.manual_seed(4)
    assert torch.equal(expose(GREY), first)


def test_headlamps_light_pictures_of_lights_that_have_them():
    bright = torch.full((6, 1, 16, 24), 500.0)
    torch.manual_seed(0)
    expose = RandomExposure("imx250c", p=1.0, **STILL, light=["street", "daylight"])
    lit = expose(GREY, headlamp_lux=bright)
    params = {name: value for name, value in expose._params.items() if name != "headlamp_lux"}
    dark = expose(GREY, params=params)
    is_street = expose._params["illuminance_lux"] == 1.0
    assert 0 < is_street.sum() < 6
    changed = (lit != dark).flatten(1).any(1)
    assert torch.equal(changed, is_street)


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ({"illuminant": "candle"}, "illuminant = 'candle'"),
        ({"illuminant": []}, "at least one spectrum"),
        ({"light": "stret"}, "did you mean 'street'"),
        ({"light": []}, "at least one light"),
        ({"light": "street", "illuminance_lux": 5.0}, "light, illuminance_lux"),
        ({"light": "street", "white_e": 5.0}, "light, white_e"),
        ({"light": "street", "illuminant": "sodium"}, "light, illuminant"),
    ],
)
def test_refused(ranges, words):
    with pytest.raises(ValueError, match=words) as error:
        ExposureRanges(**STILL, **ranges)
    assert "\n" not in str(error.value)


def test_a_run_s_spectra_are_drawn_from(tmp_path):
    rows = [
        {"exposure_s": 0.01, "illuminance_lux": lux, "illuminant": name, "headlamp": beam, "camera": 0}
        for lux, name, beam in ((1.0, "led-4000", "low"), (400.0, "D65", "off"))
    ]
    document = {"cameras": [Camera.preset("imx250c").to_dict()], "conditions": rows}
    (tmp_path / "conditions.json").write_text(json.dumps(document))
    table = ExposureTable.of_run(tmp_path)
    params = table.conditions(torch.rand(50, table.draws, generator=torch.Generator().manual_seed(1)))
    found = table.exposures(params)
    assert {one.illuminant for one in found} == {"led-4000", "D65"}
    for one, beam in zip(found, table.beams(params, range(50)), strict=True):
        assert (one.illuminant, beam) in (("led-4000", "low"), ("D65", "off"))
