"""Effects of CMOS cameras that a fit must neither refuse nor mistake; frames by NumPy alone."""

import math

import numpy as np
import pytest
from blurnoise_eval.calibration import standard
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.to_camera import camera_of
from blurnoise_eval.measure.trial import misses
from numpy_cmos import Cmos, save

SHARES = np.linspace(0.06, 0.9, 8)
FULL = (*SHARES, 1.2)


def verdicts(found):
    return {row.name: row.verdict for row in standard.rows(found.standard, camera_of(found, "mine"))}


def test_rows_that_grow_with_the_light_are_the_sensors_and_not_k(tmp_path):
    """Of 0.3 % at 7000 e-: a variance of 440 e-², 6 % of it; with it, K is 3 % too large. 64000 differences of 6
    levels give K within 0.3 %, 160 rows the row gain within 3 %.
    """
    cmos = Cmos(row_gain=0.003)
    found = measure(save(tmp_path / "frames", cmos, SHARES), bit_depth=12).estimates
    gain = found["system_gain_dn_per_e"]
    assert gain.value == pytest.approx(cmos.gain, rel=0.01)
    assert gain.low < cmos.gain < gain.high
    assert found["row_gain_noise"].value == pytest.approx(0.003, rel=0.1)


@pytest.mark.parametrize("hot", [0.0, 0.01])
def test_hot_pixels_are_no_fault_of_the_dsnu(tmp_path, hot):
    """One pixel of a hundred, of 200 e- on average: DSNU with them is 28 e-, that of the others 2 e-."""
    found = measure(save(tmp_path / "frames", Cmos(hot=hot), SHARES), bit_depth=12)
    assert found.standard.values["DSNU_pixel"].value == pytest.approx(2.0, rel=0.05)
    assert (found.standard.values["DSNU"].value > 10) == bool(hot)
    assert verdicts(found)["DSNU_pixel"] == "pass"


def test_few_levels_cannot_tell_where_the_variance_peaks(tmp_path):
    """The brightest of the nine levels clips; the one before is 10 % below the range."""
    found = measure(save(tmp_path / "frames", Cmos(), FULL), bit_depth=12)
    saturation = found.standard.values["saturation"]
    assert saturation.value < 0.95 * Cmos().range_e < saturation.interval().high
    assert "fail" not in verdicts(found).values()
    assert not found.notes


def test_k_of_the_standard_is_uncertain_by_what_rounding_hides(tmp_path):
    """Noise of 0.2 DN at a whole number hides 0.11 DN² of the dark variance, 5 % of that of the flat frames."""
    cmos = Cmos(bits=8, gain=0.02, read=10.0, black_dn=1.0, dsnu=3.0)
    found = measure(save(tmp_path / "frames", cmos, FULL))
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(cmos.gain, rel=0.01)
    assert found.standard.values["K"].value > 1.03 * cmos.gain
    assert verdicts(found)["K"] == "cannot tell"


def test_two_numbers_hide_as_much_dsnu_as_read_noise(tmp_path):
    """Noise and pattern of 0.18 and 0.09 DN: the dark frames leave 0.2 DN of both possible."""
    cmos = Cmos(bits=10, gain=0.06, read=3.0, row=0.3, black_dn=16.2, dsnu=1.5, dsnu_column=0.5)
    dsnu = measure(save(tmp_path / "frames", cmos, SHARES), bit_depth=10).estimates["dsnu_e"]
    assert dsnu.low <= 1.5 < 0.19 / cmos.gain < dsnu.high


def test_black_level_is_as_uncertain_as_few_rows_and_columns(tmp_path):
    """160 rows of 8 e- in each of 16 frames, and 200 columns of 6 e-, for the mean at no exposure."""
    cmos = Cmos(row=8.0, dsnu_column=6.0)
    black = measure(save(tmp_path / "frames", cmos, SHARES), bit_depth=12).estimates["black_level_dn"]
    least = 1.96 * cmos.gain * math.sqrt(8**2 / 160 / 16 + 6**2 / 200)
    assert least < (black.high - black.low) / 2 < 2 * least
    assert black.low < cmos.black_dn < black.high


def test_a_signal_that_sags_before_saturation_is_no_wrong_exposure(tmp_path):
    """From 50 % of the range on; at 90 % of the light the signal is 8 % too small."""
    cmos = Cmos(sag=0.5)
    found = measure(save(tmp_path / "frames", cmos, np.linspace(0.05, 1.1, 12)), bit_depth=12)
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(cmos.gain, rel=0.02)
    assert found.estimates["quantum_efficiency"].value == pytest.approx(0.5, rel=0.02)
    assert any(note.startswith("the signal sags before saturation") for note in found.notes)


def test_full_wells_are_not_held_against_the_camera(tmp_path):
    """Signals that bend to the end of the range never reach its last number."""
    cmos = Cmos(sag=0.8)
    found = measure(save(tmp_path / "frames", cmos, np.linspace(0.06, 1.2, 15)), bit_depth=12)
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(cmos.gain, rel=0.01)
    assert misses(found, camera_of(found, "mine")) == []


def test_what_a_clamped_black_hides_is_within_the_intervals(tmp_path):
    """Noise and DSNU of 0.8 DN together, of which what is below the black level becomes that."""
    cmos = Cmos(bits=10, gain=0.1, read=7.0, dsnu=3.0, least_dn=60.0)
    found = measure(save(tmp_path / "frames", cmos, SHARES), bit_depth=10)
    assert any("black seems clamped" in doubt.text for doubt in found.doubts)
    for name, true in (("read_noise_e", 7.0), ("dsnu_e", 3.0), ("black_level_dn", 60.0)):
        estimate = found.estimates[name]
        assert estimate.low <= true <= estimate.high, (name, estimate)
