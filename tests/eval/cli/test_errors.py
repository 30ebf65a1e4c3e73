"""What is wrong with an option: one line, exit code 2, the option that was typed and the unit of what was typed."""

from __future__ import annotations

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from blurnoise_eval.cli import main
from blurnoise_eval.cli._errors import in_a_line
from blurnoise_eval.grid.axes import AXES

from blurnoise._core.checks import OutOfRange
from blurnoise.optics.camera import Camera

Output = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("sweep --exposure-ms -5", "--exposure-ms = -5.0: must be finite and >= 0 and <= 3.6e+06"),
        ("sweep --ego-kmh 500", "--ego-kmh = 500.0: must be finite and >= 0 and <= 360"),
        ("sweep --ego-kmh 50 --dx 100", "--ego-kmh: a camera that drives"),
        ("sweep --exposure-ms auto --gain 5", "--exposure-ms: auto sets the gain, too; --gain must be auto"),
        ("sweep --frame-rate 0", "--frame-rate = 0.0: must be finite and > 0"),
        ("sweep --ego-kmh 9 --height-m -2", "--height-m = -2.0: must be finite and > 0"),
        ("sweep --lux nan", "--lux = nan: must be finite and >= 0"),
        ("sweep --repeats 0", "--repeats = 0: must be >= 1"),
        ("sweep --images nowhere", "--images = 'nowhere': no such folder"),
        ("simulate a.png --exposure-ms -5", "--exposure-ms = -5.0: must be"),
        ("simulate a.png --line-time-us -5", "--line-time-us = -5.0: must be finite and >= 0 and <= 1e+06"),
        ("simulate a.png --ego -36", "--ego = -36.0: must be"),
        ("simulate a.png --dy 1e9", "--dy = 1000000000.0: must be finite and >= -1e+07"),
        ("simulate a.png --object-dx 5", "--object-dx, --object-dy, --plate: go with --object"),
        ("simulate a.png --object 1,2,9,9 --object-dx nan", "--object-dx = nan: must be finite"),
        (
            "simulate a.png --object 1,2,9,9 --object-kmh 2e9 --object-m 3",
            "--object-kmh = 2000000000.0: must be",
        ),
        ("simulate a.png --ego 50,1e9", "--ego = 1000000000.0: must be"),
        ("simulate a.png --pwm 0,1", "--pwm = '0,1': frequency_hz = 0.0: must be"),
        ("simulate a.png --hdr 16 --hdr-white nan", "--hdr-white = nan: must be finite"),
        ("sweep --height-m 2", "--height-m: goes with --ego-kmh"),
        ("sweep --max-megapixels 0", "--max-megapixels = 0.0: must be"),
        ("decide --hfov-deg 60", "--hfov-deg: goes with --ego-kmh"),
        ("decide --edge-stops 0", "--edge-stops = 0.0: must be finite and > 0 and <= 64"),
        ("chart flat-patch --size nan", "--size = nan: must be finite"),
        ("chart slanted-edge --angle nan", "--angle = nan: must be finite"),
        ("gallery a.png --exposure-ms 5:1", "--exposure-ms = (5, 1): must be (low, high)"),
        ("chart stop-sign --size 0", "--size = 0.0: must be"),
    ],
)
def test_the_option_that_was_typed_is_named_in_its_unit(
    command: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", np.full((20, 31, 3), 120, np.uint8))
    assert main([*command.split(), "-o", "out.png"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"blurnoise: error: {told}"), err
    assert err.count("\n") == 1
    assert not (tmp_path / "out.png").exists()


@pytest.mark.parametrize("axis", [axis for axis in AXES if not axis.choices], ids=lambda axis: axis.name)
def test_every_axis_is_told_by_its_option(axis: object, capsys: Output) -> None:
    axis = next(each for each in AXES if each is axis)
    beyond = axis.shown(axis.high) * 2
    assert main(["sweep", "-o", "run", axis.option, f"{beyond:g}"]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"blurnoise: error: {axis.option} = "), told
    assert f"<= {axis.shown(axis.high):g}" in told
    assert axis.name not in told or axis.name in axis.option


def test_what_no_option_sets_keeps_its_name() -> None:
    options = ["--exposure-ms", "--keep"]
    assert in_a_line(ValueError("well_e = 5 or 7: must be one"), options).endswith(
        ": well_e = 5 or 7: must be one"
    )
    assert in_a_line(ValueError("exposure_s = 5: is long"), ["--lux"]).endswith(": exposure_s = 5: is long")
    assert in_a_line(ValueError("keep this = exposure_s"), options).endswith(": keep this = --exposure-ms")
    assert (
        in_a_line(FileNotFoundError(2, "No such file", "keep"), options)
        == "blurnoise: error: keep: No such file"
    )


def test_a_range_that_is_left_survives_the_way_from_a_worker() -> None:
    with pytest.raises(OutOfRange) as caught:
        Camera.from_dict({"base": "imx250", "read_noise_e": -1.0})
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value) == "read_noise_e = -1.0: must be finite and >= 0 and <= 1e+06"
