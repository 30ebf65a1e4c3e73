"""One small detector for all tests of the harness: of stop signs, exact by construction."""

import pytest
from blurnoise_eval.detectors.detector import Detector
from signs_in_memory import matched_detector


@pytest.fixture(scope="session")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return matched_detector(tmp_path_factory.mktemp("model"))
