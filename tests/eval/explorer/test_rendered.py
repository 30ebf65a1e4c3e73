"""What a state shows: the sweep's bits, numbers by their formulas, confidences, a smaller copy, and sentences."""

import math
import xml.etree.ElementTree as ET
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import Picture, rendered_signs
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.explorer.rendered import (
    POINTS,
    Point,
    Standard,
    Subject,
    boxes,
    curve_points,
    mean_confidence,
    rendered,
    verdict,
    window,
    window_sentence,
)
from blurnoise_eval.explorer.state import State, controls
from blurnoise_eval.scoring.on_picture import NOTHING, ModelOutput
from blurnoise_models.detector import STOP_SIGN

from blurnoise import Camera, photoelectrons

CAMERA = Camera.preset("imx250")
STATE = State()
KEPT, ABSOLUTE = Criterion(0.9, kept=True), Criterion(0.6, kept=False)


def seen(state, subject, model=None):
    return rendered(state, subject, subject.frame(state, CAMERA), model)


@pytest.fixture(scope="module")
def signs():
    return Subject(rendered_signs(count=1).pictures[0])


def test_numbers_are_those_of_their_formulas(signs):
    found = seen(STATE.put("gain_db", 0.0).put("velocity_y_px_s", 750.0), signs)
    values = {name: value for name, (_, value, _) in found.numbers.items()}
    white_e = photoelectrons(CAMERA, 2.0, 0.02)
    grey_e = 0.18 * white_e
    dark_dn2 = CAMERA.sensor.dark_variance_dn2(CAMERA.sensor.dark_current_e_s * 0.02)
    noise_e = math.sqrt(grey_e + dark_dn2 / CAMERA.sensor.system_gain_dn_per_e**2)
    assert values["white_electrons"] == pytest.approx(white_e)
    assert values["blur_px"] == pytest.approx(0.02 * 1250)
    assert values["snr_db"] == pytest.approx(20 * math.log10(grey_e / noise_e), abs=0.05)
    assert (values["exposure_ms"], values["gain_db"], values["clipped_percent"]) == (20.0, 0.0, 0.0)
    bright = seen(STATE.put("illuminance_lux", 500.0).put("gain_db", 0.0), signs)
    assert bright.frame.saturated is not None
    assert 0 < bright.numbers["clipped_percent"][1] == 100 * bright.frame.saturated


def test_a_detector_is_asked_as_in_a_sweep_and_the_curve_is_what_is_seen_there(signs):
    detector = Detector(STOP_SIGN)
    taken = seen(STATE, signs, detector)
    assert taken.sight is not None
    assert taken.clean is not None
    assert taken.standard is not None
    own = [row["confidence"] for row in signs.view(detector).evaluate(taken.frame.image).targets]
    assert [row["confidence"] for row in taken.sight.targets] == own
    assert taken.standard.unit == pytest.approx(np.mean([row["confidence"] for row in taken.clean.targets]))
    good, sentence = verdict(taken)
    kept = np.mean(own) / taken.standard.unit
    assert good == (kept >= 0.9)
    assert sentence.startswith(f"Keeps {100 * kept:.0f} % of its confidence in the original")
    points = list(curve_points(STATE, signs, CAMERA, detector, taken.standard))
    exposure = controls(CAMERA)["exposure_s"]
    assert [point.exposure_ms for point in points] == [
        exposure.value(200 * place / (POINTS - 1)) for place in range(POINTS)
    ]
    there = seen(exposure.put(STATE, exposure.text(points[14].exposure_ms)), signs, detector)
    assert there.sight is not None
    assert points[14].mean == mean_confidence(there.sight)


def test_the_smaller_copy_is_the_picture_averaged():
    """In mean, to what noise leaves, and, without motion apart, in what blur leaves of its edges."""
    coarse = np.random.default_rng(1).integers(0, 255, (34, 60, 3), np.uint8)
    large = cv2.resize(coarse, (880, 512), interpolation=cv2.INTER_CUBIC)
    subject = Subject(Picture("large", None, lambda: large, "large"))
    state = STATE.put("gain_db", 24.0).put("defocus_radius_px", 2.0)
    assert subject.smaller == 2
    small = subject.preview(state, CAMERA).astype(float)
    averaged = subject.frame(state, CAMERA).image.astype(float).reshape(256, 2, 440, 2, 3).mean((1, 3))
    assert small.shape == averaged.shape
    assert small.mean() == pytest.approx(averaged.mean(), abs=0.5)
    assert float(np.abs(cv2.blur(small - averaged, (9, 9))).mean()) < 2
    with pytest.raises(ValueError, match="one motion"):
        subject.preview(STATE.put("ego_speed_m_s", 20.0), CAMERA)


