"""Options that several commands share: camera, JSON, lists and ranges of numbers, regions, a grid's axes."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping
from functools import partial, wraps
from inspect import Parameter, signature
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

from typer import Argument, Context, Option

from blurnoise_eval.grid.axes import AUTOMATIC, AXES, Axis
from blurnoise_eval.system.files import check_writable, check_writable_folder
from blurnoise_eval.system.storage import Location, location

Grid = dict[str, tuple[float, ...]]
"""Values by the name of their axis, in its column's unit."""

# Named here, too, so that completion need not import PyTorch; a test holds them to what there is.
CAMERAS = ("imx250", "imx250c", "imx250m", "imx249", "mt9m034", "blackfly", "ar0132at", "ar0237", "lin2024")
FAMILIES = (
    "yolov5", "yolov6", "yolov6e2e", "yolov7", "yolov8", "yolov10", "yolox", "rtdetr", "detr", "rfdetr", "ppyoloe",
    "mmdeploy", "nanodet", "nanodetplus", "fastestdet", "yolofastestv2", "anchors", "torchvision", "tfod", "ppocr",
)  # fmt: skip
MATTES = ("auto", "segmentation", "grabcut", "box")
MODEL_TIMEOUT_S = 60.0
ENGINE_NAMES = ("threads", "processes", "ray")
BOXES = ("object", "half", "swept")
SCORES = ("target_confidence", "detection_rate", "recall@0.1", "ap50", "ap", "exact_match")
_LIST = "1,5,10 or start:stop:step (stop included)"
_RANGES = "1,5,10, start:stop:step, or low:high for both and 1, 3, 10, 30 ... between"
_MOST_NUMBERS = 100_000
_QUICKLY_READ = 30_000_000  # bytes; completion must not keep anybody waiting


def new_file(text: str) -> Path:
    """A file to write. Raises ``OSError`` where that is not possible."""
    check_writable(Path(text))
    return Path(text)


def new_folder(text: str) -> Path:
    """A folder to write to. Raises ``OSError`` where that is not possible."""
    check_writable_folder(Path(text))
    return Path(text)


def new_place(place: str | Location) -> Location:
    """As :func:`new_folder`, or a URL."""
    found: Location = location(place)
    return new_folder(str(found)) if isinstance(found, Path) else found


class Range(NamedTuple):
    """From low to high."""

    low: float
    high: float

    def __str__(self) -> str:
        """As it is typed."""
        return f"{self.low:g}:{self.high:g}"

    def __repr__(self) -> str:
        """As it is typed, too: errors tell it."""
        return str(self)


class Region(NamedTuple):
    """A rectangle of a picture, px."""

    left: int
    top: int
    width: int
    height: int

    def __repr__(self) -> str:
        """As it is typed."""
        return ",".join(map(str, self))


def numbers(text: str, *, automatic: bool = False) -> tuple[float, ...]:
    """Parse "1,5,10" or "start:stop:step", stop included; "auto" where that is allowed. Raises ``ValueError``."""
    try:
        if ":" not in text:
            return tuple(or_auto(part) if automatic else float(part) for part in text.split(","))
        start, stop, step = (float(part) for part in text.split(":"))
        count = math.floor((stop - start) / step + 1e-9) + 1
        if step == 0 or count < 1 or count > _MOST_NUMBERS:
            raise ValueError
        return tuple(start + step * index for index in range(count))
    except (ValueError, ZeroDivisionError, OverflowError):
        also = ", or auto" if automatic else ""
        raise ValueError(f"{text!r}: must be numbers as {_LIST}{also}") from None


def or_auto(text: str | float) -> float:
    """A number, or "auto" as ``AUTOMATIC``, which no number says, however large. Raises ``ValueError``."""
    if isinstance(text, str) and text.strip() == "auto":
        return AUTOMATIC
    try:
        number = float(text)
    except ValueError:
        number = math.inf
    if math.isinf(number):
        raise ValueError(f"{text!r}: must be a number, or auto")
    return number


def bounds(text: str | Range) -> Range:
    """Parse "low:high", or one number for both. Raises ``ValueError``."""
    try:
        low, high = str(text).split(":") if ":" in str(text) else (str(text),) * 2
        return Range(float(low), float(high))
    except ValueError:
        raise ValueError(f"{text!r}: must be low:high or a number") from None


