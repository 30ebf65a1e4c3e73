"""What a state shows: the sweep's bits, numbers by their formulas, confidences, a smaller copy, and sentences."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from blurnoise_eval.answers.criterion import MATCHES, Criterion
from blurnoise_eval.datasets import Picture, rendered_signs
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.explorer.rendered import (
    POINTS,
    Point,
    Rendered,
    Standard,
    Subject,
    curve_points,
    keeps_most,
    rendered,
    window_sentence,
    works,
)
from blurnoise_eval.explorer.state import State, control, with_figures
from blurnoise_eval.scoring.on_picture import NOTHING, ModelOutput
from blurnoise_models.detector import STOP_SIGN

from blurnoise import Camera, ExposedScene, Exposure, photoelectrons

CAMERA = Camera.preset("imx250")
STATE = State()
KEPT, ABSOLUTE = Criterion(0.9, kept=True), Criterion(0.6, kept=False)
ALONG = control("exposure_s", CAMERA)


def seen(state: State, subject: Subject, camera: Camera, model: Detector | None = None) -> Rendered:
    return rendered(state, subject, camera, subject.frame(state, camera), model, KEPT)


@pytest.fixture(scope="module")
def signs() -> Subject:
    return Subject(rendered_signs(count=1).pictures[0])


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector(STOP_SIGN)


def test_the_picture_has_the_simulators_bits(signs: Subject) -> None:
    state = replace(STATE.put("gain_db", 6.0), seed=5)
    taken = seen(state, signs, CAMERA)
    exposure = state.at.exposure(CAMERA, 5)
    (frame,) = ExposedScene.of_picture(signs.original).frames([exposure])
    assert np.array_equal(taken.image, frame.picture)
    assert not np.array_equal(seen(replace(state, seed=6), signs, CAMERA).image, frame.picture)


def test_numbers_are_those_of_their_formulas(signs: Subject) -> None:
    state = STATE.put("gain_db", 0.0).put("velocity_y_px_s", 750.0)
    told = {each.name: each for each in seen(state, signs, CAMERA).numbers}
    white_e = photoelectrons(CAMERA, 2.0, 0.02)
    assert told["white_electrons"].value == pytest.approx(white_e)
    assert told["blur_px"].value == pytest.approx(0.02 * 1250)
    grey_e = 0.18 * white_e
    noise_e = math.sqrt(
        grey_e + CAMERA.dark_variance_dn2(CAMERA.dark_current_e_s * 0.02) / CAMERA.system_gain_dn_per_e**2
    )
    assert told["snr_db"].value == pytest.approx(20 * math.log10(grey_e / noise_e), abs=0.05)
    assert told["gain_db"].text == "0.0 dB"


def test_blur_of_a_driven_camera_is_that_in_the_middle_of_the_picture(signs: Subject) -> None:
    state = STATE.put("ego_speed_m_s", 20.0)
    told = {each.name: each.value for each in seen(state, signs, CAMERA).numbers}
    driven = Exposure(CAMERA, 0.02, 2.0, ego_speed_m_s=20.0)
    lengths = driven.vehicle.flow_px_s(CAMERA, signs.size, 20.0).norm(dim=0) * 0.02
    assert float(lengths.min()) < told["blur_px"] < float(lengths.max())


def test_a_detector_is_asked_as_in_a_sweep(signs: Subject, detector: Detector) -> None:
    taken = seen(STATE, signs, CAMERA, detector)
    assert taken.sight is not None
    assert taken.clean is not None
    own = [row["confidence"] for row in signs.view(detector).evaluate(taken.image).targets]
    assert [row["confidence"] for row in taken.sight.targets] == own
    assert taken.confidence == pytest.approx(np.mean(own))
    assert taken.standard is not None
    assert taken.standard.original == pytest.approx(
        taken.clean.targets and np.mean([row["confidence"] for row in taken.clean.targets])
    )
    assert taken.standard.value(taken.confidence) < 0.9  # the first screen shows what is lost


def test_a_curve_runs_along_any_control_and_is_what_is_seen_there(signs: Subject, detector: Detector) -> None:
    standard = Standard.of(KEPT, signs.view(detector).clean)
    for name in ("velocity_x_px_s", "read_noise_e", "moves"):
        along = control(name, CAMERA)
        points = list(curve_points(STATE, signs, CAMERA, detector, along, standard))
        assert [point.value for point in points] == along.places(POINTS)
        at = along.put(STATE, points[1].value)
        there = seen(at, signs, with_figures(CAMERA, at.figures), detector)
        assert points[1].mean == pytest.approx(there.confidence, abs=1e-12)


def test_the_smaller_copy_is_the_picture_averaged() -> None:
    """In mean, to what noise leaves, and, without motion apart, in what blur leaves of its edges."""
    coarse = np.random.default_rng(1).integers(0, 255, (34, 60, 3), np.uint8)
    large = cv2.resize(coarse, (880, 512), interpolation=cv2.INTER_CUBIC)
    subject = Subject(Picture("large", None, lambda: large, "large"))
    state = STATE.put("gain_db", 24.0).put("defocus_radius_px", 2.0)
    assert subject.smaller == 2
    small = subject.preview(state, CAMERA).astype(float)
    full = seen(state, subject, CAMERA).image.astype(float)
    averaged = full.reshape(256, 2, 440, 2, 3).mean((1, 3))
    assert small.shape == averaged.shape
    assert small.mean() == pytest.approx(averaged.mean(), abs=0.5)
    assert float(np.abs(cv2.blur(small - averaged, (9, 9))).mean()) < 2
    with pytest.raises(ValueError, match="one motion"):
        subject.preview(STATE.put("ego_speed_m_s", 20.0), CAMERA)


def sight(*confidences: float) -> ModelOutput:
    rows = tuple({"target_id": 2 * place, "confidence": held} for place, held in enumerate(confidences))
    return ModelOutput(NOTHING, rows, 1.0, None, 0)


def strip(best_ms: float, stops: float = 3.0, saturated_from: float = math.inf) -> list[Point]:
    """A curve along the exposure: the kept share falls as a parabola of the logarithm."""

    def stop(value: float) -> Point:
        share = max(0.0, 1 - (math.log2(value / best_ms) / stops) ** 2)
        return Point(value, (0.5 * share,), 0.3 if value > saturated_from else 0.0)

    return [stop(value) for value in ALONG.places(POINTS)]


def test_a_share_of_the_original_is_enough_and_what_is_missed_there_is_no_target() -> None:
    clean, seen = sight(0.8, 0.1, 0.4), sight(0.6, 0.9, 0.5)
    standard = Standard.of(KEPT, clean)
    assert standard.original == pytest.approx(0.6)
    assert standard.enough == pytest.approx(0.54)
    assert standard.scores(seen) == (0.6, 0.5)
    assert standard.value(0.54) == pytest.approx(0.9)
    assert standard.found_from == 0.25
    assert [row["target_id"] for row in standard.sight(seen).targets] == [0, 4]


def test_a_confidence_is_enough_where_a_run_asks_for_one_of_all_its_targets() -> None:
    standard = Standard.of(ABSOLUTE, sight(0.8, 0.1, 0.4))
    assert (standard.enough, standard.found_from, standard.value(0.3)) == (0.6, 0.6, 0.3)
    assert standard.scores(sight(0.6, 0.9, 0.5)) == (0.6, 0.9, 0.5)


def test_texts_are_read_or_not() -> None:
    def read(*texts: str) -> ModelOutput:
        rows = (
            {"target_id": n, "confidence": 0.4, "text": each, "truth": "ab"} for n, each in enumerate(texts)
        )
        return ModelOutput(NOTHING, tuple(rows), 1.0, None, 0)

    standard = Standard.of(Criterion(0.9, kept=True, score=MATCHES), read("ab", "cd", "ab"))
    assert standard.scores(read("ab", "ab", "cd")) == (1.0, 0.0)
    assert standard.enough == pytest.approx(0.9)


@pytest.mark.parametrize("best_ms", [3.0, 7.7, 21.0])
def test_a_window_ends_where_the_score_crosses_what_is_enough(best_ms: float) -> None:
    """Ninety per cent of a parabola in log2: the root of a tenth of its half width, to a fifth of a stop."""
    standard = Standard.of(KEPT, sight(0.5))
    for stops in (3.0, 8.0):
        kept = works(strip(best_ms, stops), standard.enough, best_ms, logarithmic=True)
        assert kept is not None
        half = stops * math.sqrt(0.1)
        assert math.log2(kept[0] / best_ms) == pytest.approx(-half, abs=0.2)
        assert math.log2(kept[1] / best_ms) == pytest.approx(half, abs=0.2)


@pytest.mark.parametrize("best_ms", [3.0, 7.7, 21.0])
def test_the_exposure_that_keeps_most_is_found_between_the_places_of_a_strip(best_ms: float) -> None:
    """To what the places of a curve, two thirds of a stop apart, allow."""
    standard = Standard.of(KEPT, sight(0.5))
    for stops in (1.5, 3.0, 8.0):
        most = keeps_most(strip(best_ms, stops), standard)
        assert abs(math.log2(most.value / best_ms)) < 0.4


def test_a_saturated_exposure_is_used_only_where_no_other_works() -> None:
    standard = Standard.of(KEPT, sight(0.5))
    most = keeps_most(strip(20.0, stops=5.0, saturated_from=15.0), standard)
    assert most.value <= 15
    all_saturated = keeps_most(strip(20.0, stops=5.0, saturated_from=0.0), standard)
    assert abs(math.log2(all_saturated.value / 20)) < 0.4


def test_where_it_works() -> None:
    curve = [Point(float(x), (held,)) for x, held in enumerate((0.9, 0.2, 0.7, 0.8, 0.7, 0.1))]
    window = (1.8, 4 + 1 / 6)  # where straight lines cross 0.6
    assert works(curve, 0.6, 3.3) == pytest.approx(window)
    assert works(curve, 0.6, 0.0) == pytest.approx((0.0, 3 / 7))
    assert works(curve, 0.6, 5.5) == pytest.approx(window)
    along = [Point(1.0, (0.2,)), Point(4.0, (0.8,))]
    assert works(along, 0.5, 4.0, logarithmic=True) == pytest.approx((2.0, 4.0))
    assert works(curve, 0.95, 1.0) is None


@pytest.mark.parametrize(
    ("held", "told"),
    [
        ((0.9, 0.9, 0.9), "0.60 or more at every value tried; most, 0.90 at 1.64 ms."),
        (
            (0.1, 0.9, 0.1),
            "0.60 or more from about 0.15 to 17 ms, not here; most, 0.90 at 1.64 ms.",
        ),
        ((0.9, 0.8, 0.1), "0.60 or more up to about 9.9 ms, not here; most, 0.90 at 0.003 ms."),
        (
            (0.1, 0.2, 0.1),
            "none of the 3 values tried reaches 0.60; most, 0.20 at 1.64 ms.",
        ),
    ],
)
def test_the_sentence_of_a_curve(held: tuple[float, ...], told: str) -> None:
    curve = [Point(value, (each,)) for value, each in zip(ALONG.places(3), held, strict=True)]
    standard = Standard(Criterion(0.6, kept=False), frozenset(), 1.0)
    assert window_sentence(curve, ALONG, 20.0, standard).removeprefix("Exposure: ") == told
