"""Metering where the lights of a run differ in spectrum, or where headlamps add to them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from blurnoise_eval.program.scenario import Metering, mean_light

Gains = Iterable[tuple[str, float, float, float]]


@dataclass(frozen=True)
class MeteringByLight(Metering):
    """Metering by what the camera has metered at each tested light.

    means: by illuminance in lux, the mean light of the pictures, a share of white as the base's ``illuminant`` would
    give it, so that spectra and headlamps are in it. Between tested lights the logarithms are interpolated, beyond
    them the mean of the nearest stays. ``mean_light`` is the mean of these.

    >>> from blurnoise import Camera
    >>> camera = Camera.preset("imx250")
    >>> lamps = MeteringByLight(camera, 0.3, means={1.0: 0.8, 100.0: 0.2})  # at 1 lux headlamps add to the light
    >>> round(lamps.total_s(1.0) / Metering(camera, 0.2).total_s(1.0), 3)
    0.25
    """

    means: Mapping[float, float] = field(default_factory=dict)

    @classmethod
    def of(cls, gains: Gains, base: Metering) -> Self | None:
        """That of a run, by :func:`~.scenario.mean_light` of each light; None where all gains are at a limit."""
        rows: dict[float, list[tuple[str, float, float, float]]] = {}
        for row in gains:
            rows.setdefault(row[1], []).append(row)
        found = {lux: mean_light(rows[lux], base.camera, base.illuminant) for lux in sorted(rows) if lux}
        means = {lux: mean for lux, mean in found.items() if mean is not None}
        if not means:
            return None
        mean = float(np.exp(np.mean(np.log(list(means.values())))))
        return cls(base.camera, mean, base.temperature_c, base.illuminant, means)

    def at(self, illuminance_lux: float) -> Metering:
        """The metering of pictures as bright as those at this light."""
        logs = np.log(list(self.means)), np.log(list(self.means.values()))
        mean = float(np.exp(np.interp(np.log(illuminance_lux), *logs)))
        return Metering(self.camera, mean, self.temperature_c, self.illuminant)

    def total_s(self, illuminance_lux: float) -> float:
        """As the base's, by the pictures at this light."""
        return self.at(illuminance_lux).total_s(illuminance_lux)

    def gain_db(self, illuminance_lux: float, exposure_s: float) -> float:
        """As the base's, by the pictures at this light."""
        return self.at(illuminance_lux).gain_db(illuminance_lux, exposure_s)

    def lux_at(self, exposure_s: float) -> float:
        """As the base's, in light of the brightest tested kind: this is asked of brighter light."""
        return self.at(max(self.means)).lux_at(exposure_s)

    @property
    def pictures(self) -> str:
        """As the base's, at each tested light."""
        shares = ", ".join(f"{100 * mean:.3g} % at {lux:.6g} lux" for lux, mean in self.means.items())
        name = self.illuminant if isinstance(self.illuminant, str) else "the run's own spectrum"
        return f"the pictures have {shares} of white in {name} on average, headlamps included"
