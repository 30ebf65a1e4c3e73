"""The first lines of a run's terminal output and page: the exposure to use, its score, verdicts, limits, next steps.

Domain: exposures in s (written in ms), speeds in px/s or km/h, values in the criterion's unit. Texts are plain,
never markup.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter, itemgetter

from blurnoise_eval.answers.choosing import FINER, NEAR
from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.answers.recommendation import CANNOT_TELL, FAILS, SURE
from blurnoise_eval.answers.rows import AnswerRow, RecommendationRow
from blurnoise_eval.answers.table import LEAST_KNOWN
from blurnoise_eval.plan.axes import EGO, EGO_SPEED, EXPOSURE, GAIN, LIGHT, SETTING
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report.lights import lights_of_run, saturates
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import word
from blurnoise_eval.report.settled import alike_text, all_alike, settled_legend, settled_text, use_text
from blurnoise_eval.report.words import counted, joined, keeps, limit_text, plural, reached_text, value_text
from blurnoise_eval.scoring.uncertainty import FEWEST

MAX_MODELS = 4
MAX_ROWS, MAX_SPEEDS = 8, 3  # of the table in a terminal
MUCH = 0.05
"""So much better must one exposure for each light be that it is recommended before a single one."""
MARKS = {SURE: SURE, FAILS: FAILS, CANNOT_TELL: "?"}
Cell = tuple[str, str, list[str]]
"""Of a table: its class, its text, and lines in small print."""
TableRow = tuple[str, str, list[Cell]]
"""Its name, a note on it, its cells."""
UNTESTED: Cell = "", "–", []


@dataclass(frozen=True)
class Opening:
    """The first part of a report.

    model: whose table it is, the best of several; None without an answer. sentences: the answer. heads, rows: the
    table of light x speed, of the exposures to use, in two lines: '3 ms', '0.88 works'; caption: what its entries
    are, legend: what the verdicts mean. notes: (title, text) of what limits the model, and of what to do next.
    lights: a line for each light of a run with headlamps, and what is to be known of it. further: the tables of the
    other models alone.
    """

    model: str | None
    sentences: tuple[str, ...]
    heads: tuple[str, ...] = ()
    rows: tuple[TableRow, ...] = ()
    caption: str = ""
    legend: str = ""
    notes: tuple[tuple[str, str], ...] = ()
    lights: tuple[str, ...] = ()
    further: tuple[Opening, ...] = ()


def opening(data: RunData, run: str = "RUN") -> Opening:
    """The opening of a run. run: where it is, for commands to copy."""
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
            texts = each.answer(brief=each is not best)
            sentences += [f"{each.model}: {text[0].lower()}{text[1:]}" if several else text for text in texts]
        elif each.model in reasons:
            sentences.append(f"{each.model}: {reasons[each.model]}")
    title, level = data.criterion.title, data.criterion.level
    caption = f"Exposure to use, {title} and verdict:"
    legend = f"works: 95 % interval at or above {level:g}; fails: below; ?: cannot tell" + settled_legend(
        [row for each in answered[:MAX_MODELS] for row in (*each.lights, *each.conditions)]
    )
    notes = ("What limits it", best.limits()), ("What to do next", best.next_steps(run))
    shown = tuple(each for each in notes if each[1])
    lights = tuple(data.manifest.get("light", ()))
    further = tuple(Opening(each.model, (), *each.table()) for each in answered[1:MAX_MODELS])
    return Opening(best.model, tuple(sentences), *best.table(), caption, legend, shown, lights, further)


def ranked(data: RunData) -> list[str]:
    """The models, the best first: by mPC where the pictures have labels, else as they were given."""
    mpc = {row.model: row.mpc.value for row in data.models}
    if not data.manifest["images"].get("labelled", True) or None in mpc.values():
        return data.model_names
    return sorted(data.model_names, key=lambda name: -(mpc[name] or 0.0))


def _ranking(data: RunData, names: Sequence[str]) -> str:
    """Which of several models is best, and by how much, with the interval of the paired difference."""
    if not data.manifest["images"].get("labelled", True):
        return "The models cannot be ranked: without labels, each is compared with its own detections."
    rows = {row.model: row for row in data.models}
    first, *others = (rows[name] for name in names)
    if first.mpc.value is None:
        return "The models cannot be ranked: their scores are not known."
    behind = []
    for row in others[: MAX_MODELS - 1]:
        less, low, high = row.mpc_deficit
        if less is None:
            behind.append(f"{row.model} {row.mpc.known:.3f}")
        elif low is None or high is None:
            behind.append(f"{row.model} is {less:.3f} lower (too few pictures for an interval)")
        else:
            sure = "" if low > 0 else ", which may be chance"
            behind.append(f"{row.model} is {less:.3f} ({low:.3f} to {high:.3f}) lower{sure}")
    behind += [f"{len(names) - MAX_MODELS} more in models.csv"] * (len(names) > MAX_MODELS)
    mean = f"mean {first.measure} over all conditions"
    return f"The best model is {first.model}, with mPC {first.mpc.known:.3f} ({mean}). {'; '.join(behind)}."


class _OfModel:
    """What one model's recommendations say."""

    def __init__(self, data: RunData, model: str) -> None:
        self.data, self.model, self.level = data, model, data.criterion.level
        rows = [row for row in data.recommendations if row.model == model]
        self.whole = next((row for row in rows if row.scope == "all"), None)
        """Its exposure for all conditions; None where none was tested in all of them."""
        self.lights = [row for row in rows if row.scope == "light"]
        self.conditions = [row for row in rows if row.scope == "condition"]
        self.speeds = sorted({row.speed or 0.0 for row in self.conditions})
        self.answers = [answer for answer in data.answers if answer.model == model]
        self.axes = [axis for axis in data.settings.axes if axis not in (GAIN, EGO)]
        """Those that name a row of the table: the light, and what else varies, but for gain and vehicle's speed."""
        self.varied = [
            word(axis) for axis in self.axes if len({row.conditions[axis.name] for row in self.lights}) > 1
        ]
        self.lights_noun = "settings" if self.varied[1:] or self.varied[:1] != ["light"] else "lights"
        self.named = {lux: light.name for lux, light in lights_of_run(data.manifest).items()}
        """The names of the lights, if the run names them."""
        self.verb = "keep" if data.criterion.kept else "reach"

    @property
    def by_light(self) -> bool:
        """Whether one exposure for each light is recommended, and not a single one."""
        return self.whole is None or self._of_lights() - self.whole.score.known > MUCH

    @property
    def combinations(self) -> str:
        """'combinations of light and speed', 'lights'."""
        names = self.varied + ["speed"] * (len(self.speeds) > 1)
        names += ["direction"] * (sum(row.n_conditions for row in self.conditions) > len(self.conditions))
        return (
            f"combinations of {joined(names)}"
            if len(names) > 1
            else plural(names[0])
            if names
            else "conditions"
        )

    def _setting_texts(self, row: RecommendationRow) -> list[str]:
        return [
            self._light_text(row.conditions[LIGHT.name]),
            *(axis.text(row.conditions[axis.name]) for axis in self.axes[1:]),
        ]

    def _light_text(self, lux: float) -> str:  # '1 lux', or '1 lux (street)' of named lights
        return LIGHT.text(lux) + (f" ({self.named[lux]})" if lux in self.named else "")

    def _speed_text(self, speed: float) -> str:
        return self.data.speed.text(speed) if speed or self.data.speed is EGO_SPEED else "at rest"

    def answer(self, *, brief: bool) -> list[str]:
        """What to use, the most important first. brief: without where it falls short."""
        if (most := max(row.score.known for row in self.conditions)) < LEAST_KNOWN:
            best = reached_text(f"{most:.2f}", self.data.criterion)
            return [f"No exposure works, and none can be recommended: the best {best}."]
        if self.whole is None:
            return [
                self._of_each_light(brief=brief),
                f"No single exposure was tested at every {self.lights_noun[:-1]}.",
            ]
        if not self.by_light:
            return [self._single(self.whole, brief=brief)]
        first = self._of_each_light(brief=brief)
        return [first] if brief else [first, self._instead(self.whole)]

    def _of_each_light(self, *, brief: bool) -> str:
        """One exposure for each light, and its score."""
        ends = [(row, EXPOSURE.text(row.exposure_s)) for row in (self.lights[0], self.lights[-1])]
        span = " to ".join(f"{text} at {LIGHT.text(row.conditions[LIGHT.name])}" for row, text in ends)
        if self.varied != ["light"]:
            every = sorted(row.exposure_s for row in self.lights)
            span = f"{EXPOSURE.text(every[0])} to {EXPOSURE.text(every[-1])} (see the table)"
        by = f"the {self.varied[0]}" if len(self.varied) == 1 else joined(self.varied)
        counts = ("n_works", "n_fails", "n_conditions")
        works, fails, n = (sum(map(attrgetter(count), self.lights)) for count in counts)
        reached = reached_text(f"{self._of_lights():.2f}", self.data.criterion) + self._over(brief=brief)
        of_kinds, settled = self._of_each_kind() * (not brief), self._settled(self.lights)
        bright = self._saturates(max(self.lights, key=lambda row: row.saturated_share or 0.0))
        unsure = "" if brief else bright + self._unsure(self.lights[0])
        if not works:
            # Nobody should set what fails; the best of it is still worth knowing.
            start = "No exposure works" if fails == n else "No exposure surely works"
            start += " for all kinds of target together" * bool(of_kinds)
            some = self._works(works, fails, n) * (fails < n)
            return f"{start}. The best by {by}, from {span}, {reached}.{some}{of_kinds}{settled}{unsure}"
        verdicts = self._works(works, fails, n) + of_kinds
        return f"Set the exposure by {by}, from {span}.{settled} This {reached}.{verdicts}{unsure}"

    def _of_each_kind(self) -> str:
        """In how many cases some exposure works, if kinds of target differ in this."""
        works = sum(answer.verdict == WORKS for answer in self.answers)
        several = len({answer.group for answer in self.answers}) > 1
        text = f" For each kind of target alone, an exposure works in {works} of {len(self.answers)} cases."
        return text * (several and works < len(self.answers))

    def _single(self, row: RecommendationRow, *, brief: bool) -> str:
        """One exposure for everything, and its score."""
        n, use = row.n_conditions, EXPOSURE.text(row.exposure_s)
        bright = "" if brief else self._bright(row)
        if n == 1:
            use = f"Use {use}" if row.verdict == SURE else f"The best exposure is {use}"
            least = f"at least {self.level:g}"
            verdict = {
                SURE: f"This works: it is {least}.",
                FAILS: f"This fails: it is below {self.level:g}.",
                CANNOT_TELL: f"The pictures cannot tell whether that is {least}.",
            }[row.verdict]
            return (
                f"{use}.{self._settled([row])} It {self._reached(row)}. {verdict}{self._unsure(row)}{bright}"
            )
        best = "only tested exposure" if len(self.data.axes[0].values) == 1 else "best single exposure"
        use = f"Use {use}" if 2 * row.n_works >= n else f"The {best} is {use}"
        works = self._works(row.n_works, row.n_fails, n) + self._unsure(row)
        found = f"{use}.{self._settled([row])} It {self._reached(row)}{self._over(brief=brief)}.{works}"
        return found if brief else f"{found}{self._better(row)}{self._weakest()}{bright}"

    def _settled(self, rows: Sequence[RecommendationRow]) -> str:
        """Whether the pictures decide for these exposures, one or one for each light, however good they are."""

        def at(row: RecommendationRow) -> str:
            return f" at {self._light_text(row.conditions[LIGHT.name])}" if len(rows) > 1 else ""

        return settled_text(rows, at, self._pictures) + all_alike(rows, at)

    def _instead(self, row: RecommendationRow) -> str:
        """A single exposure, where one for each light is much better."""
        works = self._works(row.n_works, row.n_fails, row.n_conditions, named=False)
        use = f"{EXPOSURE.text(row.exposure_s)} {self._reached(row)}"
        return f"A single exposure for all {self.lights_noun} is worse. {use}.{works}{self._bright(row)}"

    def _reached(self, row: RecommendationRow) -> str:
        return reached_text(value_text(row.score), self.data.criterion)

    def _works(self, works: int, fails: int, n: int, *, named: bool = True) -> str:
        """In how many combinations of light and speed a choice works. named: with 'combinations ...'."""
        of = f"{n} {self.combinations}" if named else f"{n}"
        at = "in" if self.combinations.startswith("combinations") else "at"
        unknown = n - works - fails
        if n in (works, fails):
            every = f"both{f' {self.combinations}' * named}" if n == 2 else f"all {of}"
            return f" It {'works' if works else 'fails'} {at} {every}."
        if unknown == n:
            return f" The pictures cannot tell {at} which of {of} it works."
        parts = [f"{verb} {at} {count}" for verb, count in (("works", works), ("fails", fails)) if count]
        parts[0] += f" of {of}"
        return f" It {joined(parts)}." + f" For {unknown} the pictures cannot tell." * (unknown > 0)

    def _unsure(self, row: RecommendationRow) -> str:
        """Why a score has no interval."""
        if row.score.low is not None:
            return ""
        weight = " of unequal weight" if row.n_pictures >= FEWEST else ""
        are = "is" if row.n_pictures == 1 else "are"
        return f" {self._pictures(row)}{weight} {are} too few for an interval."

    def _pictures(self, row: RecommendationRow) -> str:
        """'24 pictures', '20 pictures with targets' where more were evaluated."""
        clustered = self.data.manifest.get("cluster") is not None
        fewer = row.n_pictures < self.data.manifest["images"]["count"] and not clustered
        return counted(row.n_pictures, "picture") + " with targets" * fewer

    def _of_lights(self) -> float:
        """What one exposure for each light reaches, mean over the conditions."""
        return _mean_score(self.lights)

    def _better(self, row: RecommendationRow) -> str:
        """What an exposure for each light would reach, or one for each light and speed."""
        each, best = self.lights_noun[:-1], self._of_lights()
        if len(self.lights) == 1 or best - row.score.known <= NEAR:
            each = "combination" if self.combinations.startswith("combinations") else "speed"
            best = _mean_score(self.conditions)
        better = best - row.score.known > NEAR and f"{best:.2f}" != f"{row.score.known:.2f}"
        return f" One exposure for each {each} would {self.verb} {best:.2f}." * better

    def _bright(self, row: RecommendationRow) -> str:
        """What the exposure saturates, and which one keeps more but saturates too much to be used."""
        means = (row for row in self.data.averages if row.model == self.model)
        tested = {s: value for each in means for s, value in zip(each.exposures_s, each.values, strict=True)}
        exposure_s, value = max(tested.items(), key=itemgetter(1, 0), default=(0.0, 0.0))
        if value - tested.get(row.exposure_s, value) > NEAR + FINER and exposure_s > row.exposure_s:
            more = f"{EXPOSURE.text(exposure_s)} {keeps(self.data.criterion)} {value:.2f}"
            return f"{self._saturates(row)} {more}, but saturates too much."
        return self._saturates(row)

    def _saturates(self, row: RecommendationRow) -> str:
        """How much of the picture an exposure saturates in the brightest of its lights, if that is much."""
        lux = row.conditions[LIGHT.name] or max(each.conditions[LIGHT.name] for each in self.lights)
        return saturates(row.saturated_share or 0.0, f" at {LIGHT.text(lux)}" * (len(self.lights) > 1))

    def _weakest(self) -> str:
        """Where the single exposure is worst."""
        scores = [(row.score_at_overall_exposure, row) for row in self.conditions]
        known = [(score, row) for score, row in scores if score is not None]
        least, worst = min(known, key=itemgetter(0), default=(math.inf, None))
        if worst is None or len(known) < 2 or least >= self.level:
            return ""
        speed = [self._speed_text(worst.speed or 0.0)] if len(self.speeds) > 1 else []
        at = joined(self._setting_texts(worst) + speed).replace("and at rest", "at rest")
        return f" It is worst at {at}: {least:.2f}."

    def _over(self, *, brief: bool) -> str:
        """' on average over 3 lights, 2 speeds and 3 kinds of target'."""
        if brief:
            return ""
        counts = {
            plural(word(axis)): len({row.conditions[axis.name] for row in self.lights}) for axis in self.axes
        }
        counts["speeds"] = len(self.speeds)
        counts["kinds of target"] = len({answer.group for answer in self.answers})
        over = [f"{count} {noun}" for noun, count in counts.items() if count > 1] or ["directions"]
        return f" on average over {joined(over)}"

    def table(self) -> tuple[tuple[str, ...], tuple[TableRow, ...]]:
        """Heads and rows of light x speed, the first for any speed where there are several."""
        several = len(self.speeds) > 1
        key = itemgetter(*(name for name in SETTING if name != GAIN.name))
        cells = {(key(row.conditions), row.speed): row for row in self.conditions}
        rows = []
        for light in self.lights:
            own = [light] * several + [cells.get((key(light.conditions), speed)) for speed in self.speeds]
            found = [UNTESTED if row is None else self._cell(row) for row in own]
            name = " · ".join(self._setting_texts(light)).replace(" (", " ").replace(")", "")  # shorter
            rows.append((name, "", found))
        title = "light" if len(self.axes) == 1 else "setting"
        return (title, *["any speed"] * several, *map(self._speed_text, self.speeds)), tuple(rows)

    def _cell(self, row: RecommendationRow) -> Cell:
        use, verdict, (_, low, high) = use_text(row), row.verdict, row.score
        if row.conditions[GAIN.name] is not None and GAIN in self.data.settings.axes:
            use += f", {GAIN.text(row.conditions[GAIN.name]).removeprefix('gain ')}"
        interval = "" if low is None or high is None else f"{low:.2f}–{high:.2f}"
        as_good = [f"{text} alike" for text in [alike_text(row)] if text]
        return MARKS[verdict], f"{use}\n{row.score.known:.2f} {MARKS[verdict]}", [interval, *as_good]

    def limits(self) -> str:
        """What limits the conditions in which no exposure works, the most frequent first; else what ends the
        windows."""
        parts = []
        failing = [a for a in self.answers if a.verdict != WORKS and a.best_limited_by]
        limits = Counter(answer.best_limited_by or "" for answer in failing)
        for limit, _ in limits.most_common(2):
            some = [answer for answer in failing if answer.best_limited_by == limit]
            places = []  # what these answers have in common and others do not
            for of, text in (
                (lambda at: at[LIGHT.name], self._light_text),
                (self.data.speed.of, self._speed_text),
            ):
                own, every = (
                    {of(each.conditions) for each in some},
                    {of(each.conditions) for each in self.answers},
                )
                places += [text(own.pop())] if len(own) == 1 < len(every) else []
            where = f" at {joined(places)}".replace("at at rest", "at rest") if places else ""
            groups = {answer.group for answer in some}
            only = len(groups) == 1 < len({answer.group for answer in self.answers})
            target = f", for {groups.pop()}" if only else ""
            parts.append(limit_text(limit) + where.replace("and at rest", "at rest") + target)
        if parts:
            return "; ".join(parts) + "."
        ends: list[str] = []
        sides: list[tuple[Callable[[AnswerRow], str | None], str]] = [
            (attrgetter("window_from_limited_by"), "shorter"),
            (attrgetter("window_to_limited_by"), "longer"),
        ]
        for limited_by, side in sides:
            named = [name for answer in self.answers if (name := limited_by(answer)) is not None]
            if named:
                limit = limit_text(max(sorted(set(named)), key=named.count))
                ends.append(f"{side} {'ones' if ends else 'exposures fail'} because of {limit}")
        return ", ".join(ends) + "." if ends else ""

    @property
    def _suits_a_program(self) -> bool:
        """Whether 'blurnoise program' takes such a run, and gains something over a single exposure."""
        automatic = all(row.conditions[GAIN.name] == AUTOMATIC for row in self.lights)
        return self.by_light and self.whole is not None and self.varied == ["light"] and automatic

    def next_steps(self, run: str) -> str:
        """What to do for a surer answer, or with this one. run: where it is."""
        n = sum(row.n_conditions for row in self.conditions)
        unknown = sum(row.n_conditions for row in self.conditions if row.verdict == CANNOT_TELL)
        most = max(self.conditions, key=attrgetter("n_pictures"))
        some = f" on {unknown} of {n} {self.combinations.split()[0]}" * (n > 1)
        parts = [f"Evaluate more pictures. With {self._pictures(most)}, the verdict{some} is open."] * (
            unknown > 0
        )
        if not unknown and any(row.settled is False for row in self.conditions):
            parts.append("Evaluate more pictures, to settle the exposure.")
        exposures = self.data.axes[0]
        tested = exposures.values[: exposures.count]
        rows = [] if self.whole is None else self.lights if self.by_light else [self.whole]
        chosen = {row.exposure_s for row in rows} if len(tested) > 1 else set()
        for end, side in ((tested[:1], "shortest"), (tested[-1:], "longest")):
            if chosen.intersection(end):
                text = EXPOSURE.text(end[0])
                parts.append(f"Test {side[:-3]}er exposures: {text} is the {side} tested.")
        if self._suits_a_program:
            manifest = self.data.manifest
            if manifest.get("searched") and not manifest.get(
                "predicted"
            ):  # a program needs the rest of the grid
                parts.append(f"Compute the whole grid with 'blurnoise sweep' and -o {run}.")
            parts.append(f"Make the camera's exposure program with 'blurnoise program {run} -o program'.")
        return (
            " ".join(parts) or "Check this with pictures of other scenes. With these, every verdict is clear."
        )


def _mean_score(rows: Sequence[RecommendationRow]) -> float:
    """Over their conditions."""
    total = sum(each.n_conditions for each in rows)
    return float(sum(each.score.known * each.n_conditions for each in rows) / total)


def table_rows(shown: Opening, most: int, speeds: int) -> tuple[list[str], list[list[str]], int]:
    """Heads and rows of text for a terminal, of at most so many rows and speeds; how many cells are left out."""
    kept = [*range(len(shown.heads))[:2], *spread(range(2, len(shown.heads)), speeds)]
    rows = spread(shown.rows, most)
    text = [
        [name, *(cells[place - 1][1].replace("\n", " ") for place in kept[1:])] for name, _, cells in rows
    ]
    hidden = len(shown.rows) * (len(shown.heads) - 1) - len(rows) * (len(kept) - 1)
    return [shown.heads[place] for place in kept], text, hidden
