"""Spectra: CIE data against independent facts, the anchors of the lux-to-electrons conversion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from blurnoise import Camera, Curve, photoelectrons
from blurnoise.optics import spectra

REFERENCE = Path(__file__).resolve().parents[2].parent / "shared" / "reference" / "spectra"
needs_reference = pytest.mark.skipif(not REFERENCE.is_dir(), reason="the paper's curves are not here")


def within_649(curve: Curve) -> Curve:
    """The samples from 400 to 649 nm."""
    kept = [pair for pair in zip(curve.wavelengths_nm, curve.values, strict=True) if 400 <= pair[0] <= 649]
    return Curve(*np.transpose(kept))


def paper_camera() -> Camera:
    """Green AR0237 behind the IR-cut filter."""
    qe = within_649(Curve.from_csv(REFERENCE / "ar0237_qe_curves.csv", column=2))
    nm = np.array(qe.wavelengths_nm)
    behind = qe.at(nm) * Curve.from_csv(REFERENCE / "ir_cut_filter.csv").at(nm)
    return replace(Camera.preset("lin2024"), quantum_efficiency=Curve(tuple(nm), tuple(behind)))


@needs_reference
@pytest.mark.parametrize(("exposure_s", "electrons"), [(0.030, 5774.616), (0.005, 962.436)])
def test_paper_tool_anchor(exposure_s: float, electrons: float) -> None:
    """Planck 5500 K cut to 400-649 nm, as the tool does, green AR0237 behind the IR-cut."""
    light = within_649(spectra.planck(5500))
    found = photoelectrons(paper_camera(), 50.0, exposure_s, light)
    assert found == pytest.approx(electrons, rel=1e-3)


@needs_reference
def test_paper_text_anchor_d55() -> None:
    light = within_649(Curve.from_csv(REFERENCE / "d55.csv"))
    assert photoelectrons(paper_camera(), 50.0, 0.03, light) == pytest.approx(5780.2, rel=1e-3)
    cie = within_649(spectra.illuminant("D55"))
    assert photoelectrons(paper_camera(), 50.0, 0.03, cie) == pytest.approx(5780.2, rel=1e-3)


def test_unit_response_anchor() -> None:
    light = within_649(spectra.planck(5500))
    camera = replace(Camera.preset("lin2024"), quantum_efficiency=1.0)
    assert photoelectrons(camera, 50.0, 0.03, light) == pytest.approx(20360, rel=1e-3)


@pytest.mark.parametrize(("band_nm", "photons"), [((400, 700), 10724), ((380, 780), 14050)])
def test_d55_photons_per_lux(band_nm: tuple[float, float], photons: float) -> None:
    assert spectra.photons_per_lux_s_um2("D55", (), band_nm) == pytest.approx(photons, rel=1e-4)


def test_monochromatic_photons_per_lux() -> None:
    """4090.8 photons per (lux s um^2) at 555 nm: 1 / (683 V h c / lambda)."""
    line = Curve((554.0, 555.0, 556.0), (0.0, 1.0, 0.0))
    assert spectra.photons_per_lux_s_um2(line, ()) == pytest.approx(4090.8, rel=1e-4)


def test_v_peaks_at_555() -> None:
    v = spectra._table("v_lambda.csv", 1)
    assert v.at(np.array([555.0]))[0] == 1.0
    assert np.trapezoid(v.values, v.wavelengths_nm) == pytest.approx(106.86, abs=0.01)


def test_daylight_against_cie_table() -> None:
    """D65 (CIE 15 table T.1, rounded): S(450) = 117.01, S(560) = 100, S(650) = 80.0268."""
    found = spectra.illuminant("D65").at(np.array([450.0, 560.0, 650.0])) * 100
    np.testing.assert_allclose(found, [117.008, 100.0, 80.0268], rtol=5e-4)


def test_planck_obeys_wien() -> None:
    """A black body of 5500 K peaks at 2.897772e-3 m K / 5500 K = 526.9 nm."""
    curve = spectra.planck(5500)
    assert curve.wavelengths_nm[int(np.argmax(curve.values))] == pytest.approx(526.9, abs=0.6)


def test_electrons_are_linear_and_follow_the_lens() -> None:
    camera = Camera.preset("imx250")
    one = photoelectrons(camera, 1.0, 1.0)
    assert photoelectrons(camera, 50.0, 0.03) == pytest.approx(1.5 * one, rel=1e-12)
    slower = replace(camera, f_number=2 * camera.f_number)
    assert photoelectrons(slower, 1.0, 1.0) == pytest.approx(one / 4, rel=1e-12)
    assert photoelectrons(camera, 0.0, 1.0) == 0.0


def test_responses_as_numbers_and_curves_agree() -> None:
    flat = Curve((300.0, 1100.0), (0.5, 0.5))
    number, curve = (spectra.photons_per_lux_s_um2("D55", (each,)) for each in (0.5, flat))
    assert number == pytest.approx(curve, rel=1e-9)


def test_csv_any_step_and_header(tmp_path: Path) -> None:
    path = tmp_path / "qe.csv"
    path.write_text("wavelength,red,green\n400,0,0.1\n425.5,0,0.2\n700,0,0.4\n")
    curve = Curve.from_csv(path, column=2)
    assert curve.at(np.array([399.0, 400.0, 412.75, 700.0, 701.0])).tolist() == [
        0,
        0.1,
        0.15000000000000002,
        0.4,
        0,
    ]


@pytest.mark.parametrize("text", ["400,1\n", "400,1\n500,x\n", "", "header\n400,1\n401\n"])
def test_bad_csv_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"bad\.csv"):
        Curve.from_csv(path)


@pytest.mark.parametrize("name", ["D99", "planck:hot", "planck:-3", ""])
def test_unknown_illuminant(name: str) -> None:
    with pytest.raises(ValueError, match="illuminant"):
        spectra.photons_per_lux_s_um2(name, ())


def test_bad_curves() -> None:
    for nm, values in (((1.0,), (1.0,)), ((2.0, 1.0), (1.0, 1.0)), ((1.0, 2.0), (1.0, float("nan")))):
        with pytest.raises(ValueError, match=r"^wavelengths_nm|^values"):
            Curve(nm, values)
