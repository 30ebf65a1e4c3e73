"""Text recognisers: on boxes that are known, or on those that a text detector finds."""

from blurnoise_eval.detectors.ocr.recogniser import (
    Reading,
    Recogniser,
    character_error_rate,
    is_recogniser,
    rapidocr_models,
)
from blurnoise_eval.detectors.ocr.spotter import TextSpotter

__all__ = ["Reading", "Recogniser", "TextSpotter", "character_error_rate", "is_recogniser", "rapidocr_models"]
