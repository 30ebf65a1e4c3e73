"""The networks of the rapidocr package on the rendered stop sign; skipped where it is not installed."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.detectors.ocr import (
    Recogniser,
    TextSpotter,
    character_error_rate,
    rapidocr_models,
)
from numpy.typing import NDArray

from blurnoise import motion_blur
from blurnoise.charts import stop_sign, stop_sign_text_box
from blurnoise.optics.colour import srgb_from_linear

MODELS = rapidocr_models()
pytestmark = pytest.mark.skipif(MODELS is None, reason="needs the models of the rapidocr package")
SIDE_PX = 320


@pytest.fixture(scope="module")
def recogniser() -> Recogniser:
    assert MODELS is not None
    return Recogniser(MODELS[1])


@pytest.fixture(scope="module")
def spotter(recogniser: Recogniser) -> TextSpotter:
    assert MODELS is not None
    return TextSpotter(MODELS[0], recogniser)


def sign(size_px: int, blur_px: float = 0.0) -> tuple[NDArray[np.uint8], tuple[float, ...]]:
    """The stop sign on 18 % grey, moved to the right during the exposure, and the box of its word."""
    linear = stop_sign(size_px, height_px=SIDE_PX, width_px=SIDE_PX)
    coded = srgb_from_linear(motion_blur(linear, [[blur_px, 0.0]]) if blur_px else linear)
    image = coded[0].clamp(0, 1).mul(255).round().byte().permute(1, 2, 0).contiguous().numpy()
    return image, stop_sign_text_box(size_px, height_px=SIDE_PX, width_px=SIDE_PX)


@pytest.mark.parametrize("size_px", [100, 50, 32])
def test_the_known_box_is_read(recogniser: Recogniser, size_px: int) -> None:
    image, box = sign(size_px)
    (reading,) = recogniser.read(image, [box])
    assert reading.text == "STOP"
    assert 0.97 < reading.confidence <= 1


@pytest.mark.slow
@pytest.mark.parametrize("size_px", [100, 50, 32])
def test_the_word_is_found_and_read(spotter: TextSpotter, size_px: int) -> None:
    image, box = sign(size_px)
    (reading,) = spotter.read(image, [box])
    assert reading.text == "STOP"
    assert 0.97 < reading.confidence <= 1


def test_a_smeared_word_is_not_read(recogniser: Recogniser, spotter: TextSpotter) -> None:
    image, box = sign(100, blur_px=60)
    for reader in (recogniser, spotter):
        (reading,) = reader.read(image, [box])
        assert reading.text != "STOP"
        assert character_error_rate(reading.text, "STOP") >= 0.75
