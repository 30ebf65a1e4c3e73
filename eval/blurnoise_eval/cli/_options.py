"""Options of several commands: types, parsers, completion, and the options of a file of settings."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from dataclasses import fields
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option, TyperException

from blurnoise_eval.grid.plan_file import PlanFile
from blurnoise_eval.grid.settings import Settings
from blurnoise_eval.system.terminal import say

if TYPE_CHECKING:
    from blurnoise_eval.system.urls import Location as Location

    Region = tuple[int, int, int, int]
else:
    Location = Region = object  # Typer calls the parser; a URL's class takes time to import


def place(text: str) -> Location:
    """A file, folder or URL. Raises ``ValueError``."""
    from blurnoise_eval.system.urls import location

    found: Location = location(text)
    return found


def _local(text: str) -> Path:
    """A file, fetched where it is a URL. Raises ``ValueError`` and ``OSError``."""
    from blurnoise_eval.system.urls import local_file, location

    return local_file(location(text))


def new_file(text: str) -> Path:
    """A file to write. Raises ``OSError`` where that is not possible."""
    from blurnoise_eval.system.files import check_writable

    check_writable(Path(text))
    return Path(text)


def new_folder(text: str) -> Path:
    """A folder to write to. Raises ``OSError`` where that is not possible."""
    from blurnoise_eval.system.files import check_writable_folder

    check_writable_folder(Path(text))
    return Path(text)


def new_place(text: str | Location) -> Location:
    """As :func:`new_folder`, or a URL."""
    found = place(str(text))
    return new_folder(str(found)) if isinstance(found, Path) else found


def region(text: str) -> Region:
    """Left, top, width and height of "x,y,w,h". Raises ``ValueError``."""
    try:
        left, top, width, height = map(int, text.split(","))
    except ValueError:
        raise ValueError(f"{text!r}: must be x,y,w,h, four whole numbers of px") from None
    return left, top, width, height


def camera_names() -> Iterable[str]:
    """The presets."""
    from blurnoise.optics.camera import PRESETS

    return PRESETS


def _families() -> Iterable[str]:
    from blurnoise_eval.detectors.formats import PRESETS
    from blurnoise_eval.detectors.ocr.recogniser import TEXT_PRESETS

    return (*PRESETS, *TEXT_PRESETS)


def _scores() -> Iterable[str]:
    from blurnoise_eval.answers.criterion import names

    return dict.fromkeys(name for kind in ("detector", "reader") for name in names(kind))


def _classes() -> Iterable[str]:
    from blurnoise_eval.detectors.contract import COCO80

    in_bash = os.environ.get("_BLURNOISE_COMPLETE") == "complete_bash"  # which takes words as they are typed
    return (name.replace(" ", "\\ ") if in_bash else name for name in COCO80)


def one_of(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Complete a word to the names that begin with it; they are asked for when the shell asks."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


_COMPLETED: dict[str, Callable[..., list[str]]] = {
    "cameras": one_of(camera_names),
    "families": one_of(_families),
    "scores": one_of(_scores),
    "engines": one_of(lambda: ("threads", "processes", "ray")),
    "classes": one_of(_classes),
}


def option_of(kind: type[Settings], name: str) -> Any:
    """The type of the option of a field: ``Keep = option_of(PlanFile, "keep")``."""
    return _typed(next(each for each in fields(kind) if each.name == name))


def _typed(entry: Any) -> Any:
    about = entry.metadata
    types = {"tuple": list[str], "int": int, "float": float, "bool": bool}
    word = re.match(r"\w+", str(entry.type))
    kind: Any = (
        str if "|" in str(entry.type).removesuffix(" | None") else types.get(word[0] if word else "", str)
    )
    option = Option(
        f"--{entry.name.replace('_', '-')}",
        *about["names"],
        metavar=about["metavar"] or None,
        help=about["about"],
        autocompletion=_COMPLETED.get(about["complete"]),
        rich_help_panel=about["panel"] or None,
        show_default=False,
    )
    return Annotated[kind | None, option]


def settings(
    kind: type[Settings], *names: str, file: str = "plan", save: bool = True
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command options for fields of ``kind`` in the place of its parameter ``given``, an instance.

    names: of the fields; "*": one for each axis. file: --plan FILE holds all fields, and what the command line states
    overrides it. save: whether --save-plan writes them and runs nothing; else ``output`` is needed.
    """
    by_name = {each.name: each for each in fields(kind)}
    axes = [each.key for each in getattr(kind, "AXES", ())]
    chosen = [by_name[each] for name in names for each in (axes if name == "*" else [name])]

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        theirs = signature(command, eval_str=True)
        needed = [each.name for each in theirs.parameters.values() if each.default is Parameter.empty]
        needed.remove("given")

        @wraps(command)
        def run(**options: Any) -> None:
            stated = {each.name: options.pop(each.name) for each in chosen}
            path, saved = options.pop("settings_file"), options.pop("saved_to", None)
            given = kind() if path is None else kind.read(_local(path))
            given = given.stating({name: value for name, value in stated.items() if value not in (None, [])})
            if saved is not None:
                given.save(saved)
                say(saved)
                return
            if missing := [name for name in needed if options[name] is None]:
                name = missing[0]
                stands_alone = theirs.parameters[name].kind is not Parameter.KEYWORD_ONLY
                raise TyperException(f"'{name.upper() if stands_alone else f'--{name}'}' is missing")
            command(given=given, **options)

        read = Option(
            f"--{file}", metavar="FILE.yaml", help="these and rarer settings; options override them"
        )
        written = Option(
            f"--save-{file}", parser=new_file, metavar="OUT.yaml", help="write such a file, and end"
        )
        added = {each.name: _typed(each) for each in chosen} | {"settings_file": Annotated[str | None, read]}
        added |= {"saved_to": Annotated[Path | None, written]} if save else {}
        parameters = list(theirs.parameters.values())
        place = list(theirs.parameters).index("given")
        parameters[place : place + 1] = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            for name, kind in added.items()
        ]
        parameters = [each.replace(default=None) if each.name in needed else each for each in parameters]
        run.__signature__ = theirs.replace(parameters=parameters)  # type: ignore[attr-defined]
        return run

    return decorate


