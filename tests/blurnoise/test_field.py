"""The field of a camera: heights, light, where things are, in pictures of any size."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from blurnoise import Camera
from blurnoise.optics import lens as lenses
from blurnoise.optics.lens import Distortion, Field, Lens, RelativeIllumination

SENSOR = replace(Camera.preset("imx250"), width_px=640, height_px=480, hfov_deg=90.0)


def field(**lens: Any) -> Field:
    return replace(SENSOR, lens=Lens(**lens)).field


def test_heights_reach_1_in_the_corner_of_the_sensor_of_any_scale() -> None:
    for size in ((480, 640), (240, 320), (960, 1280)):
        heights = field().heights(size)
        assert heights.shape == size
        assert heights[0, 0] == pytest.approx(math.hypot(size[0] - 1, size[1] - 1) / math.hypot(*size))
        assert heights[0, 0] == heights[-1, -1] == heights[0, -1]
    wide = field().heights((100, 640))  # a part of the sensor, which has its full width
    assert wide[0, 0] == pytest.approx(math.hypot(319.5, 49.5) / 400)
    assert field().heights((1, 1)).tolist() == [[0.0]]


def test_natural_vignetting() -> None:
    """90 degrees across: 45 at the sides, where cos^4 is 1/4; 640 px of it at half a pixel less."""
    light = lenses.light(field(falloff_power=4.0), (480, 640))
    x = 319.5 / 320
    assert light[240, -1] == pytest.approx((1 + x * x + (0.5 / 320) ** 2) ** -2)
    assert light[240, -1] == pytest.approx(0.25, abs=1e-3)
    assert light.max() == pytest.approx(1, abs=1e-4)
    cubed = lenses.light(field(falloff_power=3.0), (480, 640))
    np.testing.assert_allclose(cubed, light**0.75)
    np.testing.assert_allclose(light, light[::-1, ::-1])


def test_natural_vignetting_behind_distortion_is_of_the_direction() -> None:
    """Of an ideal fisheye: cos^4 of the angle r / f, not of atan(r / f)."""
    fisheye = Distortion("fisheye", (0.0, 0.0, 0.0, 0.0))
    seen = field(falloff_power=4.0, distortion=fisheye)
    r = np.hypot(*np.meshgrid(np.arange(640) - 319.5, np.arange(480) - 239.5)) / 320
    np.testing.assert_allclose(lenses.light(seen, (480, 640)), np.cos(r) ** 4, atol=1e-9)


@pytest.mark.parametrize("unit", ["relative", "mm"])
def test_measured_vignetting(unit: Any) -> None:
    corner_mm = 400 * 3.45e-3
    heights = (0.0, 0.4, 1.0) if unit == "relative" else (0.0, 0.4 * corner_mm, corner_mm)
    curve = RelativeIllumination(heights, (1.0, 0.9, 0.3), unit)
    light = lenses.light(field(relative_illumination=curve), (96, 128))
    expected = np.interp(field().heights((96, 128)), (0.0, 0.4, 1.0), (1.0, 0.9, 0.3))
    np.testing.assert_allclose(light, expected, atol=1e-12)


@pytest.mark.parametrize("scale", [1, 2])
def test_sources_are_opencvs(scale: int) -> None:
    """What each pixel sees, as cv2.initUndistortRectifyMap has it the other way round; half the size, half of it."""
    shape = Distortion("opencv", (-0.2, 0.04, 0.001, -0.0005, 0.002), (400.0, 410.0), (330.0, 235.0))
    lens = field(distortion=shape)
    size = (480 // scale, 640 // scale)
    back = lens.moved(lenses.sources(lens, size), size)
    np.testing.assert_allclose(back, np.meshgrid(np.arange(size[1]), np.arange(size[0])), atol=1e-6)
    if scale == 1:
        matrix = np.array([[400.0, 0, 330], [0, 410, 235], [0, 0, 1]])
        theirs = cv2.initUndistortRectifyMap(
            matrix, np.array(shape.coefficients), None, matrix, (640, 480), cv2.CV_32FC1
        )
        grid = np.meshgrid(np.arange(640.0), np.arange(480.0))
        np.testing.assert_allclose(lens.moved(np.stack(grid), (480, 640)), theirs, atol=1e-3)


def test_boxes_follow_what_is_in_them() -> None:
    """Discs drawn in the scene: their boxes in the distorted picture, seen there, to half a pixel."""
    lens = field(distortion=Distortion("opencv", (-0.25, 0.05, 0.0, 0.0)))
    size = (480, 640)
    source_x, source_y = lenses.sources(lens, size)
    for x, y, rx, ry in ((320, 240, 60, 40), (90, 80, 30, 25), (560, 400, 40, 45), (600, 240, 12, 30)):
        box = np.array([[x - rx, y - ry, x + rx, y + ry]], float)
        inside = ((source_x + 0.5 - x) / rx) ** 2 + ((source_y + 0.5 - y) / ry) ** 2 <= 1
        rows, columns = np.where(inside)
        seen = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        moved = lens.moved_boxes(box, size)[0]
        assert np.abs(moved - seen).max() < 0.8
        assert np.abs(box[0] - moved).max() > (0.3 if (x, y) == (320, 240) else 5)
    assert field().moved_boxes(box, size) == pytest.approx(box)


def test_boxes_beyond_what_the_lens_images_stay_at_its_limit() -> None:
    lens = field(distortion=Distortion("opencv", (-0.08, 0.0, 0.0, 0.0)))
    moved = lens.moved_boxes(np.array([[900.0, 200.0, 3000.0, 280.0]]), (480, 640))
    assert np.isfinite(moved).all()
    assert moved[0, 2] <= 320 + 320 * 2.0412 * 2 / 3 + 1


def test_colours_of_another_magnification() -> None:
    x, y = lenses.larger(field(), 0.01, (481, 641))
    assert x[240, 320] == 320
    assert x[240, -1] == pytest.approx(320 + 320 / 1.01)
    assert y[0, 0] == pytest.approx(240 - 240 / 1.01)
