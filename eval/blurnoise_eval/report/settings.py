"""The settings of a run: where every axis but exposure and velocity stands, and the words for it.

Domain: values in the units of the axes' columns. A setting names the light, and what else varies in the run;
what is held at one value is said once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from blurnoise_eval.grid.axes import (
    BLUR,
    EGO,
    EXPOSURE,
    LIGHT,
    SETTING_AXES,
    Axis,
    Coordinate,
    velocity_of,
    velocity_text,
)

Setting = tuple[float, ...]  # a value per axis of Settings.axes


@dataclass(frozen=True)
class Settings:
    """The axes that tell the settings of a run apart, the settings in order, and the values that are held.

    axes: the light, and every other axis but exposure and velocity that has several values in the run.
    """

    axes: tuple[Axis, ...]
    every: tuple[Setting, ...]
    held: tuple[tuple[Axis, float], ...] = ()

    @property
    def further(self) -> tuple[Axis, ...]:
        """The axes that vary besides exposure, velocity and light."""
        return tuple(axis for axis in self.axes if axis is not LIGHT)

    def of(self, row: Mapping[str, Any]) -> Setting:
        """The setting of a row of answers, curves, scores or examples."""
        return tuple(row[axis.name] for axis in self.axes)

    def text(self, setting: Setting) -> str:
        """'50 lux · 85 °C · f/2.8'."""
        return " · ".join(axis.text(value) for axis, value in zip(self.axes, setting, strict=True))

    def without(self, axis: Axis) -> Settings:
        """The settings as they are where ``axis`` is drawn against."""
        place = self.axes.index(axis)
        left = dict.fromkeys(setting[:place] + setting[place + 1 :] for setting in self.every)
        return Settings(tuple(each for each in self.axes if each is not axis), tuple(left), self.held)

    def values(self, axis: Axis) -> list[float]:
        """What was tested on one of the axes, in order."""
        place = self.axes.index(axis)
        return sorted({setting[place] for setting in self.every})

    def condition_text(self, row: Mapping[str, Any]) -> str:
        """'5 ms · 100 lux · 400 px/s · blur 2 px', what else varies before the blur; or 'untouched picture'.

        Before a camera that drives every place has a blur of its own: '5 ms · 100 lux · 50 km/h'.
        """
        if row["clean"]:
            return "untouched picture"
        parts = [EXPOSURE.text(row["exposure_s"]), LIGHT.text(row[LIGHT.name])]
        further = [axis.text(row[axis.name]) for axis in self.further]
        if row[EGO.name]:  # where no blur is the picture's
            return " · ".join([*parts, *further])
        return " · ".join([*parts, velocity_text(velocity_of(row)), *further, BLUR.text(row["blur_px"])])

    def held_text(self) -> str:
        """Where the axes stand that do not vary: '25 °C · f/2.8'."""
        return " · ".join(axis.text(value) for axis, value in self.held)

    def special_text(self, camera: Mapping[str, Any]) -> str:
        """The same of those that stand elsewhere than they would if nobody had stated them; may be empty."""
        return " · ".join(axis.text(value) for axis, value in self.held if _stated(axis, value, camera))


def settings_of(rows: Iterable[Mapping[str, Any]]) -> Settings:
    """The settings of exposed rows; light alone names them where nothing else varies."""
    every = list(rows)
    values = {axis: {row[axis.name] for row in every} for axis in SETTING_AXES}
    axes = tuple(axis for axis in SETTING_AXES if axis is LIGHT or len(values[axis]) > 1)
    found = sorted({tuple(row[axis.name] for axis in axes) for row in every})
    held = tuple((axis, next(iter(values[axis]))) for axis in SETTING_AXES if axis not in axes and every)
    return Settings(axes, tuple(found), held)


def word(axis: Axis | Coordinate) -> str:
    """The axis in running text: 'light', 'f-number', 'temperature'."""
    return axis.title.split()[-1].lower()


def axis_label(axis: Axis | Coordinate) -> str:
    """Title and unit for the axis of a figure: 'Exposure / ms', 'Speed / (px/s)', 'f-number'."""
    unit = f"({axis.unit})" if "/" in axis.unit else axis.unit
    return f"{axis.title} / {unit}" if unit else axis.title


def _stated(axis: Axis, value: float, camera: Mapping[str, Any]) -> bool:
    field = axis.into.rpartition(".")[2]
    own: Any = SimpleNamespace(**{field: value, **camera})  # a camera as far as the run has it
    return axis.own(own) != value
