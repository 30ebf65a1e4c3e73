"""Noise of rows that grows with the signal, and offsets of even and odd columns: found where they are, else 0."""

import math

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.to_camera import camera_of
from blurnoise_eval.measure.trial import misses

SIZE = (200, 161)
GAIN, READ_DN, BLACK_DN = 0.4, 1.6, 20.0
SHARE, PARITY_E = 0.002, 1.5


def correlated(random, rows):
    """One value per row, of variance 1: a share of the one before, forgotten over so many rows, and chance."""
    share = math.exp(-1 / rows) if rows else 0.0
    values = [random.standard_normal()]
    for _ in range(SIZE[0] - 1):
        values.append(share * values[-1] + math.sqrt(1 - share**2) * random.standard_normal())
    return np.array(values)[:, None]


def planes(seed, *, share=0.0, rows=0.0, parity_e=0.0, levels=10):
    """Frames by NumPy alone."""
    random, found = np.random.default_rng(seed), {}
    sign = 1 - 2 * (np.arange(SIZE[1]) % 2)
    for exposure_s in np.linspace(0.01, 0.1, levels):
        for kind in ("dark", "flat"):
            mean_e = 80000 * exposure_s * (kind == "flat")
            found[kind, exposure_s] = []
            for _ in range(2):
                light = mean_e * (1 + share * correlated(random, rows)) * np.ones(SIZE)
                noise_e = READ_DN / GAIN * random.standard_normal(SIZE)
                noise_e += parity_e * random.standard_normal((SIZE[0], 1)) * sign
                dn = BLACK_DN + GAIN * (random.poisson(light) + noise_e)
                found[kind, exposure_s].append(np.rint(dn).clip(0, 4095).astype(np.uint16))
    return found


@pytest.fixture(scope="module")
def banded(tmp_path_factory):
    """With correlation over 20 of 200 rows."""
    made = planes(1, share=SHARE, rows=20.0, parity_e=PARITY_E)
    return measure(made_frames.save(tmp_path_factory.mktemp("banded"), made), bit_depth=12)


def test_share_and_length_of_correlated_rows(banded):
    """100 pieces of 20 rows, doubled as neighbours count: the deviation is known to 1 / sqrt(2 x 50), 10 %."""
    estimates = banded.estimates
    assert estimates["row_gain_noise"].value == pytest.approx(SHARE, rel=0.3)
    assert estimates["row_gain_noise"].low < SHARE < estimates["row_gain_noise"].high
    assert estimates["row_gain_rows"].low < 20 < estimates["row_gain_rows"].high


def test_offsets_of_even_and_odd_columns(banded):
    """2000 rows give the deviation within 1.6 %; read noise is without it."""
    parity = banded.estimates["parity_noise_e"]
    assert parity.low < PARITY_E < parity.high
    assert parity.value == pytest.approx(PARITY_E, rel=0.08)
    assert banded.estimates["read_noise_e"].value == pytest.approx(READ_DN / GAIN, rel=0.015)


def test_a_camera_of_correlated_rows_does_not_miss_its_frames(banded):
    assert misses(banded, camera_of(banded, "mine")) == []


def test_rows_that_differ_each_for_itself(tmp_path):
    found = measure(made_frames.save(tmp_path / "white", planes(2, share=SHARE)), bit_depth=12).estimates
    assert found["row_gain_noise"].low < SHARE < found["row_gain_noise"].high
    assert found["row_gain_noise"].value == pytest.approx(SHARE, rel=0.08)
    assert found["row_gain_rows"].low == 0.0 <= found["row_gain_rows"].value < 1.5


@pytest.mark.parametrize("seed", range(3))
def test_cameras_without_have_none(tmp_path, seed):
    """A share that is not surely there would take every simulation off the fast route."""
    measured = measure(made_frames.save(tmp_path / "plain", planes(10 + seed)), bit_depth=12)
    assert measured.estimates["row_gain_noise"].value == 0
    assert "row_gain_rows" not in measured.estimates
    assert camera_of(measured, "mine").sensor.row_gain_noise == 0
