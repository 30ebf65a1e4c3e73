"""Colour cameras: their fields and files, and the figures that public curves and matrices give."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from blurnoise_eval.cameras import behind_one_filter
from generic_filters import behind_generic_filters

from blurnoise import Camera, Curve, photoelectrons
from blurnoise.optics.camera import PRESETS
from blurnoise.optics.colour import FilterCurves, inverse, normalised
from blurnoise.optics.radiometry import (
    clear_shares,
    colour_shares,
    electrons_per_lux_s,
    filter_electrons,
)
from blurnoise.picture.steps import GAIN_MAX, magnification, matrix, site_gains

REFERENCE = Path(__file__).resolve().parents[2].parent / "shared" / "reference" / "spectra"
IMX250 = PRESETS["imx250"]
ROWS = [[1.3671875, -0.0546875, -0.3125], [-0.53125, 1.4609375, 0.0703125], [-0.578125, -0.25, 1.828125]]
"""Of the AR0231 in openpilot, system/camerad/sensors."""
EVEN = FilterCurves(0.5, 0.5, 0.5, 0.5)
COLOUR = replace(IMX250, cfa="RGGB", quantum_efficiency=EVEN)


@pytest.fixture(scope="module")
def ar0237() -> Camera:
    """3.0 um, f/1.4, its curves times the IR-cut filter's."""
    if not REFERENCE.is_dir():
        pytest.skip("reference curves not present")
    cut = Curve.from_csv(REFERENCE / "ir_cut_filter.csv")
    curves = {}
    for column, name in ((3, "blue"), (2, "green"), (1, "red")):
        own = Curve.from_csv(REFERENCE / "ar0237_qe_curves.csv", column)
        nm = [each for each in own.wavelengths_nm if 400 <= each <= 700]
        values = [max(0.0, q * t) for q, t in zip(own.at(nm), cut.at(nm), strict=True)]  # type: ignore[arg-type]
        curves[name] = Curve(tuple(nm), tuple(values))
    return replace(
        IMX250, pixel_pitch_um=3.0, f_number=1.4, cfa="RGGB", quantum_efficiency=FilterCurves(**curves)
    )


def test_electrons_and_white_balance_of_the_ar0237(ar0237: Camera) -> None:
    """R 2152, G 2872, B 1877 e-/(lux s) under D55; white balance 1.334, 1, 1.530."""
    electrons = filter_electrons(ar0237)
    assert dict(electrons) == pytest.approx({"R": 2152, "G": 2872, "B": 1877}, abs=1)
    assert electrons_per_lux_s(ar0237) == electrons["G"]
    assert photoelectrons(ar0237, 50, 0.03) == pytest.approx(4308, abs=1)
    assert site_gains(ar0237) == pytest.approx((1.334, 1, 1, 1.530), abs=1e-3)


def test_white_balance_follows_the_light_or_stays() -> None:
    camera = PRESETS["imx250c"]
    red, green, _, blue = site_gains(camera, "planck:2856")
    assert (red, green > 1, blue > green) == (1.0, True, True)  # a lamp is red
    electrons = filter_electrons(camera, "planck:2856")
    assert green == pytest.approx(electrons["R"] / electrons["G"])
    assert electrons_per_lux_s(camera, "planck:2856") == electrons["R"]
    stays = replace(camera, white_balance=(2.0, 1.0, 1.5))
    assert site_gains(stays, "planck:2856") == site_gains(stays) == (2.0, 1.0, 1.0, 1.5)
    least = replace(camera, white_balance=(1.0, 0.5, 0.75))
    assert site_gains(least) == site_gains(stays)
    sodium = Curve((580.0, 589.0, 598.0), (0.0, 1.0, 0.0))
    assert site_gains(camera, sodium)[3] == GAIN_MAX  # as good as no blue