def spread(text: str, *, automatic: bool = False) -> tuple[float, ...]:
    """Parse "low:high" as its ends and what 1, 3, 10, 30 ... lies between, from two decades below the high end where
    the low one is 0; else as :func:`numbers`. Raises ``ValueError``."""
    if text.count(":") != 1:
        return numbers(text, automatic=automatic)
    low, high = bounds(text)
    if not 0 <= low < high < math.inf:
        raise ValueError(f"{text!r}: must be low:high with 0 <= low < high")
    least = low or high / 100
    powers = range(math.floor(math.log10(least)), math.ceil(math.log10(high)) + 1)
    between = (float(f"{digit}e{power}") for power in powers for digit in (1, 3))
    return (
        low,
        *(value for value in between if max(low, least * (1 - 1e-9)) <= value < high and value != low),
        high,
    )


def region(text: str) -> Region:
    """Parse "x,y,w,h". Raises ``ValueError``."""
    try:
        left, top, width, height = (int(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"{text!r}: must be x,y,w,h, four whole numbers of px") from None
    return Region(left, top, width, height)


def one_of(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Complete a word to the names that begin with it."""
    return lambda incomplete: [name for name in names if name.startswith(incomplete)]


def classes(context: Context, incomplete: str) -> list[str]:
    """Complete a word to classes: those of the COCO file that is named before it, else COCO's own."""
    import json

    from blurnoise_eval.detectors.class_names import COCO80

    try:
        path = Path(str(context.params.get("coco")))
        if not path.is_file():  # a pipe would never end
            raise OSError
        with path.open("rb") as file:
            told = json.loads(file.read(_QUICKLY_READ))  # cut, it is no JSON
        known = [str(each["name"]) for each in told["categories"]]
    except (OSError, ValueError, LookupError, TypeError):
        known = list(COCO80)
    in_bash = (
        os.environ.get("_BLURNOISE_COMPLETE") == "complete_bash"
    )  # which takes words as they would be typed
    return [name.replace(" ", "\\ ") if in_bash else name for name in one_of(known)(incomplete)]


def speeds(context: Context, incomplete: str) -> list[str]:
    return [f"{name}=" for name in classes(context, incomplete)]


CameraName = Annotated[
    str | None,
    Option(
        metavar="NAME|FILE",
        help="a preset or a file; see 'blurnoise cameras' (default: of the pictures)",
        autocompletion=one_of(CAMERAS),
    ),
]
FNumber = Annotated[float | None, Option(metavar="N", help="of the lens, in place of the camera's")]
Threads = Annotated[int | None, Option(metavar="N", help="default: every core")]
Workers = Annotated[
    int | None,
    Option(
        "--threads",
        "--workers",
        metavar="N",
        help="how many of them, pictures at a time (default: every core)",
    ),
]
Address = Annotated[
    str | None,
    Option(
        metavar="HOST:PORT|auto",
        help="for ray: of a cluster that runs (default: one on this machine, for as long as it takes)",
    ),
]
GreyAnchor = Annotated[
    str | None,
    Option(
        metavar="mean|pNN|x0,y0,x1,y1",
        help="what of a picture is 18 % reflectance: its mean, a percentile, a region in px (default: its brightness "
        "is taken for reflectance)",
    ),
]
StatedPath = Annotated[
    str | None,
    Option(
        "--trajectory",
        metavar="PATH",
        help="as of simulate; a shake is each picture's own, over the longest exposure",
    ),
]
Cfa = Annotated[
    Literal["none", "mono", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"] | None,
    Option(help="colour filters in place of the camera's; none: a sensor for each colour, mono: one for all"),
]
FrameRate = Annotated[float, Option(metavar="HZ", help="bounds an automatic exposure")]
Mains = Annotated[
    Literal["0", "50", "60"], Option(help="Hz; automatic exposures of whole periods of its light, 0: any")
]
_objects = partial(Option, rich_help_panel="What moves for itself (--moves targets,background)")
Mattes = Annotated[
    str,
    _objects(
        metavar="HOW",
        help="auto: by segmentations, else GrabCut in the box; segmentation; grabcut; box",
        autocompletion=one_of(MATTES),
    ),
]
Plates = Annotated[
    Location | None,
    _objects(
        parser=location,
        metavar="DIR",
        help="folder or URL of the same names, without targets (default: invented)",
    ),
]
ObjectSpeed = Annotated[
    list[str] | None,
    _objects(metavar="CLASS=FACTOR", help="of --dx and --dy; 0: they stand", autocompletion=speeds),
]
ObjectKmh = Annotated[
    list[str] | None,
    _objects(
        metavar="CLASS=KMH,...",
        help="it crosses the view to the right",
        autocompletion=speeds,
    ),
]
ObjectM = Annotated[
    list[str] | None,
    _objects(metavar="CLASS=M,...", help="how far, by --hfov-deg, --lens", autocompletion=speeds),
]
ObjectWidthM = Annotated[
    list[str] | None,
    _objects(metavar="CLASS=M,...", help="or how wide", autocompletion=speeds),
]
Boxes = Annotated[
    str,
    Option(
        metavar="WHICH",
        help="truth: object, at mid-exposure; half, there for half of it; swept, all it passes",
        autocompletion=one_of(BOXES),
    ),
]
PictureWritten = Annotated[
    Path, Option("-o", "--output", parser=new_file, metavar="OUT.png", help="the picture")
]
RunWritten = Annotated[
    Location, Option("-o", "--output", parser=new_place, metavar="RUN", help="folder or URL for everything")
]
RunRead = Annotated[
    Location, Argument(parser=location, metavar="RUN", help="the folder or URL of a sweep or a decision")
]
Folder = Annotated[
    Location, Option("-o", "--output", parser=new_place, metavar="DIR", help="folder or URL for everything")
]
CacheGb = Annotated[
    float | None,
    Option(
        "--cache-gb",
        metavar="GB",
        help="of pictures and models read by URL, how much this machine keeps (default: BLURNOISE_CACHE_GB, else 5; "
        "in BLURNOISE_CACHE, else ~/.cache/blurnoise)",
    ),
]
ModelTimeout = Annotated[
    float, Option(metavar="S", help="how long loading a model, and its first answer, may take")
]
Json = Annotated[bool, Option("--json", help="print JSON for programs")]


def axis_options(
    *, ranges: bool = False, also: Mapping[str, str] = MappingProxyType({}), **usual: str
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command an option for each of ``AXES`` in the place of its parameter ``grid``.

    ranges: whether a list may be a range, as :func:`spread` reads it. also: further names of options, by the axis's
    name. usual: by the axis's name what its option is unless stated, where that is not the axis's own default. The
    command gets in ``grid`` what was stated or is usual; the camera knows the rest.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def run(*, context: Context, **options: Any) -> None:
            given = {axis: options.pop(axis.name) for axis in AXES}
            replaced = {name for axis, values in given.items() if values is not None for name in axis.without}
            grid = {
                axis.name: tuple(map(axis.of_option, values))
                for axis, values in given.items()
                if values is not None and not (axis.name in replaced and left_out(context, axis.name))
            }
            command(grid=grid, **options)

        stated = signature(command, eval_str=True)
        shared = [part for name, part in stated.parameters.items() if name != "grid"]
        added = [
            _axis_option(axis, usual.get(axis.name, default_text(axis)), also.get(axis.name), ranges)
            for axis in AXES
        ]
        place = list(stated.parameters).index("grid")
        own = Parameter("context", Parameter.KEYWORD_ONLY, annotation=Context)
        parameters = [own, *shared[:place], *added, *shared[place:]]
        run.__signature__ = stated.replace(parameters=parameters)  # type: ignore[attr-defined]
        return run

    return decorate


def left_out(context: Context, name: str) -> bool:
    """Whether an option of the command that runs was not given."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "DEFAULT"


def default_text(axis: Axis) -> str | None:
    """What a sweep tests if not told, as it is typed."""
    return (
        ",".join("auto" if value == AUTOMATIC else f"{axis.shown(value):g}" for value in axis.default) or None
    )


def options_of(
    other: Callable[..., None], *names: str
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command these options of another in the place of its parameter ``shared``, a dictionary of them."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def run(**options: Any) -> None:
            command(shared={name: options.pop(name) for name in names}, **options)

        stated, theirs = signature(command, eval_str=True), signature(other, eval_str=True).parameters
        parameters = [part for name, part in stated.parameters.items() if name != "shared"]
        place = list(stated.parameters).index("shared")
        parameters[place:place] = [theirs[name] for name in names]
        run.__signature__ = stated.replace(parameters=parameters)  # type: ignore[attr-defined]
        return run

    return decorate


def names(text: str, axis: Axis) -> tuple[float, ...]:
    """Parse "all,targets" as places of an axis's choices. Raises ``ValueError``."""
    return tuple(axis.place_of(part.strip()) for part in text.split(","))


def _axis_option(axis: Axis, usual: str | None, also: str | None, ranges: bool) -> Parameter:
    parser: Callable[[str], tuple[float, ...]] = (
        partial(names, axis=axis)
        if axis.choices
        else partial(spread if ranges else numbers, automatic=axis.automatic)
    )
    listed = "LIST|RANGE" if ranges and not axis.choices else "LIST"
    option = Option(
        axis.option,
        *([also] if also else []),
        parser=parser,
        metavar=f"auto|{listed}" if axis.automatic else listed,
        autocompletion=one_of(axis.choices) if axis.choices else None,
        help=axis.about,
        rich_help_panel=f"Conditions, each as {_RANGES if ranges else _LIST}",
    )
    return Parameter(axis.name, Parameter.KEYWORD_ONLY, default=usual, annotation=Annotated[object, option])
