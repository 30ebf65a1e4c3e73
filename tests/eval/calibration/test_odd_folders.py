"""Folders of frames that mislead a fit: refused by file, line or header with the reason, or measured."""

from collections.abc import Callable
from pathlib import Path

import cv2
import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure

SIZE, GAIN, BLACK_DN, DARK_E_S = (48, 64), 0.5, 40.0, 50.0
HEADER = "file,kind,exposure_s"
DARK_S, FLAT_S = (0.001, 0.05, 0.1), (0.004, 0.006, 0.008, 0.01, 0.012)


class Sensor:
    """A sensor in NumPy alone; all noise in electrons, drift_dn of whole frames."""

    def __init__(self, seed, drift_dn=0.0, row_e=0.0):
        self.random, self.drift_dn, self.row_e = np.random.default_rng(seed), drift_dn, row_e
        self.response = 1 + 0.005 * self.random.standard_normal(SIZE)

    def frame(self, light_e, exposure_s, gain=GAIN, read_e=5.0):
        shot = self.random.poisson(light_e * self.response + DARK_E_S * exposure_s)
        read = read_e * self.random.standard_normal(SIZE)
        rows = self.row_e * self.random.standard_normal((SIZE[0], 1))
        drift = self.drift_dn * self.random.standard_normal()
        return np.rint(BLACK_DN + gain * (shot + read + rows) + drift).clip(0, 4095).astype(np.uint16)


def write(folder, sensor, frames=2, gains=None):
    """A stack for each level, and frames.csv, whose lines are returned. gains: DN/e- and read noise by dB."""
    lines = []
    for gain_db, (gain, read_e) in (gains or {0: (GAIN, 5.0)}).items():
        for kind, exposures in (("dark", DARK_S), ("flat", FLAT_S)):
            for exposure_s in exposures:
                light_e = 4e5 * exposure_s * GAIN / gain if kind == "flat" else 0.0
                stack = [sensor.frame(light_e, exposure_s, gain, read_e) for _ in range(frames)]
                name = f"{kind}{len(lines)}.npy"
                np.save(folder / name, np.stack(stack))
                lines.append(f"{name},{kind},{exposure_s}" + (f",{gain_db}" if gains else ""))
    (folder / "frames.csv").write_text("\n".join([HEADER + (",gain_db" if gains else ""), *lines]))
    return lines


def rewrite(folder, *changes):
    text = (folder / "frames.csv").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "frames.csv").write_text(text)


def again(folder):
    text = (folder / "frames.csv").read_text()
    (folder / "frames.csv").write_text(text + text.removeprefix(HEADER))


def doubled(folder):
    stack = np.load(folder / "flat5.npy")
    np.save(folder / "flat5.npy", np.concatenate([stack, stack]))


def fits(**cards):
    def change(folder):
        made_frames.write_fits(folder / "a.fits", np.load(folder / "dark0.npy"), **cards)
        rewrite(folder, ("dark0.npy", "a.fits"))

    return change


def cut_short(folder):
    path = folder / "a.tif"
    cv2.imwritemulti(str(path), [*np.load(folder / "flat5.npy"), *np.load(folder / "flat6.npy")])
    path.write_bytes(path.read_bytes()[:-8_000])
    rewrite(folder, ("flat5.npy", "a.tif"))


