"""A measured T-number: the light in place of f-number and transmission, and what becomes of it when these change."""

import pytest

from blurnoise import Camera, photoelectrons

CAMERA = Camera.preset("imx250").with_figures(f_number=2.0, transmission=0.9)
SECOND_E = photoelectrons(CAMERA, 10.0, 0.1)  # E t p^2 tau / (4 N^2) times a constant


@pytest.mark.parametrize("t_number", [2.0, 2.3, 7.5])
def test_light_is_that_of_the_t_number(t_number):
    """p^2 / (4 T^2) in place of p^2 tau / (4 N^2)."""
    found = photoelectrons(CAMERA.with_figures(t_number=t_number), 10.0, 0.1)
    assert found == pytest.approx(SECOND_E * (4 * 2.0**2 / 0.9) / (4 * t_number**2))


def test_the_t_number_of_the_figures_changes_nothing():
    same = CAMERA.with_figures(t_number=2.0 / 0.9**0.5)
    assert photoelectrons(same, 10.0, 0.1) == pytest.approx(SECOND_E)
    assert same.optics == CAMERA.optics  # diffraction is that of the f-number


def test_another_f_number_scales_it():
    """Two stops: a quarter of the light."""
    measured = CAMERA.with_figures(t_number=2.2)
    stopped = measured.with_figures(f_number=4.0)
    assert stopped.lens.t_number == pytest.approx(4.4)
    assert photoelectrons(stopped, 10.0, 0.1) == pytest.approx(photoelectrons(measured, 10.0, 0.1) / 4)
    assert measured.with_figures(f_number=4.0, t_number=4.1).lens.t_number == 4.1
    assert CAMERA.with_figures(f_number=4.0).lens.t_number == 0


def test_another_transmission_takes_its_place():
    """As a fit to a grey card sets it."""
    measured = CAMERA.with_figures(t_number=2.2)
    fitted = measured.with_figures(transmission=0.45)
    assert fitted.lens.t_number == 0
    assert photoelectrons(fitted, 10.0, 0.1) == pytest.approx(SECOND_E / 2)
