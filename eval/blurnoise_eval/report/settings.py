"""The axes of a run with the tested values, and their names in text.

Domain: values in the units of the axes' columns. A setting names the light, and what else varies in the run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from blurnoise_eval.plan.axes import (
    BLUR,
    EGO,
    EXPOSURE,
    LIGHT,
    LIT,
    SETTING_AXES,
    Axis,
    Coordinate,
    velocity_text,
)
from blurnoise_eval.report.lights import NamedLight
from blurnoise_eval.store.columns import AxisValues
from blurnoise_eval.store.rows import CellRow

Setting = tuple[float, ...]  # a value per axis of TestedSettings.axes


@dataclass(frozen=True)
class Tested:
    """One axis of a run.

    values: what was tested, as rows have it, of velocities (x, y) px/s. x: where each is drawn, in the axis's unit;
    side by side (0, 1, ...), hence ``named``, where they are names or left to the camera. count: so many of them are
    of the grid; exposures beyond them refine a few conditions only. short: the texts without what goes
    with them, where there is something.
    """

    axis: Axis | Coordinate
    values: tuple[Any, ...]
    x: tuple[float, ...]
    texts: tuple[str, ...]
    count: int
    named: bool = False
    short: tuple[str, ...] = ()

    @staticmethod
    def of(axis: Axis, values: Iterable[float], count: int | None = None) -> Tested:
        """Values on one axis; ``count`` as above, by default all."""
        every = tuple(values)
        named = bool(axis.choices) or not all(map(math.isfinite, every))
        x = tuple(map(float, range(len(every)))) if named else tuple(map(axis.shown, every))
        return Tested(
            axis, every, x, tuple(map(axis.text, every)), len(every) if count is None else count, named
        )

    @property
    def logarithmic(self) -> bool:
        """Whether it is drawn so."""
        return self.axis.logarithmic and not self.named and min(self.x, default=0.0) > 0


class TestedSettings:
    """The settings of conditions, in order.

    axes: the light, and every other axis but exposure and velocity that has several values; further: these without
    the light. of_light: axes of several values that go with the light, as the spectra of named lights do. held: the
    text of what does not vary, '25 °C · f/2.8'. names: of lights by lux, with what goes with them.
    """

    def __init__(self, conditions: Iterable[AxisValues], names: Mapping[float, NamedLight] = {}) -> None:
        every, self._names = list(conditions), names
        values = {axis: {at[axis.name] for at in every} for axis in SETTING_AXES}
        of_lux = {at[LIGHT.name]: at for at in every}
        several = [axis for axis in values if axis is LIGHT or len(values[axis]) > 1]
        lit = [axis for axis in several if axis.name in LIT]
        self.of_light = tuple(
            axis for axis in lit if all(at[axis.name] == of_lux[at[LIGHT.name]][axis.name] for at in every)
        )
        texts = {
            lux: ", ".join([LIGHT.text(lux), *(axis.text(at[axis.name]) for axis in self.of_light)])
            for lux, at in of_lux.items()
        }
        self._lights = {lux: str(names.get(lux, text)) for lux, text in texts.items()}
        self.axes = tuple(axis for axis in several if axis not in self.of_light)
        self.further = tuple(axis for axis in self.axes if axis is not LIGHT)
        self.every = tuple(sorted(set(map(self.of, every))))
        held = [axis for axis in values if axis not in (*several, *self.of_light) and every]
        self.held = " · ".join(axis.text(*values[axis]) for axis in held)

    def value_text(self, axis: Axis, value: float) -> str:
        """A value on an axis; of the light with all that goes with it, 'street: 1 lux, led-4000, low beam'."""
        return self._lights.get(value, axis.text(value)) if axis is LIGHT else axis.text(value)

    def short_text(self, axis: Axis, value: float) -> str:
        """A value by what tells it from others, 'street, 1 lux': the light's spectrum and headlamps go with it."""
        named = axis is LIGHT and value in self._names
        return f"{self._names[value].name}, {axis.text(value)}" if named else axis.text(value)

    def of(self, conditions: AxisValues) -> Setting:
        """The setting of some conditions."""
        return tuple(conditions[axis.name] for axis in self.axes)

    def text(self, setting: Setting) -> str:
        """'50 lux · 85 °C · f/2.8'."""
        return " · ".join(
            self.value_text(axis, value) for axis, value in zip(self.axes, setting, strict=True)
        )

    def condition_text(self, cell: CellRow, *, short: bool = False) -> str:
        """'5 ms · 100 lux · 400 px/s · blur 2 px', what else varies before the blur; or 'original picture'.

        Before a camera that drives every place has another blur: '5 ms · 100 lux · 50 km/h'. short: lights
        without what goes with them.
        """
        at = cell.conditions
        if at.original:
            return "original picture"
        further = [axis.text(at[axis.name]) for axis in self.further]
        if not at[EGO.name]:
            further = [velocity_text(at.velocity_px_s), *further, BLUR.text(cell.blur_px or 0.0)]
        light = (self.short_text if short else self.value_text)(LIGHT, at.illuminance_lux)
        return " · ".join([EXPOSURE.text(at.exposure_s), light, *further])


def word(axis: Axis | Coordinate) -> str:
    """The axis in running text: 'light', 'f-number', 'temperature'."""
    return axis.title.split()[-1].lower()


def axis_label(axis: Axis | Coordinate) -> str:
    """Title and unit for the axis of a figure: 'Exposure / ms', 'Speed / (px/s)', 'f-number'."""
    unit = f"({axis.unit})" if "/" in axis.unit else axis.unit
    return f"{axis.title} / {unit}" if unit else axis.title
