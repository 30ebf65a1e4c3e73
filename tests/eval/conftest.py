"""One small detector for all tests of the harness: of stop signs, exact by construction."""

import pytest
from signs_in_memory import matched_detector


@pytest.fixture(scope="session")
def detector(tmp_path_factory):
    return matched_detector(tmp_path_factory.mktemp("model"))
