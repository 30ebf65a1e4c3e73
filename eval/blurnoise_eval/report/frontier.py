"""The rows that decide: for every target and setting how fast it may go, with which exposure and gain, and what
limits that.

Domain: exposures in s, speeds as the run has them (px/s, or km/h of a vehicle), gains in dB, values in the
criterion's unit.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import numpy as np

from blurnoise_eval.grid.axes import GAIN, LIGHT
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.measured import finite
from blurnoise_eval.report.settings import Setting
from blurnoise_eval.report.words import CANNOT_TELL, NONE_WORKS, WORKS, Answer
from blurnoise_eval.scoring.exposure_window import NEAR_BEST


@dataclass(frozen=True)
class Row:
    """One target in one setting or, where no exposure works in them, in several that follow each other.

    shown: the answer at the fastest speed at which an exposure works (in the direction that is worst); without one,
    the best. exposure_s: the exposure to use, of ``shown`` or, if there is one, one that works at every slower speed,
    too (``for_all``); without one that works, the best. value, low, high: what it reaches there. top: that
    fastest speed, None where no exposure surely works; slower: slower ones at which none does. others: the
    answers at speeds beyond, or all where none works.
    """

    group: str
    settings: tuple[Setting, ...]
    shown: Answer
    exposure_s: float
    for_all: bool
    value: float
    low: float | None
    high: float | None
    top: float | None
    slower: tuple[float, ...]
    others: tuple[Answer, ...]

    @property
    def verdict(self) -> str:
        """Of all that is not ``top`` and slower, the verdict; "works" where there is such a speed."""
        if self.top is not None:
            return WORKS
        return CANNOT_TELL if any(each["verdict"] == CANNOT_TELL for each in self.others) else NONE_WORKS

    @property
    def fastest(self) -> bool:
        """Whether no faster speed was tested."""
        return self.top is not None and not self.others


def rows_that_decide(data: RunData, answers: Sequence[Answer]) -> list[Row]:
    """The rows of one model's answers, in their order."""
    parts: dict[tuple[str, Setting], list[Answer]] = {}
    for answer in answers:
        parts.setdefault((answer["group"], data.at_any_speed.of(answer)), []).append(answer)
    found: list[Row] = []
    for (group, setting), of_setting in parts.items():
        row = _row(group, setting, of_setting, data.speed.of, data.manifest["threshold"])
        if found and (found[-1].group, found[-1].verdict) == (group, row.verdict) and row.verdict != WORKS:
            row = _folded(found.pop(), row)
        found.append(row)
    return found


def exposure_for_all(answers: Sequence[Answer], level: float) -> tuple[float, int, int] | None:
    """The tested exposure that serves most of the answers, s; in how many it surely does, and how many know it.

    Of those that serve as many, those whose mean reaches the level in most; of these, those within ``NEAR_BEST`` of
    the highest mean; of these, the one that is recommended most often. None where nothing was measured.
    """
    at: dict[float, list[tuple[bool, bool, float]]] = {}
    for answer in answers:
        for place, exposure_s in enumerate(answer["exposures_s"]):
            value = finite(answer["confidence"][place])
            if value is not None:
                at.setdefault(exposure_s, []).append((_sure(answer, place, level), value >= level, value))
    if not at:
        return None
    served = {
        each: (sum(sure for sure, _, _ in found), sum(above for _, above, _ in found))
        for each, found in at.items()
    }
    mean = {
        each: fmean(value for _, _, value in at[each]) for each in at if served[each] == max(served.values())
    }
    near = sorted(each for each in mean if mean[each] >= max(mean.values()) - NEAR_BEST)
    chosen = Counter(answer["recommended_s"] for answer in answers)
    best = max(near, key=lambda each: (chosen[each], mean[each]))
    return best, served[best][0], len(at[best])


def at_best_gain(data: RunData, answers: Sequence[Answer]) -> list[Answer]:
    """Of answers at several stated gains, of which a camera has one at a time, those at the gain that serves best in
    each setting: where an exposure surely works most often, then highest on average, of equals the smallest."""
    if GAIN not in data.settings.axes:
        return list(answers)
    place = data.settings.axes.index(GAIN)
    by_setting: dict[Setting, dict[float, list[Answer]]] = {}
    for answer in answers:
        setting = data.settings.of(answer)
        rest = setting[:place] + setting[place + 1 :]
        by_setting.setdefault(rest, {}).setdefault(setting[place], []).append(answer)

    def merit(own: Sequence[Answer]) -> tuple[int, float]:
        chosen = exposure_for_all(own, data.manifest["threshold"])
        return (0, 0.0) if chosen is None else (chosen[1], fmean(values_at(own, chosen[0])))

    best = {
        id(answer)
        for gains in by_setting.values()
        for answer in gains[max(sorted(gains), key=lambda gain: merit(gains[gain]))]
    }
    return [answer for answer in answers if id(answer) in best]


