"""The settings of a run: the values of every axis but exposure and velocity, and the words for them.

Domain: values in the units of the axes' columns. A setting names the light, and what else varies in the run; what is
held at one value is said once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from blurnoise_eval.grid import axes as of_grid
from blurnoise_eval.grid.axes import BLUR, EGO, EXPOSURE, LIGHT, Axis, Coordinate

Setting = tuple[float, ...]  # a value per axis of Settings.axes


@dataclass(frozen=True)
class Settings:
    """The settings of a run in order, and the axes and values that are held.

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

        Before a camera that drives every place has another blur: '5 ms · 100 lux · 50 km/h'.
        """
        if row["clean"]:
            return "untouched picture"
        parts = [EXPOSURE.text(row["exposure_s"]), LIGHT.text(row[LIGHT.name])]
        further = [axis.text(row[axis.name]) for axis in self.further]
        if not row[EGO.name]:
            motion = of_grid.velocity_text(of_grid.velocity_of(row))
            further = [motion, *further, BLUR.text(row["blur_px"])]
        return " · ".join([*parts, *further])

    def held_text(self, unlike: Mapping[str, Any] | None = None) -> str:
        """The axes that do not vary: '25 °C · f/2.8'; of these only what differs from a camera's own values."""
        fields = {axis.into.rpartition(".")[2]: value for axis, value in self.held}
        camera: Any = SimpleNamespace(**{**fields, **(unlike or {})})
        kept = [(axis, value) for axis, value in self.held if unlike is None or axis.own(camera) != value]
        return " · ".join(axis.text(value) for axis, value in kept)


def settings_of(rows: Iterable[Mapping[str, Any]]) -> Settings:
    """The settings of exposed rows; light alone names them where nothing else varies."""
    every = list(rows)
    values = {axis: {row[axis.name] for row in every} for axis in of_grid.SETTING_AXES}
    axes = tuple(axis for axis in values if axis is LIGHT or len(values[axis]) > 1)
    found = sorted({tuple(row[axis.name] for axis in axes) for row in every})
    held = tuple((axis, next(iter(values[axis]))) for axis in values if axis not in axes and every)
    return Settings(axes, tuple(found), held)


def word(axis: Axis | Coordinate) -> str:
    """The axis in running text: 'light', 'f-number', 'temperature'."""
    return axis.title.split()[-1].lower()


def axis_label(axis: Axis | Coordinate) -> str:
    """Title and unit for the axis of a figure: 'Exposure / ms', 'Speed / (px/s)', 'f-number'."""
    unit = f"({axis.unit})" if "/" in axis.unit else axis.unit
    return f"{axis.title} / {unit}" if unit else axis.title
