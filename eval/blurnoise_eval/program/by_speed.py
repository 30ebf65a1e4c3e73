"""Scores where light times exposure and motion in px do not decide what a picture looks like.

Domain: lux, s, px/s; places in stops. At one speed, the light and the exposure together always decide it: a rolling
shutter skews a picture by the speed, dark charge grows with the time. So each speed has a surface of its own, over
light x exposure and exposure, through everything that was measured at this speed. Between the exposures of one light
it interpolates over the logarithm of the exposure, between lights over that of the light. Lights may differ in kind,
by spectrum or headlamps, as a street at night and daylight do: between these it is a transition from one to the
other, and no light that exists needs to have the scores there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.plane import places_of
from blurnoise_eval.answers.table import ScoreTable, same_rows
from blurnoise_eval.plan.axes import EGO, EXPOSURE, LIGHT
from blurnoise_eval.run.surface import Predicted, Trend
from blurnoise_eval.scoring.uncertainty import ratio_of_sums

PX_S_PER_KMH = 10.0
"""Motion that guides the surface of a driving camera: a sign 5 m beside and 12.5 m ahead, in 1280 px over 60 degrees,
moves by 1000 px/s at 100 km/h (``blurnoise motion``). Scores that were measured correct it."""
_LOCAL = 0.4
"""Deviation of a predicted score beside the spread of the scores that it is predicted from, both as shares of the
surface's scale. Chosen on runs of imx477, imx219, ar0132c and the usual lights, 20 rendered pictures: with it 93 to
100 % of their held-back scores lie within the 95 % interval, kept exposures being 1 to 2.5 stops apart."""
_LEAST_SPREAD = 0.03  # below it scores differ by their noise
_SLOW_PX_S = 1e-3  # stands for a speed of 0, which has no logarithm: no exposure blurs by it
Array = NDArray[np.float64]


def places_at(exposures_s: ArrayLike, illuminance_lux: ArrayLike, speed_px_s: float) -> Array:
    """(N, 2) of N exposures at one speed: log2 of lux s, and of the motion in px without a least one.

    Unlike :func:`blurnoise_eval.answers.plane.places_of`, short exposures and pictures at rest have places of their
    own.

    >>> places_at([0.01, 0.01], [100.0, 200.0], 400.0).round(6).tolist()
    [[0.0, 2.0], [1.0, 2.0]]
    """
    exposures = np.log2(np.asarray(exposures_s, float))
    light = exposures + np.log2(np.asarray(illuminance_lux, float))
    motion = exposures + np.log2(max(speed_px_s, _SLOW_PX_S))
    return np.stack(np.broadcast_arrays(light, motion), axis=-1)


@dataclass(frozen=True, eq=False)
class OnPlane:
    """One surface for all speeds, where light times exposure and motion in px decide what a picture looks like."""

    plane: Predicted

    def surface(self, speed: float) -> Predicted:
        """That of any speed."""
        return self.plane

    def places(self, exposures_s: ArrayLike, illuminance_lux: ArrayLike, speed: float) -> Array:
        """(N, 2) of N exposures at a speed, px/s."""
        return places_of(exposures_s, illuminance_lux, speed)

    def parts(self, speeds: Iterable[float]) -> Iterator[tuple[Predicted, list[int]]]:
        """The surface, with the numbers of all these speeds."""
        yield self.plane, [*range(len(list(speeds)))]

    def covariance(self, surface: Predicted, places: Array) -> Array:
        """Covariance (M, M) of a surface's prediction at places (M, 2)."""
        return surface.surface.covariance(places)


@dataclass(frozen=True, eq=False)
class BySpeed:
    """The surfaces of one kind of target by speed; speeds in px/s, or in km/h where the camera drives.

    px_s: of one unit of speed.
    """

    surfaces: Mapping[float, Predicted]
    px_s: float = 1.0

    @classmethod
    def of(cls, table: ScoreTable, trend: Trend) -> BySpeed:
        """Those of a table, of which one speed in several directions is their mean; conditions without light are
        left out."""
        driving = bool((table.conditions[EGO.name] > 0).any())
        px_s = PX_S_PER_KMH if driving else 1.0
        lit = table.take(table.measured & (table.conditions[LIGHT.name] > 0))
        speeds = speeds_of(lit)
        surfaces = {}
        for speed in np.unique(speeds).tolist():
            own = lit.take(speeds == speed)
            own = own.merged(
                same_rows([own.conditions[name] for name in (LIGHT.name, EXPOSURE.name)], len(own))
            )
            lights, exposures = own.conditions[LIGHT.name], own.conditions[EXPOSURE.name]
            surfaces[speed] = Predicted(own, trend, places_at(exposures, lights, px_s * speed))
        return cls(surfaces, px_s)

    @property
    def clusters(self) -> tuple[str, ...]:
        """Those of every surface."""
        return next(iter(self.surfaces.values())).clusters

    @property
    def most(self) -> float:
        """The greatest value of a mean."""
        return next(iter(self.surfaces.values())).most

    def surface(self, speed: float) -> Predicted:
        """That of a speed. Raises ``ValueError`` for one that was not tested."""
        if speed not in self.surfaces:
            tested = ", ".join(f"{each:g}" for each in self.surfaces)
            raise ValueError(
                f"speeds = {speed:g}: was not tested; must be one of {tested}, because this run shows no scores "
                "between its speeds"
            )
        return self.surfaces[speed]

    def places(self, exposures_s: ArrayLike, illuminance_lux: ArrayLike, speed: float) -> Array:
        """(N, 2) of N exposures on the surface of a speed."""
        return places_at(exposures_s, illuminance_lux, self.px_s * speed)

    def parts(self, speeds: Iterable[float]) -> Iterator[tuple[Predicted, list[int]]]:
        """The surfaces of these speeds, each with the numbers of the speeds that it predicts."""
        for number, speed in enumerate(speeds):
            yield self.surface(speed), [number]

    def covariance(self, surface: Predicted, places: Array) -> Array:
        """Covariance (M, M) of a surface's prediction at places (M, 2)."""
        # The surface has one scale for all of its places. Lights of several kinds have a wide plateau beside cliffs:
        # the error is small on the one and large on the other, as is the spread of the scores around.
        fitted = surface.surface
        weights = np.abs(fitted.weights(places))
        squares = (fitted.values - ratio_of_sums(*surface.on(places))[:, None]) ** 2
        spread = np.sqrt((weights * squares).sum(axis=1) / weights.sum(axis=1))
        local = _LOCAL * np.maximum(spread, _LEAST_SPREAD) / fitted.scale
        return np.asarray(fitted.covariance(places) * np.outer(local, local))


def speeds_of(table: ScoreTable) -> Array:
    """(N,) speeds of conditions: px/s, or km/h where the camera drives."""
    driven = table.conditions[EGO.name]
    return np.asarray((driven / EGO.per_option).round(9)) if (driven > 0).any() else table.speeds_px_s
