"""Nodes: the experiments of a run, each once, with the camera's figures in closed form and the scores there.

Domain: H, lux seconds on the scene; L, motion during the exposure, px; gain, dB. Conditions of equal H, L and gain
are one node, unless dark charge counts beside the other noise; then the exposure distinguishes them too. Where the
camera set its gain or exposure itself, the mean over the pictures counts, of the gain to a tenth of a dB. Scores are
in the criterion's unit, NaN where not measured; AP belongs to all targets of a size together, others to each group.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import dark_electrons, photoelectrons
from blurnoise_eval.answers import criterion as criteria
from blurnoise_eval.answers.criterion import PRECISIONS, Criterion
from blurnoise_eval.answers.plane import places_of
from blurnoise_eval.answers.table import ORDER, ScoreTable
from blurnoise_eval.cameras import behind_one_filter
from blurnoise_eval.grid.axes import CORE, LIGHT, MOVES, SETTING, VELOCITY, setting_of, velocity_of
from blurnoise_eval.grid.conditions import Conditions
from blurnoise_eval.quality.measure import BRIGHT, DARK
from blurnoise_eval.scoring.precision import AREAS_PX2, SIZES
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.run_scores import run_scores
from blurnoise_eval.sweep.score_tables import score_tables

Array = NDArray[np.float64]
Places = NDArray[np.int64]
Row = Mapping[str, Any]
USUAL = {
    "detector": (criteria.CONFIDENCE, criteria.RATE, "ap50"),
    "reader": (criteria.CONFIDENCE, criteria.MATCHES),
}
"""Scores of either kind of model that are mapped, beside the criterion's own."""
Progress = Callable[[float], None]
FIGURES = ("light_lux_s", "blur_px", "gain_db", "snr_log2", "white_share")
_MEAN = 0.3  # reflectance whose shot noise is taken for that of a scene
_DARK_SHARE = 0.02  # of the variance in the dark, from which dark charge distinguishes exposures
_DIGITS = 6  # significant digits by which H and L are equal


@dataclass(frozen=True, eq=False)
class Nodes:
    """N nodes of a run.

    rows: the store's conditions with light; node_of: (len(rows),) the node of each. conditions: the first of each
    node, its gain a number. figures: (N,) by name: light_lux_s, H; blur_px, L; gain_db; snr_log2, log2 of the
    difference of ``BRIGHT`` and ``DARK`` by the noise of a pixel; white_share, light of white by what saturates.
    """

    camera: Camera
    rows: tuple[Row, ...]
    node_of: Places
    conditions: tuple[Conditions, ...]
    figures: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.conditions)

    @cached_property
    def places(self) -> Array:
        """(N, 2) on the plane of :mod:`blurnoise_eval.answers.plane`."""
        return places_of(np.ones(len(self)), self.figures["light_lux_s"], self.figures["blur_px"])

    @property
    def lines(self) -> list[tuple[Array, Places]]:
        """Exposures, s, increasing, and their nodes, for each light, velocity and further setting."""
        every = sorted(
            ((*setting_of(row), *velocity_of(row)), row["exposure_s"], node)
            for row, node in zip(self.rows, self.node_of.tolist(), strict=True)
        )
        columns = (zip(*line, strict=True) for _, line in groupby(every, key=itemgetter(0)))
        return [(np.array(exposures_s), np.array(nodes)) for _, exposures_s, nodes in columns]


def nodes_of(store: Store) -> Nodes:
    """The nodes of a run. Raises :class:`StoreError` for a run without a condition with light, or one whose motion a
    chart cannot have: targets or background alone, or a camera that drives."""
    run = f"run = {str(store.folder)!r}"
    manifest = store.about("manifest")
    if manifest is None:
        raise StoreError(f"{run}: no sweep has begun here")
    plan = store.about("identity")["plan"]  # of a grid, or of the nodes that a search asked for
    grid = plan.get("grid") or {name: [value] for name, value in plan["further"].items()}
    if any(map(MOVES.place_of, grid.get(MOVES.name, ()))):
        raise StoreError(
            f"{run}: its targets or their background move alone, which a chart cannot; maps are of runs in which all "
            "moves"
        )
    if plan.get("ego") is not None:
        raise StoreError(
            f"{run}: its camera drives, so that each place moves in its own way; maps are of runs over "
            f"{' and '.join(VELOCITY)}"
        )
    nodes = nodes_at(queries.exposed_conditions(store), Camera.from_dict(manifest["camera"]), list(grid))
    if not len(nodes):
        raise StoreError(f"{run}: has no picture that was exposed to light")
    return nodes


def nodes_at(rows: Iterable[Row], camera: Camera, stated: Sequence[str]) -> Nodes:
    """The nodes of the store's conditions. stated: further axes on which the plan has values, in place of the
    camera's."""
    lit = tuple(row for row in rows if row["exposure_s"] * row[LIGHT.name] > 0)
    one_filter = behind_one_filter(camera)
    names = {*CORE, *stated} - {"gain_db"}
    every = [
        Conditions(**{name: row[name] for name in names}, gain_db=round(row["applied_gain_db"] or 0.0, 1))
        for row in lit
    ]
    by_exposure = _dark_charge_counts(one_filter, every)
    first: dict[tuple[float | None, ...], Conditions] = {}
    keys = [_key(at, by_exposure) for at in every]
    for key, at in zip(keys, every, strict=True):
        first.setdefault(key, at)
    number = {key: place for place, key in enumerate(first)}
    node_of = np.array([number[key] for key in keys], np.int64)
    figures = np.array([_figures(at, one_filter) for at in first.values()], float).reshape(-1, len(FIGURES))
    return Nodes(camera, lit, node_of, tuple(first.values()), dict(zip(FIGURES, figures.T, strict=True)))


