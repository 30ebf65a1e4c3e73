"""A table over the lines of a question, predicted from what a run has observed on the plane.

Domain: ``PER_STOP`` exposures to a stop. What the nodes leave open stands beside the values, ``CAUTION`` times as
wide as the surface has it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.plane import places_of, same_places
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.deciding.nodes import exposures_on
from blurnoise_eval.deciding.predicted import Predicted
from blurnoise_eval.deciding.question import Question
from blurnoise_eval.deciding.search import CAUTION
from blurnoise_eval.deciding.trend import Trend
from blurnoise_eval.grid.axes import LIGHT, VELOCITY

PER_STOP = 12
Array = NDArray[np.float64]


def predicted_table(seen: ScoreTable, question: Question, trend: Trend) -> ScoreTable:
    """Of one plane the table of all lines of the question; without conditions where the model knows too little."""
    if seen.knows_too_little:
        return seen.take([])
    exposures = exposures_on(question.exposures_s, PER_STOP)
    lines = sorted(question.lines, key=lambda line: (line.illuminance_lux, line.velocity_px_s))
    count = len(lines) * len(exposures)
    conditions = {name: np.full(count, values[0]) for name, values in seen.conditions.items()}
    conditions["exposure_s"] = np.tile(exposures, len(lines))
    conditions[LIGHT.name] = np.repeat([line.illuminance_lux for line in lines], len(exposures))
    for number, name in enumerate(VELOCITY):
        conditions[name] = np.repeat([line.velocity_px_s[number] for line in lines], len(exposures))
    speeds = np.repeat([line.speed_px_s for line in lines], len(exposures))
    places = places_of(conditions["exposure_s"], conditions[LIGHT.name], speeds)
    plane = Predicted(seen.places, seen.clusters, seen.sums, seen.counts, trend)
    at = plane.on(places)
    return replace(
        seen,
        conditions=conditions,
        sums=at.sums,
        counts=at.counts,
        saturated=_by_light(seen, seen.saturated, places),
        brightness=_by_light(seen, seen.brightness, places),
        prediction_cov=lambda those: CAUTION**2 * plane.surface.covariance(places[those]),
    )


def _by_light(seen: ScoreTable, values: Array, places: Array) -> Array:
    """What goes with the light, and hardly with motion, between the nodes' (N,), at places (M, 2)."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(places), np.nan)
    lights, which = same_places(np.stack([seen.places[known, 0], np.zeros(known.sum())], axis=1))
    means = np.bincount(which, values[known]) / np.bincount(which)
    return np.asarray(np.interp(places[:, 0], lights[:, 0], means))
