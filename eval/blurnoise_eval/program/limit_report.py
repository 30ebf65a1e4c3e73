"""The best cap of the exposure time in words, and as files: JSON, and the words of each driver."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from blurnoise_eval.plan.axes import milliseconds
from blurnoise_eval.plots.style import spread
from blurnoise_eval.program import registers
from blurnoise_eval.program.drivers import DRIVERS, Cap, comment, document_lines
from blurnoise_eval.program.limit import ExposureCap, SpeedEffect
from blurnoise_eval.program.stepping import Reached, apart, beside_promised, daylight, reached
from blurnoise_eval.program.words import lights_text, lux_text, score_text, too_few
from blurnoise_eval.report.words import counted, keeps, reached_text
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.terminal import PROSE, paragraph, table_lines

FILES = ("limit.json", "limit.txt")
_SHOWN = 8  # lights of the table


def lines(
    limit: ExposureCap, program_value: float | None, even: bool, width: int | None = None
) -> Iterator[str]:
    """The lines for a terminal of ``width`` columns: sentence, table, drivers.

    program_value: what an exposure program reaches. even: whether the shares of the speeds are equal because none
    were given.
    """
    prose = width and min(width, PROSE)
    yield from paragraph(sentence(limit), prose)
    yield from paragraph(cost(limit, program_value, even), prose)
    yield ""
    criterion = limit.problem.inputs.criterion
    heads = ["light, lux", "exposure, ms", "gain, dB", keeps(criterion), "saturated", "best cap here, ms"]
    cells = []
    for row in spread(limit.lights, _SHOWN):
        best = "no cap needed"
        if row.best_s is not None and row.from_s is not None and row.to_s is not None:
            best = f"{milliseconds(row.best_s)}{_between(row.from_s, row.to_s) if _told(limit) else ''}"
        shown = [
            score_text(row.value),
            "-" if row.saturated is None else f"{100 * row.saturated:.0f} %",
            best,
        ]
        cells.append(
            [lux_text(row.illuminance_lux), milliseconds(row.exposure_s), f"{row.gain_db:.1f}", *shown]
        )
    yield from table_lines(heads, cells, (True,) * 5 + (False,), width)
    yield ""
    cap = cap_of(limit)
    for name in ("realsense", "depthai", "spinnaker", "pylon", "v4l2"):
        yield f"{DRIVERS[name].name}: {DRIVERS[name].line(cap)}"
    yield "picamera2, libcamera: an exposure mode of the tuning file, see limit.txt"
    yield f"  {json.dumps(cap.mode)}"
    yield ""
    yield from paragraph(warnings(limit), prose)


def warnings(limit: ExposureCap) -> str:
    """Where drivers do not reach what is promised, and whether daylight saturates."""
    by_name = {DRIVERS[key].name: rows for key, rows in of_drivers(limit).items()}
    shortest_s = limit.problem.limits.first_s
    at = f"the shortest exposure, {milliseconds(shortest_s)} ms, with every driver"
    return f"{beside_promised(by_name)} {daylight(limit.problem, shortest_s, at)}".rstrip()


def of_drivers(limit: ExposureCap) -> dict[str, tuple[Reached, ...]]:
    """What each driver reaches with its words, stepped through light by light, by its key."""
    problem, cap = limit.problem, cap_of(limit)

    def promised(total_s: float) -> float:
        return problem.limits.settled(min(total_s, limit.limit_s))

    return {key: reached(problem, driver.division(cap), promised) for key, driver in DRIVERS.items()}


def sentence(limit: ExposureCap) -> str:
    """'Cap the exposure time at 2.1 ms (1.5 to 3 ms cannot be told apart): ...'."""
    lights = limit.problem.scenario.lights_lux
    value = score_text(limit.schedule.value)
    if limit.low is not None and limit.high is not None:
        value += f" ({limit.low:.3f} to {limit.high:.3f})"
    does = reached_text(value, limit.problem.inputs.criterion)
    over = f"{lights_text(lights)} auto exposure then {does}"
    if _is_longest(limit):
        longest = f"{milliseconds(limit.longest_s)} ms, the longest exposure"
        if limit.problem.inputs.exposures_s[1] < limit.problem.limits.limit_s * (1 - 1e-9):
            return f"No cap below {longest} tested, is better; longer ones may be. {over}."
        return f"No cap below {longest}, is better. {over}."
    same = ""
    if not _told(limit):
        same = f"; {too_few(len(limit.problem.clusters))} to tell caps apart"
    elif limit.to_s > limit.from_s:
        ends = f"{milliseconds(limit.from_s)} to {milliseconds(limit.to_s)}"
        same = f"; the pictures cannot tell caps from {ends} ms apart"
    return f"Cap the exposure time at {milliseconds(limit.limit_s)} ms{same}. {over}."


def cost(limit: ExposureCap, program_value: float | None, even: bool) -> str:
    """What the cap loses and saves at the slowest and the fastest speed, the gain that it needs, and its shares."""
    longest, unit = milliseconds(limit.longest_s), limit.problem.scenario.speed_unit
    effects = sorted(limit.speeds, key=lambda effect: effect.speed_px_s)
    ends = dict.fromkeys((effects[0], effects[-1]))
    # The longest exposure is no cap: beside itself it loses and saves nothing.
    against = f"Against {longest} ms it {' and '.join(_effect(end, unit) for end in ends)}. "
    text = "" if _is_longest(limit) else against
    darkest = limit.lights[0]
    # The metering is that of the mean picture, and half of the pictures are darker.
    more = (
        ", the most that the camera has, and pictures are darker than it wants"
        if darkest.lacks_gain
        else " for a picture of mean brightness, and more for darker ones"
    )
    text += f"At {lux_text(darkest.illuminance_lux)} lux the gain is then {darkest.gain_db:.1f} dB{more}."
    if program_value is not None and limit.schedule.value is not None:
        gained = program_value - limit.schedule.value
        better = f"reaches {gained:.3f} more" if gained >= 0.0005 else "is not better"
        text += f" A program, with times for each light, {better}."
    if bright := [row for row in limit.lights if row.too_bright]:
        light = lux_text(bright[0].illuminance_lux)
        text += f" From {light} lux on pictures are too bright at the shortest exposure."
    shares = ", ".join(f"{effect.speed_px_s:.4g} {unit} {effect.share:.2g}" for effect in effects)
    given = "equal because none were given; see --speeds" if even else "as given"
    pictures = counted(len(limit.problem.clusters), "picture")
    sure = ", intervals of 95 %" if _told(limit) else ""
    return f"{text} Shares of the speeds: {shares} ({given}). {pictures}{sure}."


def _effect(effect: SpeedEffect, unit: str) -> str:
    """'loses 0.030 (0.010 to 0.050) at 0 px/s'."""
    if effect.difference is None:
        return f"cannot be judged at {effect.speed_px_s:.4g} {unit}"
    verb, sign = ("saves", 1) if effect.difference >= 0 else ("loses", -1)
    within = ""
    if effect.low is not None and effect.high is not None:
        low, high = sorted((sign * effect.low, sign * effect.high))
        within = f" ({low:.3f} to {high:.3f})"
    where = "at rest" if effect.speed_px_s == 0 else f"at {effect.speed_px_s:.4g} {unit}"
    return f"{verb} {sign * effect.difference:.3f}{within} {where}"


def _is_longest(limit: ExposureCap) -> bool:
    return limit.limit_s >= limit.longest_s * (1 - 1e-9)


def _told(limit: ExposureCap) -> bool:
    """Whether the pictures are enough for intervals."""
    return limit.low is not None


def _between(from_s: float, to_s: float) -> str:
    """' (1.5 to 3)', in ms; empty where both are the same."""
    return "" if to_s <= from_s * (1 + 1e-9) else f" ({milliseconds(from_s)} to {milliseconds(to_s)})"


def cap_of(limit: ExposureCap) -> Cap:
    """The cap with the most gain: pictures that are darker than the mean need more than it does."""
    problem = limit.problem
    sensor_gains = registers.gain_limits(problem.inputs.metering.camera)
    return Cap(
        limit.limit_s, problem.limits.first_s, problem.most_gain, problem.limits.mains_hz, sensor_gains
    )


def document(
    limit: ExposureCap, program_value: float | None, run: str, notes: Sequence[str] = ()
) -> dict[str, Any]:
    """The contents of limit.json. run: the run's folder. notes: what was left out or assumed."""
    inputs, cap = limit.problem.inputs, cap_of(limit)
    drivers: Mapping[str, Any] = {
        key: {
            "version": DRIVERS[key].version,
            "words": DRIVERS[key].text(cap),
            "reaches": [row._asdict() for row in rows],
        }
        for key, rows in of_drivers(limit).items()
    }
    return {
        "run": run,
        "model": inputs.model,
        "criterion": inputs.criterion.row(),
        "camera": inputs.metering.camera.name,
        "limits": limit.problem.limits.words,
        "notes": list(notes),
        "one_axis": inputs.one_axis and inputs.one_axis._asdict(),
        "limit_s": limit.limit_s,
        "limit_us": cap.us,
        "limit_from_s": limit.from_s,
        "limit_to_s": limit.to_s,
        "longest_s": limit.longest_s,
        "value": limit.schedule.value,
        "value_low": limit.low,
        "value_high": limit.high,
        "value_without": limit.uncapped.value,
        "program_value": program_value,
        "speeds": list(map(asdict, limit.speeds)),
        "lights": list(map(asdict, limit.lights)),
        "too_bright_above_lux": inputs.metering.lux_at(limit.problem.limits.first_s),
        "drivers": drivers,
    }


