"""What a run's screen and page begin with: which exposure to use, what it keeps, how sure that is, and what limits.

Domain: exposures in s (written in ms), speeds in px/s or km/h, values in the criterion's unit. Texts are plain,
never markup.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from blurnoise_eval.grid.axes import EXPOSURE, GAIN, LIGHT, SETTING
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.measured import finite, model_names, spread
from blurnoise_eval.report.settings import word
from blurnoise_eval.report.words import (
    WORKS,
    Answer,
    counted,
    joined,
    limit_text,
    reached_text,
    value_text,
)
from blurnoise_eval.scoring.recommendation import CANNOT_TELL, FAILS, NEAR, SATURATED, SURE

MAX_MODELS = 4
MAX_ROWS, MAX_SPEEDS = 8, 3  # of the table in a terminal
HARDLY_KNOWN = 0.1
"""Mean score in the original pictures below which targets are named: what is kept of so little tells little."""
MARKS = {SURE: "sure", FAILS: "no", CANNOT_TELL: "?"}
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Cell:
    """The exposure to use under one light, at one speed or at all: its text, what it keeps, and the verdict."""

    use: str
    value: str
    verdict: str
    interval: str
    gain: str | None

    @property
    def text(self) -> str:
        """'3 ms 0.88 sure'."""
        return f"{self.use} {self.value} {MARKS[self.verdict]}"


@dataclass(frozen=True)
class Opening:
    """What stands first.

    model: whose table it is, the best of several; None without an answer. sentences: the answer. heads, rows: the
    table of light x speed, a first cell of text and :class:`Cell` (None: not tested); legend: what its marks mean.
    notes: (title, text) of what limits, and of what would make the answer surer.
    """

    model: str | None
    sentences: tuple[str, ...]
    heads: tuple[str, ...] = ()
    rows: tuple[tuple[str, tuple[Cell | None, ...]], ...] = ()
    legend: str = ""
    notes: tuple[tuple[str, str], ...] = ()


def opening(data: RunData) -> Opening:
    """The opening of a run."""
    names = ranked(data)
    whole = {name: row for name in names for row in _of(data, name, "all")}
    answered = [name for name in names if _of(data, name, "light")]
    reasons = data.manifest.get("withheld_models", {})
    if not answered:
        return Opening(
            None, tuple(f"{name}: {reason}" for name, reason in reasons.items()) or (_nothing(data),)
        )
    sentences = [] if len(model_names(data)) == 1 else [_ranking(data, names)]
    for name in names[:MAX_MODELS]:
        lead = "" if len(model_names(data)) == 1 else f"{name}: "
        if name in answered:
            sentences.append(lead + _answer(data, name, whole.get(name), brief=name != answered[0]))
        elif name in reasons:
            sentences.append(f"{name}: {reasons[name]}")
    model = answered[0]
    answers = [answer for answer in data.answers if answer["model"] == model]
    heads, rows = _table(data, model)
    notes = [("Limits", _limits(data, answers)), ("Surer", _surer(data, model, whole.get(model), answers))]
    return Opening(
        model,
        tuple(sentences),
        heads,
        rows,
        _legend(data),
        tuple((title, text) for title, text in notes if text),
    )


def ranked(data: RunData) -> list[str]:
    """The models, the best first: by mPC where the pictures have labels, else as they were given."""
    mpc = {row["model"]: finite(row.get("mpc")) for row in data.models}
    names = model_names(data)
    if not data.manifest["images"].get("labelled", True) or None in mpc.values():
        return names
    return sorted(names, key=lambda name: -(mpc[name] or 0.0))


def _of(data: RunData, model: str, scope: str) -> list[dict[str, Any]]:
    return [row for row in data.recommendations if (row["model"], row["scope"]) == (model, scope)]


def _nothing(data: RunData) -> str:
    if data.manifest.get("withheld"):
        return (
            "No exposure can be recommended: the models find almost nothing in the original pictures. "
            "Do they know these classes?"
        )
    return "No exposure can be recommended: the pictures hold no targets."


def _ranking(data: RunData, names: Sequence[str]) -> str:
    """Which of several models is best, and by how much, with the interval of the paired difference."""
    rows = {row["model"]: row for row in data.models}
    first, *others = (rows[name] for name in names)
    if not data.manifest["images"].get("labelled", True):
        return "The models cannot be ranked: without labels, each is compared with its own detections."
    if finite(first.get("mpc")) is None:
        return "The models cannot be ranked: their scores are not known."
    behind = [_difference(row) for row in others[: MAX_MODELS - 1]]
    more = f"; {len(others) + 1 - MAX_MODELS} more in models.csv" if len(others) >= MAX_MODELS else ""
    return f"Best is {first['model']}: mPC {first['mpc']:.3f} (mean {first['measure']}); {'; '.join(behind)}{more}."


def _difference(row: Row) -> str:
    behind, low, high = (
        finite(row.get(name)) for name in ("mpc_behind", "mpc_behind_low", "mpc_behind_high")
    )
    if behind is None:
        return f"{row['model']} {row['mpc']:.3f}"
    if low is None or high is None:
        return f"{row['model']} {behind:.3f} less (too few pictures for an interval)"
    sure = "" if low > 0 else ", which may be chance"
    return f"{row['model']} {behind:.3f} ({low:.3f} to {high:.3f}) less{sure}"


def _answer(data: RunData, model: str, row: Row | None, *, brief: bool) -> str:
    """The sentence for one model. row: its exposure for all conditions, None where none was tested in all of them;
    brief: without where it falls short."""
    if row is None:
        lights = _of(data, model, "light")
        value = sum(each["value"] * each["conditions"] for each in lights)
        reached = reached_text(
            f"{value / sum(each['conditions'] for each in lights):.2f}", data.criterion.text
        )
        return f"No exposure was tested in all lights. With the best of each it {reached} on average."
    asked, level, n = data.criterion.text, data.criterion.level, row["conditions"]
    use = EXPOSURE.text(row["exposure_s"])
    reached = reached_text(value_text(row["value"], row["low"], row["high"]), asked)
    average = f" on average over {_over(data, row['model'])}" if n > 1 and not brief else ""
    lost = _lost(data, row)
    bright = "" if brief else _saturated(data, row) + _brighter(data, row)
    lost = "" if brief else lost
    if n == 1:
        first = f"Use {use}: it {reached}" if row["verdict"] == SURE else f"Best is {use}: it {reached}"
        missed = f", surely less than {level:g}"
        chance = f"; whether that is at least {level:g} cannot be told"
        after = {SURE: f", surely at least {level:g}", FAILS: missed, CANNOT_TELL: chance}
        return f"{first}{after[row['verdict']]}.{bright}"
    cells = f"{n} cells" if len(_speeds(data, row["model"])) > 1 else f"{n}"
    if 2 * row["sure"] >= n:
        where = f"all {cells}" if row["sure"] == n else f"{row['sure']} of {cells}"
        return f"Use {use}: it {reached}{average}, and surely at least {level:g} in {where}{lost}.{bright}"
    often = f"only {row['sure']}" if row["sure"] else "none"
    surely = f"surely at least {level:g} in {often} of {cells}"
    weak = "" if brief else _weakest(data, row["model"])
    return f"Best single exposure: {use}. It {reached}{average}, {surely}{lost}.{weak}{bright}"


def _lost(data: RunData, row: Row) -> str:
    """What an exposure for each light would reach, or one for each light and speed."""
    lights = _of(data, row["model"], "light")
    verb = "keep" if data.criterion.kept else "reach"
    of_lights = sum(each["value"] * each["conditions"] for each in lights) / row["conditions"]
    if len(lights) > 1 and of_lights - row["value"] > NEAR:
        return f"; one exposure for each light would {verb} {of_lights:.2f}"
    best = row["value"] + row["loss"]
    return f"; the best for each speed would {verb} {best:.2f}" if row["loss"] > NEAR else ""


def _saturated(data: RunData, row: Row) -> str:
    share = row["saturated"]
    if share is None or share <= SATURATED:
        return ""
    light = max(_of(data, row["model"], "light"), key=lambda each: each[LIGHT.name])
    at = f" at {LIGHT.text(light[LIGHT.name])}" if len(_of(data, row["model"], "light")) > 1 else ""
    return f" It saturates {100 * share:.0f} % of the picture{at}."


def _brighter(data: RunData, row: Row) -> str:
    """The exposure that keeps more, and is not used since it saturates more."""
    of_all = [each for each in data.averages if each["model"] == row["model"] and each["speed"] is None]
    tested = [pair for each in of_all for pair in zip(each["values"], each["exposures_s"], strict=True)]
    value, exposure_s = max(tested, default=(0.0, 0.0))
    if value - row["value"] <= NEAR or exposure_s <= row["exposure_s"]:
        return ""
    verb = "keeps" if data.criterion.kept else "reaches"
    return f" {EXPOSURE.text(exposure_s)} {verb} {value:.2f}, but saturates too much."


def _weakest(data: RunData, model: str) -> str:
    """What falls short most at the single exposure, and where."""
    rows = [row for row in _of(data, model, "condition") if row["at_common"] is not None]
    if len(rows) < 2:
        return ""
    worst = min(rows, key=lambda row: row["at_common"])
    if worst["at_common"] >= data.criterion.level:
        return ""
    return f" It falls short most at {_place(data, worst)}: {worst['at_common']:.2f}."


def _place(data: RunData, row: Row) -> str:
    """'2 lux, 600 px/s'."""
    parts = [axis.text(row[axis.name]) for axis in _axes(data)]
    if row["speed"] is not None and len(_speeds(data, row["model"])) > 1:
        parts.append(_speed_text(data, row["speed"]))
    return ", ".join(parts)


def _over(data: RunData, model: str) -> str:
    """'3 lights, 2 speeds and 3 kinds of target'."""
    lights, speeds = _of(data, model, "light"), _speeds(data, model)
    parts = []
    for axis in _axes(data):
        count = len({row[axis.name] for row in lights})
        parts += [f"{count} {word(axis)}s"] if count > 1 else []
    parts += [f"{len(speeds)} speeds"] if len(speeds) > 1 else []
    groups = {answer["group"] for answer in data.answers if answer["model"] == model}
    parts += [f"{len(groups)} kinds of target"] if len(groups) > 1 else []
    return joined(parts) if parts else "directions"


def _axes(data: RunData) -> list[Any]:
    """The axes that name a row of the table: the light, and what else varies, but for gain and vehicle's speed."""
    return [axis for axis in data.at_any_speed.axes if axis is not GAIN]


