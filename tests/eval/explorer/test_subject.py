"""A picture that is explored: its figures, confidences, verdict, curve and boxes, and a smaller copy."""

import math

import cv2
import numpy as np
import pytest
import stored_rows
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import Picture, rendered_signs
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.explorer.state import State, controls
from blurnoise_eval.explorer.subject import CURVE_EVERY, PictureScore, Subject
from blurnoise_eval.explorer.verdict import Point, Standard, mean_confidence, window, window_sentence
from blurnoise_eval.scoring.on_picture import NOTHING, ModelOutput
from blurnoise_models.detector import STOP_SIGN

from blurnoise import Camera, photoelectrons

CAMERA = Camera.preset("imx250")
STATE = State()
KEPT, ABSOLUTE = Criterion(0.9, kept=True), Criterion(0.6, kept=False)


def rendered(state, subject, model=None):
    return subject.rendered(subject.frame(state, CAMERA), model)


@pytest.fixture(scope="module")
def signs():
    return Subject(rendered_signs(count=1).pictures[0])


def test_numbers_are_those_of_their_formulas(signs):
    numbers = rendered(STATE.put("gain_db", 0.0).put("velocity_y_px_s", 750.0), signs).numbers
    values = {name: value for name, (_, value, _) in numbers.items()}
    white_e = photoelectrons(CAMERA, 5.0, 0.005)
    grey_e = 0.18 * white_e
    dark_dn2 = CAMERA.sensor.dark_variance_dn2(CAMERA.sensor.dark_current_e_s * 0.005)
    noise_e = math.sqrt(grey_e + dark_dn2 / CAMERA.sensor.system_gain_dn_per_e**2)
    assert values["white_electrons"] == pytest.approx(white_e)
    assert values["blur_px"] == pytest.approx(0.005 * 1250)
    assert values["snr_db"] == pytest.approx(20 * math.log10(grey_e / noise_e), abs=0.05)
    assert (values["exposure_ms"], values["gain_db"], values["clipped_percent"]) == (5.0, 0.0, 0.0)
    bright = rendered(STATE.put("illuminance_lux", 500.0).put("gain_db", 0.0), signs)
    assert 0 < bright.numbers["clipped_percent"][1] == 100 * bright.frame.saturated


def test_the_verdict_is_the_share_that_is_kept_and_the_curve_goes_through_it(signs):
    detector = Detector(STOP_SIGN)
    scored = rendered(STATE, signs, detector).scored
    unit = np.mean([row.confidence for row in scored.clean.targets])
    share = mean_confidence(scored.output) / unit
    good, sentence = scored.standard.verdict(scored.counted)
    assert good == (share >= 0.9)
    assert sentence.startswith(f"Keeps {100 * share:.0f} % of its confidence in the original")
    points = list(signs.curve(STATE, CAMERA, detector))
    exposures_s = controls(CAMERA)["exposure_s"].values[::CURVE_EVERY]
    assert [point.exposure_ms for point in points] == pytest.approx([1e3 * value for value in exposures_s])
    there = rendered(STATE.put("exposure_s", exposures_s[14]), signs, detector)
    assert points[14].mean == mean_confidence(there.scored.counted)


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


def output(*confidences):
    rows = tuple(
        stored_rows.answer(2 * number, confidence=confidence) for number, confidence in enumerate(confidences)
    )
    return ModelOutput(NOTHING, rows, 1.0, None, 0)


def test_what_is_enough_is_a_share_of_the_original_or_a_confidence():
    """Of a share, what is missed in the original is no target."""
    clean, dark = output(0.8, 0.1, 0.4), output(0.6, 0.9, 0.5)
    kept = Standard.of(KEPT, clean)
    assert (kept.unit, kept.required) == (pytest.approx(0.6), pytest.approx(0.54))
    assert [row.target_id for row in kept.of_counted(dark).targets] == [0, 4]
    assert kept.text(0.54) == "90 %"
    absolute = Standard.of(ABSOLUTE, clean)
    assert (absolute.required, absolute.text(0.3), absolute.of_counted(dark)) == (0.6, "0.30", dark)


def test_the_window_is_that_around_the_exposure_or_else_the_widest():
    """Its ends are where the curve crosses the level, halfway in the logarithm: at roots of two."""
    curve = [Point(2.0**place, mean) for place, mean in enumerate((0.0, 1.0, 0.0, 1.0, 1.0, 0.0))]
    narrow, wide = (2**0.5, 2**1.5), (2**2.5, 2**4.5)
    for at_ms, expected in ((2.0, narrow), (3.0, wide), (20.0, wide), (100.0, wide)):
        assert window(curve, 0.5, at_ms) == pytest.approx(expected)
    assert window(curve, 1.5, 2.0) is None


@pytest.mark.parametrize(
    ("means", "sentence"),
    [
        ((0.9, 0.9, 0.9), "0.60 or more at every tested value; best: 0.90 at 1.64 ms."),
        ((0.1, 0.9, 0.1), "0.60 or more from about 0.15 to 17 ms, not here; best: 0.90 at 1.64 ms."),
        ((0.9, 0.9, 0.1), "0.60 or more up to about 17 ms, not here; best: 0.90 at 0.003 ms."),
        ((0.1, 0.1, 0.9), "0.60 or more from about 85 ms, not here; best: 0.90 at 900 ms."),
        ((0.1, 0.2, 0.1), "none of the 3 tested values reaches 0.60; best: 0.20 at 1.64 ms."),
    ],
)
def test_the_sentence_of_a_curve(means, sentence):
    points = [Point(*point) for point in zip((0.003, 1.64, 900.0), means, strict=True)]
    standard = Standard(0.6, False, 1.0, frozenset())
    assert window_sentence(points, 20.0, standard).removeprefix("Exposure: ") == sentence


def test_the_best_exposure_saturates_little_where_another_such_works():
    points = [Point(1.0, 0.7), Point(10.0, 0.9, 0.3), Point(100.0, 0.1)]
    standard = Standard(0.6, False, 1.0, frozenset())
    assert window_sentence(points, 1.0, standard).endswith("best: 0.70 at 1 ms.")
    assert window_sentence(points[1:], 10.0, standard).endswith("best: 0.90 at 10 ms.")


def test_boxes_are_found_missed_or_others():
    def target(x, confidence):
        box = {"x0": x, "y0": 20.0, "x1": x + 30, "y1": 50.0, "width_px": 30.0, "height_px": 30.0}
        return stored_rows.answer(x, **box, confidence=confidence)

    boxes_xyxy = np.array([[0, 0, 9, 9], [60, 20, 90, 50]], np.float32)
    detections = Detections(boxes_xyxy, np.array([0.9, 0.8], np.float32), np.array([0, 0]))
    answer = ModelOutput(detections, (target(10, 0.3), target(60, 0.2)), 1.0, None, 0)
    scored = PictureScore(answer, answer, Standard.of(ABSOLUTE, answer), ("sign",))
    assert [(each["kind"], each["text"]) for each in scored.boxes] == [
        ("other", "sign 0.90"), ("found", "0.30"), ("missed", "0.20"),
    ]  # fmt: skip
    assert scored.boxes[0]["box"] == [0, 0, 9, 9]
