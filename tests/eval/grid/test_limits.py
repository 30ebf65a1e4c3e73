"""Limits of the axes are the simulator's."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from blurnoise_eval.grid.axes import AXES, Axis

from blurnoise import Camera, Exposure
from blurnoise._core.checks import LIMITS
from blurnoise.scene.exposure import MOVES

IMX250 = Camera.preset("imx250")


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: axis.name)
def test_the_axes_limits_are_the_simulators(axis: Axis) -> None:
    name = axis.into.removeprefix("camera.").partition(".")[0]
    if axis.choices:
        assert axis.choices == MOVES
        assert (axis.low, axis.high) == (0, len(MOVES) - 1)
    elif name in LIMITS:  # a figure of the camera may have its range on the field itself
        assert (axis.low, axis.high) == LIMITS[name][:2]
        return
    for end in (axis.low, axis.high):
        if axis.into.startswith("camera."):
            replace(IMX250, **{name: end})
        else:
            value: Any = axis.choices[int(end)] if axis.choices else end
            Exposure(IMX250, 0.01, 50.0, **{name: value})
