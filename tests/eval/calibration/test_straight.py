"""K where no part of the curve is straight, and what rounding to 8 bits leaves of a camera; by NumPy alone."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure

REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "emva_ccd"
SIZE = (128, 161)
GAIN, READ_DN, BLACK_DN, TOP_DN = 0.02, 0.28, 3.3, 255
SAGGING = ((0.02, 1.25), (0.3, 1.05), (0.7, 0.95), (0.97, 0.55))
STRAIGHT = ((0.0, 1.0),)


def save(folder, seed, factors=STRAIGHT, read_dn=READ_DN, row_dn=0.0, levels=16):
    """Two dark and two flat frames of each exposure, up to saturation; factors: of shot noise over the signal."""
    random = np.random.default_rng(seed)
    response = 1 + 0.007 * random.standard_normal(SIZE)
    rows = ["file,kind,exposure_s"]
    for step in range(1, levels + 1):
        for kind in ("dark", "flat"):
            signal_dn = 1.1 * (TOP_DN - BLACK_DN) * step / levels * response if kind == "flat" else 0.0
            factor = np.interp(signal_dn / (TOP_DN - BLACK_DN), *np.transpose(factors))
            for number in range(2):
                noise_dn = np.sqrt(read_dn**2 + GAIN * factor * signal_dn) * random.standard_normal(SIZE)
                noise_dn += row_dn * random.standard_normal((SIZE[0], 1))
                name = f"{kind}-{step}-{number}.npy"
                dn = np.rint(BLACK_DN + signal_dn + noise_dn).clip(0, TOP_DN)
                np.save(folder / name, dn.astype(np.uint8))
                rows.append(f"{name},{kind},{step / 1000}")
    (folder / "frames.csv").write_text("\n".join(rows))
    return folder


@pytest.fixture(scope="module")
def sagging(tmp_path_factory):
    return measure(save(tmp_path_factory.mktemp("sagging"), 1, SAGGING))


def test_k_of_a_curve_without_a_straight_part_is_that_of_the_standard(sagging):
    """Unweighted, up to 70 % of the variance's peak, from the noise in the dark on; a weighted line has 8 % more."""
    mean, variance = (
        np.array([getattr(level, name) for level in sagging.flat]) for name in ("mean_dn", "variance_dn2")
    )
    signal, photo = mean - BLACK_DN, variance - READ_DN**2 - 1 / 12
    used = signal <= 0.7 * signal[np.argmax(variance)]
    expected = (signal[used] @ photo[used]) / (signal[used] @ signal[used])
    found = sagging.estimates["system_gain_dn_per_e"]
    assert found.value == pytest.approx(expected, rel=0.015)
    assert found.low < expected < found.high
    assert 0.02 < (found.high - found.low) / found.value < 0.2


def test_the_bend_begins_at_the_dimmest_level(sagging):
    """Chance: 1 % for each level, less for the lines through several."""
    assert sagging.bend.straight_dn is None
    assert sagging.bend.shares[0] < 0.1
    shares = np.linspace(0.08, 0.9, 9)
    factors = np.interp(shares, sagging.bend.shares, [factor.value for factor in sagging.bend.factors])
    found = sagging.estimates["system_gain_dn_per_e"].value * factors
    np.testing.assert_allclose(found, GAIN * np.interp(shares, *np.transpose(SAGGING)), rtol=0.03)


def test_a_bend_with_means_in_proportion_to_the_light_is_no_tone_curve(sagging):
    assert not sagging.doubts


def test_coarse_numbers_of_a_straight_camera_are_straight(tmp_path):
    """Dark frames hold two numbers and a few; their variance is no measure of the noise at other means."""
    found = measure(save(tmp_path, 2))
    assert found.bend is None
    assert not found.doubts
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(GAIN, rel=0.02)
    assert found.estimates["read_noise_e"].value == pytest.approx(READ_DN / GAIN, rel=0.03)


def test_noise_of_two_numbers_is_not_clipped_at_0(tmp_path, monkeypatch):
    """Black at 0.45 DN with a noise of 0.19 DN: half of the pixels are 0, and none would be -1."""
    monkeypatch.setitem(globals(), "BLACK_DN", 0.45)
    found = measure(save(tmp_path, 4, read_dn=0.19))
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(GAIN, rel=0.03)


def test_noise_of_rows_is_that_before_rounding(tmp_path):
    """Rounding leaves three quarters of small offsets; 128 rows of 32 frames give their noise within 2.2 %."""
    found = measure(save(tmp_path, 3, row_dn=0.05))
    rows = found.estimates["row_noise_e"]
    assert rows.low < 0.05 / GAIN < rows.high
    assert rows.value == pytest.approx(0.05 / GAIN, rel=0.1)


def requantised(folder, bits):
    """The real frames in fewer bits; rounded."""
    step = 2 ** (12 - bits)
    (folder / "images").mkdir()
    text = (REAL / "frames.csv").read_text()
    (folder / "frames.csv").write_text(text)
    for row in csv.DictReader(text.splitlines()):
        dn = cv2.imread(str(REAL / row["file"]), cv2.IMREAD_UNCHANGED).astype(int)
        coarse = ((dn + step // 2) // step).clip(0, 2**bits - 1)
        cv2.imwrite(str(folder / row["file"]), coarse.astype(np.uint16 if bits > 8 else np.uint8))
    return folder


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="the shared frames are absent")
@pytest.mark.parametrize("bits", [10, 8])
def test_a_real_ccd_in_fewer_bits(tmp_path, bits):
    """The figures that emva1288 gives of its 12 bits, and read noise and rows of the fit to those."""
    found = measure(requantised(tmp_path, bits), bit_depth=bits)
    expected = {
        "system_gain_dn_per_e": 0.28006 * 2 ** (bits - 12), "quantum_efficiency": 0.4525, "prnu": 0.002652,
        "read_noise_e": 10.78, "row_noise_e": 1.79,
    }  # fmt: skip
    assert {name: found.estimates[name].value for name in expected} == pytest.approx(expected, rel=0.04)
    assert not found.doubts
    gain = found.estimates["system_gain_dn_per_e"]
    assert gain.low < expected["system_gain_dn_per_e"] < gain.high < 1.03 * gain.value
