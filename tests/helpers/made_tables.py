"""Score tables of made values: of rows as the store has them, or of arrays over exposures and velocities."""

from collections.abc import Mapping
from itertools import groupby
from typing import Any

import numpy as np
from blurnoise_eval.answers import curves
from blurnoise_eval.answers.table import ORDER, ScoreTable, table_of
from blurnoise_eval.plan.axes import NAMES
from blurnoise_eval.store.queries import TargetColumns
from numpy.typing import NDArray
from plans import OWN

Row = Mapping[str, Any]
Array = NDArray[np.float64]


def tables(
    target_rows,
    value_of=lambda row: row["confidence"],
    cluster_of=lambda picture: picture,
    *,
    clean_of=lambda row: None,
    kept=False,
):
    """One of each model and group of rows of exposed targets; value_of, clean_of: of a row, None where unknown."""

    def key(row):
        return row["model"], row["group"]

    for own, alike in groupby(sorted(target_rows, key=key), key):
        rows = list(alike)
        names = list(dict.fromkeys(row["image"] for row in rows))
        numbers = [names.index(row["image"]) for row in rows], [row["repeat"] for row in rows]
        value, clean = (np.array(list(map(of, rows)), float) for of in (value_of, clean_of))
        shown = [
            np.array([row.get(name) for row in rows], float)
            for name in ("saturated_share", "brightness", "missed_pulse")
        ]
        columns = TargetColumns(
            [], names, [], np.arange(len(rows)), np.array(numbers[0]), np.zeros(len(rows)), np.array(numbers[1]),
            np.array([row["target_id"] for row in rows]), *[value] * 5, *shown,
        )  # fmt: skip
        conditions = {name: np.array([row[name] for row in rows], float) for name in NAMES}
        found = table_of(*own, conditions, columns, value, clean, cluster_of, kept=kept)
        if found is not None:
            yield found


def curve(values, x, counts=1.0, *, logarithmic=True, **fields):
    """A curve of values (C, N), each of so many targets; fields: of its table."""
    each = np.broadcast_to(np.asarray(counts, float), values.shape)
    line = table((values * each)[:, :, None], x, counts=each[:, :, None], **fields)
    return curves.ScoreCurve(line, tuple(x), logarithmic)


def table(
    sums,
    exposures_s,
    velocities_px_s=((0.0, 0.0),),
    counts=1.0,
    *,
    saturated=0.0,
    brightness=0.4,
    at=None,
    **fields,
):
    """Of one setting, ``at`` on some axes. sums, counts: (C, E, V); saturated, brightness: (E, V)."""
    shape = sums.shape
    setting = {"illuminance_lux": 50.0, **OWN, **(at or {})}
    conditions = {name: np.full(shape[1:], setting.get(name, 0.0)).ravel() for name in ORDER}
    conditions["exposure_s"] = np.tile(np.asarray(exposures_s, float), shape[2])
    for number, name in enumerate(("velocity_x_px_s", "velocity_y_px_s")):
        conditions[name] = np.repeat([float(each[number]) for each in velocities_px_s], shape[1])
    given: dict[str, Any] = {"model": "m", "group": "g", "n_targets": shape[0]}
    given["clusters"] = tuple(f"p{place}" for place in range(shape[0]))
    return ScoreTable(
        conditions=conditions,
        sums=flat(sums),
        counts=flat(np.broadcast_to(np.asarray(counts, float), shape)),
        saturated=flat(np.broadcast_to(np.asarray(saturated, float), shape[1:])),
        brightness=flat(np.broadcast_to(np.asarray(brightness, float), shape[1:])),
        **(given | fields),
    )


def flat(values):
    """Values (..., E, V) as a table has them, (..., N)."""
    return np.swapaxes(values, -1, -2).reshape(*values.shape[:-2], -1)


def over(of, values):
    """Values (..., N) of a table of one setting, over its exposures and velocities, (..., E, V); NaN where it has
    none."""
    exposures, e = np.unique(of.conditions["exposure_s"], return_inverse=True)
    velocities = list(dict.fromkeys(of.velocities_px_s))
    v = np.array([velocities.index(each) for each in of.velocities_px_s])
    found = np.full((*values.shape[:-1], len(exposures), len(velocities)), np.nan)
    found[..., e, v] = values
    return found


def on_plane(places, sums, counts=1.0, **fields):
    """A plane of sums and counts (C, N) at places (N, 2)."""
    each = np.broadcast_to(np.asarray(counts, float), sums.shape)
    made = table(sums[..., None], np.ones(len(places)), counts=each[..., None], **fields)
    made.conditions["illuminance_lux"][:] = 2.0 ** places[:, 0]
    made.conditions["velocity_x_px_s"][:] = 2.0 ** places[:, 1]
    (plane,) = made.on_plane()
    return plane
