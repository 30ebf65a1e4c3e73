"""The closed form: coefficients that are known come back, and its failure as a window is counted."""

from __future__ import annotations

import json

import numpy as np
import pytest
from blurnoise_eval.deciding.surface import logistic
from blurnoise_eval.maps import predictor
from made_maps import plane, scores_at

from blurnoise import Camera
from blurnoise.optics.radiometry import photoelectrons

PLANE = plane()
U, W = PLANE.places.T
KNOWN = np.array([-3.0, 1.5, -0.1, -2.0, 0.3, -0.4])
SIZE_PX = 50.0


def test_known_coefficients_come_back() -> None:
    """From shares without error; the usual prior moves what is predicted by less than 0.02."""
    x = predictor.features(PLANE, SIZE_PX)
    found = predictor.fit(x, logistic(x @ KNOWN), prior=1e3)
    assert found == pytest.approx(KNOWN, rel=1e-3)
    usual = logistic(x @ predictor.fit(x, logistic(x @ KNOWN)))
    assert usual == pytest.approx(logistic(x @ KNOWN), abs=0.02)


def test_features_are_the_cameras_at_a_node() -> None:
    camera = Camera.preset("imx250")
    place = int(np.argmin(np.abs(U - np.log2(0.5)) + np.abs(W - np.log2(6))))
    at = PLANE.conditions[place]
    electrons = photoelectrons(camera, at.illuminance_lux, at.exposure_s)
    rounding_e2 = 1 / 12 / camera.system_gain_dn_per_e**2
    dark_e = camera.dark_current_e_s * 2 ** ((25 - camera.dark_reference_c) / camera.dark_doubling_c)
    noise_e = np.sqrt(0.3 * electrons + camera.read_noise_e**2 + dark_e * at.exposure_s + rounding_e2)
    s, r = np.log2(0.62 * electrons / noise_e), at.blur_px / SIZE_PX
    b = np.log2(1 + (electrons / camera.saturation_e) ** 2)
    assert predictor.features(PLANE, SIZE_PX)[place] == pytest.approx([1, s, s**2, r, r**2, b], rel=1e-4)


def test_without_motion_its_coefficients_are_nought() -> None:
    still = plane(speeds=(0.0,), lights_lux=(0.3, 1.0, 7.0, 50.0, 360.0))
    x = predictor.features(still, SIZE_PX)
    found = predictor.predictor_of(still, scores_at(still, logistic(x @ KNOWN)))
    assert found is not None
    assert [found["coefficients"][name] for name in ("L/size", "(L/size)^2")] == [0, 0]
    assert (found["held_out"]["r2_l"], found["held_out"]["rms_l"]) == (None, None)
    assert found["held_out"]["r2_h"] is not None
    assert np.isfinite(list(found["coefficients"].values())).all()


def test_what_never_changes_or_is_known_at_few_nodes_has_none() -> None:
    few = np.where(np.arange(len(PLANE)) < 19, U, np.nan)
    assert predictor.predictor_of(PLANE, scores_at(PLANE, few)) is None
    assert predictor.predictor_of(PLANE, scores_at(PLANE, np.full(len(PLANE), 0.4))) is None


def test_a_cliff_does_not_run_away() -> None:
    """All kept or all lost, told apart by light alone: without a prior the coefficients would be infinite."""
    kept, x = U > 1, predictor.features(PLANE, SIZE_PX)
    found = predictor.fit(x, kept.astype(float))
    assert np.abs(found).max() < 1000
    assert logistic(x[kept] @ found).min() > logistic(x[~kept] @ found).max()


@pytest.mark.parametrize("stops", [0.0, 0.25])
def test_ends_of_windows_are_off_by_as_much_as_the_prediction_is_shifted(stops: float) -> None:
    """Straight in log exposure, so straight between the tested ones: the ends move by just that much."""
    measured, told = 0.5 + 0.1 * U, 0.5 + 0.1 * (U - stops)
    found = predictor.edges(PLANE, measured, told, 0.6)
    assert found["lines"] == 12
    assert (found["measured"], found["missed"]) == (6, 0)  # at 1 and 7 lux no tested exposure reaches 2 lux s
    assert found["off_stops"] == pytest.approx(stops, abs=1e-9)


def test_ends_that_nothing_predicts_are_missed() -> None:
    found = predictor.edges(PLANE, 0.5 + 0.1 * U, np.full(len(PLANE), 0.59), 0.6)
    assert found["missed"] == found["measured"] > 0
    assert found["off_stops"] is None
    falling = predictor.edges(PLANE, 0.5 + 0.1 * U, 0.7 - 0.1 * U, 0.6)
    assert falling["missed"] == falling["measured"]  # where one window begins, the other ends


def test_a_record_is_json() -> None:
    found = predictor.predictor_of(PLANE, scores_at(PLANE, 0.5 + 0.05 * U))
    assert found is not None
    record = json.loads(json.dumps(found))
    assert list(record["coefficients"]) == list(predictor.FEATURES)
    assert record["ranges"]["light_lux_s"] == pytest.approx([0.001, 32.4])
    assert record["n_nodes"] == len(PLANE)
