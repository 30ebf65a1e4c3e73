"""Errors in the words of the command line: the option that was typed, in its unit, for the library's names in SI."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress

import typer

from blurnoise_eval.cli._moved import now_called
from blurnoise_eval.grid.axes import AXES

_SPOKEN: tuple[tuple[str, str, float], ...] = (
    *((axis.name, axis.option, axis.per_option) for axis in AXES),
    ("velocity_px_s", "--dx", 1.0),
    ("angle_deg", "--angle", 1.0),
    ("size_px", "--size", 1.0),
    ("count", "--scenes", 1.0),
    ("width_px", "--width", 1.0),
    ("height_px", "--height", 1.0),
    ("readout_s", "--readout-ms", 1e-3),
    ("speed_m_s", "--speed-kmh", 1 / 3.6),
    ("speed_px_s", "--speed", 1.0),
    ("frame_rate_hz", "--fps", 1.0),
    ("timeout_s", "--model-timeout-s", 1.0),
    *((kind, "--labels", 1.0) for kind in ("coco", "yolo", "bdd", "text")),
)
"""The library's name, the option for it, and how much of the library's unit one of the option's is."""
_PYDANTIC = (
    ("Value error, ", ""),
    ("Input should be a valid integer, unable to parse string as an integer", "must be a whole number"),
    ("Input should be a valid number, unable to parse string as a number", "must be a number"),
    ("Input should be", "must be"),
)


def in_a_line(error: Exception, options: Collection[str]) -> str:
    """What the library says, in a line, with the names of these options where they set what it speaks of."""
    from blurnoise_eval.system.terminal import shortened
    from blurnoise_eval.system.urls import without_secrets

    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        told = f"{error.filename}: {error.strerror}"
    else:
        told = _in_options(error, options)
    return f"blurnoise: error: {shortened(without_secrets(told))}"


def _in_options(error: Exception, options: Collection[str]) -> str:
    from blurnoise._core.checks import OutOfRange

    spoken = {option.lstrip("-").replace("-", "_"): (option, 1.0) for option in options}
    spoken |= {name: (option, unit) for name, option, unit in _SPOKEN if option in options}
    if isinstance(error, OutOfRange) and error.name.replace("-", "_") in spoken:
        option, unit = spoken[error.name.replace("-", "_")]
        if isinstance(error.value, (int, float)):
            value, low, high = (float(f"{each / unit:.12g}") for each in (error.value, error.low, error.high))
            return str(OutOfRange(option, value, low, high, error.above))
    where = "--model-timeout-s" if "--model-timeout-s" in options else "model_timeout_s in --plan FILE.yaml"
    told = str(error).replace("; timeout_s allows", f"; {where} allows")
    head, colon, rest = told.partition(": ")
    name, equals, typed = head.partition(" = ")
    option, unit = spoken.get(name.replace("-", "_"), ("", 1.0))
    if equals and option:
        with suppress(ValueError):
            typed = f"{float(typed) / unit:g}" if unit != 1.0 else typed
        return f"{option} = {typed}{colon}{rest}"
    subject = told.partition(":")[0]
    names = [name.strip() for name in subject.split(",")]
    if all(name.replace("-", "_") in spoken for name in names):
        named = ", ".join(spoken[name.replace("-", "_")][0] for name in names)
        return named + told[len(subject) :]
    return told


def usage(error: typer.TyperException) -> str:
    """What is wrong with the options themselves, with the value and where to look, or what it is called now."""
    from blurnoise_eval.system.urls import without_secrets

    context = getattr(error, "ctx", None)
    path = getattr(context, "command_path", "")
    option = getattr(error, "option_name", None)
    moved = option and now_called(path.removeprefix("blurnoise "), str(option))
    if moved:
        return f"blurnoise: error: {moved}"
    told = error.format_message().rstrip(".")
    for theirs, ours in _PYDANTIC:
        told = told.replace(theirs, ours)
    for fault in getattr(error.__cause__, "errors", list)():
        if repr(fault["input"]) not in told:
            told += f", got {fault['input']!r}"
    hint = f"; see '{path} --help'" if path else ""
    return f"blurnoise: error: {' '.join(without_secrets(told).split())}{hint}"
