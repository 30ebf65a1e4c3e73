"""Standings: what each of several models reaches where every condition has its best exposure, and the differences.

Domain: values in the unit of the surfaces; a condition is a target group, a setting and a velocity. Only conditions
that all models were measured under count, all alike; clusters of one name are the same pictures, so differences are
paired.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.scoring import certainty
from blurnoise_eval.scoring.surfaces import Surface

_OWN, _BEHIND = ("best_value", "best_low", "best_high"), ("behind", "behind_low", "behind_high")
COLUMNS = (*_OWN, *_BEHIND, "standing_pictures", "pictures_to_tell_behind")
_MOST_PICTURES = 9999  # that are asked for
Array = NDArray[np.float64]
Condition = tuple[Any, ...]


@dataclass
class AtBest:
    """One model under every condition at the tested exposure that is best there: the value, and what each cluster's
    departure from it contributes, by the cluster's name."""

    values: dict[Condition, float] = field(default_factory=dict)
    departures: dict[Condition, dict[str, float]] = field(default_factory=dict)

    def add(self, surface: Surface) -> None:
        """Take in a surface of this model."""
        for v, velocity in enumerate(surface.velocities_px_s):
            mean = surface.mean[:, v]
            if not np.isfinite(mean).any():
                continue
            best = int(np.nanargmax(mean))
            away = certainty.departures(surface.sums[:, best, v], surface.counts[:, best, v])
            condition = surface.group, surface.setting, velocity
            known = np.isfinite(away)
            contributed = (away[known] / known.sum()).tolist()
            names = [name for name, there in zip(surface.clusters, known.tolist(), strict=True) if there]
            self.values[condition] = float(mean[best])
            self.departures[condition] = dict(zip(names, contributed, strict=True))


def standings(models: Mapping[str, AtBest]) -> dict[str, dict[str, float | int | None]]:
    """By model, columns of its row: best_value, its mean over the conditions, best_low and best_high; behind, what it
    lacks of the model with the highest (None for that one), behind_low and behind_high; standing_pictures, how many
    clusters say so; pictures_to_tell_behind, how many would tell that difference, None where it is told or takes more
    than 9999.

    Intervals at 95 % over clusters, None below 8. The choice of exposures is not in them: at a best one it changes
    nothing in first order. All None without a common condition.
    """
    shared = [set(model.values) for model in models.values()]
    common = sorted(set.intersection(*shared), key=repr) if shared else []
    if not common:
        return {name: dict.fromkeys(COLUMNS) for name in models}
    names = list(_names(models.values(), common))
    value = {name: float(np.mean([model.values[each] for each in common])) for name, model in models.items()}
    away = {name: _away(model, common, names) for name, model in models.items()}
    first = max(value, key=lambda name: value[name])
    rows: dict[str, dict[str, float | int | None]] = {}
    for name in models:
        row: dict[str, float | int | None] = dict.fromkeys(COLUMNS)
        low, high = _ends(value[name], away[name])
        row |= {
            "best_value": value[name],
            "best_low": None if low is None else max(low, 0.0),
            "best_high": high,
        }
        row |= {"standing_pictures": len(names)}
        if name != first:
            behind, apart = value[first] - value[name], away[first] - away[name]
            low, high = _ends(behind, apart)
            row |= {"behind": behind, "behind_low": low, "behind_high": high}
            row |= {
                "pictures_to_tell_behind": None if low is not None and low > 0 else _to_tell(behind, apart)
            }
        rows[name] = row
    return rows


def _names(models: Iterable[AtBest], common: Iterable[Condition]) -> dict[str, None]:
    conditions = list(common)
    return dict.fromkeys(name for model in models for each in conditions for name in model.departures[each])


def _away(model: AtBest, common: list[Condition], names: list[str]) -> Array:
    """Each cluster's departure of the mean over the conditions; one without such targets adds nothing."""
    place = {name: index for index, name in enumerate(names)}
    total = np.zeros(len(names))
    for condition in common:
        for name, each in model.departures[condition].items():
            total[place[name]] += each
    return total * len(names) / len(common)


def _ends(value: float, away: Array) -> tuple[float | None, float | None]:
    low, high = (float(end) for end in certainty.interval(value, away))
    return (low, high) if math.isfinite(low) and math.isfinite(high) else (None, None)


def _to_tell(difference: float, away: Array) -> int | None:
    """How many clusters like these put Student's interval off 0."""
    spread = float(np.std(away, ddof=1)) if len(away) > 1 else math.nan
    if not (difference > 0 and math.isfinite(spread)):
        return None
    fewest = max(certainty.FEWEST, len(away) + 1)
    wanted = (float(certainty.critical(max(fewest, 1000))) * spread / difference) ** 2  # of many
    n = max(fewest, math.ceil(wanted))
    while n <= _MOST_PICTURES and float(certainty.critical(n)) * spread > difference * math.sqrt(n):
        n += 1
    return n if n <= _MOST_PICTURES else None
