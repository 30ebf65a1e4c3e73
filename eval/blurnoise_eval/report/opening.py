"""What a run's screen and page begin with: which exposure to use, what it keeps, how sure that is, and what limits.

Domain: exposures in s (written in ms), speeds in px/s or km/h, values in the criterion's unit. Texts are plain,
never markup.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.answers.recommendation import CANNOT_TELL, FAILS, NEAR, SATURATED, SURE
from blurnoise_eval.grid.axes import EGO, EGO_SPEED, EXPOSURE, GAIN, LIGHT, SETTING
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import word
from blurnoise_eval.report.words import counted, joined, keeps, limit_text, reached_text, value_text
from blurnoise_eval.scoring.uncertainty import FEWEST
from blurnoise_eval.system.tables import finite

MAX_MODELS = 4
MAX_ROWS, MAX_SPEEDS = 8, 3  # of the table in a terminal
MARKS = {SURE: "sure", FAILS: "no", CANNOT_TELL: "?"}
Row = Mapping[str, Any]


Cell = tuple[str, str, list[str]]
"""Of a table: its class, its text, and lines in small print."""
TableRow = tuple[str, str, list[Cell]]
"""Its name, a note on it, its cells."""
UNTESTED: Cell = "", "–", []


@dataclass(frozen=True)
class Opening:
    """What comes first.

    model: whose table it is, the best of several; None without an answer. sentences: the answer. heads, rows: the
    table of light x speed, of the exposures to use: '3 ms 0.88 sure'; legend: what its marks mean.
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
        why = "the pictures hold no targets." if data.scores else "no cell has been computed yet."
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
    level = f"{keeps(data.criterion)} at least {data.criterion.level:g} (95 %)"
    legend = f"sure: {level}; no: surely less; ?: cannot tell"
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
    if not data.manifest["images"].get("labelled", True):
        return "The models cannot be ranked: without labels, each is compared with its own detections."
    rows = {row["model"]: row for row in data.models}
    first, *others = (rows[name] for name in names)
    if finite(first.get("mpc")) is None:
        return "The models cannot be ranked: their scores are not known."
    behind = []
    for row in others[: MAX_MODELS - 1]:
        less, low, high = (finite(row.get(f"mpc_behind{end}")) for end in ("", "_low", "_high"))
        if less is None:
            behind.append(f"{row['model']} {row['mpc']:.3f}")
        elif low is None or high is None:
            behind.append(f"{row['model']} {less:.3f} less (too few pictures for an interval)")
        else:
            sure = "" if low > 0 else ", which may be chance"
            behind.append(f"{row['model']} {less:.3f} ({low:.3f} to {high:.3f}) less{sure}")
    behind += [f"{len(names) - MAX_MODELS} more in models.csv"] * (len(names) > MAX_MODELS)
    return f"Best is {first['model']}: mPC {first['mpc']:.3f} (mean {first['measure']}); {'; '.join(behind)}."


