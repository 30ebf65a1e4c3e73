"""What a run has observed on the plane of exposures: a score's sums at every node, of a grid or of a search alike.

Domain: places (u, w) of :mod:`blurnoise_eval.deciding.nodes`. Values are in a criterion's unit: sums by counts, which
are numbers of targets or, where what is kept counts, the scores of the same targets in the untouched pictures.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.deciding.nodes import Line, by_direction, place_of, same_places
from blurnoise_eval.grid.axes import LIGHT, NAMES, SETTING, VELOCITY
from blurnoise_eval.scoring import certainty
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.scoring.surfaces import Surface
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.run_surfaces import grouped_surfaces, too_little

FURTHER = tuple(name for name in SETTING if name != LIGHT.name)
Array = NDArray[np.float64]
Row = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Observed:
    """A group of targets before one model at N nodes of the plane, in C clusters.

    setting: values of the axes in ``FURTHER``. direction: unit vector of the motion. places: (N, 2), each once.
    at: of each place the conditions of one cell there, by axis. sums, counts: (C, N), the mean of all that stand
    there. saturated, brightness, gain_db, snr_db: (N,) means over the pictures, NaN where it is not known.
    n_targets, clean, reference, kept: as of :class:`~blurnoise_eval.scoring.surfaces.Surface`. withheld: the model
    knows too little of these targets to say what it keeps.
    """

    model: str
    group: str
    setting: tuple[float, ...]
    direction: tuple[float, float]
    places: Array
    at: tuple[Mapping[str, float], ...]
    clusters: tuple[str, ...]
    sums: Array
    counts: Array
    saturated: Array
    brightness: Array
    gain_db: Array
    snr_db: Array
    n_targets: int
    clean: float | None
    reference: float
    kept: bool
    withheld: bool

    @property
    def mean(self) -> Array:
        """(N,), in the criterion's unit."""
        return certainty.mean_of(self.sums, self.counts)

    @property
    def most(self) -> float:
        """The greatest value of the mean: all of the score, by what was kept."""
        return 1 / self.clean if self.kept and self.clean else 1.0

    @property
    def error(self) -> Array:
        """(N,), the mean's standard error over clusters; NaN of fewer than two."""
        away = certainty.departures(self.sums, self.counts)
        if len(self.clusters) < 2:
            return np.full(len(self.places), np.nan)
        return np.asarray(np.nanstd(away, axis=0, ddof=1) / np.sqrt(np.isfinite(away).sum(axis=0)))


class _Node(NamedTuple):
    line: Line
    at: dict[str, float]
    sums: Array
    counts: Array
    known: tuple[float, ...]


def observed(store: Store, criterion: Criterion, cluster: str | None = None) -> list[Observed]:
    """What a run has observed, per model, group of targets, setting and direction of motion.

    cluster: a pattern on pictures' names, see :func:`~blurnoise_eval.scoring.clusters.cluster_of`. Conditions without
    light have no place and are left out; those at rest are in every direction's plane.
    """
    return on_plane(store, grouped_surfaces(store, criterion, cluster))


def on_plane(store: Store, measured: Iterable[list[Surface]]) -> list[Observed]:
    """The same of surfaces, those of one model and group together."""
    pictures: dict[str, dict[tuple[float, ...], Row]] = {}
    found: list[Observed] = []
    for of_group in measured:
        model = of_group[0].model
        if model not in pictures:
            pictures[model] = {_axes(row): row for row in queries.condition_counts(store, model)}
        settings: dict[tuple[float, ...], list[Surface]] = {}
        for surface in of_group:
            settings.setdefault(_further(surface), []).append(surface)
        for alike in settings.values():
            clusters = tuple(sorted({cluster for surface in alike for cluster in surface.clusters}))
            nodes = [node for surface in alike for node in _nodes(surface, clusters, pictures[model])]
            for direction, lines in by_direction([node.line for node in nodes]):
                here = [node for node in nodes if node.line.direction is None or node.line in lines]
                found.append(_plane(alike, direction, clusters, here))
    return found


def _nodes(
    surface: Surface, clusters: tuple[str, ...], pictures: Mapping[tuple[float, ...], Row]
) -> Iterator[_Node]:
    setting = dict(zip(SETTING, surface.setting, strict=True))
    if setting[LIGHT.name] == 0:
        return
    sums, counts = surface.of_clusters(clusters)
    for v, velocity in enumerate(surface.velocities_px_s):
        line = Line(setting[LIGHT.name], velocity)
        for e in np.flatnonzero(counts[:, :, v].any(axis=0)).tolist():
            at = {
                **setting,
                "exposure_s": surface.exposures_s[e],
                **dict(zip(VELOCITY, velocity, strict=True)),
            }
            row = pictures.get(_axes(at), {})
            known = (surface.saturated[e, v], surface.brightness[e, v])
            taken = (_known(row.get(name)) for name in ("applied_gain_db", "snr_db"))
            yield _Node(line, at, sums[:, e, v], counts[:, e, v], (*known, *taken))


def _plane(
    alike: Sequence[Surface],
    direction: tuple[float, float],
    clusters: tuple[str, ...],
    nodes: Sequence[_Node],
) -> Observed:
    """Nodes at one place, which are one experiment, as their mean."""
    places, which = same_places(np.array([place_of(node.at["exposure_s"], node.line) for node in nodes]))
    first = [int(np.argmax(which == place)) for place in range(len(places))]

    def means(values: Array) -> Array:
        """Per place of values (N, ...)."""
        mean: Array = np.stack(
            [np.mean(values[which == place], axis=0) for place in range(len(places))], axis=-1
        )
        return mean

    fullest = max(alike, key=lambda surface: surface.n_targets)
    saturated, brightness, gain_db, snr_db = means(np.array([node.known for node in nodes]))
    return Observed(
        model=fullest.model,
        group=fullest.group,
        setting=_further(fullest),
        direction=direction,
        places=places,
        at=tuple(nodes[index].at for index in first),
        clusters=clusters,
        sums=means(np.array([node.sums for node in nodes])),
        counts=means(np.array([node.counts for node in nodes])),
        saturated=saturated,
        brightness=brightness,
        gain_db=gain_db,
        snr_db=snr_db,
        n_targets=fullest.n_targets,
        clean=fullest.clean,
        reference=fullest.reference,
        kept=fullest.kept,
        withheld=too_little(fullest),
    )


def _further(surface: Surface) -> tuple[float, ...]:
    return tuple(value for name, value in zip(SETTING, surface.setting, strict=True) if name != LIGHT.name)


def _axes(row: Row) -> tuple[float, ...]:
    return tuple(row[name] for name in NAMES)


def _known(value: float | None) -> float:
    return np.nan if value is None else value