@pytest.mark.parametrize("cfa", ["RGGB", "RCCB"])
def test_matrices_keep_white_and_inverses_undo_them(cfa: Any) -> None:
    camera = replace(PRESETS["imx250c"], cfa=cfa, quantum_efficiency=behind_generic_filters(0.6))
    assert [sum(row) for row in matrix(camera)] == pytest.approx([1, 1, 1])
    back = inverse(camera.ccm)
    assert camera.ccm is not None
    for i in range(3):
        for j in range(3):
            product = sum(normalised(camera.ccm)[i][k] * back[k][j] for k in range(3))
            assert product == pytest.approx(float(i == j), abs=1e-12)


def test_green_by_difference() -> None:
    """C - R - B; less than a twentieth of clear is no green."""
    camera = replace(IMX250, cfa="RCCB", quantum_efficiency=FilterCurves(red=0.2, blue=0.1, clear=0.5))
    assert clear_shares(camera) == pytest.approx((0.4, 0.4, 0.2))
    assert matrix(camera)[1] == pytest.approx((-1, 2.5, -0.5))
    with pytest.raises(ValueError, match=r"clear makes .* cfa = 'RCCB' makes green of what clear has more"):
        clear_shares(replace(camera, quantum_efficiency=FilterCurves(red=0.3, blue=0.2, clear=0.5)))


def test_magnification_is_of_noise() -> None:
    """Standard deviations of unit noise: gains times the rows' norms, the blue row's here."""
    camera = replace(COLOUR, ccm=ROWS)
    assert magnification(camera) == pytest.approx((0.578125**2 + 0.25**2 + 1.828125**2) ** 0.5)
    assert magnification(IMX250) == 1


def test_one_plane_weighs_colours_by_what_they_make() -> None:
    """Of flat response and light per photon the shares are the bands' widths."""
    per_photon = Curve(tuple(range(400, 701)), tuple(1 / nm for nm in range(400, 701)))
    flat = replace(IMX250, cfa="mono", quantum_efficiency=0.5)
    assert colour_shares(flat, per_photon) == pytest.approx((120 / 300, 90 / 300, 90 / 300), abs=1e-3)
    red_only = replace(flat, quantum_efficiency=Curve((600.0, 700.0), (0.5, 0.5)))
    assert colour_shares(red_only) == pytest.approx((1, 0, 0))


def test_one_filter_of_a_mosaic() -> None:
    camera = PRESETS["imx250c"]
    alone = behind_one_filter(camera)
    assert isinstance(camera.quantum_efficiency, FilterCurves)
    assert (alone.cfa, alone.quantum_efficiency) == ("none", camera.quantum_efficiency.green)
    assert electrons_per_lux_s(alone) == electrons_per_lux_s(camera)
    assert behind_one_filter(IMX250) == IMX250


def test_files_bring_colour_cameras_back(tmp_path: Path) -> None:
    curves = FilterCurves(0.3, Curve((400.0, 700.0), (0.2, 0.4)), 0.2)
    camera = replace(
        IMX250, name="own", cfa="GRBG", quantum_efficiency=curves, ccm=ROWS, white_balance=(1.5, 1, 2.0),
        demosaic="edge", tone=[(0, 0), (0.5, 0.8), (1, 1)], jpeg_quality=90,
    )  # fmt: skip
    for suffix in ("yaml", "json"):
        camera.save(tmp_path / f"own.{suffix}")
        assert Camera.load(tmp_path / f"own.{suffix}") == camera
    assert hash(camera) == hash(replace(camera))


