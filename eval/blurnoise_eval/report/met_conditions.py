"""The conditions that a run has met, and its cameras, as :mod:`blurnoise.training.table` reads them for training.

Units are in the names; gains that auto-exposure sets are "auto".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from blurnoise.camera import Camera
from blurnoise_eval.answers.rows import RecommendationRow
from blurnoise_eval.plan.axes import AXES, EGO, EGO_SPEED, GAIN, SETTING, SPEED, named
from blurnoise_eval.plan.conditions import with_lens
from blurnoise_eval.store.rows import ScoreRow
from blurnoise_eval.system.tables import plain

_LENS = {each.name: each.into.partition(".")[2] for each in AXES if each.into.startswith("camera.")}
_LIGHT = [name for name in SETTING if name not in (GAIN.name, EGO.name)]


def met_conditions(
    rows: Sequence[ScoreRow],
    manifest: Mapping[str, Any],
    recommendations: Sequence[RecommendationRow] = (),
) -> dict[str, Any]:
    """The contents of conditions.json, from a run's scores, rows of axes for each model, its manifest with its plan,
    and its recommendations, see :func:`~blurnoise_eval.answers.recommendation.recommendations`."""
    recommended = {
        (*(row.conditions[name] for name in _LIGHT), row.speed, row.exposure_s, row.conditions[GAIN.name])
        for row in recommendations
        if row.scope == "condition"
    }
    plan = manifest["plan"]
    stated = sorted({*plan.get("grid", {}), *plan.get("further", {})} & {*_LENS})
    camera = Camera.from_dict(manifest["camera"])
    conditions: dict[tuple[tuple[str, Any], ...], float | None] = {}
    cameras: dict[Camera, int] = {}
    for row in rows:
        at = row.conditions
        if at.original:
            continue
        of_camera = with_lens(camera, **{_LENS[name]: at[name] for name in stated})
        met = named({axis.name: at[axis.name] for axis in AXES if axis.name not in _LENS})
        met = {name: plain(value) for name, value in met.items()}
        met["camera"] = cameras.setdefault(of_camera, len(cameras))
        speed = (EGO_SPEED if at[EGO.name] else SPEED).of(at)
        key = *(at[name] for name in _LIGHT), speed, at.exposure_s
        met["recommended"] = not recommended.isdisjoint({(*key, at[GAIN.name]), (*key, None)})
        conditions[tuple(met.items())] = row.saturated_share
    objects = plan.get("objects", {})
    drives = any(row.conditions[EGO.name] for row in rows)
    return {
        "cameras": [each.to_dict() for each in cameras],
        "auto_exposure": plan.get("auto_exposure"),
        "speeds": objects.get("speeds"),
        **{name: plan.get(name) for name in ("trajectory", "grey_anchor", "picture_tone")},
        "ego": plan.get("ego") if drives else None,  # a vehicle may stand there for its headlamps alone
        **{name: plan[name] for name in ("lamps", "hdr_white") if name in plan},
        "conditions": [{**dict(each), "saturated": share} for each, share in conditions.items()],
    }