def text_lines(limit: ExposureCap) -> Iterator[str]:
    """The lines of limit.txt: the words of each driver, and a table for whoever writes registers."""
    cap = cap_of(limit)
    yield f"# Cap of the exposure time: {cap.us} us"
    yield from comment(sentence(limit))
    yield from comment(warnings(limit))
    far = {key: how for key, rows in of_drivers(limit).items() if (how := apart(rows))}
    yield from document_lines(cap, far)
    camera, row_time_s = limit.problem.inputs.metering.camera, limit.problem.limits.row_time_s
    line_s = registers.line_time_s(camera, row_time_s)
    if not line_s:
        return
    yield ""
    about = f"registers of {camera.name}: lines of {1e6 * line_s:.4g} us, and codes of the gain with what they give"
    yield from comment(f"{about}; other modes of the sensor have other lines")
    cells = []
    for row in limit.lights:
        set_to = registers.setting(camera, row.exposure_s, 10 ** (row.gain_db / 20), row_time_s)
        code, gives = (
            ("-", "-") if set_to.code is None else (f"{set_to.code}", f"{20 * math.log10(set_to.gain):.1f}")
        )
        times = [milliseconds(row.exposure_s), f"{set_to.lines}", milliseconds(set_to.exposure_s)]
        cells.append([lux_text(row.illuminance_lux), *times, f"{row.gain_db:.1f}", code, gives])
    heads = ["light, lux", "ms", "lines", "give, ms", "gain, dB", "code", "gives, dB"]
    yield from (f"# {line}" for line in table_lines(heads, cells, (True,) * 7))


def write(
    limit: ExposureCap, program_value: float | None, folder: Path, run: str, notes: Sequence[str]
) -> list[Path]:
    """Write limit.json and limit.txt. Raises ``OSError``."""
    text = json.dumps(document(limit, program_value, run, notes), indent=1, allow_nan=False)
    texts = (text, "\n".join(text_lines(limit)))
    for name, content in zip(FILES, texts, strict=True):
        write_whole(folder / name, f"{content}\n".encode())
    return [folder / name for name in FILES]