def _speeds(data: RunData, model: str) -> list[float]:
    return sorted({row["speed"] for row in _of(data, model, "condition")})


def _speed_text(data: RunData, speed: float) -> str:
    return "at rest" if not speed else data.speed.text(speed)


def _table(
    data: RunData, model: str
) -> tuple[tuple[str, ...], tuple[tuple[str, tuple[Cell | None, ...]], ...]]:
    speeds = _speeds(data, model)
    cells = {(_key(row), row["speed"]): row for row in _of(data, model, "condition")}
    heads = [_speed_text(data, speed) for speed in speeds]
    several = len(speeds) > 1
    rows = []
    for light in _of(data, model, "light"):
        own: list[Cell | None] = [_cell(data, light)] if several else []
        own += [_cell(data, cells.get((_key(light), speed))) for speed in speeds]
        rows.append((" · ".join(axis.text(light[axis.name]) for axis in _axes(data)), tuple(own)))
    title = "light" if len(_axes(data)) == 1 else "setting"
    return (title, *(["any speed"] if several else []), *heads), tuple(rows)


def _key(row: Row) -> tuple[Any, ...]:
    return tuple(row[name] for name in SETTING if name != GAIN.name)


def _cell(data: RunData, row: Row | None) -> Cell | None:
    if row is None:
        return None
    interval = "" if row["low"] is None else f"{row['low']:.2f}–{row['high']:.2f}"
    use = EXPOSURE.text(row["exposure_s"])
    if row[GAIN.name] is not None and GAIN in data.settings.axes:
        use += f", {GAIN.text(row[GAIN.name]).removeprefix('gain ')}"
    return Cell(use, f"{row['value']:.2f}", row["verdict"], interval, _gain_text(data, row))


