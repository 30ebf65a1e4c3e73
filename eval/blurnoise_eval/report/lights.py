"""The named lights of a run, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from blurnoise.light.lights import Light
from blurnoise_eval.plan.axes import LIT, axis


def lights_of_run(manifest: Mapping[str, Any]) -> dict[float, Light]:
    """The named lights of a run's plan by their lux; spectrum and headlamps that the plan states for all are theirs.

    >>> plan = {"light": [{"name": "street", "lux": 1.0, "illuminant": "led-4000"}], "grid": {"illuminant": [9.0]}}
    >>> [str(light) for light in lights_of_run({"plan": plan}).values()]
    ['street: 1 lux, sodium']
    """
    plan = manifest.get("plan", {})
    stated = {name: plan.get("grid", {}).get(name, ()) for name in LIT}
    own: dict[str, Any] = {
        name: axis(name).choice(values[0]) for name, values in stated.items() if len(values) == 1
    }
    return {each["lux"]: replace(Light(**each), **own) for each in plan.get("light", ())}
