"""Errors in the words of the command line: the option that was typed, in its unit, for the library's names in SI."""

from __future__ import annotations

import re
from collections.abc import Collection

import typer

from blurnoise_eval.grid.axes import AXES
from blurnoise_eval.system.terminal import shortened
from blurnoise_eval.system.transport import without_secrets

_SPOKEN: tuple[tuple[str, str, float], ...] = (
    *((axis.name, axis.option, axis.per_option) for axis in AXES),
    ("velocity_px_s", "--dx", 1.0),
    ("velocity_m_s", "--object-kmh", 1 / 3.6),
    ("yaw_deg_s", "--ego", 1.0),
    ("pitch_deg_s", "--ego", 1.0),
    ("angle_deg", "--angle", 1.0),
    ("size_px", "--size", 1.0),
    ("width_px", "--width", 1.0),
    ("height_px", "--height", 1.0),
    ("count", "--scenes", 1.0),
    ("readout_s", "--readout-ms", 1e-3),
    ("line_time_s", "--line-time-us", 1e-6),
    ("row_time_s", "--line-time-us", 1e-6),
    ("speed_m_s", "--speed-kmh", 1 / 3.6),
    ("speed_m_s", "--ego", 1 / 3.6),
    ("speed_px_s", "--speed", 1.0),
    ("frame_rate_hz", "--frame-rate", 1.0),
    ("frame_rate_hz", "--fps", 1.0),
    ("timeout_s", "--model-timeout-s", 1.0),
    ("gain_max_db", "--most-gain-db", 1.0),
)
"""The library's name, the option for it, and how much of the library's unit one of the option's is."""
_PYDANTIC = (
    ("Value error, ", ""),
    ("Input should be a valid integer, unable to parse string as an integer", "must be a whole number"),
    ("Input should be a valid number, unable to parse string as a number", "must be a number"),
    ("Input should be greater than or equal to", "must be >="),
    ("Input should be less than or equal to", "must be <="),
)
_NAME = re.compile(r"[a-z][\w-]*")
_NAMES = re.compile(rf"{_NAME.pattern}(, {_NAME.pattern})*(?=:)")
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


def in_a_line(error: Exception, options: Collection[str]) -> str:
    """What the library says, in a line, with the names of these options where they set what it speaks of."""
    told = str(error)
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        told = f"{error.filename}: {error.strerror}"
    else:
        told = _in_options(error, {option.lstrip("-").replace("-", "_"): option for option in options})
    return f"blurnoise: error: {shortened(without_secrets(told))}"


def _in_options(error: Exception, own: dict[str, str]) -> str:
    from blurnoise._core.checks import OutOfRange

    spoken = {name: (option, unit) for name, option, unit in _SPOKEN if option in own.values()}
    spoken |= {name: (option, 1.0) for name, option in own.items()}
    known = isinstance(error, OutOfRange) and spoken.get(error.name.replace("-", "_"))
    if isinstance(error, OutOfRange) and known and isinstance(error.value, (int, float)):
        option, unit = known
        value, low, high = (_in_unit(each, unit) for each in (error.value, error.low, error.high))
        return str(OutOfRange(option, value, low, high, error.above))

    def option_of(name: re.Match[str]) -> str:
        return spoken.get(name[0].replace("-", "_"), (name[0],))[0]

    name, equals, rest = str(error).partition(" = ")
    if equals and name.replace("-", "_") in spoken:
        got, colon, must = rest.partition(": ")
        option, unit = spoken[name.replace("-", "_")]
        if unit != 1.0:
            got = _NUMBER.sub(lambda found: f"{_in_unit(float(found[0]), unit):g}", got)
        said = f"{option} = {got}{colon}{must}"
    else:
        begin = _NAMES.match(str(error))
        named = _NAME.sub(option_of, begin[0]) if begin else ""
        said = named + str(error)[len(begin[0]) if begin else 0 :]
    return re.sub(
        r"(?<![\w-])[a-z]+(_[a-z]+)+(?!\w| = )", option_of, said
    )  # no word of English has an underscore


def _in_unit(value: float, unit: float) -> float:
    return float(f"{value / unit:.12g}")


def usage(error: typer.TyperException) -> str:
    """What is wrong with the options themselves, with the value and where to look."""
    told = error.format_message().rstrip(".")
    for theirs, ours in _PYDANTIC:
        told = told.replace(theirs, ours)
    for fault in getattr(error.__cause__, "errors", list)():
        if repr(fault["input"]) not in told:
            told += f", got {fault['input']!r}"
    context = getattr(error, "ctx", None)
    hint = f"; see '{context.command_path} --help'" if context else ""
    return f"blurnoise: error: {' '.join(without_secrets(told).split())}{hint}"
