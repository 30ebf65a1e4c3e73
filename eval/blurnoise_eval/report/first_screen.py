"""The first screen of the page beside its answer: one figure as plain numbers, and two example pictures.

The figure is drawn by the page itself (SVG, whose colours are the page's), so that it follows dark mode, needs no
script and costs a few kB. Domain: scores in the criterion's unit over exposures in s; places in px of the drawing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

from blurnoise_eval.answers.choosing import SATURATED
from blurnoise_eval.answers.rows import AnswerRow
from blurnoise_eval.plan.axes import EXPOSURE
from blurnoise_eval.plots.style import line_colours, spread
from blurnoise_eval.report.run import RunData
from blurnoise_eval.store.columns import AxisValues
from blurnoise_eval.store.rows import CellRow, Example, ScoreRow

WIDTH, HEIGHT = 460, 250
LEFT, RIGHT, TOP, BOTTOM = 34, 10, 10, 44
"""Margins for the numbers at the axes."""
MOST_LINES, MOST_TICKS = 6, 7
MOST_EXAMPLES = 48
"""Examples among which the pair is chosen."""
_BLACK = 0.1
"""Mean brightness, coded by sRGB, of 1 % of the light of white: of less a screen in a bright room shows little."""
_ALL_NOISE_DB = -6.0
"""Signal to noise of a pixel from which on people see targets of 100: 5 / sqrt(100) (Rose, JOSA 38 (1948) 196)."""
Place = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """A line of the figure. name: of its setting; colour, by_night: on bright and dark paper; points: where it goes;
    chosen: the exposure to use and its score, None where there is none on the line."""

    name: str
    colour: str
    by_night: str
    points: tuple[Place, ...]
    chosen: Place | None


@dataclass(frozen=True)
class Figure:
    """The mean score over the exposure, a line for each light or speed. x, y: place and text of the ticks; level:
    the height of the criterion."""

    title: str
    x_title: str
    lines: tuple[Line, ...]
    x: tuple[tuple[float, str], ...]
    y: tuple[tuple[float, str], ...]
    level: float


def main_figure(data: RunData, model: str | None) -> Figure | None:
    """The figure of one model, a line for each speed where there is one light; None where no exposures can be
    compared."""
    by_speed = len(data.settings.every) == 1

    def line_of(at: AxisValues) -> tuple[float, ...]:
        return (round(float(data.speed.of(at)), 6),) if by_speed else data.settings.of(at)

    answers: dict[tuple[float, ...], list[AnswerRow]] = {}
    for answer in data.answers:
        if answer.model == model:
            answers.setdefault(line_of(answer.conditions), []).append(answer)
    means = {
        key: found for key in spread(sorted(answers), MOST_LINES) if len(found := _means(answers[key])) > 1
    }
    exposures = sorted({at for found in means.values() for at in found})
    if not exposures or not all(0 < at < math.inf for at in exposures):
        return None
    most = max(1.0, *(value for found in means.values() for value in found.values()))
    low, high = math.log(exposures[0]), math.log(exposures[-1])

    def x_of(exposure_s: float) -> float:
        share = (math.log(exposure_s) - low) / (high - low)
        return round(LEFT + share * (WIDTH - LEFT - RIGHT), 1)

    def y_of(value: float) -> float:
        return round(TOP + (1 - value / most) * (HEIGHT - TOP - BOTTOM), 1)

    chosen = {
        (round(row.speed or 0.0, 6),) if by_speed else data.settings.of(row.conditions): row
        for row in data.recommendations
        if row.model == model and row.scope == ("condition" if by_speed else "light")
    }
    colours = zip(
        line_colours("viridis", len(means)), line_colours("viridis", len(means), dark=True), strict=True
    )
    lines = []
    for (setting, found), (colour, by_night) in zip(means.items(), colours, strict=True):
        use = chosen.get(setting)
        # With the score of the table, which is below the line: corrected for having been chosen.
        dot = (x_of(use.exposure_s), y_of(use.score.known)) if use and use.exposure_s in found else None
        points = tuple((x_of(at), y_of(value)) for at, value in sorted(found.items()))
        if by_speed:
            name = data.speed.text(setting[0])
        else:
            axes = zip(data.settings.axes, setting, strict=True)
            name = " · ".join(data.settings.short_text(axis, value) for axis, value in axes)
        lines.append(Line(name, colour, by_night, points, dot))
    grid = [at for at in data.axes[0].values[: data.axes[0].count] if exposures[0] <= at <= exposures[-1]]
    ticks = tuple((x_of(at), f"{EXPOSURE.shown(at):g}") for at in spread(grid, MOST_TICKS))
    heights = tuple((y_of(value), f"{value:g}") for value in (0.0, 0.5, 1.0))
    title = data.criterion.title[0].upper() + data.criterion.title[1:]
    title = f"{model}: {data.criterion.title}" if len(data.model_names) > 1 else title
    title += f" over the exposure, mean of {'' if by_speed else 'speeds and '}kinds of target"
    return Figure(title, "Exposure / ms", tuple(lines), ticks, heights, y_of(data.criterion.level))


def _means(answers: Sequence[AnswerRow]) -> dict[float, float]:
    """The mean of some answers by exposure, s; at those that were tested in all of them."""
    rows = [
        {s: value for s, value in zip(answer.exposures_s, answer.confidence, strict=True) if value == value}
        for answer in answers
    ]
    common = set.intersection(*map(set, rows)) if rows else set()
    return {at: sum(row[at] for row in rows) / len(rows) for at in common}


def pair(data: RunData, model: str | None) -> list[Example]:
    """Two example pictures that show what the exposure does: the one in which more is found first; none where there
    are not two."""
    own = [each for each in data.examples if each.cell.model == model and not each.cell.conditions.original]
    known = [each for each in own if each.targets and each.cell.error is None]
    # A white picture says only that it is white.
    plain = [each for each in known if (each.cell.saturated_share or 0.0) <= SATURATED]
    pairs = permutations(spread(plain, MOST_EXAMPLES), 2)
    best = max(pairs, key=lambda both: _teaches(data, *both), default=None)
    return list(best or ())


def _teaches(data: RunData, one: Example, other: Example) -> tuple[float, ...]:
    """Greater is better: what only the exposure changes, where a person sees it, by night, and much of it."""
    a, b = one.cell.conditions, other.cell.conditions
    lost = _found(one, data.found_from) - _found(other, data.found_from)
    alike = one.cell.image == other.cell.image and data.settings.of(a) == data.settings.of(b)
    moves, differs = a.velocity_px_s == b.velocity_px_s, a.exposure_s != b.exposure_s
    seen = alike and differs and can_be_seen(one.cell) and can_be_seen(other.cell)
    longer = b.exposure_s > a.exposure_s
    return seen, lost > 0, alike, differs, moves, -a.illuminance_lux, longer, lost


def can_be_seen(row: CellRow | ScoreRow) -> bool:
    """Whether a person sees what is in a picture, or in those of a condition on average, as far as is known: it is
    neither white nor black, nor all noise."""
    dark = row.brightness is not None and row.brightness < _BLACK
    noisy = row.snr_db is not None and row.snr_db < _ALL_NOISE_DB
    return not (dark or noisy) and (row.saturated_share or 0.0) <= SATURATED


def _found(example: Example, threshold: float) -> int:
    return sum(target.confidence >= threshold for target in example.targets)
