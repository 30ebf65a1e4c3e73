"""Scenes whose objects are cut out, so that these and their background move each for themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

from torch import Tensor

from blurnoise.blur.layers import Layer, flattened, meeting, seen_behind
from blurnoise.scene.cutting import Cut
from blurnoise.scene.scene import ExposedScene, Exposure

_Motion = tuple[float, tuple[float, float]]
_NEAR_PX = 32  # between windows that are cheaper apart than as one


class CutScene(ExposedScene):
    """A picture, its objects cut out, so that either may move without the other, as ``Exposure.moves`` says.

    speeds, own_px_s: one for each layer of the cut, by default 1 and (0, 0). A speed is a multiple of the exposure's
    velocity: where the camera tracks objects of speed 1, one of speed s is left with 1 - s, so that one that stands
    moves with the background. own_px_s is beside that: with speed 0 it is what the object does against the
    background.
    """

    def __init__(
        self,
        cut: Cut,
        speeds: Sequence[float] | None = None,
        own_px_s: Sequence[tuple[float, float]] | None = None,
    ) -> None:
        count = len(cut.layers)
        factors = (1.0,) * count if speeds is None else speeds
        beside = ((0.0, 0.0),) * count if own_px_s is None else own_px_s
        self._cut = cut
        self._each = list(zip(cut.layers, zip(factors, beside, strict=True), strict=True))
        self._joined: list[tuple[Layer, _Motion]] = []  # those that move alike and are near each other as one
        for motion, alike in groupby(self._each, key=lambda each: each[1]):
            layers = [layer for layer, _ in alike]
            near = meeting([layer.window.grown(_NEAR_PX // 2, _NEAR_PX // 2) for layer in layers])
            self._joined += [(flattened([layers[place] for place in places]), motion) for _, places in near]
        super().__init__(cut.background, layers=tuple(layer for layer, _ in self._joined))
        self._shares: dict[tuple[float, ...], tuple[float, ...]] = {}

    def motions(self, exposure: Exposure) -> tuple[tuple[float, float] | Tensor, tuple[Layer, ...]]:
        """Velocity of the background and the layers, each with its own."""
        velocity, _ = super().motions(replace(exposure, moves="all"))
        objects = tuple(
            replace(layer, velocity_px_s=exposure.of_targets(*motion).velocity_px_s)
            for layer, motion in self._joined
        )
        return (0.0, 0.0) if exposure.moves == "targets" else velocity, objects

    def invented(self, exposure: Exposure) -> tuple[float, ...]:
        """Of each object: how much of what it hides at mid-exposure is seen in the course of it, as a share, where
        that had to be invented; 0 where it is known.

        It depends on the object's motion relative to its background, whichever of the two moves.
        """
        if exposure.moves == "all" or not self._cut.invented.any():
            return (0.0,) * len(self._each)

        def moved_px(motion: _Motion) -> tuple[float, float]:
            x, y = replace(exposure, moves="targets").of_targets(*motion).velocity_px_s
            return x * exposure.exposure_s, y * exposure.exposure_s

        key = (*exposure.velocity_px_s, exposure.exposure_s)
        if key not in self._shares:
            size = (self.light.shape[-2], self.light.shape[-1])
            movers = [(layer, moved_px(motion)) for layer, motion in self._joined]
            self._shares[key] = tuple(
                seen_behind(layer, movers, size) if any(moved_px(motion)) else 0.0
                for layer, motion in self._each
            )
        return self._shares[key]