def _gain_text(data: RunData, row: Row) -> str | None:
    """The gain applied at a light and exposure, mean over pictures and speeds; None where it was not measured."""
    gains = [
        gain
        for each in data.taken
        if (each["model"], each["exposure_s"]) == (row["model"], row["exposure_s"])
        and all(each[axis.name] == row[axis.name] for axis in _axes(data))
        and (row[GAIN.name] is None or each[GAIN.name] == row[GAIN.name])
        and (gain := finite(each.get("applied_gain_db"))) is not None
    ]
    return f"{round(sum(gains) / len(gains)) + 0:d} dB" if gains else None


def _legend(data: RunData) -> str:
    verb = "keeps" if data.criterion.kept else "reaches"
    return f"sure: {verb} at least {data.criterion.level:g} (95 %); no: surely less; ?: cannot tell"


def _pictures(answers: Sequence[Answer]) -> str:
    return counted(max((answer["n_pictures"] for answer in answers), default=0), "picture")


def _limits(data: RunData, answers: Sequence[Answer]) -> str:
    """What ends the windows, and what holds back the conditions in which no exposure works."""
    parts = [f"{limit_text(limit)} {place}".strip() for limit, place in _failing(data, answers)]
    parts += _hardly_known(data, answers)
    if parts:
        return "; ".join(parts) + "."
    ends = []
    for name, side in (("limited_low", "shorter exposures fail by"), ("limited_high", "longer ones by")):
        named = [answer[name] for answer in answers if answer[name]]
        if named:
            ends.append(f"{side} {limit_text(max(sorted(set(named)), key=named.count))}")
    return joined(ends) + "." if ends else ""


