"""What is seen of a state: the sweep's bits, numbers by their formulas, confidences, and a smaller twin."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import Picture, rendered_signs
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.explorer.controls import control
from blurnoise_eval.explorer.judging import Standard
from blurnoise_eval.explorer.rendered import Rendered, Subject, curve_points, histogram, rendered
from blurnoise_eval.explorer.state import State, with_figures
from blurnoise_models.detector import STOP_SIGN

from blurnoise import Camera, ExposedScene, photoelectrons, plan

CAMERA = Camera.preset("imx250")
STATE = State()
OWN = Criterion(0.9, kept=True)


def seen(state: State, subject: Subject, camera: Camera, model: Detector | None = None) -> Rendered:
    return rendered(state, subject, camera, subject.frame(state, camera), model, OWN)


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
    assert told["mtf50"].value == pytest.approx(0.603355 / 25, rel=1e-4)
    grey_e = 0.18 * white_e
    noise_e = math.sqrt(
        grey_e + CAMERA.dark_variance_dn2(CAMERA.dark_current_e_s * 0.02) / CAMERA.system_gain_dn_per_e**2
    )
    assert told["snr_db"].value == pytest.approx(20 * math.log10(grey_e / noise_e), abs=0.05)
    assert told["gain_db"].text == "0.0 dB"


def test_the_plan_is_the_simulators(signs: Subject) -> None:
    state = STATE.put("gain_db", 0.0)
    asked = plan(CAMERA, exposure_s=0.02, illuminance_lux=2.0, displacement_px=(20.0, 0.0), size=signs.size)
    assert seen(state, signs, CAMERA).plan == asked
    apart = seen(state.put("moves", 1.0), signs, CAMERA).plan.stages
    assert "objects" in {each.name for each in apart if each.kept}


def test_a_detector_is_asked_as_in_a_sweep(signs: Subject, detector: Detector) -> None:
    taken = seen(STATE, signs, CAMERA, detector)
    assert taken.sight is not None
    assert taken.clean is not None
    own = [row["confidence"] for row in signs.view(detector).look(taken.image).targets]
    assert [row["confidence"] for row in taken.sight.targets] == own
    assert taken.confidence == pytest.approx(np.mean(own))
    assert taken.standard is not None
    assert taken.standard.original == pytest.approx(
        taken.clean.targets and np.mean([row["confidence"] for row in taken.clean.targets])
    )
    assert taken.standard.value(taken.confidence) < 0.9  # the first screen shows what is lost


def test_a_curve_runs_along_any_control_and_is_what_is_seen_there(signs: Subject, detector: Detector) -> None:
    standard = Standard.of(OWN, signs.view(detector).clean)
    for name in ("exposure_s", "velocity_x_px_s", "read_noise_e", "moves"):
        along = control(name, CAMERA)
        points = list(curve_points(STATE, signs, CAMERA, detector, along, standard, 3))
        assert [point.value for point in points[:3]] == along.places(3)
        assert (len(points) > 3) is (name == "exposure_s")  # more where it keeps most
        at = along.put(STATE, points[1].value)
        there = seen(at, signs, with_figures(CAMERA, at.figures), detector)
        assert points[1].mean == pytest.approx(there.confidence, abs=1e-12)


def test_a_histogram_counts_and_tells_what_is_clipped() -> None:
    image = np.zeros((10, 20, 3), np.uint8)
    image[:5, :, 0] = 255
    shares, clipped = histogram(image)
    assert shares.sum(1) == pytest.approx([1, 1, 1])
    assert (shares[0, 0], shares[0, -1], shares[1, 0]) == pytest.approx((0.5, 0.5, 1.0))
    assert clipped == pytest.approx((5 / 6, 1 / 6))


def test_the_smaller_twin_is_the_picture_averaged() -> None:
    """In mean, to what noise leaves, and in noise and blur: by how far it is from its own average over 9 x 9 px."""
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
    rough = [float((each - cv2.blur(each, (9, 9))).std()) for each in (small, averaged)]
    assert rough[0] == pytest.approx(rough[1], rel=0.05)
    assert float(np.abs(cv2.blur(small - averaged, (9, 9))).mean()) < 2
