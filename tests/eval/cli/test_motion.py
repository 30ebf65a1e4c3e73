"""Road speed to px/s, with a camera's size and view."""

from __future__ import annotations

import json

import pytest
from commands import main

CROSSING = ["--speed-kmh", "50", "--distance-m", "20", "--target-width-m", "1", "--exposure-ms", "10"]


def test_a_cameras_size_and_view(capsys: pytest.CaptureFixture[str]) -> None:
    """They hold unless stated: lin2024 is the paper's, 4096 px over 99.32 degrees."""
    assert main(["motion", *CROSSING, "--camera", "lin2024", "--json"]) == 0
    by_name = json.loads(capsys.readouterr().out)
    assert main(["motion", *CROSSING, "--width-px", "4096", "--hfov-deg", "99.32", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == by_name
    assert main(["motion", *CROSSING, "--camera", "lin2024", "--hfov-deg", "60", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["blur_px"] == pytest.approx(by_name["blur_px"] * 99.32 / 60)
