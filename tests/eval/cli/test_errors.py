"""What is wrong with an option: one line, exit code 2, the option that was typed and the unit of what was typed."""

from __future__ import annotations

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from blurnoise_eval.cli._errors import in_a_line
from blurnoise_eval.grid.axes import AXES
from commands import main

from blurnoise._core.checks import OutOfRange
from blurnoise.optics.camera import Camera

Output = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("sweep --exposure-ms -5", "--exposure-ms = -5.0: must be finite and >= 0 and <= 3.6e+06"),
        ("sweep --ego-kmh 500", "--ego-kmh = 500.0: must be finite and >= 0 and <= 360"),
        ("sweep --ego-kmh 50 --dx 100", "--ego-kmh: a camera that drives"),
        ("sweep --exposure-ms auto --gain 5", "--exposure-ms: auto sets the gain, too; gain_db must be auto"),
        ("sweep --lux nan", "--lux = nan: must be finite and >= 0"),
        ("sweep --repeats 0", "repeats = 0: must be >= 1"),
        ("sweep --images nowhere", "--images = 'nowhere': no such folder"),
        ("simulate a.png --exposure-ms -5", "--exposure-ms = -5.0: must be"),
        ("simulate a.png --dy 1e9", "--dy = 1000000000.0: must be finite and >= -1e+07"),
        ("simulate a.png --ego-kmh 500", "--ego-kmh = 500.0: must be"),
        ("simulate a.png --lux 1,2", "--lux: must be one value here"),
        ("sweep --exposure-ms 1:x", "--exposure-ms = '1:x': must be numbers as 1,5,10"),
        ("sweep --gain inf", "--gain = 'inf': must be numbers as 1,5,10"),
        ("sweep --max-megapixels 0", "max_megapixels = 0.0: must be"),
        ("chart flat-patch --size nan", "--size = nan: must be finite"),
        ("chart slanted-edge --angle nan", "--angle = nan: must be finite"),
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
    told = in_a_line(ValueError("row_time_s, exposure_s = 0.02: too long"), options)
    assert told.endswith(": row_time_s, exposure_s = 0.02: too long")
    assert in_a_line(ValueError("exposure_s = 0.02: too long"), options).endswith(
        ": --exposure-ms = 20: too long"
    )
    assert in_a_line(ValueError("yolo = 'a': empty"), ["--coco", "--labels"]).endswith(
        ": --labels = 'a': empty"
    )
    assert in_a_line(ValueError("exposure_s = 5: is long"), ["--lux"]).endswith(": exposure_s = 5: is long")
    assert (
        in_a_line(FileNotFoundError(2, "No such file", "keep"), options)
        == "blurnoise: error: keep: No such file"
    )


def test_a_range_that_is_left_survives_the_way_from_a_worker() -> None:
    with pytest.raises(OutOfRange) as caught:
        Camera.from_dict({"base": "imx250", "read_noise_e": -1.0})
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value) == "read_noise_e = -1.0: must be finite and >= 0 and <= 1e+06"
