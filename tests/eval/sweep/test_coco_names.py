"""Names of exported files say the condition; further axes only where they are not the camera's own."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.sweep.coco_export import condition_name
from commands import main
from plans import IMX250, OWN

AT = {"exposure_s": 0.02, "illuminance_lux": 3.0, "velocity_x_px_s": 333.3, "velocity_y_px_s": 0.0, **OWN}


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({}, "20ms-3lux-333.3_0px_s"),
        ({"exposure_s": 0.0123456789, "velocity_y_px_s": -77.1}, "12.3457ms-3lux-333.3_-77.1px_s"),
        ({"temperature_c": -20.0, "f_number": 5.6}, "20ms-3lux-333.3_0px_s--20C-f5.6"),
        ({"defocus_radius_px": 1.5, "gain_db": 6.0}, "20ms-3lux-333.3_0px_s-defocus1.5px-6dB"),
    ],
)
def test_names(changes: dict[str, Any], name: str) -> None:
    assert condition_name({**AT, **changes}, IMX250) == name


@pytest.mark.slow
def test_command_sweeps_further_axes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [
        "sweep",
        "--f-number",
        "1.4,2.8,5.6",
        "--temperature-c",
        "-20,85",
        "--exposure-ms",
        "5",
        "--lux",
    ]
    command += ["50", "--dx", "0", "--repeats", "1", "--limit", "1", "--threads", "1", "--gain", "0"]
    command += ["-o", str(tmp_path)]
    assert main([*command, "--json"]) == 0
    assert main(["report", str(tmp_path), "--coco", "--json"]) == 0
    capsys.readouterr()
    tables = {
        name: list(csv.DictReader((tmp_path / f"{name}.csv").open(encoding="utf-8")))
        for name in ("results", "targets", "scores", "curves")
    }
    tested = {(t, n) for t in ("-20.0", "85.0") for n in ("1.4", "2.8", "5.6")}
    signs = 3  # in a picture: a target row and curves each
    for name, rows in (("results", 6), ("targets", 6 * signs), ("scores", 6)):
        found = [(row["temperature_c"], row["f_number"]) for row in tables[name] if row["clean"] == "False"]
        assert (len(found), set(found)) == (rows, tested)
    over = [row["axis"] for row in tables["curves"]]
    assert (over.count("f_number"), over.count("temperature_c"), len(over)) == (
        2 * signs,
        3 * signs,
        5 * signs,
    )
    names = {path.name for path in (tmp_path / "coco" / "stop_sign").glob("5ms*.json")}
    lens = ("", "-f2.8", "-f5.6")  # f/1.4 is the camera's own
    assert names == {f"5ms-50lux-0_0px_s-{t}{n}-0.json" for t in ("-20C", "85C") for n in lens}
