"""What a run's screen and page begin with: which exposure to use, what it keeps, how sure that is, and what limits.

Domain: exposures in s (written in ms), speeds in px/s or km/h, values in the criterion's unit. Texts are plain,
never markup.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.answers.recommendation import CANNOT_TELL, FAILS, NEAR, SATURATED, SURE
from blurnoise_eval.grid.axes import EGO, EXPOSURE, GAIN, LIGHT, SETTING, Axis
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import word
from blurnoise_eval.report.words import counted, joined, limit_text, reached_text, value_text
from blurnoise_eval.system.tables import finite

MAX_MODELS = 4
MAX_ROWS, MAX_SPEEDS = 8, 3  # of the table in a terminal
HARDLY_KNOWN = 0.1
"""Mean score in the original pictures below which targets are named: what is kept of so little tells little."""
MARKS = {SURE: "sure", FAILS: "no", CANNOT_TELL: "?"}
Row = Mapping[str, Any]


class Cell(NamedTuple):
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


TableRow = tuple[str, tuple[Cell | None, ...]]


@dataclass(frozen=True)
class Opening:
    """What comes first.

    model: whose table it is, the best of several; None without an answer. sentences: the answer. heads, rows: the
    table of light x speed, a first cell of text and :class:`Cell` (None: not tested); legend: what its marks mean.
    notes: (title, text) of what limits, and of what would make the answer surer.
    """

    model: str | None
    sentences: tuple[str, ...]
    heads: tuple[str, ...] = ()
    rows: tuple[TableRow, ...] = ()
    legend: str = ""
    notes: tuple[tuple[str, str], ...] = ()


def opening(data: RunData) -> Opening:
    """The opening of a run."""
    every = [_OfModel(data, name) for name in ranked(data)]
    answered = [each for each in every if each.lights]
    reasons = data.manifest.get("withheld_models", {})
    if not answered:
        why = "the pictures hold no targets."
        if data.manifest.get("withheld"):
            why = "the models find almost nothing in the original pictures. Do they know these classes?"
        unknown = [f"{name}: {reason}" for name, reason in reasons.items()]
        return Opening(None, tuple(unknown or [f"No exposure can be recommended: {why}"]))
    best, several = answered[0], len(every) > 1
    sentences = [_ranking(data, [each.model for each in every])] if several else []
    for each in every[:MAX_MODELS]:
        if each.lights:
            lead = f"{each.model}: " if several else ""
            sentences.append(lead + each.answer(brief=each is not best))
        elif each.model in reasons:
            sentences.append(f"{each.model}: {reasons[each.model]}")
    verb = "keeps" if data.criterion.kept else "reaches"
    legend = f"sure: {verb} at least {data.criterion.level:g} (95 %); no: surely less; ?: cannot tell"
    notes = ("Limits", best.limits()), ("Surer", best.surer())
    return Opening(
        best.model, tuple(sentences), *best.table(), legend, tuple(each for each in notes if each[1])
    )


def ranked(data: RunData) -> list[str]:
    """The models, the best first: by mPC where the pictures have labels, else as they were given."""
    mpc = {row["model"]: finite(row.get("mpc")) for row in data.models}
    if not data.manifest["images"].get("labelled", True) or None in mpc.values():
        return data.model_names
    return sorted(data.model_names, key=lambda name: -(mpc[name] or 0.0))


def _ranking(data: RunData, names: Sequence[str]) -> str:
    """Which of several models is best, and by how much, with the interval of the paired difference."""
    rows = {row["model"]: row for row in data.models}
    first, *others = (rows[name] for name in names)
    if not data.manifest["images"].get("labelled", True):
        return "The models cannot be ranked: without labels, each is compared with its own detections."
    if finite(first.get("mpc")) is None:
        return "The models cannot be ranked: their scores are not known."
    behind = "; ".join(_difference(row) for row in others[: MAX_MODELS - 1])
    more = f"; {len(others) + 1 - MAX_MODELS} more in models.csv" if len(others) >= MAX_MODELS else ""
    return f"Best is {first['model']}: mPC {first['mpc']:.3f} (mean {first['measure']}); {behind}{more}."


def _difference(row: Row) -> str:
    behind, low, high = (finite(row.get(f"mpc_behind{end}")) for end in ("", "_low", "_high"))
    if behind is None:
        return f"{row['model']} {row['mpc']:.3f}"
    if low is None or high is None:
        return f"{row['model']} {behind:.3f} less (too few pictures for an interval)"
    sure = "" if low > 0 else ", which may be chance"
    return f"{row['model']} {behind:.3f} ({low:.3f} to {high:.3f}) less{sure}"


@dataclass(frozen=True)
class _OfModel:
    """What one model's recommendations say."""

    data: RunData
    model: str

    def _rows(self, scope: str) -> list[dict[str, Any]]:
        key = self.model, scope
        return [row for row in self.data.recommendations if (row["model"], row["scope"]) == key]

    @cached_property
    def whole(self) -> Row | None:
        """Its exposure for all conditions; None where none was tested in all of them."""
        return next(iter(self._rows("all")), None)

    @cached_property
    def lights(self) -> list[dict[str, Any]]:
        return self._rows("light")

    @cached_property
    def conditions(self) -> list[dict[str, Any]]:
        return self._rows("condition")

    @cached_property
    def speeds(self) -> list[float]:
        return sorted({row["speed"] for row in self.conditions})

    @cached_property
    def answers(self) -> list[dict[str, Any]]:
        return [answer for answer in self.data.answers if answer["model"] == self.model]

    @cached_property
    def axes(self) -> list[Axis]:
        """Those that name a row of the table: the light, and what else varies, but for gain and vehicle's speed."""
        return [axis for axis in self.data.settings.axes if axis not in (GAIN, EGO)]

    @property
    def verb(self) -> str:
        return "keep" if self.data.criterion.kept else "reach"

    def _setting_texts(self, row: Row) -> list[str]:
        return [axis.text(row[axis.name]) for axis in self.axes]

    def _speed_text(self, speed: float) -> str:
        return "at rest" if not speed else self.data.speed.text(speed)

    def answer(self, *, brief: bool) -> str:
        """The sentence that says what to use. brief: without where it falls short."""
        criterion, row = self.data.criterion, self.whole
        if row is None:
            reached = reached_text(f"{self._of_lights():.2f}", criterion)
            return f"No exposure was tested in all lights. With the best of each it {reached} on average."
        n, use, at_least = (
            row["conditions"],
            EXPOSURE.text(row["exposure_s"]),
            f"at least {criterion.level:g}",
        )
        reached = reached_text(value_text(row["value"], row["low"], row["high"]), criterion)
        bright = "" if brief else self._saturated(row) + self._brighter(row)
        if n == 1:
            after = {
                SURE: f", surely {at_least}",
                FAILS: f", surely less than {criterion.level:g}",
                CANNOT_TELL: f"; whether that is {at_least} cannot be told",
            }
            first = "Use" if row["verdict"] == SURE else "Best is"
            return f"{first} {use}: it {reached}{after[row['verdict']]}.{bright}"
        average = "" if brief else f" on average over {self._over()}"
        lost = "" if brief else self._lost(row)
        cells = f"{n} cells" if len(self.speeds) > 1 else f"{n}"
        if 2 * row["sure"] >= n:
            where = f"all {cells}" if row["sure"] == n else f"{row['sure']} of {cells}"
            return f"Use {use}: it {reached}{average}, and surely {at_least} in {where}{lost}.{bright}"
        often = f"only {row['sure']}" if row["sure"] else "none"
        weak = "" if brief else self._weakest()
        return (
            f"Best single exposure: {use}. It {reached}{average}, surely {at_least} in {often} of {cells}{lost}."
            f"{weak}{bright}"
        )

    def _of_lights(self) -> float:
        """What one exposure for each light reaches, mean over the conditions."""
        total = sum(each["conditions"] for each in self.lights)
        return float(sum(each["value"] * each["conditions"] for each in self.lights) / total)

    def _lost(self, row: Row) -> str:
        """What an exposure for each light would reach, or one for each light and speed."""
        if len(self.lights) > 1 and (value := self._of_lights()) - row["value"] > NEAR:
            return f"; one exposure for each light would {self.verb} {value:.2f}"
        best = row["value"] + row["loss"]
        return f"; the best for each speed would {self.verb} {best:.2f}" if row["loss"] > NEAR else ""

    def _saturated(self, row: Row) -> str:
        share = row["saturated"]
        if share is None or share <= SATURATED:
            return ""
        brightest = max(each[LIGHT.name] for each in self.lights)
        at = f" at {LIGHT.text(brightest)}" if len(self.lights) > 1 else ""
        return f" It saturates {100 * share:.0f} % of the picture{at}."

    def _brighter(self, row: Row) -> str:
        """The exposure that keeps more, and is not used since it saturates more."""
        means = (r for r in self.data.averages if r["model"] == self.model and r["speed"] is None)
        tested = [pair for each in means for pair in zip(each["values"], each["exposures_s"], strict=True)]
        value, exposure_s = max(tested, default=(0.0, 0.0))
        if value - row["value"] <= NEAR or exposure_s <= row["exposure_s"]:
            return ""
        verb = "keeps" if self.data.criterion.kept else "reaches"
        return f" {EXPOSURE.text(exposure_s)} {verb} {value:.2f}, but saturates too much."

    def _weakest(self) -> str:
        """What falls short most at the single exposure, and where."""
        rows = [row for row in self.conditions if row["at_common"] is not None]
        worst = min(rows, key=lambda row: float(row["at_common"]), default=None)
        if worst is None or len(rows) < 2 or worst["at_common"] >= self.data.criterion.level:
            return ""
        speed = [self._speed_text(worst["speed"])] if len(self.speeds) > 1 else []
        return f" It falls short most at {', '.join(self._setting_texts(worst) + speed)}: {worst['at_common']:.2f}."

    def _over(self) -> str:
        """'3 lights, 2 speeds and 3 kinds of target'."""
        counts = {f"{word(axis)}s": len({row[axis.name] for row in self.lights}) for axis in self.axes}
        counts["speeds"] = len(self.speeds)
        counts["kinds of target"] = len({answer["group"] for answer in self.answers})
        return joined([f"{count} {what}" for what, count in counts.items() if count > 1] or ["directions"])

    def table(self) -> tuple[tuple[str, ...], tuple[TableRow, ...]]:
        """Heads and rows of light x speed, the first for any speed where there are several."""
        several = len(self.speeds) > 1
        cells = {(_key(row), row["speed"]): row for row in self.conditions}
        rows = []
        for light in self.lights:
            own = [light] * several + [cells.get((_key(light), speed)) for speed in self.speeds]
            found = tuple(None if row is None else self._cell(row) for row in own)
            rows.append((" · ".join(self._setting_texts(light)), found))
        title = "light" if len(self.axes) == 1 else "setting"
        return (title, *["any speed"] * several, *map(self._speed_text, self.speeds)), tuple(rows)

    def _cell(self, row: Row) -> Cell:
        interval = "" if row["low"] is None else f"{row['low']:.2f}–{row['high']:.2f}"
        use = EXPOSURE.text(row["exposure_s"])
        if row[GAIN.name] is not None and GAIN in self.data.settings.axes:
            use += f", {GAIN.text(row[GAIN.name]).removeprefix('gain ')}"
        return Cell(use, f"{row['value']:.2f}", row["verdict"], interval, self._gain_text(row))

    def _gain_text(self, row: Row) -> str | None:
        """The gain applied at a light and exposure, mean over pictures and speeds; None where it was not measured."""
        same = {"model": self.model, "exposure_s": row["exposure_s"]}
        same |= {axis.name: row[axis.name] for axis in self.axes}
        same |= {} if row[GAIN.name] is None else {GAIN.name: row[GAIN.name]}
        taken = (each for each in self.data.taken if all(each[name] == same[name] for name in same))
        gains = [gain for each in taken if (gain := finite(each.get("applied_gain_db"))) is not None]
        return f"{round(sum(gains) / len(gains)) + 0:d} dB" if gains else None

    def limits(self) -> str:
        """What ends the windows, and what holds back the conditions in which no exposure works."""
        if parts := [*self._failing(), *self._hardly_known()]:
            return "; ".join(parts) + "."
        ends = []
        for name, side in (("limited_low", "shorter exposures fail by"), ("limited_high", "longer ones by")):
            named = [answer[name] for answer in self.answers if answer[name]]
            if named:
                ends.append(f"{side} {limit_text(max(sorted(set(named)), key=named.count))}")
        return joined(ends) + "." if ends else ""

    def _failing(self) -> Iterator[str]:
        """What limits the best exposure, and where, the most frequent first, at most two."""
        found: dict[str, list[Row]] = {}
        for answer in self.answers:
            if answer["verdict"] != WORKS and answer["limited_by"]:
                found.setdefault(answer["limited_by"], []).append(answer)
        for limit, some in sorted(found.items(), key=lambda each: -len(each[1]))[:2]:
            places = []  # what these answers have in common and others do not
            for of, text in ((lambda a: a[LIGHT.name], LIGHT.text), (self.data.speed.of, self._speed_text)):
                own, every = {of(each) for each in some}, {of(each) for each in self.answers}
                places += [text(own.pop())] if len(own) == 1 < len(every) else []
            where = f" at {joined(places)}".replace("at at rest", "at rest") if places else ""
            yield limit_text(limit) + where

    def _hardly_known(self) -> Iterator[str]:
        """The targets of which little is to be kept, where others count beside them."""
        clean = {answer["group"]: answer["clean_value"] or 0.0 for answer in self.answers}
        weak = [group for group, value in clean.items() if self.data.criterion.kept and value < HARDLY_KNOWN]
        if weak and len(clean) > 1:
            values = joined([f"{clean[group]:.2f}" for group in weak])
            yield f"{joined(weak)} counts like the others, though it scores only {values} in the originals"

    def surer(self) -> str:
        """What to do next for a surer answer."""
        unknown = sum(row["verdict"] == CANNOT_TELL for row in self.conditions)
        pictures = counted(max((answer["n_pictures"] for answer in self.answers), default=0), "picture")
        parts = (
            [f"more pictures ({pictures} leave {unknown} of {len(self.conditions)} open)"] if unknown else []
        )
        tested, chosen = self.data.exposures_s, None if self.whole is None else self.whole["exposure_s"]
        if chosen is not None and len(tested) > 1 and chosen in (tested[0], tested[-1]):
            side = "longest" if chosen == tested[-1] else "shortest"
            parts.append(f"{side[:-3]}er exposures ({EXPOSURE.text(chosen)} is the {side} tested)")
        return joined(parts) + "." if parts else "pictures of other scenes; with these no verdict is open."


def _key(row: Row) -> tuple[Any, ...]:
    return tuple(row[name] for name in SETTING if name != GAIN.name)


def table_rows(shown: Opening, most: int, speeds: int) -> tuple[list[str], list[list[str]], int]:
    """Heads and rows of text for a terminal, of at most so many rows and speeds; how many cells are left out."""
    columns = spread(range(2, len(shown.heads)), speeds) if len(shown.heads) > 2 else []
    kept = [0, 1, *columns][: len(shown.heads)]
    rows = spread(shown.rows, most)
    text = [
        [name, *("-" if cell is None else cell.text for cell in (cells[place - 1] for place in kept[1:]))]
        for name, cells in rows
    ]
    hidden = len(shown.rows) * (len(shown.heads) - 1) - len(rows) * (len(kept) - 1)
    return [shown.heads[place] for place in kept], text, hidden
