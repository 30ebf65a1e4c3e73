"""A search for the edges of exposure windows in the plane: which nodes to measure next, until the edges are known.

Domain: places (u, w) of :mod:`blurnoise_eval.answers.plane`. A question is a score of one model and kind of targets,
in the criterion's unit, to be distinguished from the levels; all questions share their nodes. The search knows
neither pictures nor the engine, and draws nothing: what it asks follows from the batches it was given, in order.

Its phases: ``first``, nodes spread over the lattice; ``search``, batches where a score may be at a level, until the
edges are precise; ``check``, held-out nodes near the levels, predicted before their values are known; ``done``. A
check that fails leads back to ``search``; where the surface is not smooth, all nodes follow (``lattice``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.plane import same_places
from blurnoise_eval.run.search_space import Range, SearchLine, lattice, spread
from blurnoise_eval.run.surface import CAUTION, USUAL, Kriging, Trend
from blurnoise_eval.scoring.uncertainty import NORMAL

FIRST = 16  # nodes of the first batch, spread over the lattice
BATCH = 6
MOST_NODES = 72
CHECKED = 8  # held-out nodes at the end
_SURPRISING = 4.0  # times CAUTION times sigma: no held-out node of a smooth surface is further off
_PRECISE, _PRECISE_STOPS = 0.01, 0.05  # of the score, of an edge: nothing need be known better
_CHECKS = 2  # that may fail before the lattice is asked
_LATTICE_BATCH = 24
_PER_STOP = 6  # places on a line at which its edges are sought
_DIGITS = 9  # of what is compared: rounding decides nothing
_SAME = 1e-6  # stops between places that are the same
Array = NDArray[np.float64]
Phase = Literal["first", "search", "check", "lattice", "done"]


class _Fitted(NamedTuple):
    """The surface of one question through the nodes at which it is known, with their standard errors by pictures."""

    question: int
    surface: Kriging
    errors: Array

    def error(self, places: Array) -> Array:
        """The error by pictures at places (M, 2), by that of the nodes nearby, (M,)."""
        near = np.exp(-((places[:, None] - self.surface.places[None]) ** 2).sum(axis=-1)) + 1e-12
        return np.asarray(near @ self.errors / near.sum(axis=1))

    def surprises(self, places: Array, values: Array) -> bool:
        """Whether any value (M,) at held-out places (M, 2) is farther off than a smooth surface allows."""
        allowed = _SURPRISING * np.maximum(CAUTION * self.surface.sigma(places), _PRECISE)
        return bool((np.abs(values - self.surface.mean(places)) > allowed).any())


class EdgeSearch:
    """Which nodes to measure so that lines' edges at the levels become known.

    exposures: shortest and longest, s. levels: of every question, in the criterion's unit. most_nodes: from which on
    nothing more is searched for; held-out nodes, and the lattice that replaces a surface that is not smooth, may come
    on top. trend: guides the surfaces.

    phase: what the next batch is for. nodes: the places measured, (N, 2). precise: whether the nodes leave less
    open than pictures do. not_smooth: whether the whole lattice is asked. surprises: of each check so far, whether a
    held-out node was farther off than a smooth surface allows.
    """

    def __init__(
        self,
        lines: Sequence[SearchLine],
        exposures: Range,
        levels: float | Sequence[float],
        *,
        most_nodes: int = MOST_NODES,
        trend: Trend | None = USUAL,
    ) -> None:
        self.levels = np.atleast_1d(np.asarray(levels, float))
        self.most_nodes = most_nodes
        self.lattice = lattice(lines, exposures)
        stops = math.log2(exposures[1] / exposures[0])
        count = max(2, 1 + math.ceil(_PER_STOP * stops))
        self._stops = np.linspace(0.0, max(stops, 1e-9), count)
        self._on_lines = np.stack([line.places(np.geomspace(*exposures, count)) for line in lines])
        self._trend = trend
        self.nodes = np.zeros((0, 2))
        self._values = self._errors = np.zeros((0, 0))
        self._fitted: list[_Fitted] = []
        self.surprises: list[bool] = []
        self.precise, self.not_smooth = True, False
        self.phase, self._asked = self._next()

    @property
    def done(self) -> bool:
        """Whether nothing is left to ask."""
        return self.phase == "done"

    def ask(self) -> Array:
        """Places (M, 2) of the next batch; none when done."""
        return self._asked.copy()

    def tell(self, places: ArrayLike, scores: ArrayLike, errors: ArrayLike) -> None:
        """Every question's score at new places (M, 2), asked for or not, and its standard error over pictures, both
        (Q, M). NaN: not known."""
        at = np.asarray(places, float).reshape(-1, 2)
        value, error = (np.atleast_2d(np.asarray(each, float)) for each in (scores, errors))
        if self.phase == "check" and np.array_equal(same_places(self._asked)[0], same_places(at)[0]):
            self.surprises.append(any(each.surprises(at, value[each.question]) for each in self._fitted))
        first = not len(self.nodes)
        self._values = value if first else np.hstack([self._values, value])
        self._errors = error if first else np.hstack([self._errors, error])
        self.nodes = np.concatenate([self.nodes, at])
        self._fitted = []
        for question, values in enumerate(self._values):
            if (known := np.isfinite(values)).any():
                surface = Kriging.fit(self.nodes[known], values[known], self._trend)
                error_there = np.nan_to_num(self._errors[question, known])
                self._fitted.append(_Fitted(question, surface, error_there))
        self.precise = all(map(self._is_precise, self._fitted))
        surprises = sum(self.surprises)
        spent = surprises > 0 and len(self.nodes) >= self.most_nodes and not self.precise
        self.not_smooth |= surprises >= _CHECKS or spent
        self.phase, self._asked = self._next()

    def _is_precise(self, fitted: _Fitted) -> bool:
        """At edges found, with ``CAUTION``, and wherever else a line may cross a level."""
        places = self._on_lines.reshape(-1, 2)
        every = fitted.surface.mean(places), fitted.surface.sigma(places), fitted.error(places)
        mean, sigma, error = (each.reshape(self._on_lines.shape[:2]) for each in every)
        steep = np.abs(np.gradient(mean, self._stops, axis=1))
        enough = np.maximum(np.maximum(error, _PRECISE), _PRECISE_STOPS * steep)
        for level in self.levels:
            turns = (mean[:, 1:] >= level) != (mean[:, :-1] >= level)
            edge = np.pad(turns, ((0, 0), (0, 1))) | np.pad(turns, ((0, 0), (1, 0)))
            possible = np.abs(mean - level) <= CAUTION * sigma
            if (edge & (CAUTION * sigma > enough)).any() or (possible & (sigma > enough)).any():
                return False
        return True

    def _next(self) -> tuple[Phase, Array]:
        """The phase now, and the places it asks for."""
        apart = np.abs(self.lattice[:, None] - self.nodes[None]).max(axis=-1, initial=0.0)
        left = self.lattice[(apart > _SAME).all(axis=1)]
        measured, first = len(self.nodes), min(FIRST, self.most_nodes)
        if not len(left):
            return "done", left
        if measured < first:
            return "first", left[spread(left, first - measured, self.nodes)]
        if self.not_smooth:
            return "lattice", left[:_LATTICE_BATCH]
        if not self._fitted or (self.surprises and not self.surprises[-1]):
            return "done", left[:0]
        if measured < self.most_nodes and not self.precise:
            return "search", left[self._straddled(left, min(BATCH, self.most_nodes - measured))]
        return "check", left[self._held_out(left)]

    def _straddled(self, left: Array, count: int) -> list[int]:
        """Which of the places left say most: where a score may be at a level and little is known of it (straddle:
        Bryan et al., NIPS 2005). After each, sigma is as if it were measured: for that no score is needed."""
        away = [self._away(fitted, left) for fitted in self._fitted]
        covariances = [fitted.surface.covariance(left) for fitted in self._fitted]
        chosen: list[int] = []
        for _ in range(min(count, len(left))):
            sigmas = (np.sqrt(np.maximum(np.diag(each), 0.0)) for each in covariances)
            worth = np.max([NORMAL * sigma - far for sigma, far in zip(sigmas, away, strict=True)], axis=0)
            worth[chosen] = -np.inf
            best = int(np.argmax(worth.round(_DIGITS)))
            chosen.append(best)
            for fitted, covariance in zip(self._fitted, covariances, strict=True):
                own = covariance[:, best].copy()
                rough = fitted.surface.nugget * fitted.surface.scale**2
                covariance -= np.outer(own, own) / max(own[best] + rough, 1e-15)
        return chosen

    def _held_out(self, left: Array) -> NDArray[np.int64]:
        """Which of the places left lie near a level of any question, and far apart."""
        away = np.min([self._away(fitted, left) for fitted in self._fitted], axis=0)
        near = np.argsort(away.round(_DIGITS), kind="stable")[: 3 * CHECKED]
        return np.asarray(near[spread(left[near], CHECKED, self.nodes)])

    def _away(self, fitted: _Fitted, places: Array) -> Array:
        """Distance of the mean from the nearest level, (M,)."""
        return np.asarray(np.abs(fitted.surface.mean(places)[:, None] - self.levels).min(axis=1))
