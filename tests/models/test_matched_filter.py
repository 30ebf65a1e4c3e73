from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from blurnoise_eval.detectors.detector import Detector
from blurnoise_models.matched_filter import build, expected_confidence
from numpy.typing import NDArray

from blurnoise.charts import stop_sign, stop_sign_box
from blurnoise.optics.colour import srgb_from_linear

SIZES_PX = (100, 50, 32)


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return Detector(build(tmp_path_factory.mktemp("model") / "matched.onnx"))


@cache
def coded_sign(size_px: int, centre_px: tuple[float, float] | None = None) -> NDArray[np.float32]:
    sign = stop_sign(size_px, height_px=320, width_px=320, centre_px=centre_px)
    return srgb_from_linear(sign)[0].permute(1, 2, 0).numpy()


def as_uint8(coded: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(np.clip(coded, 0, 1) * 255).astype(np.uint8)


def confidence(detector: Detector, coded: NDArray[np.floating]) -> float:
    blob = np.ascontiguousarray(coded.transpose(2, 0, 1)[None], np.float32)
    return float(detector.run(blob)[0][0, 4].max())


def test_states_its_own_contract(detector: Detector) -> None:
    assert detector.contract.family == "yolov8"
    assert detector.contract.classes == ("stop sign",)
    assert detector.contract.assumptions == []
    assert detector.session.get_outputs()[0].shape == [1, 5, 40**2 + 20**2 + 10**2]


@pytest.mark.parametrize("size_px", SIZES_PX)
def test_clean_sign_is_certain_and_in_its_place(detector: Detector, size_px: int) -> None:
    found = detector.detect(as_uint8(coded_sign(size_px)))
    assert found.scores[0] > 0.95
    # 8-bit rounding adds a variance of at most 1/12 DN²; the closed form has it as VARIANCE_FLOOR's twelfth.
    assert found.scores[0] == pytest.approx(expected_confidence(size_px), abs=1e-4)
    np.testing.assert_allclose(
        found.boxes_xyxy[0], stop_sign_box(size_px, height_px=320, width_px=320), atol=1e-3
    )
    assert (found.scores[1:] < 0.2).all()


@pytest.mark.parametrize("size_px", SIZES_PX)
@pytest.mark.parametrize("corner", [(0, 0), (0, 1), (1, 0), (1, 1), (0.31, 0.77)])
def test_box_overlaps_the_sign_anywhere(
    detector: Detector, size_px: int, corner: tuple[float, float]
) -> None:
    room = 320 - size_px  # even, so that whole pixels keep the sign on the grid of its filter
    centre = tuple(2 * round(share * room / 2) + size_px / 2 for share in corner)
    found = detector.detect(as_uint8(coded_sign(size_px, centre)))
    box = (centre[0] - size_px / 2, centre[1] - size_px / 2, centre[0] + size_px / 2, centre[1] + size_px / 2)
    shared = np.clip(
        np.minimum(found.boxes_xyxy[0, 2:], box[2:]) - np.maximum(found.boxes_xyxy[0, :2], box[:2]), 0, None
    )
    area = float(shared.prod())
    assert area / (2 * size_px**2 - area) > 0.9
    assert found.scores[0] > 0.5


@pytest.mark.parametrize("size_px", SIZES_PX)
@pytest.mark.parametrize("deviation", [0.05, 0.1, 0.15])
def test_white_noise_leaves_the_closed_form(detector: Detector, size_px: int, deviation: float) -> None:
    """s / (s + n): the tolerance follows from the noise, and 20 % more noise would break it.

    Per pixel, energy has relative sd about (2 sqrt(s n) + sqrt(2) n) / (s + n) / sqrt(k) over k pixels, and
    confidence c(1 - c) times that; k = 5 of them. The best of the neighbouring places adds nothing: they
    explain far less.
    """
    rng = np.random.default_rng(size_px)
    draws = [
        confidence(detector, coded_sign(size_px) + rng.normal(0, deviation, (320, 320, 3))) for _ in range(3)
    ]
    expected = expected_confidence(size_px, noise_variance=deviation**2)
    pixels = (size_px / (2 if size_px >= 64 else 1)) ** 2
    noise_share = 1 - expected
    relative_sd = (2 * np.sqrt(expected * noise_share) + np.sqrt(2) * noise_share) / np.sqrt(pixels)
    tolerance = 5 * expected * noise_share * relative_sd / np.sqrt(len(draws)) + 2 / pixels
    assert np.mean(draws) == pytest.approx(expected, abs=tolerance)
    assert abs(expected_confidence(size_px, noise_variance=2 * deviation**2) - expected) > tolerance


@pytest.mark.parametrize(
    ("size_px", "shape"),
    [(100, (1, 7)), (100, (7, 1)), (100, (5, 3)), (50, (1, 5)), (50, (5, 1)), (32, (1, 3)), (32, (3, 1))],
)
def test_motion_blur_follows_the_autocorrelation(
    detector: Detector, size_px: int, shape: tuple[int, int]
) -> None:
    kernel = np.full(shape, 1 / np.prod(shape))
    blurred = cv2.filter2D(coded_sign(size_px), -1, kernel, borderType=cv2.BORDER_REPLICATE)
    expected = expected_confidence(size_px, blur_kernel=kernel)
    assert confidence(detector, blurred) == pytest.approx(expected, abs=2e-4)  # single precision
    assert expected < expected_confidence(size_px) - 0.05


def test_blur_then_noise(detector: Detector) -> None:
    kernel = np.full((1, 7), 1 / 7)
    blurred = cv2.filter2D(coded_sign(100), -1, kernel, borderType=cv2.BORDER_REPLICATE)
    rng = np.random.default_rng(7)
    noisy = [confidence(detector, blurred + rng.normal(0, 0.1, blurred.shape)) for _ in range(4)]
    expected = expected_confidence(100, noise_variance=0.01, blur_kernel=kernel)
    assert np.mean(noisy) == pytest.approx(expected, abs=0.005)
    assert expected_confidence(100, blur_kernel=kernel) - expected > 0.01


@pytest.mark.parametrize("grey", [0, 118, 255])
def test_flat_pictures_give_nothing(detector: Detector, grey: int) -> None:
    flat = np.full((320, 320, 3), grey / 255)
    assert confidence(detector, flat) < 1e-6
    rounding = np.random.default_rng(0).integers(-1, 2, flat.shape) / 255
    assert confidence(detector, np.clip(flat + rounding, 0, 1)) < 0.2


def test_contrast_and_brightness_do_not_matter(detector: Detector) -> None:
    assert confidence(detector, 0.3 * coded_sign(50) + 0.2) > 0.99


def test_other_sizes_and_inputs(tmp_path: Path) -> None:
    detector = Detector(build(tmp_path / "small.onnx", sizes_px=(70, 41, 20), input_px=160))
    sign = srgb_from_linear(stop_sign(41, height_px=160, width_px=160))[0].permute(1, 2, 0).numpy()
    found = detector.detect(as_uint8(sign))
    assert found.scores[0] > 0.95
    np.testing.assert_allclose(found.boxes_xyxy[0], [59.5, 59.5, 100.5, 100.5], atol=1e-3)


@pytest.mark.parametrize(
    ("sizes_px", "input_px"), [((50, 100, 32), 320), ((100, 50), 320), ((100, 50, 32), 100)]
)
def test_bad_sizes_are_refused(tmp_path: Path, sizes_px: tuple[int, ...], input_px: int) -> None:
    with pytest.raises(ValueError, match="must be"):
        build(tmp_path / "bad.onnx", sizes_px=sizes_px, input_px=input_px)
    assert not (tmp_path / "bad.onnx").exists()


def test_bad_expectations_are_refused() -> None:
    with pytest.raises(ValueError, match="noise_variance"):
        expected_confidence(50, noise_variance=-1.0)
    with pytest.raises(ValueError, match="odd"):
        expected_confidence(50, blur_kernel=np.ones((1, 2)) / 2)