def test_curves_of_filters_come_from_tables(tmp_path: Path) -> None:
    (tmp_path / "qe.csv").write_text("nm,r,g,b\n400,0.0,0.1,0.3\n550,0.2,0.5,0.0\n700,0.4,0.0,0.0\n")
    columns = {
        name: {"csv": "qe.csv", "column": place} for place, name in enumerate(("red", "green", "blue"), 1)
    }
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"base": "imx250", "cfa": "BGGR", "quantum_efficiency": columns}))
    curves = Camera.load(path).quantum_efficiency
    assert isinstance(curves, FilterCurves)
    assert curves.green == Curve((400.0, 550.0, 700.0), (0.1, 0.5, 0.0))
    short = {"red": {"wavelengths_nm": [500, 600], "values": [0.1, 0.3]}, "green": 0.3, "blue": 0.2}
    path.write_text(yaml.safe_dump({"base": "imx250", "cfa": "BGGR", "quantum_efficiency": short}))
    assert "marked: red begins at 500 nm with 33%" in Camera.load(path).sources["quantum_efficiency"]


@pytest.mark.parametrize(
    ("change", "kind", "named"),
    [
        ({"cfa": "RGBG"}, ValueError, "cfa = 'RGBG': must be one of 'none', 'mono', 'RGGB', 'GRBG', 'GBRG'"),
        ({"cfa": "none"}, ValueError, "quantum_efficiency: states filters; cfa = 'none' has none"),
        ({"cfa": "RCCB", "quantum_efficiency": FilterCurves(0.5, 0.5, 0.5)}, ValueError, "missing clear"),
        ({"quantum_efficiency": 0.5}, ValueError, "cfa = 'RGGB' needs red, green, blue of its own; missing red"),
        ({"ccm": [[1, 0, 0], [0.1, 1, 0.1], [0, 0, 1]]}, ValueError, "ccm: row 2 sums to 1.2; each must sum to 1"),
        ({"ccm": [[1, 0], [0, 1]]}, ValueError, "ccm = [[1, 0], [0, 1]]: must be three rows"),
        ({"ccm": [["a", 0, 0]]}, TypeError, "ccm = [['a', 0, 0]]: must be three rows of three finite numbers"),
        ({"ccm": [[1, 0, 0]] * 3}, ValueError, "must have an inverse"),
        ({"ccm": [[float("nan"), 0, 0]] * 3}, ValueError, "must be three rows of three finite numbers"),
        ({"white_balance": "grey"}, ValueError, "white_balance = 'grey': must be 'auto' or three gains"),
        ({"white_balance": (1, 0, 1)}, ValueError, "white_balance = (1, 0, 1): must be 'auto' or three gains from"),
        ({"white_balance": None}, ValueError, "white_balance = None"),
        ({"demosaic": "menon"}, ValueError, "demosaic = 'menon': must be one of 'bilinear', 'edge'"),
        ({"jpeg_quality": 0}, ValueError, "jpeg_quality = 0: must be finite and >= 1"),
        ({"tone": "log"}, ValueError, "tone = 'log': must be 'srgb', 'filmic' or points"),
        ({"tone": [(0, 0), (0.5, 1)]}, ValueError, "light must increase from 0 to 1"),
        ({"tone": [(0, 0.5), (1, 0.4)]}, ValueError, "and never fall"),
        ({"tone": 7}, ValueError, "tone = 7: must be 'srgb', 'filmic' or points"),
        ({"quantum_efficiency": FilterCurves}, TypeError, "quantum_efficiency = "),
    ],
)  # fmt: skip
def test_bad_fields_are_named(change: dict[str, Any], kind: type[Exception], named: str) -> None:
    with pytest.raises((ValueError, TypeError)) as error:
        replace(COLOUR, **change)
    assert error.type is kind
    assert named in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_what_has_no_colours_is_not_corrected() -> None:
    for camera in (IMX250, replace(IMX250, cfa="mono")):
        with pytest.raises(ValueError, match=r"ccm: cfa = '(none|mono)' has no colours"):
            replace(camera, ccm=ROWS)
        with pytest.raises(ValueError, match=r"white_balance: cfa = '(none|mono)' has no colours"):
            replace(camera, white_balance=(1, 1, 2))
    with pytest.raises(ValueError, match=r"red = 2\.0: must be finite and >= 0 and <= 1"):
        FilterCurves(red=2.0)
