"""The kernel of a disc: areas against the disc itself, not against the code that made them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blurnoise.blur.convolution import disc


def test_disc_equals_matlabs_fspecial() -> None:
    """fspecial('disk', 1): centre 1/pi, side (sqrt(3)/4 + pi/6 - 1/2)/pi, corner 0.0250785810238330."""
    kernel = disc(1.0)
    side = (math.sqrt(3) / 4 + math.pi / 6 - 0.5) / math.pi
    expected = [[0.0250785810238330, side, 0.0250785810238330], [side, 1 / math.pi, side]]
    np.testing.assert_allclose(kernel[:2], expected, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 12.0))
def test_disc_is_a_disc(radius: float) -> None:
    """Unit sum, symmetric, and the pixel areas match a fine grid of points to the grid's own error."""
    kernel = disc(radius)
    assert kernel.shape[0] == kernel.shape[1]
    assert kernel.shape[0] % 2 == 1
    assert kernel.sum() == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(kernel, kernel.T, atol=1e-13)
    np.testing.assert_allclose(kernel, kernel[::-1, ::-1], atol=1e-13)
    assert kernel.min() > -1e-13
    if radius > 0.5:
        fine = (np.arange(kernel.shape[0] * 64) + 0.5) / 64 - kernel.shape[0] / 2
        inside = (fine[:, None] ** 2 + fine**2 <= radius**2).astype(float)
        areas = inside.reshape(kernel.shape[0], 64, -1, 64).mean(axis=(1, 3)) / (math.pi * radius**2)
        np.testing.assert_allclose(kernel, areas, atol=0.02 / (math.pi * radius**2))
