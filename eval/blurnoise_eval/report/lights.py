"""The named lights of a run, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from blurnoise.light.lights import light_text
from blurnoise_eval.answers.choosing import SATURATED
from blurnoise_eval.plan.axes import LIT, axis


class NamedLight(NamedTuple):
    """A light's name, and all of it in words: 'street: 1 lux, led-4000, low beam'."""

    name: str
    text: str

    def __str__(self) -> str:
        return self.text


def lights_of_run(manifest: Mapping[str, Any]) -> dict[float, NamedLight]:
    """The named lights of a run's plan by their lux; spectrum and headlamps that the plan states for all are theirs.

    >>> street = {"name": "street", "lux": 1.0, "illuminant": "led-4000", "headlamp": "low"}
    >>> [str(light) for light in lights_of_run({"plan": {"light": [street], "grid": {"illuminant": [9.0]}}}).values()]
    ['street: 1 lux, sodium, low beam']
    """
    plan = manifest.get("plan", {})
    stated = {name: plan.get("grid", {}).get(name, ()) for name in LIT}
    own: dict[str, Any] = {
        name: axis(name).choice(values[0]) for name, values in stated.items() if len(values) == 1
    }
    lights = [{**each, **own} for each in plan.get("light", ())]
    return {
        each["lux"]: NamedLight(
            each["name"], light_text(*(each[name] for name in ("name", "lux", "illuminant", "headlamp")))
        )
        for each in lights
    }


def saturates(share: float, at: str = "") -> str:
    """A sentence on how much of a picture saturates, "" if that is little. at: where.

    >>> saturates(0.3, " at 20 lux"), saturates(0.02)
    (' It saturates 30 % of the picture at 20 lux.', '')
    """
    return f" It saturates {100 * share:.0f} % of the picture{at}." * (share > SATURATED)
