"""Limits: those of the axes are the simulator's, and a sweep beyond them is refused before it begins."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from blurnoise_eval.grid.axes import AXES, VELOCITY, Axis
from blurnoise_eval.grid.conditions import SweepPlan

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


@pytest.mark.parametrize("name", VELOCITY)
def test_motion_during_the_exposure_is_limited_before_anything_is_computed(name: str) -> None:
    with pytest.raises(ValueError, match=rf"{name}: 2e\+06 times exposure_s = 200000.0: .* <= 100000"):
        SweepPlan({"exposure_s": (0.01, 0.1), "illuminance_lux": (5.0,), name: (-2e6, 0.0)})
    SweepPlan({"exposure_s": (0.01, 0.05), "illuminance_lux": (5.0,), name: (-2e6, 0.0)})


@pytest.mark.parametrize("seed", [10**400, -1, 1.5, "1", None])
def test_seeds_have_63_bits(seed: object) -> None:
    with pytest.raises((TypeError, ValueError), match="seed = "):
        SweepPlan({"exposure_s": (0.01,), "illuminance_lux": (5.0,)}, seed=seed)  # type: ignore[arg-type]