class _OfModel:
    """What one model's recommendations say."""

    def __init__(self, data: RunData, model: str) -> None:
        self.data, self.model, self.level = data, model, data.criterion.level
        rows = [row for row in data.recommendations if row["model"] == model]
        self.whole = next((row for row in rows if row["scope"] == "all"), None)
        """Its exposure for all conditions; None where none was tested in all of them."""
        self.lights = [row for row in rows if row["scope"] == "light"]
        self.conditions = [row for row in rows if row["scope"] == "condition"]
        self.speeds = sorted({row["speed"] for row in self.conditions})
        self.answers = [answer for answer in data.answers if answer["model"] == model]
        self.axes = [axis for axis in data.settings.axes if axis not in (GAIN, EGO)]
        """Those that name a row of the table: the light, and what else varies, but for gain and vehicle's speed."""
        usual = dict(zip(LIGHT.default, LIGHT.default_names, strict=True))
        self.named = usual if {row[LIGHT.name] for row in self.lights} == usual.keys() else {}
        """The names of the default lights, where the run has these."""
        self.verb = "keep" if data.criterion.kept else "reach"

    def _setting_texts(self, row: Row) -> list[str]:
        return [self._light_text(row[LIGHT.name]), *(axis.text(row[axis.name]) for axis in self.axes[1:])]

    def _light_text(self, lux: float) -> str:
        """'1 lux', or '1 lux (night street)' of the default lights."""
        return LIGHT.text(lux) + (f" ({self.named[lux]})" if lux in self.named else "")

    def _speed_text(self, speed: float) -> str:
        return self.data.speed.text(speed) if speed or self.data.speed is EGO_SPEED else "at rest"

    def answer(self, *, brief: bool) -> str:
        """The sentence that says what to use. brief: without where it falls short."""
        criterion, row = self.data.criterion, self.whole
        if row is None:
            reached = reached_text(f"{self._of_lights():.2f}", criterion)
            return f"No exposure was tested in all lights. With the best of each it {reached} on average."
        n, sure, use = row["conditions"], row["sure"], EXPOSURE.text(row["exposure_s"])
        reached = reached_text(value_text(row["value"], row["low"], row["high"]), criterion)
        bright = self._unsure(row) + ("" if brief else self._bright(row))
        if n == 1:
            after = {
                SURE: f", surely at least {self.level:g}",
                FAILS: f", surely less than {self.level:g}",
                CANNOT_TELL: f"; whether that is at least {self.level:g} cannot be told",
            }
            first = "Use" if row["verdict"] == SURE else "Best is"
            return f"{first} {use}: it {reached}{after[row['verdict']]}.{bright}"
        average, lost = ("", "") if brief else (f" on average over {self._over()}", self._lost(row))
        where = f"{n} cells" if len(self.speeds) > 1 else f"{n}"
        if 2 * sure >= n:
            where = f"all {where}" if sure == n else f"{sure} of {where}"
            return f"Use {use}: it {reached}{average}, and surely at least {self.level:g} in {where}{lost}.{bright}"
        often = f"only {sure}" if sure else "none"
        weak = "" if brief else self._weakest()
        return (
            f"Best single exposure: {use}. It {reached}{average}, surely at least {self.level:g} in {often} of "
            f"{where}{lost}.{weak}{bright}"
        )

    def _unsure(self, row: Row) -> str:
        """Why a value has no interval."""
        if row["low"] is not None:
            return ""
        count = max(answer["n_pictures"] for answer in self.answers)
        weight = ", of unequal weight," if count >= FEWEST else ""
        return (
            f" {counted(count, 'picture')}{weight} {'is' if count == 1 else 'are'} too few for an interval."
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

    def _bright(self, row: Row) -> str:
        """What the exposure saturates, and which one keeps more but saturates too much to be used."""
        text = ""
        if row["saturated"] is not None and row["saturated"] > SATURATED:
            brightest = max(each[LIGHT.name] for each in self.lights)
            at = f" at {LIGHT.text(brightest)}" if len(self.lights) > 1 else ""
            text = f" It saturates {100 * row['saturated']:.0f} % of the picture{at}."
        means = (row for row in self.data.averages if row["model"] == self.model)
        tested = [pair for each in means for pair in zip(each["values"], each["exposures_s"], strict=True)]
        value, exposure_s = max(tested, default=(0.0, 0.0))
        if value - row["value"] > NEAR and exposure_s > row["exposure_s"]:
            text += f" {EXPOSURE.text(exposure_s)} {keeps(self.data.criterion)} {value:.2f}, but saturates too much."
        return text

    def _weakest(self) -> str:
        """What falls short most at the single exposure, and where."""
        rows = [row for row in self.conditions if row["at_common"] is not None]
        worst = min(rows, key=lambda row: float(row["at_common"]), default=None)
        if worst is None or len(rows) < 2 or worst["at_common"] >= self.level:
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
        key = itemgetter(*(name for name in SETTING if name != GAIN.name))
        cells = {(key(row), row["speed"]): row for row in self.conditions}
        rows = []
        for light in self.lights:
            own = [light] * several + [cells.get((key(light), speed)) for speed in self.speeds]
            found = [UNTESTED if row is None else self._cell(row) for row in own]
            rows.append((" · ".join(self._setting_texts(light)), "", found))
        title = "light" if len(self.axes) == 1 else "setting"
        return (title, *["any speed"] * several, *map(self._speed_text, self.speeds)), tuple(rows)

    def _cell(self, row: Row) -> Cell:
        use, verdict = EXPOSURE.text(row["exposure_s"]), row["verdict"]
        if row[GAIN.name] is not None and GAIN in self.data.settings.axes:
            use += f", {GAIN.text(row[GAIN.name]).removeprefix('gain ')}"
        interval = "" if row["low"] is None else f"{row['low']:.2f}–{row['high']:.2f}"
        return MARKS[verdict], f"{use} {row['value']:.2f} {MARKS[verdict]}", [interval]

    def limits(self) -> str:
        """What holds back the conditions in which no exposure works, the most frequent first; else what ends the
        windows."""
        parts = []
        failing = [a for a in self.answers if a["verdict"] != WORKS and a["limited_by"]]
        for limit, _ in Counter(answer["limited_by"] for answer in failing).most_common(2):
            some = [answer for answer in failing if answer["limited_by"] == limit]
            places = []  # what these answers have in common and others do not
            for of, text in (
                (lambda a: a[LIGHT.name], self._light_text),
                (self.data.speed.of, self._speed_text),
            ):
                own, every = {of(each) for each in some}, {of(each) for each in self.answers}
                places += [text(own.pop())] if len(own) == 1 < len(every) else []
            where = f" at {joined(places)}".replace("at at rest", "at rest") if places else ""
            parts.append(limit_text(limit) + where)
        if parts:
            return "; ".join(parts) + "."
        ends = []
        for name, side in (("limited_low", "shorter exposures fail by"), ("limited_high", "longer ones by")):
            named = [answer[name] for answer in self.answers if answer[name]]
            if named:
                ends.append(f"{side} {limit_text(max(sorted(set(named)), key=named.count))}")
        return joined(ends) + "." if ends else ""

    def surer(self) -> str:
        """What to do next for a surer answer."""
        unknown = sum(row["verdict"] == CANNOT_TELL for row in self.conditions)
        count = max((answer["n_pictures"] for answer in self.answers), default=0)
        leave = f"{counted(count, 'picture')} {'leaves' if count == 1 else 'leave'}"
        parts = [f"more pictures ({leave} {unknown} of {len(self.conditions)} open)"] if unknown else []
        exposures = self.data.axes[0]
        tested = exposures.values[: exposures.count]
        chosen = None if self.whole is None else self.whole["exposure_s"]
        if chosen is not None and len(tested) > 1 and chosen in (tested[0], tested[-1]):
            side = "longest" if chosen == tested[-1] else "shortest"
            parts.append(f"{side[:-3]}er exposures ({EXPOSURE.text(chosen)} is the {side} tested)")
        return joined(parts) + "." if parts else "pictures of other scenes; with these no verdict is open."


def table_rows(shown: Opening, most: int, speeds: int) -> tuple[list[str], list[list[str]], int]:
    """Heads and rows of text for a terminal, of at most so many rows and speeds; how many cells are left out."""
    kept = [*range(len(shown.heads))[:2], *spread(range(2, len(shown.heads)), speeds)]
    rows = spread(shown.rows, most)
    text = [[name, *(cells[place - 1][1] for place in kept[1:])] for name, _, cells in rows]
    hidden = len(shown.rows) * (len(shown.heads) - 1) - len(rows) * (len(kept) - 1)
    return [shown.heads[place] for place in kept], text, hidden
