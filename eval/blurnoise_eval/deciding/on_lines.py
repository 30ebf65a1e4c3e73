"""Surfaces over the lines of a question, predicted from what a run has observed on the plane.

Domain: as of :mod:`blurnoise_eval.scoring.surfaces`, ``PER_STOP`` exposures to a stop. What the nodes leave open
stands beside the values, ``CAUTION`` times as wide as the surface has it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.deciding.nodes import exposures_on, places_of, same_places
from blurnoise_eval.deciding.observed import FURTHER, Observed
from blurnoise_eval.deciding.predicted import Predicted
from blurnoise_eval.deciding.question import Question
from blurnoise_eval.deciding.search import CAUTION
from blurnoise_eval.deciding.trend import Trend
from blurnoise_eval.grid.axes import LIGHT, SETTING
from blurnoise_eval.scoring.surfaces import Surface

PER_STOP = 12
Array = NDArray[np.float64]


def predicted_surfaces(seen: Observed, question: Question, trend: Trend) -> Iterator[Surface]:
    """One for each light of the question, with all its velocities; of what is withheld an empty one."""
    exposures = exposures_on(question.exposures_s, PER_STOP)
    if seen.withheld:
        none = np.zeros((len(seen.clusters), 0, 0))
        own = seen.model, seen.group, (), (), (), seen.clusters, none, none, none[0], seen.n_targets, none[0]
        yield Surface(*own, seen.clean, seen.reference, seen.kept)
        return
    plane = Predicted(seen.places, seen.clusters, seen.sums, seen.counts, trend)
    setting = dict(zip(FURTHER, seen.setting, strict=True))
    for lux in question.lights_lux:
        lines = [line for line in question.lines if line.illuminance_lux == lux]
        places = np.stack([places_of(exposures, line) for line in lines], axis=1)  # (E, V, 2)
        shape = places.shape[:2]
        at = plane.on(places.reshape(-1, 2))
        not_known = np.stack([plane.surface.covariance(places[:, v]) for v in range(shape[1])])
        yield Surface(
            seen.model,
            seen.group,
            tuple(lux if name == LIGHT.name else setting[name] for name in SETTING),
            tuple(exposures.tolist()),
            tuple(line.velocity_px_s for line in lines),
            seen.clusters,
            at.sums.reshape(-1, *shape),
            at.counts.reshape(-1, *shape),
            _by_light(seen, seen.saturated, places),
            seen.n_targets,
            _by_light(seen, seen.brightness, places),
            seen.clean,
            seen.reference,
            seen.kept,
            open=CAUTION**2 * not_known,
        )


def _by_light(seen: Observed, values: Array, places: Array) -> Array:
    """What goes with the light, and hardly with motion, between the nodes' (N,), at places (E, V, 2)."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(places.shape[:2], np.nan)
    lights, which = same_places(np.stack([seen.places[known, 0], np.zeros(known.sum())], axis=1))
    means = np.bincount(which, values[known]) / np.bincount(which)
    return np.asarray(np.interp(places[..., 0], lights[:, 0], means))
