"""Lamps in near infrared, in W/m2 beside lux: the photons of EMVA 1288, and who sees them."""

import pytest

from blurnoise import Camera, Curve, photoelectrons
from blurnoise.camera.radiometry import check_sees, colour_shares
from blurnoise.camera.spectra import check_illuminant, photons_per_lux_s_um2, with_infrared

EVEN = Curve((400.0, 1000.0), (0.5, 0.5))
GREY = Camera.preset("imx250m").with_figures(
    quantum_efficiency=EVEN, f_number=2.0, transmission=0.8, pixel_pitch_um=3.0
)
DARK_LUX = 1e-6


@pytest.mark.parametrize("nm", [850, 940])
def test_electrons_are_those_of_emva_1288(nm):
    """mu_p = 50.34 A t lambda E (um^2, ms, um, uW/cm^2), release 4, section 2.2; a lens passes tau / (4 N^2) of E."""
    irradiance_uw_cm2 = 0.2 * 100  # 0.2 W/m2
    on_sensor = irradiance_uw_cm2 * 0.8 / (4 * 2.0**2)
    expected = 0.5 * 50.34 * 9.0 * 5.0 * nm / 1e3 * on_sensor
    lit = with_infrared("D55", DARK_LUX, f"{nm}:0.2")
    assert photoelectrons(GREY, DARK_LUX, 0.005, lit) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("source", ["D55", "led-4000", "low-pressure-sodium", "planck:2856"])
def test_the_light_of_lux_stays_what_it_is(source):
    """Electrons of light and lamp add up, whatever the light's table."""
    lamp = photoelectrons(GREY, DARK_LUX, 1.0, with_infrared("D55", DARK_LUX, "850:0.01"))
    both = photoelectrons(GREY, 2.0, 1.0, with_infrared(source, 2.0, "850:0.01"))
    assert both - lamp == pytest.approx(photoelectrons(GREY, 2.0, 1.0, source), rel=2e-3)
    visible = (400.0, 700.0)
    lit = photons_per_lux_s_um2(with_infrared(source, 2.0, "850:0.01"), (), visible)
    assert lit == pytest.approx(photons_per_lux_s_um2(source, (), visible), rel=1e-3)


def test_pictures_of_the_lamp_are_their_red():
    red, green, blue = colour_shares(GREY, with_infrared("D55", DARK_LUX, "850:1"))
    assert red == pytest.approx(1)
    assert green + blue < 1e-3


@pytest.mark.parametrize(
    ("camera", "end"), [("imx250c", 660), ("imx250m", 800), (GREY.with_figures(infrared_cut_nm=700.0), 700)]
)
def test_cameras_that_see_nothing_of_it(camera, end):
    seen_by = Camera.preset(camera) if isinstance(camera, str) else camera
    with pytest.raises(ValueError, match=rf"infrared = '850:1': imx250. sees nothing from {end} nm on"):
        check_sees(seen_by, "850:1")
    check_sees(GREY, "850:1")


@pytest.mark.parametrize("text", ["850", "850:", "900:1", "850:0", "850:-1", "850:nan", "lamp", "850:1:2"])
def test_other_words_for_lamps_are_refused(text):
    with pytest.raises(ValueError, match=r"infrared = .* must be NM:IRRADIANCE in W/m2"):
        with_infrared("D55", 1.0, text)


@pytest.mark.parametrize("name", ["led-850", "LED-940", "850nm", "ir 940"])
def test_lux_do_not_count_infrared(name):
    with pytest.raises(ValueError, match=r"is infrared, which lux do not count; .*infrared = (850|940):IRR"):
        check_illuminant(name)


def test_the_lamp_needs_some_visible_light():
    with pytest.raises(ValueError, match="beside infrared"):
        with_infrared("D55", 0.0, "850:1")
