"""Figures of a camera: the field of a record is the whole entry."""

from dataclasses import dataclass
from typing import Annotated

import pytest

from blurnoise import Camera
from blurnoise._core.checks import Limit
from blurnoise._core.fields import check_fields
from blurnoise.camera.camera_files import FIGURES, KEYS, OVER_THE_FIELD, RECORD_OF
from blurnoise.camera.figures import CameraFigure, figures_of

CAMERA = Camera.preset("imx250")


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_has_a_title_a_place_in_files_and_limits_that_hold(name):
    figure = FIGURES[name]
    low, high, _ = figure.limit
    assert figure.title
    assert (name in KEYS) != (name in OVER_THE_FIELD)
    for beyond in (low - 1.0, 2.0 * high + 1.0):
        with pytest.raises(ValueError, match=rf"^{name} = .*: must be finite and >=? "):
            CAMERA.with_figures(**{name: beyond})
    if figure.span:
        assert low <= figure.span[0] < figure.span[1] <= high


def test_files_have_every_field_once():
    assert sorted((*KEYS, *OVER_THE_FIELD)) == sorted((*RECORD_OF, "name", "lens", "sources"))


def test_a_new_figure_is_one_entry():
    @dataclass(frozen=True)
    class Warmed:
        glow_e_s: Annotated[float, CameraFigure("Glow", "e-/s", Limit(0.0, 5.0, above=True), span=(1.0, 2.0))]

        def __post_init__(self):
            check_fields(self)

    assert figures_of(Warmed)["glow_e_s"].title == "Glow"
    for wrong in (0.0, 5.1):
        with pytest.raises(ValueError, match=rf"glow_e_s = {wrong}: must be finite and > 0 and <= 5"):
            Warmed(wrong)


def test_with_figures_names_what_it_does_not_know():
    with pytest.raises(ValueError, match="figure 'read_noise' is unknown"):
        CAMERA.with_figures(read_noise=3.0)
    with pytest.raises(ValueError, match="figure 'optics' is unknown"):
        CAMERA.with_figures(optics=None)
