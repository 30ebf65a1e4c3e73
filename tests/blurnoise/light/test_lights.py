"""Named lights: the table, and what a list of names may hold."""

import pytest

from blurnoise.camera.spectra import ILLUMINANTS
from blurnoise.light.lights import Light, lights_of, named_lights, names_of_lights


def test_the_table_is_sorted_and_each_light_has_a_source():
    lights = list(named_lights().values())
    assert [light.name for light in lights] == list(names_of_lights())
    assert [light.lux for light in lights] == sorted(light.lux for light in lights)
    assert all(light.source and light.illuminant in ILLUMINANTS for light in lights)


@pytest.mark.parametrize(
    ("name", "lux", "illuminant", "headlamp"),
    [
        ("street", 1, "led-4000", "low"),
        ("unlit-high", 0.2, "D55", "high"),
        ("daylight", 20_000, "D55", "off"),
    ],
)
def test_a_light_is_a_lux_a_spectrum_and_a_headlamp(name, lux, illuminant, headlamp):
    light = named_lights()[name]
    assert (light.lux, light.illuminant, light.headlamp) == (lux, illuminant, headlamp)


def test_a_light_is_written_in_one_line():
    assert str(named_lights()["street"]) == "street: 1 lux, led-4000, low beam"
    assert str(named_lights()["dusk"]) == "dusk: 400 lux, D65"


def test_names_are_sorted_by_lux_and_each_counts_once():
    assert [light.name for light in lights_of("dusk, street,dusk")] == ["street", "dusk"]


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("stret", "did you mean 'street'"),
        ("lit-street,sodium-street", "--lux 20 --illuminant led-4000,sodium --headlamp low$"),
        ("unlit-high,unlit-low", "--lux 0.2 --illuminant D55 --headlamp high,low$"),
        ("", "light '' is unknown"),
    ],
)
def test_refused(names, words):
    with pytest.raises(ValueError, match=words) as error:
        lights_of(names)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "fields",
    [{"lux": 0.0}, {"lux": -1.0}, {"illuminant": "moon"}, {"headlamp": "dipped"}, {"lux": float("nan")}],
)
def test_fields_are_checked(fields):
    with pytest.raises(ValueError, match=next(iter(fields))):
        Light(**{"name": "yard", "lux": 5.0, **fields})
