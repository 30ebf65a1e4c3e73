"""The conditions that a run has met, and its cameras, as :mod:`blurnoise.exposure_table` reads them for training.

Units are in the names; gains that auto-exposure sets are "auto".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from blurnoise.camera import Camera
from blurnoise_eval.grid.axes import AUTOMATIC, AXES, CHOICES
from blurnoise_eval.grid.conditions import with_lens

_LENS = {each.name: each.into.partition(".")[2] for each in AXES if each.into.startswith("camera.")}


def met_conditions(rows: Sequence[Mapping[str, Any]], manifest: Mapping[str, Any]) -> dict[str, Any]:
    """What conditions.json holds, of a run's scores, rows of axes for each model, and its manifest with its plan."""
    plan = manifest["plan"]
    stated = {*plan.get("grid", {}), *plan.get("further", {})} & {*_LENS}
    camera = Camera.from_dict(manifest["camera"])
    conditions: dict[tuple[tuple[str, Any], ...], None] = {}
    cameras: dict[Camera, int] = {}
    for row in rows:
        if row["clean"]:
            continue
        own = with_lens(camera, **{_LENS[name]: row[name] for name in sorted(stated)})
        at = {each.name: _named(each.name, row[each.name]) for each in AXES if each.name not in _LENS}
        at["camera"] = cameras.setdefault(own, len(cameras))
        conditions[tuple(at.items())] = None
    return {
        "cameras": [each.to_dict() for each in cameras],
        "auto_exposure": plan.get("auto_exposure"),
        "speeds": plan.get("objects", {}).get("speeds") or plan.get("objects", {}).get("crossings"),
        **{name: manifest.get(name) for name in ("trajectory", "ego", "grey_anchor")},
        "conditions": [dict(each) for each in conditions],
    }


def _named(name: str, value: float) -> float | str:
    if value == AUTOMATIC:
        return "auto"
    return CHOICES[name][int(value)] if name in CHOICES else value
