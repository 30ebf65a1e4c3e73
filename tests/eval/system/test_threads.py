"""Thread settings last as long as their block."""

from __future__ import annotations

import cv2
import torch
from blurnoise_eval.system.machine import limited_threads


def settings() -> tuple[int, int]:
    return torch.get_num_threads(), cv2.getNumThreads()


def test_settings_hold_inside_and_come_back() -> None:
    before = settings()
    with limited_threads(before[0] + 1):
        assert settings() == (before[0] + 1, before[0] + 1)
        with limited_threads(1):
            assert settings() == (1, 1)
        assert settings() == (before[0] + 1, before[0] + 1)
    assert settings() == before
