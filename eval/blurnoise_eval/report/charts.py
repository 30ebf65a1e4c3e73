"""The charts of a run as plain numbers. The page's script draws them, and :mod:`.figures` draws them for print.

Models, groups and measures are given by index, never by name. Domain: scores in their units, exposures in s and ms,
speeds in px/s, blur in px; other axes in the units of figures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.plan.axes import BLUR, MOVES, velocity_of
from blurnoise_eval.plots.style import line_colours, spread
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import axis_label, word
from blurnoise_eval.scoring.scores import Score, of_conditions
from blurnoise_eval.system.tables import finite

EXPOSURES, VELOCITIES = 0, 1  # places of the first two of a run's axes; light and what else varies follow
MAX_TICKS = 8  # of an axis whose tested values are its ticks
_BLUR_TICKS = (0, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
OF_PICTURES = {
    "applied_gain_db": "Gain / dB",
    "snr_db": "SNR of the mean light / dB",
    "brightness": "Mean brightness of the picture, 0-1",
    "saturated_share": "Share of saturated pixels",
    "missed_pulse_share": "Share of pictures that miss the pulsed lamp",
}
"""Columns of scores that distinguish a dark picture from a noisy one."""
Row = dict[str, Any]


@dataclass(frozen=True)
class View:
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


def views(data: RunData) -> list[View]:
    """The views of a run: over exposure and blur, and over each axis that has several values besides."""
    further = tuple(range(2, len(data.axes)))
    exposures, speeds = data.axes[:2]
    found = [
        View(
            "exposure", axis_label(exposures.axis), "confidence_exposure.png", EXPOSURES, VELOCITIES, further,
            "Along a line the exposure grows, and with it light and blur. The bars below 0 show the exposure window "
            "at each speed (pale: cannot tell), with the 95 % intervals of its ends as thin lines and the "
            "recommended exposure as a tick.",
            "log" if exposures.logarithmic else "linear", bands=True,
        ),
        View(
            "blur", axis_label(BLUR), "confidence_blur.png", VELOCITIES, EXPOSURES, further,
            "Along a line only the speed changes. Each line has another exposure, and so another amount of light. "
            "The axis is linear below 1 px and logarithmic above.", "symlog",
        ),
    ]  # fmt: skip
    speed = View(
        "speed", axis_label(speeds.axis), "confidence_speed.png", VELOCITIES, EXPOSURES, further,
        "Along a line only the speed changes, and with it the blur.",
    )  # fmt: skip
    found += [speed] * (speeds.count > 1)
    for place in further:
        tested, name = data.axes[place], word(data.axes[place].axis)
        if tested.axis is MOVES and tested.count > 1:
            moved = replace(speed, word=name, file="score_moves.png", lines=place)
            found.append(replace(moved, panels=(EXPOSURES,), bands=True))
        elif tested.count > 1:
            others = tuple(each for each in further if each != place)
            of = name, axis_label(tested.axis), f"confidence_{tested.axis.name}.png", place, EXPOSURES, others
            scale = "log" if tested.logarithmic else "linear"
            found.append(View(*of, f"Along a line only the {name} changes.", scale))
    return found


def choices(data: RunData) -> list[Score]:
    """The scores that can be chosen on the page: those that this run has a value of."""
    kinds = {model["kind"] for model in data.manifest["models"]}
    charted = (score for score in of_conditions() if score.charted and kinds & score.kinds)
    return [score for score in charted if any(finite(row.get(score.name)) is not None for row in data.scores)]


def numbers(data: RunData, groups: list[str]) -> Row:
    """All that is drawn; conditions by their places on the ``axes``, None where they have none.

    series: per measure, model and (of the first measure) target group its value in the original pictures, and rows of
    place in ``conditions``, value, interval and count of targets or pictures. windows, over exposure: whether one
    works, the exposure to use, and both ends of each with their intervals, in s.
    """
    models = {name: place for place, name in enumerate(data.model_names)}
    group_of = {name: place for place, name in enumerate(groups)}
    conditions: dict[tuple[int | None, ...], int] = {}

    def place(at: tuple[int | None, ...]) -> int:
        return conditions.setdefault(at, len(conditions))

    most = max(
        [1.0, *(float(answer["best_score"]) for answer in data.answers)]
    )  # what is kept may be more than 1
    title = data.criterion.title[0].upper() + data.criterion.title[1:]
    measures: list[Row] = [{"name": title, "better": "higher", "most": most}]
    of_targets: dict[tuple[int, int], list[Any]] = {}
    clean: dict[tuple[int, int], float | None] = {}
    windows = []
    for answer in data.answers:
        if answer["group"] not in group_of:
            continue
        whose, velocity = (models[answer["model"]], group_of[answer["group"]]), velocity_of(answer)
        clean.setdefault(whose, 1.0 if data.criterion.kept else _short(answer["clean_score"]))
        unknown = [None] * len(answer["exposures_s"])
        columns = (answer["confidence"], answer["low"] or unknown, answer["high"] or unknown)
        for exposure_s, *values in zip(answer["exposures_s"], *columns, strict=True):
            y, low, high = map(_short, values)
            if y is not None:
                point = [place(data.at(answer, exposure_s, velocity)), y, low, high, answer["n_targets"]]
                of_targets.setdefault(whose, []).append(point)
        ends = zip(answer["windows_s"], answer["windows_low_s"], answer["windows_high_s"], strict=True)
        bars = [[*_seconds(both), _seconds(of_low), _seconds(of_high)] for both, of_low, of_high in ends]
        sure = [*map(_seconds, answer["sure_windows_s"])]
        use = answer["verdict"] == WORKS, answer["recommended_s"]
        windows.append([*whose, data.at(answer, None, velocity), *use, sure, bars])
    series = [[0, *whose, clean[whose], values] for whose, values in of_targets.items()]
    named = [(score.name, f"{score.title} (all targets)", score.better) for score in choices(data)]
    of_pictures = [
        (each, text) for each, text in OF_PICTURES.items() if any(each in row for row in data.scores)
    ]
    for name, title, better in [*named, *((each, text, None) for each, text in of_pictures)]:
        of_models: dict[str, list[Any]] = {model: [] for model in models}
        for row in data.exposed_scores:
            if (y := _short(row.get(name))) is not None:
                bounds = (_short(row.get(f"{name}{end}")) for end in ("_low", "_high"))
                at = place(data.at(row, row["exposure_s"], velocity_of(row)))
                of_models[row["model"]].append([at, y, *bounds, row["n_pictures"]])
        for model, values in of_models.items():
            original = _short(data.clean_scores.get(model, {}).get(name))
            series += [[len(measures), models[model], 0, original, values]] * bool(values)
        most = max([row[1] for each in of_models.values() for row in each], default=0.0)
        measures.append({"name": title, "better": better, "most": most or 1.0})
    found: Row = {
        "threshold": data.criterion.level,
        "axes": [
            {"word": word(each.axis), "title": axis_label(each.axis)}
            | {"texts": each.texts, "x": each.x, "count": each.count}
            | {"colours": line_colours("viridis" if place else "plasma", each.count)}
            for place, each in enumerate(data.axes)
        ],
        "measures": measures,
        "conditions": list(conditions),
        "series": series,
        "windows": windows,
    }
    return found | {"views": [_view(data, view, found) for view in views(data)]}


def _view(data: RunData, view: View, found: Row) -> Row:
    """What a drawing needs of a view. joined: whether points follow one another on a line; not where several
    velocities share a speed. ticks: places and texts, None for those of a library. range: as drawn, logarithms of a
    logarithmic axis."""
    tested, about = data.axes[view.along], asdict(view)
    x = [x_of(about, found["axes"], at) for at in found["conditions"]] or [1.0]
    x = [math.log10(each) for each in x] if view.scale == "log" else x
    room = 0.04 * (max(x) - min(x)) or 0.5
    ticks = None
    if view.scale == "symlog":
        ticks = [(_height(tick), f"{tick:g}") for tick in _BLUR_TICKS]
    elif tested.named or view.along not in (EXPOSURES, VELOCITIES):
        shown = spread(range(tested.count), MAX_TICKS)
        texts = tested.texts if tested.named else [f"{each:g}" for each in tested.x]
        ticks = [(tested.x[each], texts[each]) for each in shown]
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
    kept = finite(value)
    return None if kept is None else round(kept, 4)


def _seconds(ends_s: Sequence[float | None]) -> list[float | None]:
    return [None if end is None else round(end, 7) for end in ends_s]
