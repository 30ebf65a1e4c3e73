"""Label files as they come from anywhere: read strictly, every fault one line that names file and place; what of them
is used."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, TypeVar

from annotated_types import Gt, Lt
from pydantic import AfterValidator, BaseModel, BeforeValidator, Strict, ValidationError

from blurnoise._core.checks import Characters, shown
from blurnoise._core.files import LARGEST_TEXT_BYTES, json_of, read_bytes, text_of
from blurnoise_eval.datasets.folder import Entry, from_files
from blurnoise_eval.datasets.records import PictureSet, Target, size_group
from blurnoise_eval.system.files import inside
from blurnoise_eval.system.urls import Location, local_file

T = TypeVar("T")
Form = TypeVar("Form", bound=BaseModel)
LARGEST_ID = 2**63  # COCO's tools hold ids in 64 bits
LARGEST_SET_BYTES = 2 << 30
"""Of a file with the labels of a whole set: COCO's of 118 000 pictures has 448 MB, BDD100K's of 70 000 1.3 GB."""
Number = Annotated[float, Strict()]
"""A number, which may be NaN or infinite."""
Whole = Annotated[
    int,
    BeforeValidator(lambda value: int(value) if type(value) is float and value.is_integer() else value),
    Strict(),
    Gt(-LARGEST_ID),
    Lt(LARGEST_ID),
]
"""A whole number of at most 64 bits; 7.0 is one."""
FileName = Annotated[Characters, AfterValidator(inside)]
"""A name in the pictures' folder."""


class Sized(BaseModel):
    """Size of a picture, px, where both sides are known."""

    width: Number | None = None
    height: Number | None = None

    @property
    def size_px(self) -> tuple[float, float] | None:
        """Width and height; None where one is missing or 0."""
        return (self.width, self.height) if self.width and self.height else None


@contextmanager
def faults_of(kind: str, file: Location) -> Iterator[None]:
    """What is wrong inside becomes one ``ValueError`` that begins with the kind and the file."""
    try:
        yield
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise ValueError(f"{kind} = {str(file)!r}: {why}") from None


def read_text(file: Location, largest: int = LARGEST_TEXT_BYTES, known: str | None = None) -> str:
    """The file as UTF-8, with or without a byte-order mark; line ends are ``\\n``. Raises ``OSError``, and
    ``ValueError``, also above ``largest`` bytes. known: an object's version, where it has been looked up."""
    return text_of(read_bytes(local_file(file, known=known), largest))


def as_json(content: str, what: str) -> Any:
    """``content`` as JSON. Raises ``ValueError`` that it is not ``what``."""
    try:
        return json_of(content)
    except ValueError as error:
        raise ValueError(f"not {what}: {error}") from None


def checked(form: type[Form], value: object, name: str = "") -> Form:
    """``value`` in that form. Raises ``ValueError`` of one line, the place first, beginning with ``name``.

    A text in a field's annotation is what a message says of the whole field: ``Annotated[..., "must be [x, y]"]``.
    """
    try:
        return form.model_validate(value)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
    place, value = fault["loc"], fault["input"]
    must = (
        fault["msg"]
        .replace("Input should", "must")
        .removeprefix("Value error, ")
        .partition(" or instance")[0]
    )
    field = form.model_fields[str(place[0])] if place else None
    own = [text for text in (field.metadata if field else ()) if isinstance(text, str)]
    if fault["type"] == "missing" and isinstance(place[-1], str):
        must, own = f"has no {place[-1]!r}", []
    must, place = (own or [must])[0], place[:-1] if fault["type"] == "missing" else place
    for part in place:
        name += f"[{part}]" if isinstance(part, int) else f": {part}"
    stated = f" = {shown(value)}" if must.startswith("must") else ""
    raise ValueError(f"{name}{stated}: {must}".lstrip(" :="))


def each(entries: object, name: str, form: type[Form]) -> Iterator[Form]:
    """Every object in a list in that form. Raises as :func:`checked` does."""
    if not isinstance(entries, list):
        raise ValueError(f"{name} = {shown(entries)}: must be a list")
    for place, entry in enumerate(entries):
        yield checked(form, entry, f"{name}[{place}]")


def each_line(content: str, read: Callable[[str], T]) -> Iterator[T]:
    """``read`` of every line that is not blank; its ``ValueError`` comes to name the line."""
    for place, line in enumerate(content.split("\n"), start=1):
        if line.strip():
            try:
                found = read(line)
            except ValueError as error:
                raise ValueError(f"line {place}: {error}") from None
            yield found


class Selection:
    """What of a labelled set is used: boxes of these ``labels`` (all, if there are none), pictures with them.

    keep_empty: pictures without any of the labels, too: what is found there is wrong.
    """

    def __init__(self, labels: Sequence[str], keep_empty: bool) -> None:
        self._labels = tuple(labels)
        self._keep_empty = keep_empty
        self._left_out: Counter[str] = Counter()

    def target(
        self,
        label: str,
        box_xyxy: tuple[float, float, float, float],
        size_px: tuple[float, float] | None = None,
        *,
        group: str | None = None,
        **beside: Any,
    ) -> list[Target]:
        """The box as a target, or nothing. size_px: (width, height) of the picture, where that is known.

        group: by default its size class. ``beside``: the target's other fields. Boxes partly outside the
        picture stay as they are.
        """
        if self._labels and label not in self._labels:
            return []
        x0, y0, x1, y1 = box_xyxy
        width, height = x1 - x0, y1 - y0
        if not math.isfinite(width * height):
            return self.leave_out("with numbers that are not finite")
        if width <= 0 or height <= 0:
            return self.leave_out("of no area")
        if size_px and (x1 <= 0 or y1 <= 0 or x0 >= size_px[0] or y0 >= size_px[1]):
            return self.leave_out("outside the picture")
        group = group or size_group(width, height, label if self._labels else "objects")
        return [Target(label, group, box_xyxy, **beside)]

    def leave_out(self, why: str) -> list[Target]:
        """Count a box that is left out, and be no target in its place."""
        self._left_out[why] += 1
        return []

    def picture_set(
        self,
        kind: str,
        file: Location,
        entries: Iterable[Entry],
        categories: Mapping[str, int],
        folder: Location | None,
        max_megapixels: float,
        notes: Sequence[str] = (),
    ) -> PictureSet:
        """The pictures that count, of a folder, by default the file's own; crowds alone are no reason to look at one.

        Raises ``ValueError`` for a label that is no category, or where no picture is left.
        """
        every = self._keep_empty or not self._labels
        taken = [entry for entry in entries if every or not all(target.crowd for target in entry[1] or ())]
        if unknown := [label for label in self._labels if label not in categories]:
            raise ValueError(f"target = {unknown}: not among the categories {sorted(categories)}")
        if not taken:
            raise ValueError(f"lists no pictures{f' with {list(self._labels)}' if self._labels else ''}")
        pictures = from_files(folder or file.parent, taken, max_megapixels)
        empty = ["pictures without them"] * (self._keep_empty and bool(self._labels))
        chosen = ", ".join([*sorted(self._labels), *empty])
        counted = (f"{n} {'box' if n == 1 else 'boxes'} {why} left out" for why, n in self._left_out.items())
        return PictureSet(kind, str(file), pictures, categories, (*counted, *notes), chosen)
