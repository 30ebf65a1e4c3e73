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
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.plane import places_of
from blurnoise_eval.answers.table import ScoreTable, same_rows
from blurnoise_eval.plan.axes import EGO, EXPOSURE, LIGHT, LIT
from blurnoise_eval.program.held_back import (
    LEAST,
    UNKNOWN,
    HeldBack,
    can_be_held_back,
    hold_back,
    spread_around,
)
from blurnoise_eval.run.surface import CAUTION, Predicted, Trend
from blurnoise_eval.scoring.uncertainty import ratio_of_sums

PX_S_PER_KMH = 10.0
"""Motion that guides the surface of a driving camera: a sign 5 m beside and 12.5 m ahead, in 1280 px over 60 degrees,
moves by 1000 px/s at 100 km/h (``blurnoise motion``). Scores that were measured correct it."""
ALIKE_STOPS = 0.1
"""Lights, exposures and speeds that are nearer show one score twice, and nothing of what lies between others."""
_DIGITS = 9  # of a light in lux
_SAME = 1e-6  # a share of a light by which it is another
_LEAST_VARIANCE = 1e-18  # of a surface, beside which that at its nodes is a rounding error
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

    def covariance(self, speed: float, places: Array) -> Array:
        """Covariance (M, M) of the prediction at places (M, 2), with ``CAUTION`` times its standard error."""
        return CAUTION**2 * self.plane.surface.covariance(places)


class AtSpeed(Predicted):
    """The surface of one speed, px/s, through everything that was measured at it under light."""

    def __init__(self, table: ScoreTable, trend: Trend, speed_px_s: float) -> None:
        lights, exposures = table.conditions[LIGHT.name], table.conditions[EXPOSURE.name]
        super().__init__(table, trend, places_at(exposures, lights, speed_px_s))
        self._speed_px_s = speed_px_s

    def lights(self, places: Array) -> Array:
        """Of places (M, 2), lux (M,)."""
        return np.asarray(np.exp2(places[:, 0] - places[:, 1]) * max(self._speed_px_s, _SLOW_PX_S))

    def exposures_s(self, places: Array) -> Array:
        """Of places (M, 2), (M,)."""
        return np.asarray(np.exp2(places[:, 1]) / max(self._speed_px_s, _SLOW_PX_S))