REFUSED: dict[str, tuple[Callable[[Path], object], str]] = {
    "all rows twice": (again, r"frames\.csv: line 10: file 'dark0\.npy', page 0: is already in line 2"),
    "flat and dark": (
        lambda folder: rewrite(folder, ("dark0", "flat3")),
        r"frames\.csv: line 5: file 'flat3\.npy', page 0: is already in line 2",
    ),
    "a stack of equal frames": (doubled, r"flat5\.npy: page 2: is the same picture as flat5\.npy, page 0"),
    "a copy as dark": (
        lambda folder: np.save(folder / "dark1.npy", np.load(folder / "flat5.npy")),
        r"dark1\.npy: page 0: is the same picture as flat5\.npy, page 0; each frame must be a new exposure",
    ),
    "more cells": (
        lambda folder: rewrite(folder, ("dark1.npy,dark,0.05", "dark1.npy,dark,0.05,1,2")),
        r"frames\.csv: line 3: 5 values; must be at most 3",
    ),
    "a column twice": (
        lambda folder: rewrite(folder, (HEADER, HEADER + ",kind")), "line 1: column 'kind': must occur once",
    ),
    "no number": (
        lambda folder: rewrite(folder, ("dark,0.05", "dark,nan")),
        "line 3: exposure_s = 'nan': must be a finite number",
    ),
    "not UTF-8": (
        lambda folder: (folder / "frames.csv").write_bytes(HEADER.encode() + b"\n\xe4"),
        r"^\S+frames\.csv: not UTF-8",
    ),
    "no frames in an array": (
        lambda folder: np.save(folder / "flat5.npy", np.zeros((0, *SIZE), np.uint16)),
        r"flat5\.npy: shape = \(0, 48, 64\): must not be empty",
    ),
    "a TIFF cut short": (cut_short, r"a\.tif: is incomplete; page \d cannot be read"),
    "BZERO": (fits(BZERO="abc"), r"a\.fits: BZERO = 'abc': must be a number"),
    "BITPIX": (fits(BITPIX="abc"), r"a\.fits: BITPIX = 'abc': must be a number"),
    "GAIN": (fits(GAIN="'high'"), r"a\.fits: GAIN = 'high': must be a number"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "why"), REFUSED.values(), ids=REFUSED)
def test_refused(tmp_path, change, why):
    write(tmp_path, Sensor(1))
    change(tmp_path)
    with pytest.raises(ValueError, match=why):
        measure(tmp_path)


def test_columns_in_capitals(tmp_path):
    write(tmp_path, Sensor(1))
    rewrite(tmp_path, (HEADER, "File,Kind,Exposure_s"))
    assert measure(tmp_path).estimates["system_gain_dn_per_e"].value == pytest.approx(GAIN, rel=0.05)


def test_read_noise_at_a_gain_is_net_of_its_own_rows(tmp_path):
    """3 e- per pixel and 1.5 e- per row; of 5 e- at the lowest gain rows are a third of that share."""
    write(tmp_path, Sensor(2, row_e=1.5), frames=4, gains={0: (GAIN, 5.0), 12: (2.0, 3.0)})
    read_e = measure(tmp_path).gains[12]["read_noise_e"]
    assert read_e.low <= 3 <= read_e.high
    assert read_e.value == pytest.approx(3, rel=0.03)


def test_a_gain_with_dark_frames_alone_is_named(tmp_path):
    lines = write(tmp_path, Sensor(3), gains={0: (GAIN, 5.0), 12: (2.0, 3.0)})
    lines_left = [line for line in lines if not (",flat," in line and line.endswith(",12"))]
    (tmp_path / "frames.csv").write_text("\n".join([f"{HEADER},gain_db", *lines_left]))
    found = measure(tmp_path)
    assert not found.gains
    assert "left out: the frames at 12 dB; dark levels and 3 flat levels are needed" in found.notes


def test_a_black_level_that_wanders_is_not_the_lamp(tmp_path):
    """2 DN of whole frames: 0.5 % of the dimmest light, 800 DN; linearity's interval has them in."""
    write(tmp_path, Sensor(4, drift_dn=2.0), frames=4)
    found = measure(tmp_path)
    assert not any("lamp" in note for note in found.notes)
    drift = found.estimates["black_level_drift_dn"]
    assert drift.low <= 2 <= drift.high
    error = found.estimates["linearity_error"]
    assert error.high - error.value == pytest.approx(1.96 * drift.value / 4**0.5 / 800, rel=0.05)


def test_lux_times_exposure_is_the_light(tmp_path):
    """Levels of one exposure in several lights."""
    lines = write(tmp_path, Sensor(5))
    lit = [f"{line}," if "dark" in line else _in_lux(line) for line in lines]
    (tmp_path / "frames.csv").write_text("\n".join([f"{HEADER},illuminance_lux", *lit]))
    linear = measure(tmp_path).linearity
    assert linear
    assert linear.light == "lux s"
    assert linear.x == pytest.approx([4, 6, 8, 10, 12])
    assert linear.slope == pytest.approx(GAIN * 400, rel=0.02)


def _in_lux(line):
    name, kind, exposure_s = line.split(",")
    return f"{name},{kind},0.01,{1e5 * float(exposure_s):g}"
