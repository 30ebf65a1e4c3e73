"""The numbers behind the page's curves and heat maps: indexes, never names.

Domain: scores in their units, exposures in s and ms, speeds in px/s, blur in px; other axes in the units of figures.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.grid.axes import velocity_of
from blurnoise_eval.plots.style import line_colours
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import word
from blurnoise_eval.report.views import View, drawn, joined, ticks, views
from blurnoise_eval.report.words import title_text
from blurnoise_eval.scoring.scores import Score, of_conditions
from blurnoise_eval.system.tables import finite

MAX_TICKS = 10  # of an axis whose tested values are its ticks
_BLUR_TICKS = (0, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
OF_PICTURES = {
    "applied_gain_db": "Gain / dB",
    "snr_db": "SNR of the mean light / dB",
    "brightness": "Mean of the picture, 0-1",
    "saturated": "Share of saturated pixels",
}
"""Columns of scores that tell a dark picture from a noisy one."""
Row = dict[str, Any]


def choices(data: RunData) -> list[Score]:
    """The scores that can be chosen on the page: those that this run has a value of."""
    kinds = {model["kind"] for model in data.manifest["models"]}
    charted = (score for score in of_conditions() if score.charted and kinds & score.kinds)
    return [score for score in charted if any(finite(row.get(score.name)) is not None for row in data.scores)]


def numbers(data: RunData, groups: list[str]) -> Row:
    """All that the page's script draws. Models, groups and measures are given by index, conditions by their places on
    the ``axes``; None where they have none.

    series: per measure, model and (of the first measure) target group its value in the original pictures, and rows of
    place in ``conditions``, value, interval and count of targets or pictures. windows, over exposure: both ends in s,
    whether it is sure, and the intervals of the ends.
    """
    models = {name: place for place, name in enumerate(data.model_names)}
    group_of = {name: place for place, name in enumerate(groups)}
    conditions: dict[tuple[int | None, ...], int] = {}

    def place(at: tuple[int | None, ...]) -> int:
        return conditions.setdefault(at, len(conditions))

    def where(row: Row, exposure_s: float | None, velocity: object) -> list[Any]:
        return [models[row["model"]], group_of[row["group"]], data.at(row, exposure_s, velocity)]

    measures: list[Row] = [{"name": title_text(data.criterion), "better": "higher", "most": data.highest}]
    of_targets: dict[tuple[str, str], list[Any]] = {}
    for p in data.points:
        if p.group in group_of:
            values = [place(p.at), *map(_short, (p.y, p.low, p.high)), p.n_targets]
            of_targets.setdefault((p.model, p.group), []).append(values)
    series = [
        [0, models[model], group_of[group], _short(_clean(data, model, group)), values]
        for (model, group), values in of_targets.items()
    ]
    named = [(score.name, f"{score.title} (all targets)", score.better) for score in choices(data)]
    for name, title, better in [*named, *((each, text, None) for each, text in OF_PICTURES.items())]:
        of_models: dict[str, list[Any]] = {model: [] for model in models}
        for row in data.exposed_scores:
            if (y := _short(row.get(name))) is not None:
                ends = (_short(row.get(f"{name}{end}")) for end in ("_low", "_high"))
                at = place(data.at(row, row["exposure_s"], velocity_of(row)))
                of_models[row["model"]].append([at, y, *ends, row["n_images"]])
        for model, values in of_models.items():
            clean = _short(data.clean_scores.get(model, {}).get(name))
            series += [[len(measures), models[model], 0, clean, values]] * bool(values)
        most = max([row[1] for each in of_models.values() for row in each], default=0.0)
        measures.append({"name": title, "better": better, "most": most or 1.0})
    places = list(conditions)
    return {
        "threshold": data.criterion.level,
        "axes": [
            {"word": word(each.axis), "texts": each.texts, "x": each.x, "count": each.count}
            | {"colours": line_colours("viridis" if place else "plasma", each.count)}
            for place, each in enumerate(data.axes)
        ],
        "views": [_view(data, view, places) for view in views(data)],
        "measures": measures,
        "conditions": places,
        "series": series,
        "windows": [
            [*where(a, None, velocity_of(a)), low, high, a["verdict"] == WORKS, bounds]
            for a in data.answers
            if a["group"] in group_of
            for (low, high), *bounds in zip(
                a["windows_s"], a["windows_low_s"], a["windows_high_s"], strict=True
            )
        ],
    }


def _view(data: RunData, view: View, places: list[Any]) -> Row:
    """What the script needs of a view; ticks: places and texts, None for those that the library of charts sets."""
    x = [drawn(view, view.x(data, at)) for at in places] or [0.0]
    room = 0.04 * (max(x) - min(x)) or 0.5
    shown = ticks(data, view, MAX_TICKS)
    if view.scale == "symlog":
        shown = [(drawn(view, tick), f"{tick:g}") for tick in _BLUR_TICKS]
    about = {name: value for name, value in asdict(view).items() if name not in ("panels", "file")}
    return about | {"joined": joined(data, view), "ticks": shown, "range": [min(x) - room, max(x) + room]}


def _short(value: float | None) -> float | None:
    kept = finite(value)
    return None if kept is None else round(kept, 4)


def _clean(data: RunData, model: str, group: str) -> float | None:
    """The score in the original pictures, in the unit of the answers: of what is kept, all."""
    if data.criterion.kept:
        return 1.0
    known = (each["clean_value"] for each in data.answers if (each["model"], each["group"]) == (model, group))
    return finite(next(known, None))
