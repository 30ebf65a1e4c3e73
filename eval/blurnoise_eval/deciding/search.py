"""A search for the edges of exposure windows in the plane: which nodes to ask next, until the edges are known.

Domain: places (u, w) of :mod:`blurnoise_eval.answers.plane`. A question is a score of one model and kind of targets,
in the criterion's unit, to be distinguished from the levels; all questions share their nodes. The search knows
neither pictures nor the engine. It draws nothing: what it asks follows from the batches it was told, in order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.plane import same_places
from blurnoise_eval.deciding.kriging import USUAL, Kriging, Trend
from blurnoise_eval.deciding.lines import Line, Range, lattice, spread
from blurnoise_eval.deciding.predicted import CAUTION

FIRST = 16
"""Nodes of the first batch, spread over the lattice."""
BATCH = 6
MOST_NODES = 72
CHECKED = 8
"""Nodes near the levels that are held out at the end: predicted before their values are told."""
_CONFIDENT = 1.96  # sigma within which a level is not distinguished from a score
_SURPRISING = 4.0  # times CAUTION times sigma: no held-out node of a smooth surface is further off
_PRECISE, _PRECISE_STOPS = 0.01, 0.05  # of the score, of an edge: nothing need be known better
_CHECKS = 2  # that may fail before the lattice is asked
_LATTICE_BATCH = 24
_PER_STOP = 6  # places on a line at which its edges are sought
_DIGITS = 9  # of what is compared: rounding decides nothing
_SAME = 1e-6  # stops between places that are the same
Array = NDArray[np.float64]
Phase = Literal["first", "search", "check", "lattice", "done"]


@dataclass(frozen=True, eq=False)
class _Known:
    """The surface of one question through its known nodes, and their values and errors."""

    surface: Kriging
    values: Array
    errors: Array

    def on(self, places: Array) -> tuple[Array, Array, Array]:
        """Mean, sigma and the error by pictures at places (M, 2), three of (M,)."""
        weights = self.surface.weights(places)
        near = np.exp(-((places[:, None] - self.surface.places[None]) ** 2).sum(axis=-1)) + 1e-12
        errors = near @ self.errors / near.sum(axis=1)
        return weights @ self.values, self.surface.sigma(places), errors


@dataclass(frozen=True, eq=False)
class Check:
    """Held-out nodes (M, 2): errors of their prediction and its expected standard deviation, (Q, M); NaN: unknown."""

    places: Array
    off: Array
    sigma: Array

    @property
    def surprising(self) -> bool:
        """Whether any is farther off than a smooth surface allows."""
        allowed = np.maximum(_SURPRISING * CAUTION * self.sigma, _SURPRISING * _PRECISE)
        return bool((np.abs(self.off) > allowed).any())


class Search:
    """Which nodes to ask so that lines' edges at the levels become known.

    exposures: shortest and longest, s. levels: of every question, in the criterion's unit. most_nodes: from which on
    nothing more is searched for; held-out nodes, and the lattice that replaces a surface that is not smooth, may come
    on top. trend: guides the surfaces.

    phase: what the next batch is for. nodes: the places told so far, (N, 2). precise: whether the nodes leave less
    open than pictures do. not_smooth: whether the whole lattice is asked, for the surface is not smooth. checks: of
    held-out nodes so far.
    """

    def __init__(
        self,
        lines: Sequence[Line],
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
        self.nodes, self._values, self._errors = np.zeros((0, 2)), np.zeros((0, 0)), np.zeros((0, 0))
        self._known: list[_Known] = []
        self.checks: list[Check] = []
        self.precise, self.not_smooth = True, False
        self.phase, self._asked = self._next()

    @property
    def done(self) -> bool:
        """Whether nothing is left to ask."""
        return self.phase == "done"

    def ask(self) -> Array:
        """Places (M, 2) of the next batch; none when done."""
        return self._asked.copy()

    def tell(self, places: ArrayLike, values: ArrayLike, errors: ArrayLike) -> None:
        """Every question's score at places (M, 2), asked for or not, and its standard error over pictures, both
        (Q, M). NaN: not known."""
        at = np.asarray(places, float).reshape(-1, 2)
        value, error = (np.atleast_2d(np.asarray(each, float)) for each in (values, errors))
        questions = len(self._values) if len(self.nodes) else len(value)
        if self.phase == "check" and np.array_equal(same_places(self._asked)[0], same_places(at)[0]):
            self.checks.append(self._check(at, value))
        kept = _not_among(self.nodes, at)
        self.nodes = np.concatenate([self.nodes[kept], at])
        self._values = np.concatenate([self._values.reshape(questions, -1)[:, kept], value], axis=1)
        self._errors = np.concatenate([self._errors.reshape(questions, -1)[:, kept], error], axis=1)
        self._known = []
        for values, errors in zip(self._values, self._errors, strict=True):
            told = np.isfinite(values)
            if told.any():
                surface = Kriging.fit(self.nodes[told], values[told], self._trend)
                self._known.append(_Known(surface, values[told], np.nan_to_num(errors[told])))
        self.precise = all(map(self._is_precise, self._known))
        surprises = sum(check.surprising for check in self.checks)
        spent = surprises > 0 and len(self.nodes) >= self.most_nodes and not self.precise
        self.not_smooth |= surprises >= _CHECKS or spent
        self.phase, self._asked = self._next()

    def _is_precise(self, known: _Known) -> bool:
        """At edges found, with ``CAUTION``, and wherever else a line may cross a level."""
        places = self._on_lines.reshape(-1, 2)
        mean, sigma, error = (each.reshape(self._on_lines.shape[:2]) for each in known.on(places))
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
        left = self.lattice[_not_among(self.lattice, self.nodes)]
        told, first = len(self.nodes), min(FIRST, self.most_nodes)
        if not len(left):
            return "done", left
        if told < first:
            return "first", left[spread(left, first - told, self.nodes)]
        if self.not_smooth:
            return "lattice", left[:_LATTICE_BATCH]
        if not self._known or (self.checks and not self.checks[-1].surprising):
            return "done", left[:0]
        if told < self.most_nodes and not self.precise:
            return "search", left[self._straddled(left, min(BATCH, self.most_nodes - told))]
        return "check", left[self._held_out(left)]

    def _straddled(self, left: Array, count: int) -> list[int]:
        """Which of the places left tell most: where a score may be at a level and little is known of it (straddle:
        Bryan et al., NIPS 2005). After each, sigma is as if it were told: for that no score is needed."""
        away = [self._away(known, left) for known in self._known]
        covariances = [known.surface.covariance(left) for known in self._known]
        chosen: list[int] = []
        for _ in range(min(count, len(left))):
            sigmas = (np.sqrt(np.maximum(np.diag(each), 0.0)) for each in covariances)
            worth = np.max(
                [_CONFIDENT * sigma - far for sigma, far in zip(sigmas, away, strict=True)], axis=0
            )
            worth[chosen] = -np.inf
            best = int(np.argmax(worth.round(_DIGITS)))
            chosen.append(best)
            for place, known in enumerate(self._known):
                own = covariances[place][:, best]
                rough = known.surface.nugget * known.surface.scale**2
                covariances[place] = covariances[place] - np.outer(own, own) / max(own[best] + rough, 1e-15)
        return chosen

    def _held_out(self, left: Array) -> NDArray[np.int64]:
        """Which of the places left lie near a level of any question, and far apart."""
        away = np.min([self._away(known, left) for known in self._known], axis=0)
        near = np.argsort(away.round(_DIGITS), kind="stable")[: 3 * CHECKED]
        return np.asarray(near[spread(left[near], CHECKED, self.nodes)])

    def _check(self, places: Array, values: Array) -> Check:
        """The prediction of held-out nodes beside their values."""
        known = values[np.isfinite(self._values).any(axis=1)]
        predicted = [each.on(places) for each in self._known]
        off = [found - mean for found, (mean, *_) in zip(known, predicted, strict=True)]
        return Check(places, np.array(off), np.array([sigma for _, sigma, _ in predicted]))

    def _away(self, known: _Known, places: Array) -> Array:
        """Distance of the mean from the nearest level, (M,)."""
        mean, *_ = known.on(places)
        return np.asarray(np.abs(mean[:, None] - self.levels).min(axis=1))


def _not_among(places: Array, others: Array) -> NDArray[np.bool_]:
    """Which of places (N, 2) are none of others (M, 2), (N,)."""
    apart = np.abs(places[:, None] - others[None]).max(axis=-1, initial=0.0)
    return np.asarray((apart > _SAME).all(axis=1))
