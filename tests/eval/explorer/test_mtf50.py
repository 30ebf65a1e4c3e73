"""MTF50 of lens and motion against closed forms."""

from __future__ import annotations

import math

import pytest
from blurnoise_eval.explorer.mtf50 import mtf50

from blurnoise import Optics


def test_of_motion_alone() -> None:
    assert mtf50(Optics(), (8.0, 0.0)) == pytest.approx(0.603355 / 8, rel=1e-4)
    assert mtf50(Optics(), (3.0, 4.0), 90) == pytest.approx(0.603355 / 4, rel=1e-4)
    assert mtf50(Optics(), (3.0, 4.0), math.degrees(math.atan2(4, 3))) == pytest.approx(
        0.603355 / 5, rel=1e-4
    )


def test_of_a_lens_alone() -> None:
    assert mtf50(Optics(defocus_radius_px=2.0), angle_deg=37) == pytest.approx(0.352542 / 2, rel=1e-4)
    assert mtf50(Optics(gaussian_sigma_px=1.5)) == pytest.approx(0.187391 / 1.5, rel=1e-4)


def test_beyond_sampling_there_is_none() -> None:
    assert mtf50(Optics()) == math.inf
    assert mtf50(Optics(), (1.0, 0.0)) == math.inf
    assert mtf50(Optics(), (1.3, 0.0)) == pytest.approx(0.603355 / 1.3, rel=1e-4)
