"""Nodes: the experiments of a run, each once, and its score tables by node.

Domain: H, lux seconds on the scene; L, motion during the exposure, px; gain, dB. Conditions of equal H, L and gain
are one node, unless dark charge counts beside the other noise; then the exposure distinguishes them too. Where the
camera set its gain or exposure itself, the mean over the pictures counts, of the gain to a tenth of a dB.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import dark_electrons
from blurnoise_eval.answers.plane import places_of
from blurnoise_eval.answers.table import ORDER, ScoreTable
from blurnoise_eval.cameras import behind_one_filter
from blurnoise_eval.plan.axes import CORE, LIGHT, SETTING
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.run.run import Run
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import StoreError

Array = NDArray[np.float64]
Row = Mapping[str, Any]
_DARK_SHARE = 0.02  # of the variance in the dark, from which dark charge distinguishes exposures
_DIGITS = 6  # significant digits by which H and L are equal


@dataclass(frozen=True, eq=False)
class Nodes:
    """N nodes of a run.

    conditions: the first of each node, its gain a number. node_at: the node of each of the run's conditions with
    light, by its values on the axes in ``ORDER``.
    """

    camera: Camera
    conditions: tuple[Conditions, ...]
    node_at: Mapping[tuple[float, ...], int]

    def __len__(self) -> int:
        return len(self.conditions)

    @property
    def figures(self) -> dict[str, Array]:
        """(N,) by name, as nodes.csv has them: H, L and gain."""
        return {
            "light_lux_s": np.array([at.exposure_s * at.illuminance_lux for at in self.conditions]),
            "blur_px": np.array([at.blur_px for at in self.conditions]),
            "gain_db": np.array([at.stated["gain_db"] for at in self.conditions]),
        }

    @property
    def places(self) -> Array:
        """(N, 2) on the plane of :mod:`blurnoise_eval.answers.plane`."""
        figures = self.figures
        return places_of(1.0, figures["light_lux_s"], figures["blur_px"])

    def group(self, table: ScoreTable) -> ScoreTable:
        """A table of one condition per node, the sums of all conditions there; without the values of the axes."""
        columns = zip(*(table.conditions[name].tolist() for name in ORDER), strict=True)
        node = np.array([self.node_at.get(at, -1) for at in columns], np.int64)
        of_node = (node[:, None] == np.arange(len(self))).astype(float)
        unknown = np.full(len(self), np.nan)
        sums, counts = table.sums @ of_node, table.counts @ of_node
        table = replace(table, saturated=unknown, brightness=unknown, missed_pulses=None)
        return replace(table, conditions={}, sums=sums, counts=counts)


def nodes_of(run: Run) -> Nodes:
    """The nodes of a run. Raises :class:`StoreError` for a run without a condition with light, or one whose motion is
    not the straight motion of the whole picture, as which charts move."""
    where, plan = f"run = {str(run.folder)!r}", run.plan  # of a grid, or of the nodes that a search asked for
    others = {
        "targets or background move separately": plan.cuts,
        "its camera drives": plan.vehicle is not None,
        "its pictures follow a trajectory": plan.trajectory is not None,
        "it has lamps": plan.lamps is not None,
        "its camera takes several captures": bool(run.camera.captures),
    }
    if reason := next((text for text, holds in others.items() if holds), None):
        raise StoreError(
            f"{where}: {reason}; maps need a run with straight motion of the whole picture, in one capture"
        )
    nodes = nodes_at(queries.exposed_conditions(run.store), run.camera, list(plan.grid))
    if not len(nodes):
        raise StoreError(f"{where}: has no pictures with light")
    return nodes


def nodes_at(rows: Iterable[Row], camera: Camera, planned: Sequence[str]) -> Nodes:
    """The nodes of the store's conditions. planned: axes on which the plan has values, in place of the camera's."""
    lit = [row for row in rows if row["exposure_s"] * row[LIGHT.name] > 0]
    names = {*CORE, *planned} - {"gain_db"}
    every = [
        Conditions(**{name: row[name] for name in names}, gain_db=round(row["applied_gain_db"] or 0.0, 1))
        for row in lit
    ]
    by_exposure = _dark_charge_counts(behind_one_filter(camera), every)
    keys = [_key(at, by_exposure) for at in every]
    number = {key: place for place, key in enumerate(dict.fromkeys(keys))}
    first = dict(zip(reversed(keys), reversed(every), strict=True))
    node_at = {tuple(row[name] for name in ORDER): number[key] for row, key in zip(lit, keys, strict=True)}
    return Nodes(camera, tuple(first[key] for key in number), node_at)


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
