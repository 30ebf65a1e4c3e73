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
from blurnoise_eval.plan.axes import EXPOSURE, LIGHT, Axis
from blurnoise_eval.plots.style import line_colours, spread
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import axis_label
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
    """The mean score, with a line for each light, speed or model. x, y: place and text of the ticks; level: the
    height of the criterion."""

    title: str
    x_title: str
    lines: tuple[Line, ...]
    x: tuple[tuple[float, str], ...]
    y: tuple[tuple[float, str], ...]
    level: float


@dataclass(frozen=True)
class _Drawn:
    """What is drawn. of: what a title begins with; over: and ends with; ticks: values of the axis to choose from;
    curves: by their names the scores, and the exposure to use with its score."""

    of: str
    over: str
    axis: Axis
    ticks: Sequence[float]
    curves: dict[str, tuple[dict[float, float], Place | None]]


def main_figure(data: RunData, model: str | None) -> Figure | None:
    """The figure of one model over the exposure, a line for each light, or speed where there is one light.

    Of one exposure it is over the light, a line for each model, or speed where there is one model. None where nothing
    can be compared.
    """
    drawn = _over_light(data) if len(data.axes[0].values) == 1 else _over_exposure(data, model)
    curves = {name: curve for name, curve in drawn.curves.items() if len(curve[0]) > 1}
    every = sorted({at for means, _ in curves.values() for at in means})
    if not every or not all(0 < at < math.inf for at in every):
        return None
    most = max(1.0, *(value for means, _ in curves.values() for value in means.values()))
    low, high = math.log(every[0]), math.log(every[-1])

    def place(at: float, value: float) -> Place:
        share = (math.log(at) - low) / (high - low)
        across, up = share * (WIDTH - LEFT - RIGHT), (1 - value / most) * (HEIGHT - TOP - BOTTOM)
        return round(LEFT + across, 1), round(TOP + up, 1)

    colours = zip(
        line_colours("viridis", len(curves)), line_colours("viridis", len(curves), dark=True), strict=True
    )
    lines = tuple(
        Line(name, *both, tuple(place(*each) for each in sorted(means.items())), chosen and place(*chosen))
        for (name, (means, chosen)), both in zip(curves.items(), colours, strict=True)
    )
    shown = spread([at for at in drawn.ticks if every[0] <= at <= every[-1]], MOST_TICKS)
    ticks = tuple((place(at, 0)[0], f"{drawn.axis.shown(at):g}") for at in shown)
    heights = tuple((place(every[0], value)[1], f"{value:g}") for value in (0.0, 0.5, 1.0))
    title = drawn.of + data.criterion.title + drawn.over
    title = title if drawn.of else title[0].upper() + title[1:]
    level = place(every[0], data.criterion.level)[1]
    return Figure(title, axis_label(drawn.axis), lines, ticks, heights, level)


def _over_exposure(data: RunData, model: str | None) -> _Drawn:
    by_speed = len(data.settings.every) == 1

    def line_of(at: AxisValues) -> tuple[float, ...]:
        return (round(float(data.speed.of(at)), 6),) if by_speed else data.settings.of(at)

    def name_of(setting: tuple[float, ...]) -> str:
        if by_speed:
            return data.speed.text(setting[0])
        axes = zip(data.settings.axes, setting, strict=True)
        return " · ".join(data.settings.short_text(axis, value) for axis, value in axes)

    answers: dict[tuple[float, ...], list[AnswerRow]] = {}
    for answer in data.answers:
        if answer.model == model:
            answers.setdefault(line_of(answer.conditions), []).append(answer)
    chosen = {
        (round(row.speed or 0.0, 6),) if by_speed else data.settings.of(row.conditions): row
        for row in data.recommendations
        if row.model == model and row.scope == ("condition" if by_speed else "light")
    }
    curves = dict[str, tuple[dict[float, float], Place | None]]()
    for setting in spread(sorted(answers), MOST_LINES):
        means, use = _means(answers[setting]), chosen.get(setting)
        # With the score of the table, which is below the line: corrected for having been chosen.
        dot = (use.exposure_s, use.score.known) if use and use.exposure_s in means else None
        curves[name_of(setting)] = means, dot
    over = f" over the exposure, mean of {'' if by_speed else 'speeds and '}kinds of target"
    of = f"{model}: " if len(data.model_names) > 1 else ""
    return _Drawn(of, over, EXPOSURE, data.axes[0].values[: data.axes[0].count], curves)


def _over_light(data: RunData) -> _Drawn:
    compared = len(data.model_names) > 1
    scores = dict[str, dict[float, list[float]]]()
    for answer in data.answers:
        name = (
            answer.model if compared else data.speed.text(round(float(data.speed.of(answer.conditions)), 6))
        )
        at = scores.setdefault(name, {}).setdefault(float(answer.conditions[LIGHT.name]), [])
        at += [value for value in answer.confidence if value == value]
    curves: dict[str, tuple[dict[float, float], Place | None]] = {
        name: ({lux: sum(found) / len(found) for lux, found in scores[name].items() if found}, None)
        for name in spread(list(scores), MOST_LINES)
    }
    exposure = EXPOSURE.text(data.axes[0].values[0])
    speeds = "speeds and " if compared and data.axes[1].count > 1 else ""
    over = f" at {exposure} over the light, mean of {speeds}kinds of target"
    lights = sorted({lux for means, _ in curves.values() for lux in means})
    return _Drawn("", over, LIGHT, lights, curves)


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