def values_at(answers: Sequence[Answer], exposure_s: float) -> list[float]:
    """What the answers reach at an exposure, where it was measured."""
    found = [
        finite(answer["confidence"][answer["exposures_s"].index(exposure_s)])
        for answer in answers
        if exposure_s in answer["exposures_s"]
    ]
    return [value for value in found if value is not None]


_SPARE = 2**0.5  # beyond the conditions that a search asks for, half a stop apart


def gain_at(data: RunData, setting: Setting, exposure_s: float) -> float | None:
    """The gain that was applied in a setting at an exposure, mean over pictures, dB.

    Between tested exposures it is straight over their logarithm, and where it ends at 0 dB, falls by 20 dB a decade
    until it is there; None where it is not known, or beyond them. A search takes few pictures in each light; its
    gains follow from light times exposure, whatever the light.
    """
    place = data.settings.axes.index(LIGHT)
    rest = setting[:place] + setting[place + 1 :]
    known: dict[float, float] = {}
    for row in data.taken:
        of = data.settings.of(row)
        gain = finite(row.get("applied_gain_db"))
        if gain is not None and data.searched and of[:place] + of[place + 1 :] == rest:
            known[row["exposure_s"] * of[place] / setting[place]] = gain
        elif gain is not None and of == setting:
            known[row["exposure_s"]] = gain
    tested = sorted(known)
    spare = _SPARE if data.searched else 1.0
    if not tested or not tested[0] / spare <= exposure_s <= tested[-1] * spare:
        return None
    after = bisect_right(tested, exposure_s)
    if 0 < after < len(tested) and known[tested[after]] == 0 < known[tested[after - 1]]:
        fallen = 20 * math.log10(exposure_s / tested[after - 1])
        return max(0.0, known[tested[after - 1]] - fallen)
    return float(np.interp(np.log(exposure_s), np.log(tested), [known[each] for each in tested]))


def _row(
    group: str,
    setting: Setting,
    answers: Sequence[Answer],
    speed_of: Callable[[Answer], float],
    level: float,
) -> Row:
    speeds = sorted(set(map(speed_of, answers)))
    works = [
        speed
        for speed in speeds
        if all(answer["verdict"] == WORKS for answer in answers if speed_of(answer) == speed)
    ]
    if not works:
        shown = max(answers, key=lambda answer: answer["best_value"])
        best = shown["best_value"], shown["best_low"], shown["best_high"]
        return Row(group, (setting,), shown, shown["best_s"], False, *best, None, (), tuple(answers))
    top = works[-1]
    held = [answer for answer in answers if speed_of(answer) in works]
    shown = min(
        (answer for answer in held if speed_of(answer) == top),
        key=lambda answer: answer["confidence_at_recommended"],
    )
    exposure_s, for_all = _use(held, shown, level)
    place = shown["exposures_s"].index(exposure_s)
    low, high = (shown[end][place] if shown[end] else None for end in ("low", "high"))
    slower = tuple(speed for speed in speeds if speed < top and speed not in works)
    beyond = tuple(answer for answer in answers if speed_of(answer) > top)
    value = shown["confidence"][place]
    return Row(group, (setting,), shown, exposure_s, for_all, value, low, high, top, slower, beyond)


def _use(held: Sequence[Answer], shown: Answer, level: float) -> tuple[float, bool]:
    """An exposure that surely works in all of the answers, the recommended one if it does; else that, and False."""
    common = [
        exposure_s
        for exposure_s in shown["exposures_s"]
        if all(
            exposure_s in answer["exposures_s"]
            and _sure(answer, answer["exposures_s"].index(exposure_s), level)
            for answer in held
        )
    ]
    recommended: float = shown["recommended_s"]
    if recommended in common or not common:
        return recommended, bool(common)
    return max(common, key=lambda exposure_s: min(values_at(held, exposure_s))), True


def _folded(one: Row, other: Row) -> Row:
    better = max(one, other, key=lambda row: row.value)
    both: dict[str, Any] = vars(better) | {
        "settings": one.settings + other.settings,
        "others": one.others + other.others,
    }
    return Row(**both)


def _sure(answer: Answer, place: int, level: float) -> bool:
    low = answer["low"][place] if answer["low"] else None
    return low is not None and low >= level