def _hardly_known(data: RunData, answers: Sequence[Answer]) -> list[str]:
    """The targets of which little is to be kept, where others count beside them."""
    clean = {answer["group"]: answer["clean_value"] or 0.0 for answer in answers}
    weak = [group for group, value in clean.items() if data.criterion.kept and value < HARDLY_KNOWN]
    if not weak or len(clean) == 1:
        return []
    values = joined([f"{clean[group]:.2f}" for group in weak])
    return [f"{joined(weak)} counts like the others, though it scores only {values} in the originals"]


def _failing(data: RunData, answers: Sequence[Answer]) -> Iterable[tuple[str, str]]:
    """(limit, where it holds the best exposure back), the most frequent first, at most two."""
    found: dict[str, list[Answer]] = {}
    for answer in answers:
        if answer["verdict"] != WORKS and answer["limited_by"]:
            found.setdefault(answer["limited_by"], []).append(answer)
    for limit, own in sorted(found.items(), key=lambda each: -len(each[1]))[:2]:
        yield limit, _where(data, own, answers)


def _where(data: RunData, some: Sequence[Answer], every: Sequence[Answer]) -> str:
    """'at 2 lux and 600 px/s': what the answers have in common and others do not."""
    parts = []
    for of, text in ((lambda a: a[LIGHT.name], LIGHT.text), (data.speed.of, lambda v: _speed_text(data, v))):
        own, all_of = sorted({of(each) for each in some}), {of(each) for each in every}
        if len(own) == 1 and len(all_of) > 1:
            parts.append(text(own[0]))
    return f"at {joined(parts)}".replace("at at rest", "at rest") if parts else ""


def _surer(data: RunData, model: str, row: Row | None, answers: Sequence[Answer]) -> str:
    """What to do next for a surer answer."""
    cells = _of(data, model, "condition")
    untold = sum(cell["verdict"] == CANNOT_TELL for cell in cells)
    parts = [f"more pictures ({_pictures(answers)} leave {untold} of {len(cells)} open)"] if untold else []
    tested, chosen = data.exposures_s, None if row is None else row["exposure_s"]
    if chosen is not None and len(tested) > 1 and chosen in (tested[0], tested[-1]):
        side = "longest" if chosen == tested[-1] else "shortest"
        parts.append(f"{side[:-3]}er exposures ({EXPOSURE.text(chosen)} is the {side} tested)")
    return joined(parts) + "." if parts else "pictures of other scenes; with these no verdict is open."


def table_rows(told: Opening, most: int, speeds: int) -> tuple[list[str], list[list[str]], int]:
    """Heads and rows of text for a terminal, of at most so many rows and speeds; how many cells are left out."""
    columns = spread(range(2, len(told.heads)), speeds) if len(told.heads) > 2 else []
    kept = [0, 1, *columns][: len(told.heads)]
    rows = spread(told.rows, most)
    text = [
        [name, *("-" if cells[place - 1] is None else cells[place - 1].text for place in kept[1:])]  # type: ignore[union-attr]
        for name, cells in rows
    ]
    hidden = len(told.rows) * (len(told.heads) - 1) - len(rows) * (len(kept) - 1)
    return [told.heads[place] for place in kept], text, hidden
