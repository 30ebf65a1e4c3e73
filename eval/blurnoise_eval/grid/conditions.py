"""What a sweep computes, as plain descriptors: conditions, their grid, and cells.

A cell (picture, repeat, conditions, seed) says all that a worker needs. Conditions of one picture and repeat
share their seed, so they see the same noise field and differ by physics, not by luck (common random numbers).
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from blurnoise._core.checks import in_range, non_negative, positive


@dataclass(frozen=True)
class Conditions:
    """Exposure s, scene illuminance lux, velocity px/s (x right, y down)."""

    exposure_s: float
    illuminance_lux: float
    velocity_x_px_s: float
    velocity_y_px_s: float

    @property
    def displacement_px(self) -> tuple[float, float]:
        """Motion during the exposure, px, in single precision as :func:`blurnoise.simulate` computes it."""
        exposure_s = np.float32(self.exposure_s)
        return (
            float(np.float32(self.velocity_x_px_s) * exposure_s),
            float(np.float32(self.velocity_y_px_s) * exposure_s),
        )

    @property
    def blur_px(self) -> float:
        """Length of the motion blur, px."""
        return float(np.hypot(self.velocity_x_px_s, self.velocity_y_px_s) * self.exposure_s)


@dataclass(frozen=True)
class Plan:
    """What a sweep computes. Grids in s, lux, px/s; ``repeats`` noise fields per picture; base ``seed``.

    Raises ``ValueError`` for an empty grid, an exposure that is not > 0, or a value that is not finite.
    """

    exposures_s: tuple[float, ...]
    illuminances_lux: tuple[float, ...]
    velocities_x_px_s: tuple[float, ...] = (0.0,)
    velocities_y_px_s: tuple[float, ...] = (0.0,)
    repeats: int = 1
    seed: int = 0
    temperature_c: float = 25.0
    examples: bool = True

    def __post_init__(self) -> None:
        for name in ("exposures_s", "illuminances_lux", "velocities_x_px_s", "velocities_y_px_s"):
            values = getattr(self, name)
            if not values:
                raise ValueError(f"{name}: must hold at least one value")
            object.__setattr__(self, name, tuple(sorted({float(value) + 0.0 for value in values})))  # no -0.0
        for exposure in self.exposures_s:
            positive("exposure_s", exposure)
        for lux in self.illuminances_lux:
            non_negative("illuminance_lux", lux)
        for velocity in (*self.velocities_x_px_s, *self.velocities_y_px_s):
            if not np.isfinite(velocity):
                raise ValueError(f"velocity_px_s = {velocity!r}: must be finite")
        in_range("temperature_c", self.temperature_c, -273.15, 300.0)
        if self.repeats < 1 or self.seed < 0:
            raise ValueError(f"repeats = {self.repeats}, seed = {self.seed}: must be >= 1 and >= 0")

    def conditions(self) -> list[Conditions]:
        """Every combination, those of one displacement next to each other."""
        grid = [
            Conditions(exposure, lux, vx, vy)
            for exposure in self.exposures_s
            for lux in self.illuminances_lux
            for vx in self.velocities_x_px_s
            for vy in self.velocities_y_px_s
        ]
        return sorted(grid, key=lambda at: (at.displacement_px, at.exposure_s, at.illuminance_lux))

    def example_conditions(self) -> set[Conditions]:
        """A few conditions whose pictures are kept: the middle light, exposures and speeds from end to end."""
        lux = self.illuminances_lux[len(self.illuminances_lux) // 2]
        exposures = {
            self.exposures_s[round(share * (len(self.exposures_s) - 1))] for share in (0, 1 / 3, 2 / 3, 1)
        }
        by_speed = sorted(
            ((vx, vy) for vx in self.velocities_x_px_s for vy in self.velocities_y_px_s),
            key=lambda velocity: np.hypot(*velocity),
        )
        speeds = {by_speed[0], by_speed[len(by_speed) // 2], by_speed[-1]}
        return {Conditions(exposure, lux, *velocity) for exposure in exposures for velocity in speeds}

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Cell:
    """One picture under one condition; None is the clean picture, untouched."""

    image: str
    repeat: int
    conditions: Conditions | None
    seed: int

    @property
    def cell_id(self) -> str:
        """A name made of everything that sets the cell apart within its run."""
        text = repr((self.image, self.repeat, self.conditions))
        return hashlib.blake2b(text.encode(), digest_size=10).hexdigest()

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for a worker elsewhere; :meth:`from_dict` reads them."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Cell:
        """The cell of :meth:`to_dict`."""
        at = values["conditions"]
        return cls(**{**values, "conditions": None if at is None else Conditions(**at)})


def cell_seed(base_seed: int, image: str, repeat: int) -> int:
    """The seed of a picture's noise field: a hash, so that neither order nor number of pictures matters."""
    digest = hashlib.blake2b(repr((base_seed, image, repeat)).encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") >> 1
