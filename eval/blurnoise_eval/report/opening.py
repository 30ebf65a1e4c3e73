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

from blurnoise_eval.grid.axes import AUTOMATIC, EXPOSURE, speed_px_s
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.frontier import (
    Row,
    exposure_for_all,
    gain_at,
    rows_that_decide,
    values_at,
)
from blurnoise_eval.report.measured import finite, model_names, spread
from blurnoise_eval.report.settings import Setting, word
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
    own = [answer for answer in data.answers if answer["model"] == model]
    rows = tuple(rows_that_decide(data, own))
    several = [] if len(model_names(data)) == 1 else [_between(data, model)]
    return Opening(
        model, (*several, _answer(data, own)), tuple(_questions(data, own, rows)), rows, _what(data)
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
    combinations = f"{n} combinations of {_what(data)}"
    works, untold = _count(answers, WORKS), _count(answers, CANNOT_TELL)
    chosen = exposure_for_all(answers, level)
    if chosen is None:
        return f"Nothing was measured in {combinations}."
    exposure_s, sure, _ = chosen
    mean = fmean(values_at(answers, exposure_s))
    at = EXPOSURE.text(exposure_s)
    average = reached_text(f"{mean:.2f}", asked) + " on average"
    surely = f"Use {at}: it {average}, and surely at least {level:g} in"
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
    few = f"{_pictures(answers)} are too few to tell whether any exposure {enough} in {which}"
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
    return (
        f"{best} {pictures_text(answer)} cannot tell whether any {enough_text(asked)}; {needed_text(answer)}."
    )


def _questions(data: RunData, answers: Sequence[Answer], rows: Sequence[Row]) -> Iterable[tuple[str, str]]:
    level = data.manifest["threshold"]
    best = {
        setting: chosen[0]
        for setting in data.settings.every
        if (own := [answer for answer in answers if data.settings.of(answer) == setting])
        and (chosen := exposure_for_all(own, level))
    }
    if not best:
        return
    yield "Which exposure?", _per_setting(data, {each: EXPOSURE.text(at) for each, at in best.items()})
    gains = {each: gain for each, at in best.items() if (gain := gain_at(data, each, at)) is not None}
    if gains:
        told = _per_setting(data, {each: gain_text(gain) for each, gain in gains.items()})
        automatic = any(axis.automatic and value == AUTOMATIC for axis, value in data.settings.held)
        yield "Which gain?", f"{told}{' (set by the camera, mean over pictures)' if automatic else ''}"
    yield "How fast?", _how_fast(data, answers, rows)
    yield "How sure?", _how_sure(answers)


def gain_text(gain_db: float) -> str:
    """'12 dB'."""
    return f"{round(gain_db) + 0:d} dB"


def limits_of(answers: Iterable[Answer]) -> str | None:
    """What limits most of the answers in which no exposure surely works: 'motion blur', 'noise (in 5 of 9)'.

    None where that is known of fewer than half of them.
    """
    every = [answer for answer in answers if answer["verdict"] != WORKS]
    named = [answer["limited_by"] for answer in every if answer["limited_by"]]
    if not named or 2 * len(named) < len(every):
        return None
    (first, count), *_ = Counter(named).most_common()
    return limit_text(first) + (f" (in {count} of {len(named)})" if count < len(named) else "")


def _per_setting(data: RunData, texts: dict[Setting, str]) -> str:
    """'20 ms at 5 lux, 5 ms at 50 lux'; one text where all are alike."""
    if len(set(texts.values())) == 1:
        text = next(iter(texts.values()))
        lights = len(data.settings.every) > 1 and len(texts) == len(data.settings.every)
        return f"{text} at every {_settings_word(data)}" if lights else text
    shown = spread(texts, MAX_NAMED)
    left = len(texts) - len(shown)
    listed = ", ".join(f"{texts[setting]} at {data.settings.text(setting)}" for setting in shown)
    return f"{listed}; {left} more between" if left else listed


def _settings_word(data: RunData) -> str:
    return "setting" if data.settings.further else "light"


def _how_fast(data: RunData, answers: Sequence[Answer], rows: Sequence[Row]) -> str:
    fastest = max(map(speed_px_s, answers))
    combined = len(rows) > 1 or len(rows[0].settings) > 1
    tops = [row for row in rows if row.top_px_s is not None]
    count = sum(len(row.settings) for row in rows)
    what = joined([name for name in _varied(data, answers) if name != "speed"]) if combined else ""
    if not tops:
        if all(answer["verdict"] == NONE_WORKS for answer in answers):
            return f"at no tested speed{'' if fastest else ', not even at rest,'} does an exposure suffice"
        guess = max((speed_px_s(answer) for answer in answers if answer["windows_s"]), default=None)
        seen = f"; for these pictures alone one does up to {guess:g} px/s" if guess is not None else ""
        return f"at no tested speed does an exposure surely suffice{seen}"
    top = max(tops, key=lambda row: row.top_px_s or 0.0)
    if len(tops) == len(rows) and all(row.fastest for row in rows):
        longest = max(rows, key=lambda row: row.exposure_s)
        return _up_to(longest, f" for every {what}" if combined else "")
    text = _up_to(top, f" for {top.group} at {data.settings.text(top.settings[0])}" if combined else "")
    limit = limits_of(answer for row in rows for answer in row.others)
    if not combined:
        return f"{text}; beyond, {limit} limits" if limit else text
    if len(tops) == len(rows):
        least = min(row.top_px_s or 0.0 for row in rows)
        rest = f"{f'up to {least:g} px/s' if least else 'at rest'} for every {what}"
    else:
        rest = f"in {count - len(tops)} of {count} combinations of {what} at no tested speed"
    return f"{text}; {rest}" + (f", limited by {limit}" if limit else "")


def _up_to(row: Row, where: str) -> str:
    """'up to 1000 px/s, the fastest tested, for every target (5 px of blur at 5 ms)'."""
    speed = row.top_px_s or 0.0
    if not speed:
        return (
            f"at rest, the only speed tested,{where}".removesuffix(",") if row.fastest else f"at rest{where}"
        )
    tested = ", the fastest tested" if row.fastest else ""
    blur = f"{speed * row.exposure_s:.2g} px of blur at {EXPOSURE.text(row.exposure_s)}"
    return f"up to {speed:g} px/s{tested}{',' if tested and where else ''}{where} ({blur})"


def _how_sure(answers: Sequence[Answer]) -> str:
    untold = [answer for answer in answers if answer["verdict"] == CANNOT_TELL]
    told = f"{len(answers) - len(untold)} of {len(answers)}" if untold else f"all {len(answers)}"
    few = " (few)" if any(answer["few_pictures"] for answer in answers) else ""
    parts = [f"{_pictures(answers)}{few}, 95 % intervals"]
    if len(answers) > 1:
        parts.append(f"{told} verdicts are sure")
    if untold:
        parts.append(_more(untold))
    losses = [
        loss
        for each in answers
        if each["verdict"] == WORKS and (loss := finite(each["regret_95"])) is not None
    ]
    if losses:
        parts.append(f"the exposures to use lose at most {max(losses):.2g} against the best tested")
    return "; ".join(parts)


def _more(untold: Sequence[Answer]) -> str:
    """How many pictures more would tell: '~28 more pictures would tell 4, ~900 all; very many the last 2'."""
    more = sorted(
        answer["pictures_to_tell"] - answer["n_pictures"]
        for answer in untold
        if answer["pictures_to_tell"] is not None
    )
    if not more:
        return f"of the rest: {needed_text(untold[0])}" if len(untold) > 1 else needed_text(untold[0])
    steps = [f"~{more[0]} more pictures would tell" + (" one more" if len(untold) > 1 else "")]
    if len(more) > 1 and more[-1] > more[0]:
        half = more[(len(more) - 1) // 2]
        steps += [f"~{half} half of the rest"] if more[0] < half < more[-1] else []
        steps += [f"~{more[-1]} all"]
    elif len(more) > 1:
        steps = [f"~{more[0]} more pictures would tell all"]
    beyond = len(untold) - len(more)
    return ", ".join(steps) + (f" but {beyond}" if beyond else "")


def _pictures(answers: Sequence[Answer]) -> str:
    counts = [answer["n_pictures"] for answer in answers]
    low, high = min(counts), max(counts)
    return f"{high} picture{'' if high == 1 else 's'}" if low == high else f"{low} to {high} pictures"


def _what(data: RunData) -> str:
    return joined(_varied(data, data.answers)) if len(data.answers) > 1 else "answer"


def _varied(data: RunData, answers: Sequence[Answer]) -> list[str]:
    """What tells the answers apart: 'target', 'light', 'speed'."""
    varied = ["target"] if len({answer["group"] for answer in answers}) > 1 else []
    varied += [word(axis) for axis in data.settings.axes if len(data.settings.values(axis)) > 1]
    return [*varied, "speed"] if len(data.velocities_px_s) > 1 else varied


def _count(answers: Iterable[Answer], verdict: str, model: str | None = None) -> int:
    return sum(answer["verdict"] == verdict and model in (None, answer["model"]) for answer in answers)


def _listed(parts: Sequence[str], between: str = ", ") -> str:
    return between.join(parts[:MAX_NAMED]) + (f"{between}…" if len(parts) > MAX_NAMED else "")
