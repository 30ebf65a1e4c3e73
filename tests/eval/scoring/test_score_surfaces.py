"""Surfaces of AP: means and intervals are those of the score and its jackknife."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from blurnoise_eval.scoring import certainty
from blurnoise_eval.scoring.crossings import Curve
from blurnoise_eval.scoring.estimates import Estimate, left_out
from blurnoise_eval.scoring.score_surfaces import Sized, score_surfaces
from plans import OWN

PICTURES = 12
GENERATOR = np.random.default_rng(2)


def estimate(value: float) -> Estimate:
    """A value, and those without each picture."""
    return left_out(np.concatenate([[value], value + 0.01 * GENERATOR.normal(size=PICTURES)]))


def sized(exposure_s: float | None, speed: float, large: Estimate, **pictures: Any) -> Sized:
    row = {"model": "m", "exposure_s": exposure_s, "illuminance_lux": 50.0, "velocity_x_px_s": speed, **OWN}
    row |= {"velocity_y_px_s": 0.0, "saturated": None, "brightness": None, **pictures}
    nothing = dict.fromkeys(("all", "small", "medium"), Estimate(None))
    return Sized(row, {**nothing, "large": large}, {"all": 9, "small": 0, "medium": 4, "large": 5})


CLEAN = estimate(0.5)
CONDITIONS = {
    (0.01, 0.0): estimate(0.4),
    (0.01, 90.0): estimate(0.2),
    (0.02, 0.0): estimate(0.6),
    (0.02, 90.0): estimate(0.1),
}


def scored() -> list[Sized]:
    exposed = [sized(*at, found, saturated=at[0], brightness=0.3) for at, found in CONDITIONS.items()]
    return [sized(None, 0.0, CLEAN), *exposed[::-1]]


@pytest.mark.parametrize("kept", [False, True])
def test_values_and_intervals_are_the_scores_own(kept: bool) -> None:
    (((surface,),)) = list(score_surfaces(scored(), kept))
    assert (surface.group, surface.n_targets, surface.clean) == ("large", 5, 0.5)
    assert surface.reference == pytest.approx(2.5)
    assert surface.most == (2.0 if kept else 1.0)
    assert surface.exposures_s == (0.01, 0.02)
    assert surface.velocities_px_s == ((0.0, 0.0), (90.0, 0.0))
    assert surface.saturated[:, 1] == pytest.approx([0.01, 0.02])
    assert surface.brightness[0, 0] == 0.3
    for (exposure_s, speed), own in CONDITIONS.items():
        e, v = surface.exposures_s.index(exposure_s), [0.0, 90.0].index(speed)
        assert own.value is not None
        assert own.departures is not None
        assert surface.mean[e, v] == pytest.approx(own.value / (0.5 if kept else 1.0))
        curve = Curve((exposure_s,), surface.sums[:, [e], v], surface.counts[:, [e], v], most=surface.most)
        ends = curve.interval()
        assert ends is not None
        away = own.departures
        if kept:
            assert CLEAN.departures is not None
            away = (away - own.value / 0.5 * CLEAN.departures) / 0.5
        expected = certainty.interval(surface.mean[e, v], away, within=(0.0, surface.most))
        assert (ends.low[0], ends.high[0]) == pytest.approx((float(expected.low), float(expected.high)))


def test_a_size_without_targets_has_no_surface() -> None:
    """There is no AP of small targets, and none of medium ones in the untouched pictures."""
    assert [surface.group for alike in score_surfaces(scored(), kept=False) for surface in alike] == ["large"]
