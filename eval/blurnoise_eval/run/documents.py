"""Documents of a run: JSON besides its rows, the keys and types of each, and the error for a fault in one.

Sweeps, searches and merges write them; in a run of somebody else they may hold anything.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from annotated_types import Ge, Le, Len
from pydantic import ConfigDict, StringConstraints, TypeAdapter, ValidationError, with_config
from typing_extensions import TypedDict

from blurnoise._core.checks import shown

_DEEPEST = 20  # a camera's curves are six levels down
_MOST_CONDITIONS = 100_000
_STRICT = with_config(ConfigDict(strict=True, extra="forbid", allow_inf_nan=False))
_WITH_AUTO = with_config(ConfigDict(strict=True, extra="forbid"))  # infinite: set by the camera
_OF_DATA_SETS = with_config(ConfigDict(extra="allow", allow_inf_nan=False))
Name = Annotated[str, StringConstraints(min_length=1, max_length=1000)]
Count = Annotated[int, Ge(0), Le(10**9)]
Plain = dict[str, Any]


@_STRICT
class ModelNote(TypedDict):
    """A model of the run."""

    name: Name
    kind: Literal["detector", "reader"]
    unknown_labels: list[str]
    file: str
    sha256: str
    contract: Plain
    latency: NotRequired[dict[str, float]]
    suspicions: NotRequired[list[str]]


@_STRICT
class ImagesPlace(TypedDict):
    """Labels, or the folder without any, and the folder of the pictures: paths from the root of this machine."""

    source: str
    folder: str


@_STRICT
class ImagesNote(TypedDict):
    """The pictures of the run; exif: how many photographs have their exposure in EXIF."""

    kind: str
    source: str
    labelled: bool
    notes: list[str]
    chosen: str
    count: Count
    at: NotRequired[ImagesPlace]
    exif: NotRequired[str]


@_STRICT
class TrajectoryNote(TypedDict):
    """The motion beside the velocity; content: of a file."""

    text: str
    content: str | None
    longest_s: float


@_STRICT
class Manifest(TypedDict):
    """How the run was made."""

    title: str
    models: Annotated[list[ModelNote], Len(1, 1000)]
    camera: Plain
    images: ImagesNote
    seed: Annotated[int, Ge(0), Le(2**63)]
    grey_anchor: str | None
    trajectory: TrajectoryNote | None
    versions: dict[str, str]
    hardware: dict[str, str | int]
    command: NotRequired[str]
    engine: NotRequired[str]
    threads: NotRequired[int]


@_STRICT
class Enough(TypedDict):
    """The criterion and the clusters that the sweep was given."""

    threshold: float | None
    keep: float | None
    score: str | None
    cluster: str | None


@_WITH_AUTO
class BatchNote(TypedDict):
    """Conditions that were computed together."""

    n_pictures: Count
    places: list[Annotated[list[float], Len(2, 2)]]
    conditions: list[dict[str, float]]


@_WITH_AUTO
class SearchSpaceNote(TypedDict):
    """The exposures, lights and speeds that a search was asked for; because: why the full grid was computed."""

    grid: dict[str, list[float]]
    because: list[str]


@_OF_DATA_SETS
class Instance(TypedDict):
    """A target, with whatever its data set says of it."""

    id: int | str
    image_id: int | str
    category_id: int | str
    bbox: tuple[float, float, float, float]
    area: float
    iscrowd: NotRequired[int]


@_OF_DATA_SETS
class ImageEntry(TypedDict):
    """A picture of the run."""

    id: int | str
    file_name: str


@_OF_DATA_SETS
class TruthCategory(TypedDict):
    """A class of the labels."""

    id: int | str
    name: str


class TruthFile(TypedDict):
    """The run's instances.json."""

    images: list[ImageEntry]
    annotations: list[Instance]
    categories: list[TruthCategory]


_KINDS: dict[str, TypeAdapter[Any]] = {
    "manifest": TypeAdapter(Manifest),
    "identity": TypeAdapter(Plain),
    "enough": TypeAdapter(Enough | None),
    "asked": TypeAdapter(Annotated[list[BatchNote], Len(0, _MOST_CONDITIONS)] | None),
    "question": TypeAdapter(SearchSpaceNote | None),
    "truth": TypeAdapter(TruthFile),
    "wall_s": TypeAdapter(Annotated[float, Ge(0)] | None),
}


def validated(key: str, value: Any) -> Any:
    """The document of this key. Raises ``ValueError`` of one line."""
    _check_depth(value)
    try:
        found = _KINDS[key].validate_python(value)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        at = ".".join(map(str, fault["loc"]))
        raise ValueError(f"{at}: {fault['msg']}, got {shown(fault['input'])}") from None
    if key == "asked" and sum(len(batch["conditions"]) for batch in found or ()) > _MOST_CONDITIONS:
        raise ValueError(f"must have at most {_MOST_CONDITIONS} conditions")
    return found


def _check_depth(value: Any) -> None:
    level = [value]
    # Level by level: calls that nest as deep as a hostile document would reach Python's limit.
    for _ in range(_DEEPEST):
        inside = (each for each in level if isinstance(each, dict | list))
        level = [part for each in inside for part in (each.values() if isinstance(each, dict) else each)]
    if level:
        raise ValueError(f"is nested more than {_DEEPEST} levels deep")


def check_files(value: Any) -> None:
    """Raise ``ValueError`` for a table in a file: a sweep notes what it held."""
    if isinstance(value, dict):
        if "csv" in value:
            raise ValueError(f"csv = {shown(value['csv'])}: must be the values")
        for part in value.values():
            check_files(part)
    elif isinstance(value, list):
        for part in value:
            check_files(part)
