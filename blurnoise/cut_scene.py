"""Cut scenes: pictures whose objects are told apart from their background, so that either may move without the other.

Convention: ``Exposure.moves`` says what has the exposure's velocity. "all": the picture, as a camera that turns sees
it. "targets": the objects, before what is still. "background": all else, behind objects that the camera tracks. An
object's speed is a multiple of that velocity, 1 unless stated: where the camera tracks those of speed 1, one of speed
s is left with 1 - s, so that one that stands moves with the background.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from blurnoise.exposure import ExposedScene, Exposure
from blurnoise.layers import Layer, seen_behind
from blurnoise.mattes import Cut


class CutScene(ExposedScene):
    """A picture, its objects cut out. speeds: one for each layer of the cut. options: as of ``ExposedScene``.

    Raises ``ValueError`` for another number of speeds.
    """

    def __init__(self, cut: Cut, speeds: Sequence[float] | None = None, **options: Any) -> None:
        super().__init__(cut.background, layers=cut.layers, **options)
        self._cut = cut
        self._speeds = (1.0,) * len(cut.layers) if speeds is None else tuple(speeds)
        if len(self._speeds) != len(cut.layers):
            raise ValueError(f"speeds: {len(self._speeds)}; must be {len(cut.layers)}, one for each layer")
        self._shares: dict[tuple[float, float], tuple[float, ...]] = {}
        self._shares_lock = threading.Lock()

    def invented(self, exposure: Exposure) -> tuple[float, ...]:
        """Of each object: how much of what it hides at mid-exposure is seen in the course of it, as a share, where
        that had to be invented; 0 where it is known.

        What the object moves against its background decides, whichever of the two moves.
        """
        if exposure.moves == "all" or not self._cut.invented.any():
            return (0.0,) * len(self._cut.layers)
        x, y = (along * exposure.exposure_s for along in exposure.velocity_px_s)
        with self._shares_lock:
            if (x, y) not in self._shares:
                each = zip(self._cut.layers, self._speeds, strict=True)
                self._shares[x, y] = tuple(_seen(layer, (s * x, s * y)) for layer, s in each)
            return self._shares[x, y]

    def _velocity(self, exposure: Exposure) -> tuple[float, float]:
        return (0.0, 0.0) if exposure.moves == "targets" else exposure.velocity_px_s

    def _objects(self, exposure: Exposure) -> tuple[Layer, ...]:
        moving = (exposure.of_targets(speed).velocity_px_s for speed in self._speeds)
        return tuple(
            replace(layer, velocity_px_s=velocity)
            for layer, velocity in zip(self._cut.layers, moving, strict=True)
        )


def _seen(layer: Layer, displacement_px: tuple[float, float]) -> float:
    return seen_behind(layer, displacement_px) if any(displacement_px) else 0.0
