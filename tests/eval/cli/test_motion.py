"""``blurnoise motion``: the numbers of the paper, and of a camera."""

from __future__ import annotations

import pytest
from commands import Output, main, told

CROSSING = ("--speed-kmh", 100, "--distance-m", 50, "--target-width-m", 4.9, "--exposure-ms", 15)
PAPER = ("--width-px", 4096, "--hfov-deg", 99.32)


def test_table_2(capsys: Output) -> None:
    """Lin et al. 2024, Table 2: a truck of 4.9 m at 50 m and 100 km/h, 15 ms."""
    facts = told(capsys, "motion", *CROSSING, *PAPER)
    assert facts["blur_px"] == pytest.approx(19.67512, abs=1e-4)
    assert facts["velocity_px_s"] == pytest.approx(facts["blur_px"] / 0.015)
    assert facts["lens"] == "f-theta"
    assert told(capsys, "motion", *CROSSING, *PAPER, "--lens", "rectilinear")["blur_px"] < facts["blur_px"]
    assert main(["motion", *CROSSING, *PAPER]) == 0
    assert "19.6751" in capsys.readouterr().out


def test_a_cameras_size_and_view_are_the_defaults(capsys: Output) -> None:
    """lin2024 is the paper's, 4096 px over 99.32 degrees."""
    by_name = told(capsys, "motion", *CROSSING, "--camera", "lin2024")
    assert told(capsys, "motion", *CROSSING, *PAPER) == by_name
    narrow = told(capsys, "motion", *CROSSING, "--camera", "lin2024", "--hfov-deg", 60)
    assert narrow["blur_px"] == pytest.approx(by_name["blur_px"] * 99.32 / 60)