def _key(at: Conditions, by_exposure: bool) -> tuple[float | None, ...]:
    x, y = max(at.displacement_px, tuple(-each for each in at.displacement_px))  # there and back blur alike
    numbers = (at.exposure_s * at.illuminance_lux, x, y)
    further = (at[name] for name in SETTING if name != LIGHT.name)
    rounded = (float(f"{each:.{_DIGITS}g}") + 0.0 for each in numbers)
    return (*rounded, *further, at.exposure_s if by_exposure else None)


def _dark_charge_counts(camera: Camera, every: Iterable[Conditions]) -> bool:
    in_the_dark = camera.dark_variance_dn2() / camera.system_gain_dn_per_e**2
    charges = (dark_electrons(camera, at.exposure_s, at.stated.get("temperature_c", 25.0)) for at in every)
    return max(charges, default=0.0) > _DARK_SHARE * in_the_dark


def _figures(at: Conditions, camera: Camera) -> tuple[float, ...]:
    """Of a node, in the order of ``FIGURES``."""
    exposure = at.exposure(camera)
    taker, digital_db = exposure.amplified
    white_e = photoelectrons(taker, at.illuminance_lux, at.exposure_s)
    dark_e = dark_electrons(taker, at.exposure_s, exposure.temperature_c)
    noise_e2 = _MEAN * white_e + taker.dark_variance_dn2(dark_e) / taker.system_gain_dn_per_e**2
    snr_log2 = math.log2((BRIGHT - DARK) * white_e / math.sqrt(noise_e2))
    white_share = white_e / (taker.saturation_e / max(10 ** (digital_db / 20), 1.0))
    gain_db = at.stated["gain_db"]
    return at.exposure_s * at.illuminance_lux, at.blur_px, gain_db, snr_log2, white_share


@dataclass(frozen=True, eq=False)
class NodeScores:
    """A score at N nodes: a table of one condition per node, without the values of the axes; the criterion with this
    score; and the mean side of the targets, px, NaN where unknown."""

    table: ScoreTable
    enough: Criterion
    size_px: float

    @property
    def values(self) -> Array:
        """(N,)."""
        return self.table.mean

    @property
    def known(self) -> NDArray[np.bool_]:
        """The nodes at which there is a value, (N,)."""
        return np.isfinite(self.values)

    @property
    def without(self) -> Array:
        """(C, N): the values with each of C clusters left out; NaN for clusters that count nowhere."""
        sums, counts = self.table.sums, self.table.counts
        left = counts.sum(axis=0) - counts
        with np.errstate(invalid="ignore", divide="ignore"):
            found = np.where(left > 0, (sums.sum(axis=0) - sums) / left, np.nan)
        found[~(np.abs(sums) + counts).any(axis=1)] = np.nan
        return np.asarray(found)


def scores_of(
    store: Store, nodes: Nodes, criterion: Criterion, cluster: str | None, progress: Progress
) -> tuple[list[NodeScores], list[str]]:
    """The usual scores of the run's models and the criterion's at the nodes; and what is withheld, in words.

    cluster: a pattern on pictures' names. progress: called with 1 for each condition of a model whose AP is new.
    """
    models = store.about("manifest")["models"]
    names = [model["name"] for model in models]
    sizes_px = _sizes_px(store)
    found: list[NodeScores] = []
    withheld: list[str] = []
    for score in dict.fromkeys([criterion.score, *USUAL[models[0]["kind"]]]):
        enough = replace(criterion, score=score)
        precisions = (
            run_scores(store, names, cluster, progress, by_size=score) if score in PRECISIONS else None
        )
        for table in score_tables(store, enough, cluster, precisions):
            if table.knows_too_little:
                withheld.append(
                    f"{table.model}, {table.group}, {score}: its targets score {table.clean or 0.0:.2g} on "
                    "average in the original pictures, too little to say what is kept of it"
                )
            else:
                size_px = sizes_px.get((table.model, table.group), np.nan)
                found.append(at_nodes(table, nodes, enough, size_px))
    return sorted(found, key=lambda each: names.index(each.table.model)), withheld


def at_nodes(table: ScoreTable, nodes: Nodes, enough: Criterion, size_px: float) -> NodeScores:
    """A table at the nodes; conditions of one node together."""
    node_at = {
        tuple(row[name] for name in ORDER): node
        for row, node in zip(nodes.rows, nodes.node_of.tolist(), strict=True)
    }
    columns = zip(*(table.conditions[name].tolist() for name in ORDER), strict=True)
    node = np.array([node_at.get(at, -1) for at in columns], np.int64)
    own = (node[:, None] == np.arange(len(nodes))).astype(float)
    unknown = np.full(len(nodes), np.nan)
    merged = {"conditions": {}, "sums": table.sums @ own, "counts": table.counts @ own}
    return NodeScores(replace(table, **merged, saturated=unknown, brightness=unknown), enough, size_px)


def _sizes_px(store: Store) -> dict[tuple[str, str], float]:
    """Mean of width and height of each model's targets by group, and by the sizes of COCO."""
    sides: dict[tuple[str, str], list[float]] = defaultdict(list)
    for row in queries.target_boxes(store):
        width, height = row["width_px"], row["height_px"]
        area = width * height
        sizes = [size for size, (low, high) in zip(SIZES, AREAS_PX2, strict=True) if low <= area <= high]
        for group in (row["group"], *sizes):
            sides[row["model"], group].append((width + height) / 2)
    return {key: float(np.mean(each)) for key, each in sides.items()}
