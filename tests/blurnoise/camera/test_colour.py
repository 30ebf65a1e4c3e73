"""Spectra and colour cameras: CIE data, lux to electrons, filters, balance and matrices, files and their faults."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from blurnoise_eval.cameras import behind_one_filter
from generic_filters import behind_generic_filters

from blurnoise import Camera, Curve, photoelectrons
from blurnoise.camera import PRESETS, spectra
from blurnoise.camera.colour import FilterCurves, inverse, normalised
from blurnoise.camera.radiometry import clear_shares, colour_shares, electrons_per_lux_s, filter_electrons
from blurnoise.picture.steps import GAIN_MAX, magnification, matrix, site_gains

REFERENCE = Path(__file__).resolve().parents[3].parent / "shared" / "reference" / "spectra"
needs_reference = pytest.mark.skipif(not REFERENCE.is_dir(), reason="the paper's curves are not here")
IMX250 = PRESETS["imx250"]
EVEN = FilterCurves(0.5, 0.5, 0.5, 0.5)
COLOUR = IMX250.with_figures(cfa="RGGB", quantum_efficiency=EVEN)


def ar0237(column, end_nm):
    """Its curve of a filter, times the IR-cut filter's."""
    own = Curve.from_csv(REFERENCE / "ar0237_qe_curves.csv", column)
    nm = [each for each in own.wavelengths_nm if 400 <= each <= end_nm]
    cut = Curve.from_csv(REFERENCE / "ir_cut_filter.csv").at(np.array(nm))
    return Curve(tuple(nm), tuple(np.maximum(0.0, own.at(np.array(nm)) * cut)))


@needs_reference
def test_electrons_and_white_balance_of_the_ar0237():
    """R 2152, G 2872, B 1877 e-/(lux s) under D55; white balance 1.334, 1, 1.530."""
    curves = FilterCurves(**{name: ar0237(k, 700) for k, name in ((3, "blue"), (2, "green"), (1, "red"))})
    camera = COLOUR.with_figures(pixel_pitch_um=3.0, f_number=1.4, quantum_efficiency=curves)
    electrons = filter_electrons(camera)
    assert dict(electrons) == pytest.approx({"R": 2152, "G": 2872, "B": 1877}, abs=1)
    assert electrons_per_lux_s(camera) == electrons["G"]
    assert photoelectrons(camera, 50, 0.03) == pytest.approx(4308, abs=1)
    assert site_gains(camera) == pytest.approx((1.334, 1, 1, 1.530), abs=1e-3)


@pytest.mark.parametrize(("band_nm", "photons"), [((400, 700), 10724), ((380, 780), 14050)])
def test_d55_photons_per_lux(band_nm, photons):
    assert spectra.photons_per_lux_s_um2("D55", (), band_nm) == pytest.approx(photons, rel=1e-4)


def test_monochromatic_photons_per_lux():
    """4090.8 photons per (lux s um^2) at 555 nm: 1 / (683 V h c / lambda)."""
    line = Curve((554.0, 555.0, 556.0), (0.0, 1.0, 0.0))
    assert spectra.photons_per_lux_s_um2(line, ()) == pytest.approx(4090.8, rel=1e-4)


def test_daylight_against_cie_table():
    """D65 (CIE 15 table T.1, rounded): S(450) = 117.01, S(560) = 100, S(650) = 80.0268."""
    found = spectra.illuminant("D65").at(np.array([450.0, 560.0, 650.0])) * 100
    np.testing.assert_allclose(found, [117.008, 100.0, 80.0268], rtol=5e-4)


def test_planck_obeys_wien():
    """A black body of 5500 K peaks at 2.897772e-3 m K / 5500 K = 526.9 nm."""
    curve = spectra.planck(5500)
    assert curve.wavelengths_nm[int(np.argmax(curve.values))] == pytest.approx(526.9, abs=0.6)


