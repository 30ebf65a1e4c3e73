"""Commands called in the test's process, and pictures to give them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.cli import main
from numpy.typing import NDArray

Output = pytest.CaptureFixture[str]


def told(capsys: Output, *arguments: object) -> Any:
    """The JSON that a command prints, which must succeed."""
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def pixels(shape: Sequence[int], dtype: type = np.uint8) -> NDArray[Any]:
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
