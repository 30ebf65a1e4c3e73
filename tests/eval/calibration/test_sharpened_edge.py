"""Sharpening found again in slanted edges: in closed form, and behind the whole chain of a camera in colour."""

import math

import numpy as np
import pytest
import torch
from blurnoise_eval.calibration.developed import _lux_of, measure_developed
from blurnoise_eval.calibration.sharpened_edge import sharpening_of
from blurnoise_eval.datasets import write_picture
from scipy.special import ndtr

from blurnoise import Camera, Exposure, Scene, charts, take_each
from blurnoise.camera.isp import Sharpening
from blurnoise.scene.take import EIGHT_BIT

LINEAR = Camera.preset("imx250m").with_figures(tone=((0.0, 0.0), (1.0, 1.0)))
COLOUR = Camera.preset("imx250c")


def edge(strength, sigma_px, limit_dn=255.0):
    """60 to 150 DN at 4 degrees: of Gaussians alone, the mask's difference is that of two normal distributions."""
    y, x = np.mgrid[:90, :110] + 0.5
    distance = (x - 55) * math.cos(math.radians(4)) - (y - 45) * math.sin(math.radians(4))
    blurred, twice = (60 + 90 * ndtr(distance / sigma) for sigma in (sigma_px, math.hypot(sigma_px, 1)))
    return np.rint(blurred + np.clip(strength * (blurred - twice), -limit_dn, limit_dn)).astype(np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strength", "sigma_px", "limit_dn"),
    [
        (0.0, 0.8, 255.0),
        (0.5, 0.8, 255.0),
        (1.5, 0.8, 255.0),
        (1.5, 1.2, 255.0),
        (3.0, 1.0, 255.0),
        (3.0, 0.8, 15.0),
    ],
)
def test_strength_and_limit_are_those_of_the_closed_form(strength, sigma_px, limit_dn):
    found = sharpening_of(
        edge(strength, sigma_px, limit_dn), LINEAR, 0.0, lambda dn: _lux_of(LINEAR, 0.0, dn)
    )
    assert found.strength == pytest.approx(strength, rel=0.15)
    assert found.limit_dn == (255.0 if limit_dn == 255 else pytest.approx(limit_dn, rel=0.15))


@pytest.mark.slow
@pytest.mark.parametrize("strength", [0.0, 1.5])
def test_a_folder_with_an_edge_has_its_sharpening_at_all_gains(tmp_path, strength):
    """Behind colour filters, demosaicing and sRGB, with noise, of a lens that is sharper than the filters' grid."""
    camera = COLOUR.with_figures(sharpening=(Sharpening(0.0, strength),))
    flat = Scene(torch.full((1, 1, 128, 128), 0.5))
    (seen,) = take_each(
        Scene(charts.slanted_edge(110, 130, dark=0.2, bright=0.45)),
        [Exposure(camera, 0.01, 150.0, seed=1)],
        EIGHT_BIT,
    )
    write_picture(tmp_path / "edge.png", np.ascontiguousarray(seen.images()[0]))
    rows = ["file,gain_db"]
    for gain_db, lux in ((0.0, 100.0), (18.0, 12.5)):
        at = [Exposure(camera, 0.01, lux, gain_db=gain_db, seed=5 + number) for number in range(2)]
        for number, frames in enumerate(take_each(flat, at, EIGHT_BIT)):
            write_picture(tmp_path / f"{gain_db:g}-{number}.png", np.ascontiguousarray(frames.images()[0]))
            rows.append(f"{gain_db:g}-{number}.png,{gain_db}")
    (tmp_path / "frames.csv").write_text("\n".join(rows))
    found = measure_developed(tmp_path, COLOUR)
    rows, source = found.known["sharpening"]
    assert source.startswith("measured: the edge edge.png in ")
    assert [row.strength for row in rows] == ([pytest.approx(strength, rel=0.2)] if strength else [])


def test_what_is_no_edge_is_one_line():
    with pytest.raises(
        ValueError, match="edge: must be one slanted edge from border to border; no step stands out"
    ):
        sharpening_of(np.full((90, 90, 3), 120, np.uint8), LINEAR, 0.0, float)