@dataclass(frozen=True, eq=False)
class BySpeed:
    """The surfaces of one kind of target by speed; speeds in px/s, or in km/h where the camera drives.

    px_s: of one unit of speed. kinds: what each tested light, lux, is by its spectrum and headlamps, from dark to
    bright.
    """

    surfaces: Mapping[float, AtSpeed]
    kinds: Mapping[float, tuple[float, ...]]
    px_s: float = 1.0

    @classmethod
    def of(cls, table: ScoreTable, trend: Trend) -> BySpeed:
        """Those of a table, of which one speed in several directions is their mean; conditions without light are
        left out."""
        driving = bool((table.conditions[EGO.name] > 0).any())
        px_s = PX_S_PER_KMH if driving else 1.0
        lit = _distinct(table.take(table.measured & (table.conditions[LIGHT.name] > 0)))
        speeds = speeds_of(lit)
        surfaces = {}
        for speed in np.unique(speeds).tolist():
            own = lit.take(speeds == speed)
            own = own.merged(
                same_rows([own.conditions[name] for name in (LIGHT.name, EXPOSURE.name)], len(own))
            )
            surfaces[speed] = AtSpeed(own, trend, px_s * speed)
        columns = [lit.conditions[name] for name in (LIGHT.name, *LIT)]
        kinds = {
            light: tuple(kind)
            for light, *kind in sorted(zip(*(each.tolist() for each in columns), strict=True))
        }
        return cls(surfaces, kinds, px_s)

    @property
    def clusters(self) -> tuple[str, ...]:
        """Those of every surface."""
        return next(iter(self.surfaces.values())).clusters

    @property
    def most(self) -> float:
        """The greatest value of a mean."""
        return next(iter(self.surfaces.values())).most

    def surface(self, speed: float) -> AtSpeed:
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

    def parts(self, speeds: Iterable[float]) -> Iterator[tuple[AtSpeed, list[int]]]:
        """The surfaces of these speeds, each with the numbers of the speeds that it predicts."""
        for number, speed in enumerate(speeds):
            yield self.surface(speed), [number]

    @cached_property
    def held_back(self) -> HeldBack:
        """What is held back at all speeds that differ."""
        differ = np.unique(stand_ins([*self.surfaces])).tolist()
        lit = [(each.surface, each.lights(each.places)) for each in map(self.surface, differ)]
        return hold_back(lit, can_be_held_back(self.kinds))

    @cached_property
    def unknown(self) -> list[tuple[float, float]]:
        """Lights, lux, that follow each other and between which nothing shows how wrong a surface is: neither lies
        between two lights of its kind, as one must to be held back, or too few were held back over such a gap."""
        known, errors = {*can_be_held_back(self.kinds)}, self.held_back.lights
        return [
            (dark, bright)
            for dark, bright in pairwise(self.kinds)
            if not {dark, bright} & known or errors.number(np.log2(bright / dark)) < LEAST
        ]

    @cached_property
    def unknown_s(self) -> list[tuple[float, float]]:
        """Exposures, s, that follow each other at a light and between which too few were held back, rising."""
        found = set()
        for surface in self.surfaces.values():
            light, exposures = surface.lights(surface.places), surface.exposures_s(surface.places)
            for lux in np.unique(light.round(_DIGITS)):
                found |= {*pairwise(np.sort(exposures[np.isclose(light, lux)]).tolist())}
        return sorted(
            (short, long)
            for short, long in found
            if self.held_back.exposures.number(np.log2(long / short)) < LEAST
        )

    def covariance(self, speed: float, places: Array) -> Array:
        """Covariance (M, M) of the prediction at places (M, 2) of a speed: as wide as what was held back is wrong by,
        and as the scores around differ where too little was."""
        surface = self.surface(speed)
        # The surface has one scale for all of its places. Lights of several kinds have a wide plateau beside cliffs:
        # the error is small on the one and large on the other, as is the spread of the scores around.
        fitted, lights = surface.surface, surface.lights(places)
        share = self.held_back.shares_at(places, fitted.places)
        for dark, bright in self.unknown:
            within = (lights > dark * (1 + _SAME)) & (lights < bright * (1 - _SAME))
            share[within] = np.maximum(share[within], UNKNOWN)
        sigma = share * spread_around(fitted, places, ratio_of_sums(*surface.on(places)))
        covariance = fitted.covariance(places)
        # At a node both are 0, but for rounding.
        own = np.sqrt(np.maximum(np.diag(covariance), _LEAST_VARIANCE))
        return np.asarray(covariance * np.outer(sigma / own, sigma / own))


def stand_ins(values: ArrayLike) -> Array:
    """(N,) for each the least of those that are alike, within a tenth of a stop.

    >>> stand_ins([100.0, 100.01, 200.0, 0.0]).tolist()
    [100.0, 100.0, 200.0, 0.0]
    """
    rising, which = np.unique(np.asarray(values, float), return_inverse=True)
    stand_in = [rising[0]]
    for value in rising[1:]:
        alike = value <= stand_in[-1] * 2**ALIKE_STOPS
        stand_in.append(stand_in[-1] if alike else value)
    return np.array(stand_in)[which]


def _distinct(table: ScoreTable) -> ScoreTable:
    """A table with lights and exposures that are :func:`stand_ins`, of lights those of a kind."""
    lights = table.conditions[LIGHT.name].copy()
    kinds = same_rows([table.conditions[name] for name in LIT], len(table))
    for kind in np.unique(kinds):
        lights[kinds == kind] = stand_ins(lights[kinds == kind])
    exposures = stand_ins(table.conditions[EXPOSURE.name])
    return replace(table, conditions={**table.conditions, LIGHT.name: lights, EXPOSURE.name: exposures})


def speeds_of(table: ScoreTable) -> Array:
    """(N,) speeds of conditions: px/s, or km/h where the camera drives."""
    driven = table.conditions[EGO.name]
    return np.asarray((driven / EGO.per_option).round(9)) if (driven > 0).any() else table.speeds_px_s
