"""Populations over the plane of exposures with a closed form: what a search is to find is known exactly."""

from typing import NamedTuple

import numpy as np
from blurnoise_eval.answers.curves import windows
from blurnoise_eval.run.search_space import SearchLine, exposures_on
from numpy.typing import NDArray

Array = NDArray[np.float64]
EXPOSURES = (1e-3, 90e-3)
LIGHTS, SPEEDS = (2.0, 10.0, 45.0, 200.0, 1000.0), (0.0, 100.0, 400.0, 1600.0)
LINES = [SearchLine(lux, (speed, 0.0)) for lux in LIGHTS for speed in SPEEDS]
PICTURES = 35
_RNG = np.random.default_rng(0)
_DARK, _BLURRED = _RNG.normal(-4, 1.2, (PICTURES, 1)), _RNG.normal(3, 1, (PICTURES, 1))
REFERENCES = _RNG.gamma(2, 1, PICTURES)


def photographs(places):
    """The score of each of C pictures at places (M, 2), (C, M): lost in the dark and in motion, each picture
    elsewhere; a third is lost to saturation."""
    return np.asarray(_unsaturated(places) * (1 - 0.3 / (1 + np.exp(-2 * (places[:, 0] - 3)))))


def _unsaturated(places):
    u, w = places.T
    return np.asarray(1 / (1 + np.exp(-1.5 * (u - _DARK))) / (1 + (2**w / 2**_BLURRED) ** 2))


def notched(places):
    """Half is lost in a notch of half a stop, at the edge of the dark."""
    return np.asarray(photographs(places) * (1 - 0.5 * (np.abs(places[:, 0] + 3) < 0.25)))


class Found(NamedTuple):
    """A mean and its standard error over pictures, (M,) each."""

    mean: Array
    error: Array


def seen(rates, places, references=REFERENCES):
    """What the pictures give at places."""
    sums = rates(places) * references[:, None]
    mean = sums.sum(axis=0) / references.sum()
    return Found(mean, np.sqrt(((sums - mean * references[:, None]) ** 2).sum(axis=0)) / references.sum())


def searched(search, *questions, references=REFERENCES, until="done"):
    """Answer the search until it is done, or in a phase; the batches that it asked."""
    asked: list[Array] = []
    while search.phase not in ("done", until) and len(asked) < 400:
        places = search.ask()
        found = [seen(rates, places, references) for rates in questions]
        search.tell(places, [each.mean for each in found], [each.error for each in found])
        asked.append(places)
    return asked


def edges(mean, line, level):
    """log2 of the exposures at which a line's windows begin and end within the range, s."""
    times = exposures_on(EXPOSURES, 24)
    found = windows(tuple(times.tolist()), mean(line.places(times)).tolist(), level, True)
    ends = [end for window in found for end in window if EXPOSURES[0] < end < EXPOSURES[1] * (1 - 1e-9)]
    return np.log2(ends).tolist()  # type: ignore[no-any-return]
