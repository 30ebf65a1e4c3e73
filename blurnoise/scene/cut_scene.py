"""Cut scenes: pictures whose objects are told apart from their background, so that either may move without the other.

Convention: ``Exposure.moves`` says what has the exposure's velocity. "all": the picture, as a camera that turns sees
it. "targets": the objects, before what is still. "background": all else, behind objects that the camera tracks. An
object's speed is a multiple of that velocity, 1 unless stated: where the camera tracks those of speed 1, one of speed
s is left with 1 - s, so that one that stands moves with the background. It may have a velocity of its own, px/s,
beside that: with speed 0 it is what the object does against the background.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

from torch import Tensor

from blurnoise.blur.layers import Layer, flattened, meeting, seen_behind, window_at_rest
from blurnoise.scene.cutting import Cut
from blurnoise.scene.scene import ExposedScene, Exposure

_Motion = tuple[float, tuple[float, float]]
_NEAR_PX = 32  # apart, from which on two windows take less than their hull


class CutScene(ExposedScene):
    """A picture, its objects cut out. speeds, own_px_s: one for each layer of the cut, by default 1 and (0, 0).

    options: as of ``ExposedScene``. Raises ``ValueError`` for another number of speeds or velocities.
    """

    def __init__(
        self,
        cut: Cut,
        speeds: Sequence[float] | None = None,
        own_px_s: Sequence[tuple[float, float]] | None = None,
        **options: Any,
    ) -> None:
        count = len(cut.layers)
        factors = (1.0,) * count if speeds is None else tuple(speeds)
        beside = ((0.0, 0.0),) * count if own_px_s is None else tuple(own_px_s)
        for name, given in (("speeds", factors), ("own_px_s", beside)):
            if len(given) != count:
                raise ValueError(f"{name}: {len(given)}; must be {count}, one for each layer")
        self._cut, self._cut_motions = cut, tuple(zip(factors, beside, strict=True))
        joined = [
            (layer, motion)
            for motion, alike in groupby(
                zip(cut.layers, self._cut_motions, strict=True), key=lambda each: each[1]
            )
            for layer in _joined([layer for layer, _ in alike])
        ]
        self._motions = tuple(motion for _, motion in joined)
        super().__init__(cut.background, layers=tuple(layer for layer, _ in joined), **options)
        self._shares: dict[tuple[float, ...], tuple[float, ...]] = {}
        self._shares_lock = threading.Lock()

    def invented(self, exposure: Exposure) -> tuple[float, ...]:
        """Of each object: how much of what it hides at mid-exposure is seen in the course of it, as a share, where
        that had to be invented; 0 where it is known.

        What the object moves against its background decides, whichever of the two moves.
        """
        if exposure.moves == "all" or not self._cut.invented.any():
            return (0.0,) * len(self._cut.layers)
        key = (*exposure.velocity_px_s, exposure.exposure_s)

        def moved_px(motion: _Motion) -> tuple[float, float]:
            speed, (own_x, own_y) = motion
            x, y = exposure.velocity_px_s
            return (speed * x + own_x) * exposure.exposure_s, (speed * y + own_y) * exposure.exposure_s

        with self._shares_lock:
            if key not in self._shares:
                movers = list(zip(self._layers[0], map(moved_px, self._motions), strict=True))
                own = zip(self._cut.layers, map(moved_px, self._cut_motions), strict=True)
                self._shares[key] = tuple(
                    seen_behind(layer, movers, self._size) if any(by) else 0.0 for layer, by in own
                )
            return self._shares[key]

    def _velocity(self, exposure: Exposure) -> tuple[float, float] | Tensor:
        if exposure.moves == "targets":
            return 0.0, 0.0
        return super()._velocity(replace(exposure, moves="all"))

    def _objects(self, exposure: Exposure) -> tuple[Layer, ...]:
        moving = (exposure.of_targets(*motion).velocity_px_s for motion in self._motions)
        return tuple(
            replace(layer, velocity_px_s=velocity)
            for layer, velocity in zip(self._layers[0], moving, strict=True)
        )


def _joined(layers: Sequence[Layer]) -> list[Layer]:
    """Layers that move alike, those that are near each other as one."""
    near = meeting([window_at_rest(layer).grown(_NEAR_PX // 2, _NEAR_PX // 2) for layer in layers])
    return [flattened([layers[place] for place in places]) for _, places in near]