def test_electrons_are_linear_and_follow_the_lens():
    camera = Camera.preset("imx250")
    one = photoelectrons(camera, 1.0, 1.0)
    assert photoelectrons(camera, 50.0, 0.03) == pytest.approx(1.5 * one, rel=1e-12)
    slower = camera.with_figures(f_number=2 * camera.lens.f_number)
    assert photoelectrons(slower, 1.0, 1.0) == pytest.approx(one / 4, rel=1e-12)
    assert photoelectrons(camera, 0.0, 1.0) == 0.0


def test_white_balance_follows_the_light_or_stays():
    camera = PRESETS["imx250c"]
    red, green, _, blue = site_gains(camera, "planck:2856")
    assert (red, green > 1, blue > green) == (1.0, True, True)  # a lamp is red
    electrons = filter_electrons(camera, "planck:2856")
    assert green == pytest.approx(electrons["R"] / electrons["G"])
    assert electrons_per_lux_s(camera, "planck:2856") == electrons["R"]
    stays = camera.with_figures(white_balance=(2.0, 1.0, 1.5))
    assert site_gains(stays, "planck:2856") == site_gains(stays) == (2.0, 1.0, 1.0, 1.5)
    least = camera.with_figures(white_balance=(1.0, 0.5, 0.75))
    assert site_gains(least) == site_gains(stays)
    sodium = Curve((580.0, 589.0, 598.0), (0.0, 1.0, 0.0))
    assert site_gains(camera, sodium)[3] == GAIN_MAX  # as good as no blue


@pytest.mark.parametrize("cfa", ["RGGB", "RCCB"])
def test_matrices_keep_white_and_inverses_undo_them(cfa):
    camera = PRESETS["imx250c"].with_figures(cfa=cfa, quantum_efficiency=behind_generic_filters(0.6))
    assert [sum(row) for row in matrix(camera)] == pytest.approx([1, 1, 1])
    back = inverse(camera.isp.ccm)
    assert camera.isp.ccm is not None
    np.testing.assert_allclose(np.array(normalised(camera.isp.ccm)) @ back, np.eye(3), atol=1e-12)


def test_green_by_difference():
    """C - R - B; less than a twentieth of clear is no green."""
    camera = IMX250.with_figures(cfa="RCCB", quantum_efficiency=FilterCurves(red=0.2, blue=0.1, clear=0.5))
    assert clear_shares(camera) == pytest.approx((0.4, 0.4, 0.2))
    assert matrix(camera)[1] == pytest.approx((-1, 2.5, -0.5))
    with pytest.raises(ValueError, match=r"clear makes .* cfa = 'RCCB' takes green from the difference"):
        clear_shares(camera.with_figures(quantum_efficiency=FilterCurves(red=0.3, blue=0.2, clear=0.5)))


def test_one_plane_weighs_colours_by_what_they_make():
    """Of flat response and light per photon the shares are the bands' widths."""
    per_photon = Curve(tuple(range(400, 701)), tuple(1 / nm for nm in range(400, 701)))
    flat = IMX250.with_figures(cfa="mono", quantum_efficiency=0.5)
    assert colour_shares(flat, per_photon) == pytest.approx((120 / 300, 90 / 300, 90 / 300), abs=1e-3)
    red_only = flat.with_figures(quantum_efficiency=Curve((600.0, 700.0), (0.5, 0.5)))
    assert colour_shares(red_only) == pytest.approx((1, 0, 0))


def test_one_filter_of_a_mosaic_and_its_magnification_of_noise():
    camera = PRESETS["imx250c"]
    alone = behind_one_filter(camera)
    assert (alone.sensor.cfa, alone.sensor.quantum_efficiency) == (
        "none",
        camera.sensor.quantum_efficiency.green,
    )
    assert electrons_per_lux_s(alone) == electrons_per_lux_s(camera)
    rows = ((1.3, 0.0, -0.3), (-0.5, 1.4, 0.1), (-0.578125, -0.25, 1.828125))
    expected = (0.578125**2 + 0.25**2 + 1.828125**2) ** 0.5  # standard deviation of unit noise in blue
    assert magnification(COLOUR.with_figures(ccm=rows)) == pytest.approx(expected)
    assert magnification(IMX250) == 1


