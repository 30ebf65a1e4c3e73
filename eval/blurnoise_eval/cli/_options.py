"""Options of several commands: types, parsers, and the options of a file of settings."""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Exit, Option

from blurnoise_eval.plan.files import PlanFile
from blurnoise_eval.plan.settings import Settings
from blurnoise_eval.system.terminal import say

if TYPE_CHECKING:
    from blurnoise_eval.system.urls import Location as Location

    Region = tuple[int, int, int, int]
else:
    Location = Region = object  # Typer calls the parser; a URL's class takes time to import


BEGIN: ContextVar[Callable[[], None]] = ContextVar("begin", default=lambda: None)
"""Called before anything is written or checked for it: says what the command may replace. What it imports is slow."""


def place(text: str) -> Location:
    """A file, folder or URL. Raises ``ValueError``."""
    from blurnoise_eval.system.urls import location

    found: Location = location(text)
    return found


def _local(text: str) -> Path:
    """A local file; the file of a URL is downloaded. Raises ``ValueError`` and ``OSError``."""
    from blurnoise_eval.system.urls import local_file, location

    return local_file(location(text))


def new_file(text: str) -> Path:
    """A file to write. Raises ``OSError`` if it cannot be written."""
    from blurnoise_eval.system.files import check_writable

    BEGIN.get()()
    check_writable(Path(text))
    return Path(text)


def new_folder(text: str) -> Path:
    """A folder to write to. Raises ``OSError`` if it cannot be written to."""
    from blurnoise_eval.system.files import check_writable_folder

    BEGIN.get()()
    check_writable_folder(Path(text))
    return Path(text)


def new_place(text: str | Location) -> Location:
    """As :func:`new_folder`, or a URL."""
    found = place(str(text))
    return new_folder(str(found)) if isinstance(found, Path) else found


WRITTEN = (new_file, new_folder, new_place)
"""The parsers of what a command writes."""


def region(text: str) -> Region:
    """Left, top, width and height of "x,y,w,h". Raises ``ValueError``."""
    try:
        left, top, width, height = map(int, text.split(","))
    except ValueError:
        raise ValueError(f"{text!r}: must be x,y,w,h, four integers in px") from None
    return left, top, width, height


def option_of(kind: type[Settings], name: str) -> Any:
    """The type of the option of a setting: ``Threads = option_of(PlanFile, "threads")``."""
    setting = kind.settings()[name]
    typed: Any = {int: int, float: float, tuple[str, ...]: list[str]}.get(setting.kind, str)
    option = Option(
        setting.option,
        *setting.names,
        metavar=setting.metavar or None,
        help=setting.about,
        rich_help_panel=setting.panel or None,
        show_default=False,
    )
    return Annotated[typed | None, option]


def settings(
    kind: type[Settings], *names: str, file: str = "plan", template: bool = True
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command options for settings of ``kind`` in place of its parameter ``config``, an instance.

    names: of the settings; "*": one for each axis. file: --plan FILE has all settings, which the options override;
    "": there is no file. template: whether --save-plan writes such a file.
    """
    axes = [setting.name for setting in kind.settings().values() if setting.panel]
    chosen = [setting for name in names for setting in (axes if name == "*" else [name])]
    added = {name: option_of(kind, name) for name in chosen} | _file_options(kind, file, template)

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def run(settings_file: Path | None = None, saved_to: None = None, **options: Any) -> None:
            values = {name: options.pop(name) for name in chosen}
            values = {name: value for name, value in values.items() if value not in (None, [])}
            config = kind.of(values) if settings_file is None else kind.read(settings_file, values)
            command(config=config, **options)

        own = signature(command, eval_str=True)
        parameters = list(own.parameters.values())
        index = list(own.parameters).index("config")
        parameters[index : index + 1] = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=of) for name, of in added.items()
        ]
        run.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
        run.settings = file, kind  # type: ignore[attr-defined]
        return run

    return decorate


def _file_options(kind: type[Settings], file: str, template: bool) -> dict[str, Any]:
    """The options for a file of settings, and for a template of it."""

    def save(path: Path | None) -> None:
        from blurnoise._core.writing import write_whole

        if path is not None:
            write_whole(path, kind.document().encode())
            say(path)
            raise Exit

    about_file = "file with all settings; options override it"
    about_template = "write a file with the default of every setting, and exit"
    read = Option(f"--{file}", parser=_local, metavar="FILE.yaml", help=about_file)
    written = Option(
        f"--save-{file}",
        parser=new_file,
        metavar="OUT.yaml",
        callback=save,
        is_eager=True,
        help=about_template,
    )
    options: dict[str, Any] = {"settings_file": Annotated[Path | None, read]} if file else {}
    return options | ({"saved_to": Annotated[Path | None, written]} if file and template else {})


Threads = option_of(PlanFile, "threads")
Trust = Annotated[
    bool,
    Option(
        "--trust",
        help="open the pictures and models at the paths in the run, though another user has made it; use it for runs "
        "of people you trust only",
    ),
]
Contract = Annotated[
    str | None,
    Option(
        metavar="FILE|PRESET[,FIELD=VALUE...]",
        help="how to read the model: a contract file (JSON, YAML) or a preset, and the fields that differ",
    ),
]
ModelTimeout = Annotated[
    float, Option(metavar="S", help="time limit for loading a model and for its first inference, s")
]
PictureWritten = Annotated[
    Path, Option("-o", "--output", parser=new_file, metavar="OUT.png", help="picture to write")
]
RunRead = Annotated[Location, Argument(parser=place, metavar="RUN", help="folder or URL of a run")]
Folder = Annotated[
    Location, Option("-o", "--output", parser=new_place, metavar="DIR", help="folder or URL for the results")
]
NewFolder = Annotated[
    Path, Option("-o", "--output", parser=new_folder, metavar="DIR", help="folder for the results")
]
CodingOfPicture = Annotated[
    Literal["auto", "linear", "srgb"],
    Option(help="coding of the pixel values; auto: linear for 16 bits, sRGB for 8 bits"),
]
BlackLevel = Annotated[float | None, Option(metavar="DN", help="digital number without light (default: 0)")]
FullScale = Annotated[
    float | None, Option(metavar="DN", help="largest digital number (default: all bits set)")
]
Json = Annotated[bool, Option("--json", help="print JSON instead of text")]
FramesLayout = Annotated[
    str | None,
    Option(
        metavar="PACKING,WxH[,STRIDE]", help="layout of .raw and .bin files, such as mipi10,4056x3040,5072"
    ),
]
FramesLeftOut = Annotated[
    list[str] | None,
    Option("--leave-out", metavar="LEVEL", help="leave out a level, such as 'flat 10 ms'; may be repeated"),
]
FramesCfa = Annotated[
    str | None, Option(metavar="CFA", help="colour filters, such as RGGB, or none (default: from the files)")
]
