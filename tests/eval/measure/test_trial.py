"""A fitted camera on its own frames: what simulated frames of it miss is named with its size."""

from dataclasses import replace

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.to_camera import camera_of
from blurnoise_eval.measure.trial import misses
from commands import main

SIZE = (160, 201)


@pytest.fixture(scope="module")
def planes():
    return made_frames.exposed(made_frames.CAMERA, 4, size=SIZE, levels=5)


@pytest.fixture(scope="module")
def found(planes, tmp_path_factory):
    return measure(made_frames.save(tmp_path_factory.mktemp("frames"), planes), bit_depth=12)


def with_columns(planes):
    """Flat frames whose columns differ in each by 0.2 % of the light, 1 % of the variance."""
    random = np.random.default_rng(1)
    black = made_frames.CAMERA.sensor.black_level_dn

    def banded(plane):
        return np.rint(black + (plane - black) * (1 + 0.002 * random.standard_normal((1, SIZE[1])))).astype(
            np.uint16
        )

    return {key: [banded(x) for x in of] if key[0] == "flat" else of for key, of in planes.items()}


def test_a_camera_fits_its_own_frames(found):
    assert misses(found, camera_of(found, "mine")) == []


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"system_gain_dn_per_e": 0.44}, "the variance of flat frames (DN²) at 5 of 5 levels; flat "),
        ({"read_noise_e": 4.6}, "the variance of dark frames (DN²) at "),
        ({"black_level_dn": 20.4}, "the mean in the dark (DN) at 5 of 5 levels; dark "),
        ({"full_well_e": 6000.0}, "the mean (DN) at "),
        (
            {"row_noise_e": 1.0},
            "the share of whole rows in the variance of dark frames; mean of 5",
        ),
    ],
)
def test_what_a_wrong_camera_misses(found, changes, why):
    """A tenth of gain or noise, 0.4 DN of black, a well below the brightest level, rows that the frames lack."""
    lines = misses(found, camera_of(found, "mine").with_figures(**changes))
    assert any(line.startswith(f"misses its frames: {why}") for line in lines), lines


def test_dark_frames_of_two_numbers_are_not_held_against_a_camera(found):
    """Noise below 0.2 DN leaves bounds of read noise and black level; flat frames are still compared."""
    wrong = camera_of(found, "mine").with_figures(read_noise_e=4.6, system_gain_dn_per_e=0.44)
    fine, coarse = (
        misses(replace(found, fit=fit), wrong) for fit in (found.fit, replace(found.fit, read_dn2=0.03))
    )
    assert ["variance of dark frames" in " ".join(lines) for lines in (fine, coarse)] == [True, False]
    assert "variance of flat frames" in " ".join(coarse)


def test_strict_writes_nothing_for_frames_that_the_camera_misses(planes, tmp_path, capsys):
    folder = made_frames.save(tmp_path / "frames", with_columns(planes))
    words = ["cameras", "fit", folder, "-o", tmp_path / "mine.yaml", "--bit-depth", "12", "--strict"]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "--strict: misses its frames: the share of whole columns in the variance of flat frames" in said
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.slow
def test_what_the_camera_misses_is_printed_without_strict(planes, tmp_path, capsys):
    folder = made_frames.save(tmp_path / "frames", with_columns(planes))
    assert main(["cameras", "fit", folder, "-o", tmp_path / "mine.yaml", "--bit-depth", "12"]) == 0
    assert "misses its frames: the share of whole columns" in capsys.readouterr().out
    assert (tmp_path / "mine.yaml").is_file()
