"""The outlook of a search: what a model may reach under conditions that were not measured, and which to measure next.

Domain: N lines, each a light, speed and whatever else a grid combines, at E exposures, s; scores in the criterion's
unit. A cell (n, e) is a condition of the grid, by its line and exposure.

Conditions that are surely easier or harder bracket a cell (:class:`~.bracketing.Order`). Where the bracket is narrow
the cell need not be measured for an exposure of several conditions. Else a surface through the measured cells
(:class:`~.surface.Kriging`) says where to measure next, and what the rest may gain at most: beside a cliff, as where
white saturates, it errs by .1 and more.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from blurnoise.camera import Camera
from blurnoise_eval.answers.bracketing import Order
from blurnoise_eval.answers.choosing import best_exposure, without_saturated
from blurnoise_eval.answers.plane import DIGITS
from blurnoise_eval.answers.recommendation import Averages, Setting, Velocity
from blurnoise_eval.answers.settling import SETTLED
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.run.grid_cells import Array, Cells, Flags, Places
from blurnoise_eval.run.surface import Kriging, Trend, correlation

Cell = tuple[int, int]
ALIKE = 0.02
"""A cell whose bracket is no wider is known to its middle, for exposures of several conditions. Chosen: below
``SETTLED``, and as much as scores break the order of conditions by."""


class Promise(NamedTuple):
    """How much more than the best known exposure another one may reach under some conditions, and the cell to measure
    to know."""

    gain: float
    cell: Cell


class Outlook:
    """What one model may reach at cells that were not measured.

    measured: the model's averages over what was. ceiling: its score on the original pictures, which simulated ones
    may reach and hardly surpass. trend: guides the surface.
    """

    def __init__(self, measured: Averages, cells: Cells, ceiling: float, trend: Trend) -> None:
        self._cells = cells
        value, saturated = np.full((2, *cells.shape), np.nan)
        at = cells.lines(measured.settings, measured.velocities_px_s)
        columns = np.searchsorted(cells.exposures_s, measured.exposures_s)
        value[np.ix_(at, columns)], saturated[np.ix_(at, columns)] = measured.value, measured.saturated
        self.measured, self._rows = measured, np.ix_(at, columns)
        self._value, self._known = value, np.isfinite(value)
        surface = Kriging.fit(cells.places[self._known], value[self._known], trend)
        flat = cells.places.reshape(-1, cells.places.shape[-1])
        self._surface, self._sigma = (of(flat).reshape(cells.shape) for of in (surface.mean, surface.sigma))
        self._order = Order.of(cells.settings, cells.velocities_px_s, monotone=cells.monotone)
        self._ceiling = max(ceiling, float(np.nanmax(value)))
        self._saturated = self._shares(saturated)
        self._of = replace(
            measured,
            settings=cells.settings,
            velocities_px_s=cells.velocities_px_s,
            exposures_s=cells.exposures_s,
            of_grid=cells.of_grid,
        )
        self._places, self._lengths = flat, surface.lengths
        self._bracket()
        self._scopes = [np.array(scope.members) for scope in self._of.scopes()]
        self._promises: dict[int, Promise | None] = {}

    def promise(self, chosen: Sequence[Cell] = ()) -> Promise | None:
        """That of the conditions, of those for which an exposure is recommended, where most is to gain; None where
        nothing is: there the best exposures are measured, and no other may gain more than ``SETTLED``.

        chosen: cells of a batch; their lines promise nothing before these are measured."""
        for index, members in enumerate(self._scopes):
            if index not in self._promises:
                self._promises[index] = self._promise(members)
        busy = {n for n, _ in chosen}
        return _greatest(each for each in self._promises.values() if each and each.cell[0] not in busy)

    def untested_gain(
        self, settings: Sequence[Setting], velocities_px_s: Sequence[Velocity], exposure_s: float
    ) -> float | None:
        """What an exposure that was not measured may gain at most over one that was; None where all were. Means over
        the conditions of these settings and velocities, (N,)."""
        members = self._cells.lines(settings, velocities_px_s)
        place = self._cells.exposures_s.index(exposure_s)
        _, value, _ = self._line(self._mean, self._saturated, members)
        _, may, measured = self._line(self._upper, self._least_saturated, members)
        untested = np.isfinite(may) & ~measured
        return float(may[untested].max() - value[place]) if untested.any() else None

    def suppose(self, cell: Cell) -> None:
        """Take a cell for measured, as the surface has it."""
        self._value[cell], self._known[cell] = self._mean[cell], True
        near = correlation(self._places, self._cells.places[cell][None], self._lengths).reshape(
            self._sigma.shape
        )
        self._sigma *= np.sqrt(1 - near**2)  # as of one neighbour alone
        self._bracket()
        self._promises.clear()

    @property
    def bracketed(self) -> Averages:
        """What was measured, and beside it the cells of the same lines and exposures that are known by brackets. What
        pictures differ by is there that of the comparable measured cell with the nearest score."""
        of, known, alike = self.measured, self._known[self._rows], self._alike[self._rows]
        value, half = (np.where(alike, each[self._rows], np.nan) for each in (self._mean, self._half))
        influence, effective = of.influence.copy(), of.effective.copy()
        order = self._order.brighter[np.ix_(*[self._rows[0].ravel()] * 2)]
        for n, e in np.argwhere(alike & ~known).tolist():
            comparable = known & (order | order.T)[n][:, None]
            away = np.where(comparable, np.abs(of.value - value[n, e]), np.inf)
            m, at = divmod(int(away.argmin()), away.shape[1])
            influence[:, n, e], effective[n, e] = of.influence[:, m, at], of.effective[m, at]
        return replace(
            of,
            value=value,
            influence=influence,
            effective=effective,
            sigma=np.where(known, of.sigma, half),
            saturated=np.where(alike, self._saturated[self._rows], np.nan),
        )

    def _bracket(self) -> None:
        """What is known of each cell: by itself, by others that are surely easier or harder, and by the surface."""
        most, least = self._order.bounds(self._value, np.where(self._known, self._saturated, np.nan))
        self._bound = np.minimum(most, self._ceiling)
        least = np.minimum(least, self._bound)
        self._half = (self._bound - least) / 2
        self._alike = self._known | (2 * self._half <= ALIKE)
        mean = np.where(self._alike, least + self._half, np.clip(self._surface, least, self._bound))
        self._mean = np.where(self._known, self._value, mean)
        self._upper = self._bounds()

    def _promise(self, members: Places) -> Promise | None:
        """The unmeasured exposure that may gain most over the one that seems best; where none may gain more than
        ``SETTLED``, the one that seems best, unless it is measured."""
        at, value, known = self._line(self._mean, self._saturated, members)
        best = best_exposure(self._of.exposures_s, value + SETTLED * known) or 0
        others, may, measured = self._line(self._upper, self._least_saturated, members)
        may = np.where(np.isfinite(may) & ~measured, may, -np.inf)
        may[best] = -np.inf
        e = int(np.argmax(may.round(DIGITS)))
        gain = float(may[e] - np.nanmax(value))
        if gain <= SETTLED:
            if known[best]:
                return None
            # An exposure for many conditions serves each of them: the most conditions first.
            others, e, gain = at, best, SETTLED * (1 + 1e-3 * len(members))
        doubt = (self._sigma + self._saturated - self._least_saturated)[:, e].round(DIGITS)
        known = self._known_for(members)
        unknown = [n for n in others[:, e].tolist() if not known[n, e]]
        return Promise(gain, (max(unknown, key=doubt.__getitem__), e))

    def _line(self, value: Array, saturated: Array, members: Places) -> tuple[Places, Array, Flags]:
        """As :meth:`Averages.line`, NaN at exposures that may not be used, and at which all of it is known, (E,).

        An exposure for everything may lie between those of the grid, too."""
        at, mean, share = replace(self._of, value=value, saturated=saturated).line(members)
        known = np.take_along_axis(self._known_for(members), at, axis=0).all(axis=0)
        allowed = self._cells.of_grid | known | (len(members) == len(self._mean))
        mean = without_saturated(np.where(allowed, mean, np.nan), share, self._of.level)
        return at, mean, np.asarray(known)

    def _known_for(self, members: Places) -> Flags:
        """(N, E), the cells that need not be measured. An exposure of one condition is measured there."""
        return np.asarray(self._alike if len(members) > 1 else self._known)

    def _bounds(self) -> Array:
        """(N, E), what each cell may reach. Beside the best measured exposure of a line the next ones of the grid are
        not known before they are measured, whatever the surface says."""
        upper = np.where(self._alike, self._mean, np.minimum(self._mean + self._sigma, self._bound))
        tested = np.flatnonzero(self._cells.of_grid)
        best = np.where(self._known, self._mean, -1.0).argmax(axis=1)
        for n in np.flatnonzero(self._known.any(axis=1)):
            beside = [*tested[tested < best[n]][-1:], *tested[tested > best[n]][:1]]
            unknown = [e for e in beside if not self._alike[n, e]]
            upper[n, unknown] = self._bound[n, unknown]
        return upper

    def _shares(self, saturated: Array) -> Array:
        """(N, E), of saturated values: between those measured, by the light on the sensor; 0 where none is known."""
        light, known = self._cells.places[..., 0], np.isfinite(saturated)
        if not known.any():
            return np.zeros_like(saturated)
        lights, which = np.unique(light[known].round(DIGITS), return_inverse=True)
        shares = np.bincount(which, saturated[known]) / np.bincount(which)
        return np.where(known, saturated, np.interp(light, lights, shares))

    @property
    def _least_saturated(self) -> Array:
        """(N, E) shares that longer exposures surely have: those of shorter ones in the same light."""
        known = np.where(self._known, self._saturated, 0.0)
        least = np.empty_like(known)
        for light in np.unique(self._cells.lights):
            lit = self._cells.lights == light
            least[lit] = np.maximum.accumulate(known[lit].max(axis=0))
        return np.where(self._known, self._saturated, np.minimum(least, self._saturated))


def most_promising(outlooks: Sequence[Outlook], count: int) -> list[Cell]:
    """At most ``count`` cells to measure next, of different lines, until nothing is to gain: each is the one that may
    gain most, with those before it taken for measured."""
    chosen: list[Cell] = []
    while len(chosen) < count and (best := _greatest(outlook.promise(chosen) for outlook in outlooks)):
        chosen.append(best.cell)
        for outlook in outlooks:
            outlook.suppose(best.cell)
    return chosen


def _greatest(promises: Iterable[Promise | None]) -> Promise | None:
    return max((each for each in promises if each), key=lambda promise: promise.gain, default=None)


def outlooks(
    cells: Cells, camera: Camera, averages: Iterable[Averages], tables: Sequence[ScoreTable]
) -> list[Outlook]:
    """Of each model, by its averages over the tables of what was measured of the cells."""
    trend = Trend.of(camera)
    return [
        Outlook(of, cells, _ceiling([table for table in tables if table.model == of.model]), trend)
        for of in averages
    ]


def _ceiling(tables: Sequence[ScoreTable]) -> float:
    """The mean score on the original pictures, in the criterion's unit: what simulated ones hardly surpass."""
    return float(np.mean([1.0 if table.kept or table.clean is None else table.clean for table in tables]))
