"""Road speed to pixels: the paper's Table 2, both lenses."""

from __future__ import annotations

import math

import pytest

from blurnoise import blur_pixels, velocity_px_s

WIDE = {"width_px": 4096, "hfov_deg": 99.32}

# Nine results as the paper prints them. Object widths, distances and exposures are reconstructed from the
# results (only speed x exposure and width / distance enter); km/h are divided by 3.6 unrounded.
TABLE_2 = [
    (0.5, 25, 5, 30, 3.93804),
    (0.5, 50, 5, 30, 1.96907),
    (0.5, 100, 5, 30, 0.98454),
    (0.5, 100, 10, 30, 1.96908),
    (4.9, 100, 20, 30, 3.93738),
    (4.9, 100, 50, 30, 9.84346),
    (4.9, 50, 100, 15, 19.67512),
    (4.9, 50, 100, 30, 39.35024),
    (4.9, 100, 100, 30, 19.68692),
]


@pytest.mark.parametrize(("width_m", "distance_m", "speed_kmh", "exposure_ms", "blur_px"), TABLE_2)
def test_table_2(
    width_m: float, distance_m: float, speed_kmh: float, exposure_ms: float, blur_px: float
) -> None:
    found = blur_pixels(speed_kmh / 3.6, distance_m, exposure_ms / 1e3, target_width_m=width_m, **WIDE)
    assert found == pytest.approx(blur_px, abs=1e-4)


def test_rectilinear_is_26_percent_smaller_on_axis() -> None:
    """f = 1739.3 px, blur f v T / d."""
    found = blur_pixels(100 / 3.6, 50, 0.03, target_width_m=4.9, lens="rectilinear", **WIDE)
    assert found == pytest.approx(1739.3 * (100 / 3.6) * 0.03 / 50, rel=1e-4)
    assert found / 39.35024 == pytest.approx(0.737, abs=0.002)


def test_both_lenses_meet_for_narrow_fields() -> None:
    """tan x = x for small x: 1 degree differs by less than (0.5 deg)^2 / 3 = 2.5e-5."""
    numbers = {"target_width_m": 0.01, "width_px": 1000, "hfov_deg": 1.0}
    f_theta = velocity_px_s(10, 100, **numbers)
    assert velocity_px_s(10, 100, lens="rectilinear", **numbers) == pytest.approx(f_theta, rel=3e-5)


def test_zero_speed_and_zero_exposure() -> None:
    assert blur_pixels(0, 10, 0.1, target_width_m=1, **WIDE) == 0
    assert blur_pixels(10, 10, 0, target_width_m=1, **WIDE) == 0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed_m_s", -1),
        ("distance_m", 0),
        ("exposure_s", math.nan),
        ("target_width_m", math.inf),
        ("width_px", -5),
        ("hfov_deg", 0),
    ],
)
def test_bad_numbers_are_named(name: str, value: float) -> None:
    good = {"speed_m_s": 1, "distance_m": 1, "exposure_s": 1, "target_width_m": 1, **WIDE}
    with pytest.raises(ValueError, match=name):
        blur_pixels(**{**good, name: value})


def test_bad_lens() -> None:
    with pytest.raises(ValueError, match="lens"):
        velocity_px_s(1, 1, target_width_m=1, lens="fisheye", **WIDE)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="180"):
        velocity_px_s(1, 1, target_width_m=1, width_px=10, hfov_deg=180, lens="rectilinear")
