"""The command's map: what it says, what it writes, and what it refuses."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from commands import main

ROAD = [
    "--speed-kmh", "50", "--yaw-deg-s", "10", "--hfov-deg", "60", "--lens", "rectilinear", "--mount", "1.5,2",
]  # fmt: skip
CROSSING = ["--speed-kmh", "50", "--distance-m", "20", "--target-width-m", "1", "--exposure-ms", "10"]


@pytest.mark.slow
def test_a_map_answers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The sky moves by f w (1 + x^2), most at the ends of the horizon; at the bottom the map's values say it."""
    picture, values = tmp_path / "map.png", tmp_path / "map.npy"
    size = ["--width-px", "240", "--map", str(values), "--exposure-ms", "20"]
    assert main(["motion", "--map", str(picture), *ROAD, *size]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines[:-1])) <= 80
    told = " ".join(" ".join(lines).split())
    focal_px = 120 / math.tan(math.radians(30))
    horizon_ms = 1e3 / (focal_px * math.radians(10) * (1 + (119.5 / focal_px) ** 2))
    assert "turning right at 10 degrees/s" in told
    assert "plane at 10 m:" in told
    assert "of it keeps within at 20 ms" in told
    assert picture.read_bytes().startswith(b"\x89PNG")
    longest_ms = np.load(values)
    assert longest_ms.shape == (3, 200, 240)  # 240 x 2056 / 2464
    bottom_ms = longest_ms[0, -1].min()
    assert f": {bottom_ms:.3g} ms at the bottom edge, {horizon_ms:.3g} ms at the horizon, " in told


@pytest.mark.slow
def test_a_map_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = str(tmp_path / "map.png")
    straight = [
        "--speed-kmh",
        "50",
        "--max-blur-px",
        "2",
        "--planes-m",
        "20",
        "--camera",
        "mt9m034",
        "--json",
    ]
    assert main(["motion", "--map", picture, *straight]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["camera"], facts["width_px"], facts["lens"]) == ("mt9m034", 1280, "f-theta")
    assert [each["scene"] for each in facts["maps"]] == ["road and sky", "plane at 20 m"]
    assert facts["maps"][0]["horizon_ms"] is None  # driving straight, without limit
    assert facts["maps"][1]["all_ms"] > facts["maps"][0]["all_ms"] > 0
    assert facts["files"] == [picture]


def test_a_cameras_size_and_view(capsys: pytest.CaptureFixture[str]) -> None:
    """They hold unless stated: lin2024 is the paper's, 4096 px over 99.32 degrees."""
    assert main(["motion", *CROSSING, "--camera", "lin2024", "--json"]) == 0
    by_name = json.loads(capsys.readouterr().out)
    assert main(["motion", *CROSSING, "--width-px", "4096", "--hfov-deg", "99.32", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == by_name
    assert main(["motion", *CROSSING, "--camera", "lin2024", "--hfov-deg", "60", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["blur_px"] == pytest.approx(by_name["blur_px"] * 99.32 / 60)
