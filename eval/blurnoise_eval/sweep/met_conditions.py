"""The conditions that a run has met, and its cameras, as :mod:`blurnoise.training.table` reads them for training.

Units are in the names; gains that auto-exposure sets are "auto".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise_eval.grid.axes import AUTOMATIC, AXES, CHOICES
from blurnoise_eval.grid.conditions import with_lens

_LENS = {each.name: each.into.partition(".")[2] for each in AXES if each.into.startswith("camera.")}


def met_conditions(
    rows: Sequence[Mapping[str, Any]],
    manifest: Mapping[str, Any],
    answers: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """What conditions.json holds, of a run's scores, rows of axes for each model, and its manifest with its plan.

    answers: as rows; an exposure that one of them recommends, or calls the best where none works, is recommended.
    """
    recommended = {(*_beside(each), each["recommended_s"] or each["best_s"]) for each in answers}
    plan = manifest["plan"]
    stated = {*plan.get("grid", {}), *plan.get("further", {})} & {*_LENS}
    camera = Camera.from_dict(manifest["camera"])
    conditions: dict[tuple[tuple[str, Any], ...], float | None] = {}
    cameras: dict[Camera, int] = {}
    for row in rows:
        if row["clean"]:
            continue
        own = with_lens(camera, **{_LENS[name]: row[name] for name in sorted(stated)})
        at = {each.name: _named(each.name, row[each.name]) for each in AXES if each.name not in _LENS}
        at["camera"] = cameras.setdefault(own, len(cameras))
        at["recommended"] = (*_beside(row), row["exposure_s"]) in recommended
        conditions[tuple(at.items())] = row.get("saturated")
    return {
        "cameras": [each.to_dict() for each in cameras],
        "auto_exposure": plan.get("auto_exposure"),
        "speeds": plan.get("objects", {}).get("speeds") or plan.get("objects", {}).get("crossings"),
        **{name: manifest.get(name) for name in ("trajectory", "ego", "grey_anchor")},
        "conditions": [{**dict(each), "saturated": share} for each, share in conditions.items()],
    }


def _beside(row: Mapping[str, Any]) -> tuple[float, ...]:
    """All axes but the exposure."""
    return tuple(row[each.name] for each in AXES if each.name != "exposure_s")


def _named(name: str, value: float) -> float | str:
    if value == AUTOMATIC:
        return "auto"
    return CHOICES[name][int(value)] if name in CHOICES else value
