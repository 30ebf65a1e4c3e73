"""The conditions that a run has met, and its cameras, as :mod:`blurnoise.training.table` reads them for training.

Units are in the names; gains that auto-exposure sets are "auto".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from blurnoise.camera import Camera
from blurnoise_eval.plan.axes import AXES, EGO, EGO_SPEED, GAIN, SETTING, SPEED, named
from blurnoise_eval.plan.conditions import with_lens
from blurnoise_eval.system.tables import plain

_LENS = {each.name: each.into.partition(".")[2] for each in AXES if each.into.startswith("camera.")}
_LIGHT = [name for name in SETTING if name not in (GAIN.name, EGO.name)]


def met_conditions(
    rows: Sequence[Mapping[str, Any]],
    manifest: Mapping[str, Any],
    recommendations: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """The contents of conditions.json, from a run's scores, rows of axes for each model, its manifest with its plan,
    and its recommendations, see :func:`~blurnoise_eval.answers.recommendation.recommendations`."""
    recommended = {
        (*(each[name] for name in _LIGHT), each["speed"], each["exposure_s"], each[GAIN.name])
        for each in recommendations
        if each["scope"] == "condition"
    }
    plan = manifest["plan"]
    stated = sorted({*plan.get("grid", {}), *plan.get("further", {})} & {*_LENS})
    camera = Camera.from_dict(manifest["camera"])
    conditions: dict[tuple[tuple[str, Any], ...], float | None] = {}
    cameras: dict[Camera, int] = {}
    for row in rows:
        if row["clean"]:
            continue
        own = with_lens(camera, **{_LENS[name]: row[name] for name in stated})
        at = {each.name: row[each.name] for each in AXES if each.name not in _LENS}
        at = {name: plain(value) for name, value in named(at).items()}
        at["camera"] = cameras.setdefault(own, len(cameras))
        speed = (EGO_SPEED if row[EGO.name] else SPEED).of(row)
        place = *(row[name] for name in _LIGHT), speed, row["exposure_s"]
        at["recommended"] = not recommended.isdisjoint({(*place, row[GAIN.name]), (*place, None)})
        conditions[tuple(at.items())] = row.get("saturated_share")
    objects = plan.get("objects", {})
    return {
        "cameras": [each.to_dict() for each in cameras],
        "auto_exposure": plan.get("auto_exposure"),
        "speeds": objects.get("speeds"),
        **{name: plan.get(name) for name in ("trajectory", "ego", "grey_anchor", "picture_tone")},
        **{name: plan[name] for name in ("lamps", "hdr_white") if name in plan},
        "conditions": [{**dict(each), "saturated": share} for each, share in conditions.items()],
    }
