"""The opening of a report: the sentence that answers, then which exposure, which gain, how fast, how sure.

Domain: exposures in s (written in ms), gains in dB, speeds in px/s, values in the criterion's unit. Texts are plain,
never markup.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from blurnoise_eval.grid.axes import EXPOSURE
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.frontier import (
    Row,
    at_best_gain,
    exposure_for_all,
    rows_that_decide,
    values_at,
)
from blurnoise_eval.report.measured import finite, model_names
from blurnoise_eval.report.questions import combinations_text, limits_of, questions, varied
from blurnoise_eval.report.words import (
    CANNOT_TELL,
    NONE_WORKS,
    WORKS,
    Answer,
    best_value_text,
    confidence_text,
    enough_text,
    joined,
    limit_text,
    needed_text,
    pictures_range,
    pictures_text,
    reached_text,
    value_text,
)

MAX_NAMED = 4  # settings or models in a sentence


@dataclass(frozen=True)
class Opening:
    """What stands first. model: whose answer it is, the one that keeps most of several; None without targets.

    sentences: the answer. questions: (question, answer), in the order in which they are asked. rows: those that
    decide. every: what there is an answer of: 'target, light and speed'.
    """

    model: str | None
    sentences: tuple[str, ...]
    questions: tuple[tuple[str, str], ...] = ()
    rows: tuple[Row, ...] = ()
    every: str = ""


def opening(data: RunData) -> Opening:
    """The opening of a run."""
    if not data.answers:
        return Opening(None, (_nothing(data),))
    model = leader(data)
    own = at_best_gain(data, [answer for answer in data.answers if answer["model"] == model])
    rows = tuple(rows_that_decide(data, own))
    several = [] if len(model_names(data)) == 1 else [_between(data, model)]
    return Opening(
        model, (*several, _answer(data, own)), tuple(questions(data, own, rows)), rows, _what(data)
    )


def _nothing(data: RunData) -> str:
    if data.manifest.get("withheld"):
        return (
            "The models find too little in the untouched pictures to say what they keep of it: no exposure can be "
            "recommended. Are these the classes that they know?"
        )
    return "The pictures hold no targets, so no exposure can be recommended."


def leader(data: RunData) -> str:
    """The model that keeps most or, where that is not known, the one for which an exposure works most often."""
    kept = {row["model"]: finite(row.get("best_value")) for row in data.models}
    names = [name for name in model_names(data) if any(answer["model"] == name for answer in data.answers)]

    def merit(name: str) -> tuple[float, int]:
        return kept.get(name) or 0.0, _count(data.answers, WORKS, name)

    return max(names, key=merit)


def _between(data: RunData, model: str) -> str:
    """Which of several models keeps most, and whether that can be told."""
    asked = data.answers[0]["criterion"]
    kept = [(value, row) for row in data.models if (value := finite(row.get("best_value"))) is not None]
    if len(kept) < 2:
        of = Counter(answer["model"] for answer in data.answers)
        counts = [f"{name} {_count(data.answers, WORKS, name)} of {count}" for name, count in of.items()]
        return f"Some exposure {enough_text(asked)} in: {_listed(counts)}."
    kept.sort(key=lambda pair: -pair[0])
    (value, first), *others = kept
    said = " of its " in asked and asked.endswith("confidence")
    reached = reached_text(value_text(value, first["best_low"], first["best_high"]), asked)
    reached += f"{clean} in untouched pictures" if (clean := _untouched(first, said)) else ""
    behind = [
        f"{row['model']} {value_text(other, row['best_low'], row['best_high'])}{_untouched(row, said)}, "
        f"{_difference(row)}"
        for other, row in others
    ]
    return f"{model} {reached} at the best exposures, on average; {_listed(behind, '; ')}."


def _untouched(row: dict[str, Any], said: bool) -> str:
    """Of a model that keeps much, how much that is: ' of 0.24'."""
    value = finite(row.get("target_confidence"))
    return "" if value is None or not said else f" of {value:.2f}"


def _difference(row: dict[str, Any]) -> str:
    low = finite(row["behind_low"])
    if low is not None and low > 0:
        return f"surely less ({row['behind']:.2f}, at least {low:.2f})"
    wanted = row["pictures_to_tell_behind"]
    more = (
        "very many more pictures" if wanted is None else f"~{wanted - row['standing_pictures']} more pictures"
    )
    return f"too close to tell ({more} would)"


def _answer(data: RunData, answers: Sequence[Answer]) -> str:
    """The sentence that answers for one model."""
    if len(answers) == 1:
        return _answer_of_one(answers[0])
    level, asked = data.manifest["threshold"], answers[0]["criterion"]
    n, enough = len(answers), enough_text(asked)
    combinations = combinations_text(n, varied(data, answers))
    works, untold = _count(answers, WORKS), _count(answers, CANNOT_TELL)
    chosen = exposure_for_all(answers, level)
    if chosen is None:
        return f"Nothing was measured in {combinations}."
    exposure_s, sure, known = chosen
    values, at = values_at(answers, exposure_s), EXPOSURE.text(exposure_s)
    use = f"Use {at}: it"
    if known < n:  # as where the camera sets it: each light has its own
        values, at, sure = [answer["best_value"] for answer in answers], "what is best for each", works
        use = "With the exposure that is best for each it"
    average = reached_text(f"{fmean(values):.2f}", asked) + " on average"
    surely = f"{use} {average}, and surely at least {level:g} in"
    if sure == n:
        return f"{surely} all {combinations}."
    rest = [f"no exposure does in {n - works - untold}"] if n - works - untold else []
    rest += [f"{untold} cannot be told"] if untold else []
    if sure:
        more = [f"other exposures do in {works - sure} more"] if works > sure else []
        return f"{surely} {sure} of {combinations}; {joined([*more, *rest])}."
    limit = limits_of(answers)
    limited = f", limited by {limit}" if limit else ""
    if not untold:
        return f"No tested exposure {enough} in any of {combinations}. Best is {at}: {average}{limited}."
    which = (
        f"any of {combinations}" if untold == n else f"{untold} of {combinations}; in the others none does"
    )
    few = (
        f"{pictures_range(answers)} {_are(answers)} too few to tell whether any exposure {enough} in {which}"
    )
    return f"Best is {at}: {average}{limited}. {few[0].upper()}{few[1:]}."


def _answer_of_one(answer: Answer) -> str:
    asked = answer["criterion"]
    if answer["verdict"] == WORKS:
        reached = reached_text(confidence_text(answer), asked)
        return f"Use {EXPOSURE.text(answer['recommended_s'])}: it {reached}."
    limited = f", limited by {limit_text(answer['limited_by'])}" if answer["limited_by"] else ""
    best = (
        f"Best is {EXPOSURE.text(answer['best_s'])}: {reached_text(best_value_text(answer), asked)}{limited}."
    )
    if answer["verdict"] == NONE_WORKS:
        return f"No tested exposure {enough_text(asked)}. {best}"
    untold = f"{pictures_text(answer)} cannot tell whether any exposure {enough_text(asked)}"
    return f"{best} {untold}; {needed_text(answer)}."


def _are(answers: Iterable[Answer]) -> str:
    return "is" if all(answer["n_pictures"] == 1 for answer in answers) else "are"


def _what(data: RunData) -> str:
    return joined(varied(data, data.answers)) if len(data.answers) > 1 else "answer"


def _count(answers: Iterable[Answer], verdict: str, model: str | None = None) -> int:
    return sum(answer["verdict"] == verdict and model in (None, answer["model"]) for answer in answers)


def _listed(parts: Sequence[str], between: str = ", ") -> str:
    return between.join(parts[:MAX_NAMED]) + (f"{between}…" if len(parts) > MAX_NAMED else "")
