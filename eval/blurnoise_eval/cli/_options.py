"""Options of several commands: types, parsers, completion, and the options of a file of settings."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import fields
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from typer import Argument, Context, Option, TyperException

from blurnoise_eval.grid.plan_file import PlanFile
from blurnoise_eval.grid.settings import Settings
from blurnoise_eval.system.terminal import say

if TYPE_CHECKING:
    from blurnoise_eval.system.urls import Location as Location
else:
    Location = object  # what it is takes time to import

_QUICKLY_READ = 30_000_000  # bytes; completion must not keep anybody waiting


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


class Region(NamedTuple):
    """A rectangle of a picture, px."""

    left: int
    top: int
    width: int
    height: int

    def __repr__(self) -> str:
        """As it is typed."""
        return ",".join(map(str, self))


def region(text: str) -> Region:
    """Parse "x,y,w,h". Raises ``ValueError``."""
    try:
        left, top, width, height = (int(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"{text!r}: must be x,y,w,h, four whole numbers of px") from None
    return Region(left, top, width, height)


def camera_names() -> Iterable[str]:
    """The presets."""
    from blurnoise.optics.camera import PRESETS

    return PRESETS


def _families() -> Iterable[str]:
    from blurnoise_eval.detectors.formats import PRESETS
    from blurnoise_eval.detectors.ocr.contract import TEXT_PRESETS

    return (*PRESETS, *TEXT_PRESETS)


def _scores() -> Iterable[str]:
    from blurnoise_eval.answers.criterion import names

    return dict.fromkeys(name for kind in ("detector", "reader") for name in names(kind))


def one_of(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Complete a word to the names that begin with it; they are asked for when the shell asks."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


def classes(context: Context, incomplete: str) -> list[str]:
    """Complete a word to classes: those of the COCO file that is named before it, else COCO's own."""
    import json

    from blurnoise_eval.detectors.class_names import COCO80

    try:
        path = Path(str(context.params.get("labels")))
        if not path.is_file():  # a pipe would never end
            raise OSError
        with path.open("rb") as file:
            told = json.loads(file.read(_QUICKLY_READ))  # cut, it is no JSON
        known = [str(each["name"]) for each in told["categories"]]
    except (OSError, ValueError, LookupError, TypeError):
        known = list(COCO80)
    in_bash = os.environ.get("_BLURNOISE_COMPLETE") == "complete_bash"  # which takes words as they are typed
    return [name.replace(" ", "\\ ") if in_bash else name for name in known if name.startswith(incomplete)]


_COMPLETED: dict[str, Callable[..., list[str]]] = {
    "cameras": one_of(camera_names),
    "families": one_of(_families),
    "scores": one_of(_scores),
    "engines": one_of(lambda: ("threads", "processes", "ray")),
    "classes": classes,
}


def option_of(kind: type[Settings], name: str) -> Any:
    """The type of the option of a field: ``Keep = option_of(PlanFile, "keep")``."""
    return _typed(next(each for each in fields(kind) if each.name == name))


def _typed(entry: Any) -> Any:
    told, typed = entry.metadata, str(entry.type)
    types: dict[str, Any] = {"tuple[str, ...]": list[str] | None, "int | None": int | None, "int": int | None}
    types |= {"float | None": float | None, "float": float | None, "bool": bool | None}
    flag = f"--{entry.name.replace('_', '-')}"
    option = Option(
        flag,
        *told["names"],
        metavar=told["metavar"] or None,
        help=told["about"],
        autocompletion=_COMPLETED.get(told["complete"]),
        rich_help_panel=told["panel"] or None,
        show_default=False,
    )
    return Annotated[types.get(typed, str | None), option]


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
        added = [_parameter(each.name, _typed(each)) for each in chosen]
        added.append(_parameter("settings_file", Annotated[str | None, read]))
        added += [_parameter("saved_to", Annotated[Path | None, written])] if save else []
        parameters = list(theirs.parameters.values())
        place = list(theirs.parameters).index("given")
        parameters[place : place + 1] = added
        parameters = [each.replace(default=None) if each.name in needed else each for each in parameters]
        run.__signature__ = theirs.replace(parameters=parameters)  # type: ignore[attr-defined]
        return run

    return decorate


def _parameter(name: str, annotation: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


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
Json = Annotated[bool, Option("--json", help="print JSON for programs")]
