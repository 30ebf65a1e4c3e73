"""The four questions that a report opens with: which exposure, which gain, how fast, how sure.

Domain: exposures in s (written in ms), gains in dB, speeds in px/s or km/h. Texts are plain, never markup.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from blurnoise_eval.grid.axes import AUTOMATIC, EGO, EXPOSURE, GAIN, SPEED
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.frontier import Row, exposure_for_all, gain_at
from blurnoise_eval.report.measured import finite, spread
from blurnoise_eval.report.settings import Setting, word
from blurnoise_eval.report.words import (
    CANNOT_TELL,
    NONE_WORKS,
    WORKS,
    Answer,
    gain_text,
    joined,
    limit_text,
    needed_text,
    pictures_range,
)

MAX_NAMED = 4  # settings in an answer


def questions(data: RunData, answers: Sequence[Answer], rows: Sequence[Row]) -> Iterable[tuple[str, str]]:
    """(question, answer) of one model's answers and their rows that decide; none where nothing was measured."""
    level = data.manifest["threshold"]
    asked = {data.settings.of(answer) for answer in answers}
    best = {
        setting: chosen[0]
        for setting in data.settings.every
        if setting in asked
        and (chosen := exposure_for_all([a for a in answers if data.settings.of(a) == setting], level))
    }
    if not best:
        return
    every = len(asked) > 1 and len(asked) == len(best)
    some = {data.settings.of(answer) for answer in answers if answer["verdict"] != NONE_WORKS}
    texts = {each: EXPOSURE.text(at) if each in some else "none" for each, at in best.items()}
    yield "Which exposure?", _per_setting(data, texts, every)
    best = {each: at for each, at in best.items() if each in some}
    gains = {each: gain for each, at in best.items() if (gain := gain_at(data, each, at)) is not None}
    if gains:
        told = _per_setting(
            data, {each: gain_text(gain) for each, gain in gains.items()}, every and len(gains) == len(best)
        )
        if GAIN in data.settings.axes:
            told += f" (the best of {len(data.settings.values(GAIN))} tested)"
        elif (GAIN, AUTOMATIC) in data.settings.held:
            told += " (set by the camera, mean over pictures)"
        yield "Which gain?", told
    yield "How fast?", _how_fast(data, answers, rows)
    yield "How sure?", _how_sure(answers)


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


def _per_setting(data: RunData, texts: dict[Setting, str], every: bool) -> str:
    """'20 ms at 5 lux, 5 ms at 50 lux'; one text where all are alike. every: whether they are all of several."""
    if len(set(texts.values())) == 1:
        text = next(iter(texts.values()))
        light = set(data.settings.further) <= {GAIN}
        return f"{text} at every {'light' if light else 'setting'}" if every else text
    shown = spread(texts, MAX_NAMED)
    left = len(texts) - len(shown)
    listed = ", ".join(f"{texts[each]} at {_but_gain(data, each)}" for each in shown)
    return f"{listed}; {left} more between" if left else listed


def _but_gain(data: RunData, setting: Setting) -> str:
    """A setting in words, without the gain, which is the answer."""
    pairs = zip(data.settings.axes, setting, strict=True)
    return " · ".join(axis.text(value) for axis, value in pairs if axis is not GAIN)


def _how_fast(data: RunData, answers: Sequence[Answer], rows: Sequence[Row]) -> str:
    fastest = max(map(data.speed.of, answers))
    combined = len(rows) > 1 or len(rows[0].settings) > 1
    tops = [row for row in rows if row.top is not None]
    count = sum(len(row.settings) for row in rows)
    names = [name for name in varied(data, answers) if name != "speed"]
    what = joined(names) if combined else ""
    if not tops:
        if all(answer["verdict"] == NONE_WORKS for answer in answers):
            return f"at no tested speed{'' if fastest else ', not even at rest,'} does an exposure suffice"
        guess = max((data.speed.of(answer) for answer in answers if answer["windows_s"]), default=None)
        at = f"up to {data.speed.text(guess)}" if guess else "at rest"
        seen = f"; for these pictures alone one does {at}" if guess is not None else ""
        return f"at no tested speed does an exposure surely suffice{seen}"
    top = max(tops, key=lambda row: row.top or 0.0)
    if len(tops) == len(rows) and all(row.fastest for row in rows):
        longest = max(rows, key=lambda row: row.exposure_s)
        return _up_to(data, longest, f" for every {what}" if combined else "")
    text = _up_to(
        data, top, f" for {top.group} at {data.at_any_speed.text(top.settings[0])}" if combined else ""
    )
    limit = limits_of(answer for row in rows for answer in row.others)
    if not combined:
        return f"{text}; beyond, {limit} limits" if limit else text
    if len(tops) == len(rows):
        least = min(row.top or 0.0 for row in rows)
        rest = f"{f'up to {data.speed.text(least)}' if least else 'at rest'} for every {what}"
    else:
        rest = f"in {count - len(tops)} of {combinations_text(count, names)} at no tested speed"
    return f"{text}; {rest}" + (f", limited by {limit}" if limit else "")


def _up_to(data: RunData, row: Row, where: str) -> str:
    """'up to 1000 px/s, the fastest tested, for every target (5 px of blur at 5 ms)'."""
    speed = row.top or 0.0
    if not speed:
        return (
            f"at rest, the only speed tested,{where}".removesuffix(",") if row.fastest else f"at rest{where}"
        )
    tested = ", the fastest tested" if row.fastest else ""
    blur = f"{speed * row.exposure_s:.2g} px of blur at " if data.speed is SPEED else "at "
    comma = "," if tested and where else ""
    return f"up to {data.speed.text(speed)}{tested}{comma}{where} ({blur}{EXPOSURE.text(row.exposure_s)})"


def _how_sure(answers: Sequence[Answer]) -> str:
    untold = [answer for answer in answers if answer["verdict"] == CANNOT_TELL]
    told = f"{len(answers) - len(untold)} of {len(answers)}" if untold else f"all {len(answers)}"
    few = " (few)" if any(answer["few_pictures"] for answer in answers) else ""
    parts = [f"{pictures_range(answers)}{few}, 95 % intervals"]
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
    pictures = "picture" if more[0] == 1 else "pictures"
    steps = [f"~{more[0]} more {pictures} would tell" + (" one more" if len(untold) > 1 else "")]
    if len(more) > 1 and more[-1] > more[0]:
        half = more[(len(more) - 1) // 2]
        steps += [f"~{half} half of the rest"] if more[0] < half < more[-1] else []
        steps += [f"~{more[-1]} all"]
    elif len(more) > 1:
        steps = [f"~{more[0]} more {pictures} would tell all"]
    beyond = len(untold) - len(more)
    return ", ".join(steps) + (f" but {beyond}" if beyond else "")


def varied(data: RunData, answers: Sequence[Answer]) -> list[str]:
    """What tells the answers apart: 'target', 'light', 'speed'; not what follows from the rest, as a chosen gain."""
    varied = ["target"] if len({answer["group"] for answer in answers}) > 1 else []
    settings = {data.settings.of(answer) for answer in answers}
    varied += [
        word(axis)
        for place, axis in enumerate(data.settings.axes)
        if axis is not EGO
        and len({setting[:place] + setting[place + 1 :] for setting in settings}) < len(settings)
    ]
    faster = len(data.velocities_px_s) > 1 or EGO in data.settings.axes
    return [*varied, "speed"] if faster else varied


def combinations_text(count: int, names: Sequence[str]) -> str:
    """'8 combinations of target and light', '3 lights'."""
    return f"{count} combinations of {joined(names)}" if len(names) > 1 else f"{count} {names[0]}s"
