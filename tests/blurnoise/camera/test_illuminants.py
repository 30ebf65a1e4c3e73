"""Named spectra: what they give a camera, against figures of scene_light's table and closed forms."""

import numpy as np
import pytest

from blurnoise import Camera, Curve, photoelectrons
from blurnoise.camera import spectra
from blurnoise.camera.radiometry import colour_shares, electrons_per_lux_s, filter_electrons

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


GREY = Camera.preset("imx250m")
SILICON = Curve((400.0, 500.0, 600.0, 700.0, 800.0, 900.0, 1000.0), (0.45, 0.6, 0.5, 0.4, 0.25, 0.12, 0.03))
CUT = "state infrared_cut_nm if the camera has such a filter"
SAID = {
    "light beyond the curve": (
        {"f_number": 3.3},
        "halogen",
        rf"ends at 800 nm; this light has 1\.2 times .*; {CUT}",
    ),
    "a plain number": ({"quantum_efficiency": 0.5}, "halogen", r"ends at 700 nm; this light has 2\.9 times"),
    "curve beyond the light": (
        {"quantum_efficiency": SILICON},
        "D55",
        "spectrum ends at 830 nm, .* at 1000 nm; infra",
    ),
}


@pytest.mark.parametrize(("figures", "name", "said"), SAID.values(), ids=SAID)
def test_infrared_that_is_not_counted_is_said(figures, name, said):
    with pytest.warns(UserWarning, match=said):
        electrons_per_lux_s(GREY.with_figures(**figures), name)


@pytest.mark.parametrize(
    ("camera", "name"),
    [
        (GREY, "led-4000"),
        (IMX250C, "halogen"),
        (GREY.with_figures(infrared_cut_nm=700.0), "halogen"),
        (GREY.with_figures(quantum_efficiency=SILICON), "planck:2856"),
    ],
)
def test_no_word_on_infrared_elsewhere(camera, name, recwarn):
    electrons_per_lux_s(camera.with_figures(f_number=3.4), name)
    assert not recwarn.list


# CIE's daylight to 830 nm, Planck's law to 1000 nm.
@pytest.mark.parametrize(("name", "lost"), [("D55", 0.217), ("planck:2856", 0.575)])
@pytest.mark.filterwarnings("ignore:imx250m")
def test_light_counts_to_the_end_of_the_curve(name, lost):
    """Behind a filter at 700 nm a monochrome camera loses 22 % of daylight, and more than half of tungsten's."""
    whole = GREY.with_figures(quantum_efficiency=SILICON)
    filtered = whole.with_figures(infrared_cut_nm=700.0)
    nm = np.arange(360.0, 1001.0)
    photons = spectra.illuminant(name).at(nm) * SILICON.at(nm) * nm
    assert photons[nm >= 700].sum() / photons.sum() == pytest.approx(lost, abs=0.005)
    of_filtered = electrons_per_lux_s(filtered, name) / electrons_per_lux_s(whole, name)
    assert 1 - of_filtered == pytest.approx(lost, abs=0.005)


def test_a_filter_cuts_a_plain_number_and_the_red_of_pictures():
    """Half of the light from 580 to 700 nm is from 580 to 640, where the light has the same photons at each nm."""
    even = Curve((380.0, 780.0), (1 / 380.0, 1 / 780.0))
    grey = GREY.with_figures(quantum_efficiency=0.5, infrared_cut_nm=640.0)
    red, green, blue = colour_shares(grey, even)
    assert (red, green, blue) == pytest.approx((60 / 240, 90 / 240, 90 / 240), rel=0.15)
    assert colour_shares(grey.with_figures(infrared_cut_nm=500.0), even)[0] == 0


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
