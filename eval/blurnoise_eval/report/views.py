"""The views of a run: the score against one quantity, a line for each value of another.

Figures for print and the page's script loop over the same list.

Domain: exposures in s (drawn in ms), speeds in px/s, blur in px.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from blurnoise_eval.grid.axes import BLUR, EXPOSURE, MOVES, SPEED
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report.run import Place, RunData
from blurnoise_eval.report.settings import axis_label, word

EXPOSURES, VELOCITIES = 0, 1  # places of the first two of a run's axes; light and what else varies follow


@dataclass(frozen=True)
class View:
    """One way to draw the curves.

    word: of its tab on the page, title: of its axis. along: the axis of the run whose values follow one another on a
    line, lines: the axis that has a line for each value. panels: axes that have a panel of their own for each value
    in print; all others stand at their middle value. scale: "linear", "log", or "symlog": linear below 1, of blur.
    bands: whether intervals are bands. file: of the figure for print, empty for none. reading: how to read a line.
    """

    word: str
    title: str
    along: int
    lines: int
    panels: tuple[int, ...]
    file: str
    reading: str
    scale: str = "linear"
    bands: bool = False

    def x(self, data: RunData, at: Place) -> float:
        """Where a condition stands, in the unit of the axis."""
        x = data.axes[self.along].x[at[self.along]]
        return x * data.axes[EXPOSURES].values[at[EXPOSURES]] if self.scale == "symlog" else x

    def held(self, data: RunData) -> dict[int, int]:
        """The axes that are neither drawn nor have panels, at their middle value."""
        drawn = {self.along, self.lines, *self.panels}
        return {axis: each.count // 2 for axis, each in enumerate(data.axes) if axis not in drawn}


def views(data: RunData) -> list[View]:
    """The views of a run: over exposure, blur and speed, and over each axis that has several values besides."""
    further = tuple(range(2, len(data.axes)))
    speed = View(
        "speed", axis_label(SPEED), VELOCITIES, EXPOSURES, further, "",
        "Along a line the light is the same; only the speed, and with it the blur, changes.",
    )  # fmt: skip
    found = [
        View(
            "exposure", axis_label(EXPOSURE), EXPOSURES, VELOCITIES, further, "confidence_exposure.png",
            "Along a line the exposure grows: light, noise and blur all change together. Bars: the exposure window "
            "at each speed, pale where the pictures cannot tell; thin: the intervals of its ends.",
            "log" if data.axes[EXPOSURES].logarithmic else "linear", bands=True,
        ),
        View(
            "blur", axis_label(BLUR), VELOCITIES, EXPOSURES, further, "confidence_blur.png",
            "Along a line only the speed changes; from line to line the light per picture changes, too. "
            "The axis is linear below 1 px, logarithmic above.", "symlog",
        ),
        speed,
    ]  # fmt: skip
    for place in further:
        tested, name = data.axes[place], word(data.axes[place].axis)
        if tested.axis is MOVES and tested.count > 1:
            found.append(
                replace(
                    speed, word=name, lines=place, panels=(EXPOSURES,), file="score_moves.png", bands=True
                )
            )
        elif tested.count > 1:
            others = tuple(each for each in further if each != place)
            file = f"confidence_{tested.axis.name}.png" if tested.axis in data.settings.further else ""
            scale, reading = (
                ("log" if tested.logarithmic else "linear"),
                f"Along a line only the {name} changes.",
            )
            found.append(View(name, axis_label(tested.axis), place, EXPOSURES, others, file, reading, scale))
    return found


def joined(data: RunData, view: View) -> bool:
    """Whether points follow one another on a line; not where several velocities share a speed."""
    speeds = data.axes[VELOCITIES].x
    return view.along != VELOCITIES or len(set(speeds)) == len(speeds)


def ticks(data: RunData, view: View, most: int) -> list[tuple[float, str]] | None:
    """Places and texts of at most so many ticks where an axis has its tested values; None where it is continuous."""
    tested = data.axes[view.along]
    if view.along in (EXPOSURES, VELOCITIES) and not tested.named:
        return None
    shown = spread(range(tested.count), most)
    return [(tested.x[each], tested.texts[each] if tested.named else f"{tested.x[each]:g}") for each in shown]


def common_windows(windows_s: Sequence[Sequence[Sequence[float]]]) -> list[tuple[float, float]]:
    """The ranges, in s, that lie inside a window of every list; empty where there is none."""
    common = [(low, high) for low, high in windows_s[0]] if windows_s else []
    for windows in windows_s[1:]:
        overlaps = [(max(a, c), min(b, d)) for a, b in common for c, d in windows]
        common = [(low, high) for low, high in overlaps if low <= high]
    return common


def drawn(view: View, x: float) -> float:
    """Where x is on an axis that is linear in what is drawn, as the page's is: logarithms where it has them."""
    if view.scale == "log":
        return math.log10(x)
    return x if view.scale == "linear" or x < 1 else 1 + math.log10(x)
