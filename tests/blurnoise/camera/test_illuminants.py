"""Named spectra: what they give a camera, against figures of scene_light's table and closed forms."""

import numpy as np
import pytest

from blurnoise import Camera, Curve, photoelectrons
from blurnoise.camera import spectra
from blurnoise.camera.radiometry import electrons_per_lux_s, filter_electrons

IMX250C = Camera.preset("imx250c")
# Electrons behind the filters of imx250c at equal lux, relative to D55: red, green, blue; by a separate
# script, from CIE's tables (LED-B2, LED-B3, HP1), NIST's (low-pressure sodium), Planck's law and CIE's daylight.
RELATIVE = {
    "led-3000": (1.248, 0.827, 0.432),
    "led-4000": (1.104, 0.908, 0.670),
    "sodium": (1.475, 0.647, 0.141),
    "low-pressure-sodium": (1.541, 0.566, 0.0),
    "halogen": (1.207, 0.868, 0.524),
    "D65": (0.960, 1.029, 1.157),
}


@pytest.mark.parametrize("name", RELATIVE)
def test_electrons_relative_to_daylight(name):
    day, lit = filter_electrons(IMX250C), filter_electrons(IMX250C, name)
    assert [lit[letter] / day[letter] for letter in "RGB"] == pytest.approx(
        RELATIVE[name], rel=0.01, abs=1e-3
    )


@pytest.mark.parametrize(("name", "green", "blue"), [("D55", 569.1, 312.5), ("led-4000", 516.6, 209.5)])
def test_white_under_20_lux_for_10_ms(name, green, blue):
    electrons = filter_electrons(IMX250C, name)
    assert [0.2 * electrons[letter] for letter in "GB"] == pytest.approx([green, blue], rel=0.005)


@pytest.mark.parametrize(
    ("name", "kelvin"),
    [("led-2700", 2733), ("led-3000", 2998), ("led-4000", 4103), ("led-5000", 5109), ("led-6500", 6598)],
)
def test_leds_have_the_colour_that_their_name_says(name, kelvin):
    """CIE 015:2018, table 12.1. Approximated by red to blue light, which falls as the colour temperature rises."""
    ratio = [spectra.photons_per_lux_s_um2(name, (), band) for band in ((580.0, 700.0), (400.0, 490.0))]
    nearest = min(range(2000, 8000, 10), key=lambda t: abs(_red_to_blue(f"planck:{t}") - ratio[0] / ratio[1]))
    assert nearest == pytest.approx(kelvin, rel=0.15)  # a lamp is no black body


def _red_to_blue(name):
    red, blue = (spectra.photons_per_lux_s_um2(name, (), band) for band in ((580.0, 700.0), (400.0, 490.0)))
    return red / blue


@pytest.mark.parametrize("name", ["LED-4000", "d65", "Planck:2856", "Sodium"])
def test_case_does_not_matter(name):
    assert photoelectrons(IMX250C, 1.0, 1.0, name) == photoelectrons(IMX250C, 1.0, 1.0, name.lower())


def test_every_table_is_whole():
    for name in spectra.ILLUMINANTS:
        curve = spectra.illuminant(name)
        assert min(curve.values) >= 0, name
        assert spectra.photons_per_lux_s_um2(name) > 0, name
        if name.startswith("led") or name in ("sodium", "metal-halide"):
            assert np.diff(curve.wavelengths_nm).tolist() == [5.0] * 80, name


@pytest.mark.parametrize("name", ["led", "D5500", "planck", "planck:hot", "planck:1", "halogen:3200", ""])
def test_unknown_names_are_refused(name):
    with pytest.raises(ValueError, match=r"^illuminant = "):
        spectra.illuminant(name)


@pytest.mark.parametrize(
    ("nm", "power"),
    [((400.0, 700.0), (-1.0, 2.0)), ((300.0, 400.0), (2.0, 1.0)), ((400.0, 700.0), (0.0, 0.0))],
)
def test_curves_that_are_no_light_are_refused(nm, power):
    with pytest.raises(ValueError, match=r"^illuminant: (power at 400 nm|gives no visible light)"):
        spectra.photons_per_lux_s_um2(spectra.Curve(nm, power))


def test_names_are_listed_where_one_is_wrong():
    with pytest.raises(ValueError, match=r"led-4000, .*halogen, planck:KELVIN"):
        spectra.check_illuminant("street")


def test_infrared_is_not_counted_and_said_of_a_camera_without_colours():
    grey = Camera.preset("imx250m").with_figures(f_number=3.3)  # whose electrons nobody has computed
    with pytest.warns(UserWarning, match=r"infrared is not counted.* 2\.9 times"):
        electrons_per_lux_s(grey, "halogen")


@pytest.mark.parametrize(("camera", "name"), [("imx250m", "led-4000"), ("imx250c", "halogen")])
def test_no_word_on_infrared_elsewhere(camera, name, recwarn):
    electrons_per_lux_s(Camera.preset(camera).with_figures(f_number=3.4), name)
    assert not recwarn.list


def test_infrared_of_black_bodies_by_planck():
    """Photons of a black body go with x^2 / (exp(x) - 1) dx, x = hc / (lambda k T): a sum apart from the grid."""

    def photons(kelvin, low_nm, high_nm):
        x = np.linspace(
            0.014387768775 / kelvin / (high_nm * 1e-9), 0.014387768775 / kelvin / (low_nm * 1e-9), 100_001
        )
        return np.trapezoid(x**2 / np.expm1(x), x)

    expected = photons(2856.0, 700.0, 1000.0) / photons(2856.0, 400.0, 700.0)
    assert spectra.infrared_share("planck:2856") == pytest.approx(expected, rel=1e-4)
    assert spectra.infrared_share(Curve((400.0, 700.0), (1.0, 1.0))) == 0.0