CameraName = option_of(PlanFile, "camera")
Threads = option_of(PlanFile, "threads")
Keep = option_of(PlanFile, "keep")
Threshold = option_of(PlanFile, "threshold")
Score = option_of(PlanFile, "score")
Cluster = option_of(PlanFile, "cluster")
Contract = Annotated[
    str | None,
    Option(
        metavar="FILE|PRESET[,FIELD=VALUE...]",
        help="how to read the model: a JSON or YAML file, or a preset, and what differs",
        autocompletion=_COMPLETED["families"],
    ),
]
ModelTimeout = Annotated[
    float, Option(metavar="S", help="how long loading a model, and its first answer, may take")
]
PictureWritten = Annotated[
    Path, Option("-o", "--output", parser=new_file, metavar="OUT.png", help="the picture")
]
RunWritten = Annotated[
    Location, Option("-o", "--output", parser=new_place, metavar="RUN", help="folder or URL for everything")
]
RunRead = Annotated[
    Location, Argument(parser=place, metavar="RUN", help="the folder or URL of a sweep or a decision")
]
Folder = Annotated[
    Location, Option("-o", "--output", parser=new_place, metavar="DIR", help="folder or URL for everything")
]
NewFolder = Annotated[Path, Option("-o", "--output", parser=new_folder, metavar="DIR", help="for everything")]
Linear = Annotated[bool, Option("--linear", help="the numbers are linear in light (default for 16 bits)")]
Srgb = Annotated[bool, Option("--srgb", help="the numbers are sRGB-coded (default for 8 bits)")]
BlackLevel = Annotated[float | None, Option(metavar="DN", help="of no light (default: 0)")]
FullScale = Annotated[
    float | None, Option(metavar="DN", help="the most a pixel can hold (default: all bits set)")
]
Json = Annotated[bool, Option("--json", help="print JSON for programs")]
