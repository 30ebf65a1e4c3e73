"""Bench of decisions: how many conditions a search asks for beside grids, and how far off its windows are.

Domain: a score at every exposure, light and speed is known from a dense sweep and interpolated smoothly, by a method
that is none of those judged (Clough and Tocher's). Levels are shares of the clean confidence. Errors are stops of
exposure on the wrong side of a level, mean of lines; a line is one light and speed.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator, NearestNDInterpolator

from blurnoise.optics.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.bench.contest import Case, Contender, Contest
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run import computing as run
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.run.score_tables import score_tables
from blurnoise_eval.run.search import Search
from blurnoise_eval.run.search_space import Line
from blurnoise_eval.run.surface import USUAL, Kriging
from blurnoise_eval.store.store import Store

EXPOSURES = (1e-3, 90e-3)
LEVELS = (0.8, 0.9)
LIGHTS_LUX, SPEEDS_PX_S = (2.0, 10.0, 45.0, 200.0, 1000.0), (0.0, 100.0, 400.0, 1600.0)
GRIDS = (4, 6, 10, 16)
"""Exposures of the grids; all of them are among those of the dense sweep."""
DENSE = 46
Array = NDArray[np.float64]


def decide(
    detector: Detector, pictures: datasets.PictureSet, threads: int, folder: Path, *, quick: bool
) -> Contest:
    """The dense sweep is made in ``folder`` first, or continued."""
    axes = {
        "exposure_s": tuple(np.geomspace(*EXPOSURES, DENSE if not quick else 16).tolist()),
        "illuminance_lux": LIGHTS_LUX,
        "velocity_x_px_s": SPEEDS_PX_S,
    }
    plan = SweepPlan(axes, examples=False)
    with Store(folder / "dense", create=True) as store:
        run.run([detector], Camera.preset("imx250"), pictures, plan, store, engine=ThreadEngine(threads))
        tables = score_tables(store, Criterion(0.9, kept=True))
        groups = [plane for table in tables if not table.knows_too_little for plane in table.on_plane()]
    if not groups:
        raise ValueError(
            f"model = {detector.name!r}: must find more of these targets; its scores are too low for a window"
        )
    known = (np.array([getattr(each, name) for each in groups]) for name in ("mean", "standard_error"))
    return Contest(
        "decide", f"Windows of {detector.name}", [partial(case, Truth(groups[0].places, *known))],
        cost_unit="conditions", error_unit="stops wrong",
    )  # fmt: skip


class Truth:
    """Kept shares of groups of targets and their standard errors over pictures, anywhere between (N, 2) places.

    mean, error: (Q, N) of Q groups. kept: on the lines, finely, (Q, M).
    """

    def __init__(self, places: Array, mean: Array, error: Array) -> None:
        values = np.moveaxis(np.array([mean, error]), -1, 0)
        self._between = CloughTocher2DInterpolator(places, values)
        self._beyond = NearestNDInterpolator(places, values)
        self.lines = [Line(lux, (speed, 0.0)) for lux in LIGHTS_LUX for speed in SPEEDS_PX_S]
        self.times = np.geomspace(*EXPOSURES, 24 * 7)
        self.places = np.concatenate([line.places(self.times) for line in self.lines])
        self.kept = self.seen(self.places)[0]

    def seen(self, places: Array) -> tuple[Array, Array]:
        """Of places (M, 2), two times (Q, M); beyond all nodes that of the nearest one."""
        values = self._between(places)
        mean, error = np.moveaxis(np.where(np.isfinite(values), values, self._beyond(places)), 0, -1)
        return mean, error

    def through(self, nodes: Array) -> Array:
        """On the lines by surfaces through some nodes (M, 2), as ``blurnoise decide`` has them."""
        fits = [Kriging.fit(nodes, values, USUAL) for values in self.seen(nodes)[0]]
        return np.array([fit.mean(self.places) for fit in fits])

    def stops_wrong(self, found: Array) -> float:
        """Of shares (Q, M) on the lines."""
        wrong = np.mean([(self.kept >= level) != (found >= level) for level in LEVELS])
        return float(wrong * np.log2(EXPOSURES[1] / EXPOSURES[0]))


def case(truth: Truth) -> Case:
    """The search and the grids, each of which answers for all groups at once: shares, and conditions asked."""

    def search() -> tuple[Array, int]:
        asking = Search(truth.lines, EXPOSURES, LEVELS)
        while not asking.done:
            places = asking.ask()
            asking.tell(places, *truth.seen(places))
        return truth.through(asking.nodes), len(asking.nodes)

    def grid(count: int) -> tuple[Array, int]:
        times = np.geomspace(*EXPOSURES, count)
        x, known = np.log2(truth.times), np.log2(times)
        lines = [
            [np.interp(x, known, values) for values in truth.seen(line.places(times))[0]]
            for line in truth.lines
        ]
        return np.concatenate(lines, axis=1), count * len(truth.lines)

    ways = [Contender("decide's search", search, True)]
    ways += [Contender(f"grid of {count} exposures", partial(grid, count)) for count in GRIDS]
    return Case(
        f"{len(LIGHTS_LUX)} lights, {len(SPEEDS_PX_S)} speeds", ways, lambda found: truth.stops_wrong(found[0]),
        cost=lambda found: float(found[1]),
    )  # fmt: skip
