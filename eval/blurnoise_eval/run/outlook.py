"""The outlook of a search: what a model may reach under conditions that were not measured, and which to measure next.

Domain: N lines, each a light, speed and whatever else a grid combines, at E exposures, s; scores in the criterion's
unit. A cell (n, e) is a condition of the grid, by its line and exposure.

A surface through the measured cells (:class:`~.surface.Kriging`) says where to measure next, and what the rest may
gain at most: beside a cliff, as where white saturates, it errs by .1 and more. Scores are of measured cells only.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from blurnoise.camera import Camera
from blurnoise_eval.answers.choosing import best_exposure, without_saturated
from blurnoise_eval.answers.plane import DIGITS
from blurnoise_eval.answers.recommendation import Averages, Setting, Velocity
from blurnoise_eval.answers.settling import SETTLED
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.run.grid_cells import Array, Cells, Flags, Places
from blurnoise_eval.run.surface import Kriging, Trend, correlation

Cell = tuple[int, int]


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
        self._known = np.isfinite(value)
        surface = Kriging.fit(cells.places[self._known], value[self._known], trend)
        flat = cells.places.reshape(-1, cells.places.shape[-1])
        mean, sigma = (of(flat).reshape(cells.shape) for of in (surface.mean, surface.sigma))
        no_more = np.where(self._known, value, np.inf)  # than at rest, or more slowly
        no_less = np.where(self._known, value, 0.0)  # than faster
        most = np.where(cells.slower[:, :, None], no_more, np.inf).min(axis=1)
        least = np.where(cells.slower.T[:, :, None], no_less, 0.0).max(axis=1)
        self._bound = np.minimum(most, max(ceiling, float(np.nanmax(value))))
        self._mean = np.where(self._known, value, np.minimum(np.maximum(mean, least), self._bound))
        self._sigma = np.where(self._known, 0.0, sigma)
        self._saturated = self._shares(saturated)
        self._of = replace(
            measured,
            settings=cells.settings,
            velocities_px_s=cells.velocities_px_s,
            exposures_s=cells.exposures_s,
            of_grid=cells.of_grid,
        )
        self._places, self._lengths = flat, surface.lengths
        self._upper = self._bounds()
        self._scopes = [np.array(scope.members) for scope in self._of.scopes()]
        self._promises: dict[int, Promise | None] = {}

    def promise(self) -> Promise | None:
        """That of the conditions, of those for which an exposure is recommended, where most is to gain; None where
        nothing is: there the best exposures are measured, and no other may gain more than ``SETTLED``."""
        for index, members in enumerate(self._scopes):
            if index not in self._promises:
                self._promises[index] = self._promise(members)
        return _greatest(self._promises.values())

    def untested_gain(
        self, settings: Sequence[Setting], velocities_px_s: Sequence[Velocity], exposure_s: float
    ) -> float | None:
        """What an exposure that was not measured may gain at most over one that was; None where all were. Means over
        the conditions of these settings and velocities, (N,)."""
        members = self._cells.lines(settings, velocities_px_s)
        place = self._cells.exposures_s.index(exposure_s)
        _, value, _ = self._line(self._mean, self._saturated, members)
        _, may, measured = self._line(self._upper, self._least_saturated, members)
        untested = self._allowed(members, measured) & ~measured
        return float(may[untested].max() - value[place]) if untested.any() else None

    def suppose(self, cell: Cell) -> None:
        """Take a cell for measured, as the surface has it."""
        self._known[cell] = True
        near = correlation(self._places, self._cells.places[cell][None], self._lengths).reshape(
            self._sigma.shape
        )
        self._sigma *= np.sqrt(1 - near**2)  # as of one neighbour alone
        self._upper = self._bounds()
        self._promises.clear()

    def _promise(self, members: Places) -> Promise | None:
        """The unmeasured exposure that may gain most over the one that seems best; where none may gain more than
        ``SETTLED``, the one that seems best, unless it is measured."""
        at, value, known = self._line(self._mean, self._saturated, members)
        allowed = self._allowed(members, known)
        value = np.where(allowed, value, -np.inf)
        best = (
            best_exposure(self._of.exposures_s, np.where(np.isfinite(value), value + SETTLED * known, np.nan))
            or 0
        )
        others, may, measured = self._line(self._upper, self._least_saturated, members)
        may = np.where(allowed & ~measured, may, -np.inf)
        may[best] = -np.inf
        e = int(np.argmax(may.round(DIGITS)))
        gain = float(may[e] - value.max())
        if gain <= SETTLED:
            if known[best]:
                return None
            # An exposure for many conditions serves each of them: the most conditions first.
            others, e, gain = at, best, SETTLED * (1 + 1e-3 * len(members))
        doubt = (self._sigma + self._saturated - self._least_saturated)[:, e].round(DIGITS)
        unknown = [n for n in others[:, e].tolist() if not self._known[n, e]]
        return Promise(gain, (max(unknown, key=doubt.__getitem__), e))

    def _allowed(self, members: Places, known: Flags) -> Flags:
        """(E,), the exposures that may be used: one for everything may lie between those of the grid, too."""
        return np.asarray(self._cells.of_grid | known | (len(members) == len(self._mean)))

    def _line(self, value: Array, saturated: Array, members: Places) -> tuple[Places, Array, Flags]:
        """As :meth:`Averages.line`, and at which exposures all of it is measured, (E,)."""
        at, mean, share = replace(self._of, value=value, saturated=saturated).line(members)
        mean = without_saturated(mean, share, self._of.level)
        return at, mean, np.asarray(np.take_along_axis(self._known, at, axis=0).all(axis=0))

    def _bounds(self) -> Array:
        """(N, E), what each cell may reach. Beside the best measured exposure of a line the next ones of the grid are
        not known before they are measured, whatever the surface says."""
        upper = np.where(self._known, self._mean, np.minimum(self._mean + self._sigma, self._bound))
        tested = np.flatnonzero(self._cells.of_grid)
        best = np.where(self._known, self._mean, -1.0).argmax(axis=1)
        for n in np.flatnonzero(self._known.any(axis=1)):
            beside = [*tested[tested < best[n]][-1:], *tested[tested > best[n]][:1]]
            unknown = [e for e in beside if not self._known[n, e]]
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
    """At most ``count`` cells to measure next, until nothing is to gain: each is the one that may gain most, with
    those before it taken for measured."""
    chosen: list[Cell] = []
    while len(chosen) < count and (best := _greatest(outlook.promise() for outlook in outlooks)):
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
