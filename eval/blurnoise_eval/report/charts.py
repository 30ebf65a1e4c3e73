"""The charts of a run as plain numbers. The page's script draws them, and :mod:`.figures` draws them for print.

Models, groups and measures are given by index, never by name. Domain: scores in their units, exposures in s and ms,
speeds in px/s, blur in px; other axes in the units of figures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Any

from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.plan.axes import BLUR, MOVES
from blurnoise_eval.plots.style import line_colours, spread
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import axis_label, word
from blurnoise_eval.scoring.scores import Score, of_conditions
from blurnoise_eval.store.columns import UNKNOWN, WithInterval
from blurnoise_eval.store.rows import ScoreRow
from blurnoise_eval.system.tables import finite

EXPOSURES, VELOCITIES = 0, 1  # places of the first two of a run's axes; light and what else varies follow
MAX_TICKS = 8  # of an axis whose tested values are its ticks
_BLUR_TICKS = (0, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
OF_PICTURES: tuple[tuple[str, Callable[[ScoreRow], float | None]], ...] = (
    ("Gain / dB", attrgetter("applied_gain_db")),
    ("SNR of the mean light / dB", attrgetter("snr_db")),
    ("Mean brightness of the picture, 0-1", attrgetter("brightness")),
    ("Share of saturated pixels", attrgetter("saturated_share")),
)
"""What distinguishes a dark picture from a noisy one: its title, and the column of scores."""
OF_LAMPS = ("Share of pictures that miss the pulsed lamp", attrgetter("lamps.missed_pulse_share"))
"""The same of a run with a pulsed lamp."""
Row = dict[str, Any]


@dataclass(frozen=True)
class ChartView:
    """One way to draw the curves, on the page and as a figure.

    word: its name on the page, title: of its axis, file: of its figure. along: the axis of the run whose values
    follow one another on a line, lines: the axis that has a line for each value. panels: axes that have a panel of
    their own for each value in print; all others stand at their middle value. scale: "linear", "log", or "symlog":
    linear below 1, of blur. bands: whether intervals are bands. reading: how to read a line.
    """

    word: str
    title: str
    file: str
    along: int
    lines: int
    panels: tuple[int, ...]
    reading: str
    scale: str = "linear"
    bands: bool = False


def views(data: RunData) -> list[ChartView]:
    """The views of a run: over exposure and blur, and over each axis that has several values besides."""
    further = tuple(range(2, len(data.axes)))
    exposures, speeds = data.axes[:2]
    listed = [
        ChartView(
            "exposure", axis_label(exposures.axis), "confidence_exposure.png", EXPOSURES, VELOCITIES, further,
            "Along a line the exposure grows, and with it light and blur. The bars below 0 show the exposure window "
            "at each speed (pale: cannot tell), with the 95 % intervals of its ends as thin lines and the "
            "recommended exposure as a tick.",
            "log" if exposures.logarithmic else "linear", bands=True,
        ),
        ChartView(
            "blur", axis_label(BLUR), "confidence_blur.png", VELOCITIES, EXPOSURES, further,
            "Along a line only the speed changes. Each line has another exposure, and so another amount of light. "
            "The axis is linear below 1 px and logarithmic above.", "symlog",
        ),
    ]  # fmt: skip
    speed = ChartView(
        "speed", axis_label(speeds.axis), "confidence_speed.png", VELOCITIES, EXPOSURES, further,
        "Along a line only the speed changes, and with it the blur.",
    )  # fmt: skip
    listed += [speed] * (speeds.count > 1)
    for index in further:
        tested, name = data.axes[index], word(data.axes[index].axis)
        if tested.axis is MOVES and tested.count > 1:
            moved = replace(speed, word=name, file="score_moves.png", lines=index)
            listed.append(replace(moved, panels=(EXPOSURES,), bands=True))
        elif tested.count > 1:
            others = tuple(each for each in further if each != index)
            of = name, axis_label(tested.axis), f"confidence_{tested.axis.name}.png", index, EXPOSURES, others
            scale = "log" if tested.logarithmic else "linear"
            listed.append(ChartView(*of, f"Along a line only the {name} changes.", scale))
    return listed


def choices(data: RunData) -> list[Score]:
    """The scores that can be chosen on the page: those that this run has a value of."""
    kinds = {model["kind"] for model in data.manifest["models"]}
    charted = (score for score in of_conditions() if score.charted and kinds & score.kinds)
    return [
        score
        for score in charted
        if any(finite(row.scores.get(score.name, UNKNOWN).value) is not None for row in data.scores)
    ]


def _measures(data: RunData) -> Iterator[tuple[str, str | None, Callable[[ScoreRow], WithInterval]]]:
    """The scores and means over pictures that are drawn: title, which way is better, and the value in a row."""
    for score in choices(data):
        yield f"{score.title} (all targets)", score.better, partial(_score_in, score.name)
    of_pictures = OF_PICTURES if data.scores else ()
    if any(row.lamps is not None for row in data.scores):
        of_pictures = (*of_pictures, OF_LAMPS)
    for title, column in of_pictures:
        yield title, None, partial(_mean_in, column)


def _score_in(name: str, row: ScoreRow) -> WithInterval:
    return row.scores.get(name, UNKNOWN)


def _mean_in(column: Callable[[ScoreRow], float | None], row: ScoreRow) -> WithInterval:
    return WithInterval(column(row))


def numbers(data: RunData, groups: list[str]) -> Row:
    """All that is drawn; conditions by their places on the ``axes``, None where they have none.

    series: per measure, model and (of the first measure) target group its value in the original pictures, and rows of
    place in ``conditions``, value, interval and count of targets or pictures. windows, over exposure: whether one
    works, the exposure to use, and both ends of each with their intervals, in s.
    """
    models = {name: number for number, name in enumerate(data.model_names)}
    group_of = {name: number for number, name in enumerate(groups)}
    conditions: dict[tuple[int | None, ...], int] = {}

    def number_of(at: tuple[int | None, ...]) -> int:
        return conditions.setdefault(at, len(conditions))

    most = max(
        [1.0, *(answer.best_score.known for answer in data.answers)]
    )  # what is kept may be more than 1
    title = data.criterion.title[0].upper() + data.criterion.title[1:]
    measures: list[Row] = [{"name": title, "better": "higher", "most": most}]
    of_targets: dict[tuple[int, int], list[Any]] = {}
    clean: dict[tuple[int, int], float | None] = {}
    windows = []
    for answer in data.answers:
        if answer.group not in group_of:
            continue
        whose, velocity = (models[answer.model], group_of[answer.group]), answer.conditions.velocity_px_s
        clean.setdefault(whose, 1.0 if data.criterion.kept else _short(answer.clean_score))
        unknown = [None] * len(answer.exposures_s)
        columns = (answer.confidence, answer.low or unknown, answer.high or unknown)
        for exposure_s, *values in zip(answer.exposures_s, *columns, strict=True):
            y, low, high = map(_short, values)
            if y is not None:
                point = [
                    number_of(data.at(answer.conditions, exposure_s, velocity)),
                    y,
                    low,
                    high,
                    answer.n_targets,
                ]
                of_targets.setdefault(whose, []).append(point)
        ends = zip(answer.windows_s, answer.windows_low_s, answer.windows_high_s, strict=True)
        bars = [[*_seconds(both), _seconds(of_low), _seconds(of_high)] for both, of_low, of_high in ends]
        sure = [*map(_seconds, answer.sure_windows_s)]
        use = answer.verdict == WORKS, answer.recommended_s
        windows.append([*whose, data.at(answer.conditions, None, velocity), *use, sure, bars])
    series = [[0, *whose, clean[whose], values] for whose, values in of_targets.items()]
    for title, better, value_in in _measures(data):
        of_models: dict[str, list[Any]] = {model: [] for model in models}
        for row in data.exposed_scores:
            y, low, high = map(_short, value_in(row))
            if y is not None:
                under = row.conditions
                at = number_of(data.at(under, under.exposure_s, under.velocity_px_s))
                of_models[row.model].append([at, y, low, high, row.n_pictures])
        for model, values in of_models.items():
            untouched = data.clean_scores.get(model)
            original = None if untouched is None else _short(value_in(untouched).value)
            series += [[len(measures), models[model], 0, original, values]] * bool(values)
        most = max([row[1] for each in of_models.values() for row in each], default=0.0)
        measures.append({"name": title, "better": better, "most": most or 1.0})
    drawn: Row = {
        "threshold": data.criterion.level,
        "axes": [
            {"word": word(each.axis), "title": axis_label(each.axis)}
            | {"texts": each.texts, "short": each.short or each.texts, "x": each.x, "count": each.count}
            | {"colours": line_colours("viridis" if index else "plasma", each.count)}
            | {"by_night": line_colours("viridis" if index else "plasma", each.count, dark=True)}
            for index, each in enumerate(data.axes)
        ],
        "measures": measures,
        "conditions": list(conditions),
        "series": series,
        "windows": windows,
    }
    return drawn | {"views": [_view(data, view, drawn) for view in views(data)]}


def _view(data: RunData, view: ChartView, drawn: Row) -> Row:
    """What a drawing needs of a view. joined: whether points follow one another on a line; not where several
    velocities share a speed. ticks: places and texts, None for those of a library. range: as drawn, logarithms of a
    logarithmic axis."""
    tested, about = data.axes[view.along], asdict(view)
    x = [x_of(about, drawn["axes"], at) for at in drawn["conditions"]] or [1.0]
    x = [math.log10(each) for each in x] if view.scale == "log" else x
    # Lines should not touch the frame; one condition alone gets an axis of width 1.
    room = 0.04 * (max(x) - min(x)) or 0.5
    ticks = None
    if view.scale == "symlog":
        ticks = [(_height(tick), f"{tick:g}") for tick in _BLUR_TICKS]
    elif tested.named or view.along not in (EXPOSURES, VELOCITIES):
        shown = spread(range(tested.count), MAX_TICKS)
        texts = tested.texts if tested.named else [f"{each:g}" for each in tested.x]
        ticks = [(tested.x[each], texts[each]) for each in shown]
    # Velocities of equal speed, left and right, would be joined by a vertical line, which is no curve.
    joined = view.along != VELOCITIES or len(set(tested.x)) == len(tested.x)
    return about | {"joined": joined, "ticks": ticks, "range": [min(x) - room, max(x) + room]}


def x_of(view: Row, axes: list[Row], at: tuple[int, ...]) -> float:
    """Where a condition stands: in the unit of the axis; blur at the height that it is drawn at."""
    x: float = axes[view["along"]]["x"][at[view["along"]]]
    return _height(x * axes[EXPOSURES]["x"][at[EXPOSURES]] / 1e3) if view["scale"] == "symlog" else x


def _height(blur_px: float) -> float:
    """Linear below 1 px, logarithmic above."""
    return blur_px if blur_px < 1 else 1 + math.log10(blur_px)


def _short(value: float | None) -> float | None:
    known = finite(value)
    # Four decimals are finer than a chart's pixels; all digits would make the page much larger.
    return None if known is None else round(known, 4)


def _seconds(ends_s: Sequence[float | None]) -> list[float | None]:
    return [None if end is None else round(end, 7) for end in ends_s]
