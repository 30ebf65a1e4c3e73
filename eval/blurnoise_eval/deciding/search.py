"""A search for the edges of exposure windows in the plane: which nodes to ask next, until the edges are known.

Domain: places (u, w) of :mod:`blurnoise_eval.deciding.nodes`. A question is a score of one model and kind of targets,
in the criterion's unit, that is to be told from the levels asked for; all questions share their nodes. The search
knows neither pictures nor who computes. It draws nothing, and what it asks follows from what it was told, in order: a
rerun that tells the same batches is asked the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise._core.checks import integer
from blurnoise_eval.answers.plane import same_places
from blurnoise_eval.deciding.kriging import Kriging
from blurnoise_eval.deciding.nodes import Line, Range, lattice, places_of, spread
from blurnoise_eval.deciding.trend import USUAL, Trend

CAUTION = 1.5
"""Times sigma: so far off is the surface in truth (``blurnoise bench decide``)."""
FIRST = 16
"""Nodes of the first batch, spread over the lattice."""
BATCH = 6
MOST_NODES = 72
CHECKED = 8
"""Nodes near the levels that are held out at the end, and predicted before they are told."""
_CONFIDENT = 1.96  # sigma within which a level is not told from a score
_SURPRISING = 4.0  # times CAUTION times sigma: what no held-out node is off by, where the surface is smooth
_PRECISE, _PRECISE_STOPS = 0.01, 0.05  # of the score, of an edge: nothing need be known better
_CHECKS = 2  # that may fail before the lattice is asked
_LATTICE_BATCH = 24
_PER_STOP = 6  # places on a line at which its edges are looked for
_DIGITS = 9  # of what is compared: rounding decides nothing
_SAME = 1e-6  # stops between places that are the same
Array = NDArray[np.float64]
Phase = Literal["first", "search", "check", "lattice", "done"]


@dataclass(frozen=True, eq=False)
class _Known:
    """What was told of one question: its surface, mean and error at some places."""

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
    """Nodes (M, 2) that were predicted before they were told. off: by how much the prediction was wrong, sigma: what
    was to be expected of it, both (Q, M); NaN: not told."""

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
    nothing more is searched for; held-out nodes, and the lattice that stands in for a surface that is not smooth, may
    come on top. trend: what the surfaces are guided by. Raises ``ValueError`` for what is no question.
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
        self.levels = tuple(np.atleast_1d(np.asarray(levels, float)).tolist())
        if not self.levels or not np.isfinite(self.levels).all():
            raise ValueError(f"levels = {levels}: must be finite, at least one")
        self.most_nodes = integer("most_nodes", most_nodes, 1, 100_000)
        self.lattice = lattice(lines, exposures)
        low, high = exposures
        count = max(2, 1 + math.ceil(_PER_STOP * math.log2(high / low)))
        times = np.geomspace(low, high, count)
        self._stops = np.linspace(0.0, max(math.log2(high / low), 1e-9), count)
        self._on_lines = np.stack([places_of(times, line) for line in lines])
        self._trend = trend
        self._places, self._values, self._errors = np.zeros((0, 2)), np.zeros((0, 0)), np.zeros((0, 0))
        self._checks: list[Check] = []
        self._not_smooth = False

    @property
    def nodes(self) -> Array:
        """The places told so far, (N, 2), in that order."""
        return self._places.copy()

    @property
    def checks(self) -> tuple[Check, ...]:
        """The checks so far."""
        return tuple(self._checks)

    @property
    def not_smooth(self) -> bool:
        """Whether the surface was found not to be smooth, so that the whole lattice is asked."""
        return self._not_smooth

    @property
    def done(self) -> bool:
        """Whether nothing is left to ask."""
        return self._next[0] == "done"

    @property
    def phase(self) -> Phase:
        """What the next batch is for."""
        return self._next[0]

    def ask(self) -> Array:
        """Places (M, 2) of the next batch; none when done."""
        return self._next[1].copy()

    def tell(self, places: ArrayLike, values: ArrayLike, errors: ArrayLike) -> None:
        """What was found at places (M, 2), asked for or not: every question's score there, and its standard error
        over pictures, both (Q, M). NaN: not known. Raises ``ValueError`` for shapes that do not fit."""
        at = np.asarray(places, float).reshape(-1, 2)
        value, error = (np.atleast_2d(np.asarray(each, float)) for each in (values, errors))
        questions = len(self._values) if len(self._places) else len(value)
        if not value.shape == error.shape == (questions, len(at)):
            raise ValueError(
                f"values, errors: {value.shape} and {error.shape}; must be ({questions}, {len(at)}), "
                "questions by places"
            )
        if self._answers_check(at):
            self._checks.append(self._check(at, value))
        told = _not_among(self._places, at)
        self._places = np.concatenate([self._places[told], at])
        self._values = np.concatenate([self._values.reshape(questions, -1)[:, told], value], axis=1)
        self._errors = np.concatenate([self._errors.reshape(questions, -1)[:, told], error], axis=1)
        for name in ("_next", "_known", "precise"):
            self.__dict__.pop(name, None)
        surprises = sum(check.surprising for check in self._checks)
        spent = surprises > 0 and len(self._places) >= self.most_nodes and not self.precise
        self._not_smooth |= surprises >= _CHECKS or spent

    @cached_property
    def precise(self) -> bool:
        """Whether what the nodes leave open is less than what pictures do: at edges found, with ``CAUTION``, and
        wherever else a line may cross a level."""
        shape = self._on_lines.shape[:2]
        for known in self._known:
            mean, sigma, error = (each.reshape(shape) for each in known.on(self._on_lines.reshape(-1, 2)))
            steep = np.abs(np.gradient(mean, self._stops, axis=1))
            enough = np.maximum(np.maximum(error, _PRECISE), _PRECISE_STOPS * steep)
            for level in self.levels:
                turns = (mean[:, 1:] >= level) != (mean[:, :-1] >= level)
                edge = np.pad(turns, ((0, 0), (0, 1))) | np.pad(turns, ((0, 0), (1, 0)))
                possible = np.abs(mean - level) <= CAUTION * sigma
                if (edge & (CAUTION * sigma > enough)).any() or (possible & (sigma > enough)).any():
                    return False
        return True

    @cached_property
    def _known(self) -> list[_Known]:
        """The questions of which anything is known."""
        found = []
        for values, errors in zip(self._values, self._errors, strict=True):
            told = np.isfinite(values)
            if told.any():
                surface = Kriging.fit(self._places[told], values[told], self._trend)
                found.append(_Known(surface, values[told], np.nan_to_num(errors[told])))
        return found

    @cached_property
    def _next(self) -> tuple[Phase, Array]:
        """What is to be done now, and the places asked for."""
        left = self.lattice[_not_among(self.lattice, self._places)]
        told, first = len(self._places), min(FIRST, self.most_nodes)
        if not len(left):
            return "done", left
        if told < first:
            return "first", left[spread(left, first - told, self._places)]
        if self.not_smooth:
            return "lattice", left[:_LATTICE_BATCH]
        if not self._known or (self._checks and not self._checks[-1].surprising):
            return "done", left[:0]
        if told < self.most_nodes and not self.precise:
            return "search", left[self._straddled(left, min(BATCH, self.most_nodes - told))]
        return "check", left[self._held_out(left)]

    def _straddled(self, left: Array, count: int) -> list[int]:
        """Which of the places left tell most: where a score may be at a level and little is known of it (straddle:
        Bryan et al., NIPS 2005). After each, sigma is as if it were told: for that no score is needed."""
        away = [self._away(known.on(left)[0]) for known in self._known]
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
        away = np.min([self._away(known.on(left)[0]) for known in self._known], axis=0)
        near = np.argsort(away.round(_DIGITS), kind="stable")[: 3 * CHECKED]
        return np.asarray(near[spread(left[near], CHECKED, self._places)])

    def _answers_check(self, places: Array) -> bool:
        """Whether these are the held-out nodes that are asked for now."""
        left = _not_among(self.lattice, self._places).sum()
        if len(places) != min(CHECKED, left) or not len(self._places):  # spares most of a replay its surfaces
            return False
        phase, asked = self._next
        return phase == "check" and np.array_equal(same_places(asked)[0], same_places(places)[0])

    def _check(self, places: Array, values: Array) -> Check:
        """What was found at held-out nodes, beside what was predicted."""
        asked = [found for found, known in zip(values, self._values, strict=True) if np.isfinite(known).any()]
        off, sigmas = [], []
        for found, known in zip(asked, self._known, strict=True):
            mean, sigma, _ = known.on(places)
            off.append(found - mean)
            sigmas.append(sigma)
        return Check(places, np.array(off), np.array(sigmas))

    def _away(self, mean: Array) -> Array:
        """Distance from the nearest level."""
        return np.asarray(np.min([np.abs(mean - level) for level in self.levels], axis=0))


def _not_among(places: Array, others: Array) -> NDArray[np.bool_]:
    """Which of places (N, 2) are none of others (M, 2), (N,)."""
    apart = np.abs(places[:, None] - others[None]).max(axis=-1, initial=0.0)
    return np.asarray((apart > _SAME).all(axis=1))