def test_curves_of_filters_come_from_tables(tmp_path):
    (tmp_path / "qe.csv").write_text("nm,r,g,b\n400,0.0,0.1,0.3\n550,0.2,0.5,0.0\n700,0.4,0.0,0.0\n")
    columns = {
        name: {"csv": "qe.csv", "column": place} for place, name in enumerate(("red", "green", "blue"), 1)
    }
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"base": "imx250", "cfa": "BGGR", "quantum_efficiency": columns}))
    curves = Camera.load(path).sensor.quantum_efficiency
    assert isinstance(curves, FilterCurves)
    assert curves.green == Curve((400.0, 550.0, 700.0), (0.1, 0.5, 0.0))
    short = {"red": {"wavelengths_nm": [500, 600], "values": [0.1, 0.3]}, "green": 0.3, "blue": 0.2}
    path.write_text(yaml.safe_dump({"base": "imx250", "cfa": "BGGR", "quantum_efficiency": short}))
    assert "marked: red begins at 500 nm with 33%" in Camera.load(path).sources["quantum_efficiency"]


def test_csv_of_any_step_and_header(tmp_path):
    path = tmp_path / "qe.csv"
    path.write_text("wavelength,red,green\n400,0,0.1\n425.5,0,0.2\n700,0,0.4\n")
    values = Curve.from_csv(path, column=2).at(np.array([399.0, 400.0, 412.75, 700.0, 701.0]))
    assert values.tolist() == pytest.approx([0, 0.1, 0.15, 0.4, 0])
    for text in ("400,1\n", "400,1\n500,x\n", "", "header\n400,1\n401\n"):
        path.write_text(text)
        with pytest.raises(ValueError, match=r"qe\.csv"):
            Curve.from_csv(path)


ROWS = [[1, 0, 0], [0.1, 1, 0.1], [0, 0, 1]]


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: COLOUR.with_figures(cfa="RGBG"), "cfa = 'RGBG': must be one of 'none', 'mono', 'RGGB'"),
        (lambda: COLOUR.with_figures(cfa="none"), "quantum_efficiency: states filters; cfa = 'none' has none"),
        (lambda: COLOUR.with_figures(cfa="RCCB", quantum_efficiency=FilterCurves(0.5, 0.5, 0.5)), "missing clear"),
        (lambda: COLOUR.with_figures(quantum_efficiency=0.5), "cfa = 'RGGB' needs red, green, blue of its own"),
        (lambda: COLOUR.with_figures(ccm=ROWS), "ccm: row 2 sums to 1.2; each must sum to 1"),
        (lambda: COLOUR.with_figures(ccm=[["a", 0, 0]]), "ccm = [['a', 0, 0]]: must be three rows of three"),
        (lambda: COLOUR.with_figures(ccm=[[1, 0, 0]] * 3), "must have an inverse"),
        (lambda: COLOUR.with_figures(white_balance="grey"), "white_balance = 'grey': must be 'auto' or three gains"),
        (lambda: COLOUR.with_figures(white_balance=(1, 0, 1)), "white_balance = (1, 0, 1): must be 'auto' or three"),
        (lambda: COLOUR.with_figures(tone=[(0, 0), (0.5, 1)]), "light must increase from 0 to 1"),
        (lambda: COLOUR.with_figures(tone=[(0, 0.5), (1, 0.4)]), "and never fall"),
        (lambda: IMX250.with_figures(ccm=np.eye(3).tolist()), "ccm: cfa = 'none' has no colours"),
        (lambda: IMX250.with_figures(cfa="mono", white_balance=(1, 1, 2)), "white_balance: cfa = 'mono' has no"),
        (lambda: Curve((2.0, 1.0), (1.0, 1.0)), "wavelengths_nm"),
        (lambda: Curve((1.0, 2.0), (1.0, float("nan"))), "values"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(call, named):
    with pytest.raises((ValueError, TypeError)) as error:
        call()
    assert named in str(error.value)
    assert len(str(error.value).splitlines()) == 1
