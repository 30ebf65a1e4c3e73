"""Errors in the words of the command line: the option that was typed, in its unit, for the library's names in SI."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress

import typer

from blurnoise_eval.grid.axes import AXES
from blurnoise_eval.grid.settings import Settings

_OPTIONS: tuple[tuple[str, str, float], ...] = (
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
        text = f"{error.filename}: {error.strerror}"
    else:
        text = _in_options(error, options)
    return f"blurnoise: error: {shortened(without_secrets(text))}"


def _in_options(error: Exception, options: Collection[str]) -> str:
    from blurnoise._core.checks import OutOfRange

    known = {_name(option): (option, 1.0) for option in options}
    known |= {name: (option, unit) for name, option, unit in _OPTIONS if option in options}
    if isinstance(error, OutOfRange) and _name(error.name) in known and isinstance(error.value, (int, float)):
        option, unit = known[_name(error.name)]
        typed, low, high = (float(f"{each / unit:.12g}") for each in (error.value, error.low, error.high))
        return str(OutOfRange(option, typed, low, high, error.above))
    where = "--model-timeout-s" if "--model-timeout-s" in options else "model_timeout_s in --plan FILE.yaml"
    text = str(error).replace("; timeout_s allows", f"; {where} allows")
    subject, colon, rest = text.partition(":")
    names, equals, value = subject.partition(" = ")
    named = [_name(name.strip()) for name in names.split(",")]
    if not colon or not known.keys() >= set(named):
        return text
    unit = known[named[0]][1]
    with suppress(ValueError):
        value = f"{float(value) / unit:g}" if unit != 1.0 else value
    return f"{', '.join(known[name][0] for name in named)}{equals}{value}:{rest}"


def _name(option: str) -> str:
    return option.lstrip("-").replace("-", "_")


def usage(error: typer.TyperException) -> str:
    """What is wrong with the options themselves, with the value and where to look; an option that is a setting of the
    command's file, with its name there."""
    from blurnoise_eval.system.urls import without_secrets

    path = getattr(getattr(error, "ctx", None), "command_path", "")
    option = str(getattr(error, "option_name", None))
    file, kind = files().get(path.removeprefix("blurnoise "), ("", Settings))
    if _name(option) in kind.names():
        writer = "blurnoise sweep" if kind.__name__ == "PlanFile" else path
        setting = f"'{_name(option)}: ...' in --{file} FILE.yaml (see --save-{file} of {writer})"
        return f"blurnoise: error: no such option: {option}; it is {setting}"
    text = error.format_message().rstrip(".")
    for theirs, ours in _PYDANTIC:
        text = text.replace(theirs, ours)
    for fault in getattr(error.__cause__, "errors", list)():
        if repr(fault["input"]) not in text:
            text += f", got {fault['input']!r}"
    hint = f"; see '{path} --help'" if path else ""
    return f"blurnoise: error: {' '.join(without_secrets(text).split())}{hint}"


def files() -> dict[str, tuple[str, type[Settings]]]:
    """Of a command: its file's option, and what the file holds."""
    from blurnoise_eval.grid.plan_file import PlanFile
    from blurnoise_eval.grid.program_file import ProgramFile
    from blurnoise_eval.grid.scene_file import SceneFile

    found: dict[str, tuple[str, type[Settings]]] = dict.fromkeys(
        ("sweep", "decide", "quality"), ("plan", PlanFile)
    )
    return found | {"simulate": ("scene", SceneFile), "program": ("plan", ProgramFile)}