def sight(*confidences):
    rows = tuple({"target_id": 2 * place, "confidence": held} for place, held in enumerate(confidences))
    return ModelOutput(NOTHING, rows, 1.0, None, 0)


def test_what_is_enough_is_a_share_of_the_original_or_a_confidence():
    """Of a share, what is missed in the original is no target."""
    clean, dark = sight(0.8, 0.1, 0.4), sight(0.6, 0.9, 0.5)
    kept = Standard.of(KEPT, clean)
    assert (kept.unit, kept.required) == (pytest.approx(0.6), pytest.approx(0.54))
    assert [row["target_id"] for row in kept.sight(dark).targets] == [0, 4]
    assert kept.text(0.54) == "90 %"
    absolute = Standard.of(ABSOLUTE, clean)
    assert (absolute.required, absolute.text(0.3), absolute.sight(dark)) == (0.6, "0.30", dark)


def test_the_window_is_that_around_the_exposure_or_else_the_widest():
    """Its ends are where the curve crosses the level, halfway in the logarithm: at roots of two."""
    curve = [Point(2.0**place, mean) for place, mean in enumerate((0.0, 1.0, 0.0, 1.0, 1.0, 0.0))]
    narrow, wide = (2**0.5, 2**1.5), (2**2.5, 2**4.5)
    for at_ms, expected in ((2.0, narrow), (3.0, wide), (20.0, wide), (100.0, wide)):
        assert window(curve, 0.5, at_ms) == pytest.approx(expected)
    assert window(curve, 1.5, 2.0) is None


@pytest.mark.parametrize(
    ("held", "told"),
    [
        ((0.9, 0.9, 0.9), "0.60 or more at every tested value; best: 0.90 at 1.64 ms."),
        ((0.1, 0.9, 0.1), "0.60 or more from about 0.15 to 17 ms, not here; best: 0.90 at 1.64 ms."),
        ((0.9, 0.9, 0.1), "0.60 or more up to about 17 ms, not here; best: 0.90 at 0.003 ms."),
        ((0.1, 0.1, 0.9), "0.60 or more from about 85 ms, not here; best: 0.90 at 900 ms."),
        ((0.1, 0.2, 0.1), "none of the 3 tested values reaches 0.60; best: 0.20 at 1.64 ms."),
    ],
)
def test_the_sentence_of_a_curve(held, told):
    points = [Point(value, each) for value, each in zip((0.003, 1.64, 900.0), held, strict=True)]
    standard = Standard(0.6, False, 1.0, frozenset())
    assert window_sentence(points, 20.0, standard).removeprefix("Exposure: ") == told


def test_the_best_exposure_saturates_little_where_another_such_works():
    points = [Point(1.0, 0.7), Point(10.0, 0.9, 0.3), Point(100.0, 0.1)]
    standard = Standard(0.6, False, 1.0, frozenset())
    assert window_sentence(points, 1.0, standard).endswith("best: 0.70 at 1 ms.")
    assert window_sentence(points[1:], 10.0, standard).endswith("best: 0.90 at 10 ms.")


# --- boxes and the curve ---


def row(x, confidence):
    place = {"x0": x, "y0": 20.0, "x1": x + 30, "y1": 50.0, "width_px": 30.0, "height_px": 30.0}
    return {**place, "confidence": confidence}


def drawn(classes, *targets):
    places = np.array([[0, 0, 9, 9], [60, 20, 90, 50]], np.float32)
    detections = Detections(places, np.array([0.9, 0.8], np.float32), np.array([0, 0]))
    found: Any = SimpleNamespace(classes=classes, frame=SimpleNamespace(image=np.zeros((80, 120, 3))))
    return ET.fromstring(boxes(found, ModelOutput(detections, targets, 1.0, None, 0)))


def test_boxes_are_found_missed_or_others():
    tree = drawn(("sign",), row(10, 0.3), row(60, 0.2))
    assert tree.get("viewBox") == "0 0 120 80"  # whatever lies below
    assert [each.get("class") for each in tree] == ["other", "found", "missed"]
    assert [each.findtext("text") for each in tree] == ["sign 0.90", "0.30", "0.20"]
