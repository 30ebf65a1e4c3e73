"""Distortion models against OpenCV's own, there and back."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from blurnoise.optics.lens import Distortion

MODELS = [
    Distortion("opencv", (-0.28, 0.07, 0.0, 0.0)),
    Distortion("opencv", (-0.28, 0.07, 0.002, -0.001)),
    Distortion("opencv", (0.2, -0.03, 0.0003, 0.001, 0.01)),
    Distortion("opencv", (0.3, -0.1, 0.0004, -0.0002, 0.01, 0.55, -0.05, 0.02)),
    Distortion("fisheye", (0.0, 0.0, 0.0, 0.0)),
    Distortion("fisheye", (-0.02, 0.004, -0.001, 0.0002)),
]


def directions() -> tuple[Any, Any]:
    x, y = np.meshgrid(np.linspace(-0.9, 0.9, 21), np.linspace(-0.6, 0.6, 15))
    return x, y


@pytest.mark.parametrize("lens", MODELS)
def test_models_are_opencvs(lens: Distortion) -> None:
    x, y = directions()
    own = np.moveaxis(lens.distorted(np.stack([x, y])), 0, -1)
    rays = np.stack([x, y], -1).reshape(1, -1, 2)
    if lens.model == "fisheye":
        theirs = cv2.fisheye.distortPoints(rays, np.eye(3), np.array(lens.coefficients))
    else:
        points = np.concatenate([rays[0], np.ones((rays.shape[1], 1))], 1)
        theirs, _ = cv2.projectPoints(
            points, np.zeros(3), np.zeros(3), np.eye(3), np.array(lens.coefficients)
        )
    np.testing.assert_allclose(own.reshape(-1, 2), theirs.reshape(-1, 2), atol=1e-12)


@pytest.mark.parametrize("lens", MODELS)
def test_there_and_back(lens: Distortion) -> None:
    seen = np.stack(directions())
    np.testing.assert_allclose(lens.undistorted(lens.distorted(seen)), seen, atol=1e-9)


def test_what_folds_is_named() -> None:
    """r (1 - r^2 / 3) turns at r = 1, where it is 2/3."""
    lens = Distortion("opencv", (-1 / 3, 0.0, 0.0, 0.0))
    inside, _ = lens.undistorted(np.array([[0.66], [0.0]]))
    assert inside[0] * (1 - inside[0] ** 2 / 3) == pytest.approx(0.66)
    with pytest.raises(ValueError, match=r"images nothing beyond 0\.666\d* focal lengths .* reaches 0\.7"):
        lens.undistorted(np.array([[0.7], [0.0]]))
    drawn = lens.before_fold(np.array([[3.0, 0.3], [4.0, 0.4]]))
    np.testing.assert_allclose(np.hypot(*drawn), [1.0, 0.5], atol=1e-3)
