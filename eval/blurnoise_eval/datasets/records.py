"""Records that every set of pictures is made of, wherever it comes from. Boxes are (x0, y0, x1, y1) px."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.scene.cutting import Cut

Coded = NDArray[np.uint8] | NDArray[np.uint16]
"""Values of a tone curve."""
Image = Coded | NDArray[np.float32]
"""Coded values, or linear light, of which 1 is white."""
DOUBTFUL_LABELS = "doubtful labels: "
"""What a note of a set begins with where its labels may mean something else than is read."""


class UnreadablePicture(ValueError):
    """A picture cannot be read; the message says why."""


@dataclass(frozen=True, slots=True)
class Target:
    """An object that the model should find: class name, curve it counts for, box (x0, y0, x1, y1) px.

    area_px2: of the object, as COCO counts it; None: of the box. crowd: several objects under one box, which
    are neither missed nor wrong, as COCO's crowds. text: what is to be read there. annotation: what else the
    file says of it, for those who write it again.

    >>> Target("car", "car, large (> 96 px)", (10.0, 20.0, 210.0, 140.0)).crowd
    False
    """

    label: str
    group: str
    box_xyxy: tuple[float, float, float, float]
    area_px2: float | None = None
    crowd: bool = False
    text: str | None = None
    annotation: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture by name. ``targets`` None: whatever the detector finds in the clean picture.

    ``load`` returns (H, W, 3) RGB, 8 or 16 bit, sRGB-coded, or linear light, and raises :class:`UnreadablePicture`.
    ``identity`` changes when the picture does, and may change without (a file's size and times): where it has
    changed, a resumed run looks at the picture's content.
    ``image_id`` is COCO's, else the place in the set, from 1 on.
    ``cut`` returns, where that is known, the targets' own light in their order and what is truly behind them.

    >>> from blurnoise_eval import datasets
    >>> picture = datasets.rendered_signs((50,), count=1).pictures[0]
    >>> picture.load().dtype, picture.targets[0].label
    (dtype('uint8'), 'stop sign')
    """

    name: str
    targets: tuple[Target, ...] | None
    load: Callable[[], Image]
    identity: str
    image_id: int = 0
    cut: Callable[[], Cut] | None = None


@dataclass(frozen=True)
class Part:
    """The ``number``th of ``count`` parts of a set of pictures, from 1 on: the same on every machine.

    >>> quarters = [Part.parse(f"{number}/4") for number in (1, 2, 3, 4)]
    >>> sum(part.has("drive_0012.png") for part in quarters)  # every picture is in one of them
    1
    """

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Part:
        """Of "1/4". Raises ``ValueError`` for anything else."""
        match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
        if not match or not 1 <= int(match[1]) <= int(match[2]):
            raise ValueError(f"part = {text!r}: must be K/N with 1 <= K <= N, such as 1/4")
        return cls(int(match[1]), int(match[2]))

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def has(self, picture: str) -> bool:
        """Whether a picture of this name belongs to it, by the name's hash."""
        # By the name and not by the order in a list, which may differ between machines.
        digest = hashlib.blake2b(picture.encode("utf-8", "surrogatepass"), digest_size=8).digest()
        return int.from_bytes(digest, "little") % self.count == self.number - 1


@dataclass(frozen=True)
class PictureSet:
    """Pictures of one kind ("rendered", "folder", or a label format's) and where they come from.

    categories: ids of the labels, COCO's own, or by default from 1 on as they occur. notes: what was left out or
    assumed, how much of it, and what is doubtful. chosen: which targets count, in words; "" for all. folder: of its
    files. whole: the set that these pictures are a part of, of_part: which one, see :meth:`part`. Raises
    ``ValueError`` for a name that occurs twice: results are told apart by it.

    >>> from blurnoise_eval import datasets
    >>> pictures = datasets.rendered_signs((50,), count=8)
    >>> len(pictures), dict(pictures.categories), pictures.part("1/2").every is pictures
    (8, {'stop sign': 1}, True)
    """

    kind: str
    source: str
    pictures: tuple[Picture, ...]
    categories: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    chosen: str = ""
    folder: Path | None = None
    whole: PictureSet | None = None
    of_part: Part | None = None

    def __post_init__(self) -> None:
        names: set[str] = set()
        for picture in self.pictures:
            if picture.name in names:
                raise ValueError(f"pictures: {picture.name!r} is listed twice; names must be unique")
            names.add(picture.name)
        if not self.categories:
            labels = dict.fromkeys(t.label for picture in self.pictures for t in picture.targets or ())
            object.__setattr__(self, "categories", {label: n for n, label in enumerate(labels, start=1)})

    def part(self, text: str) -> PictureSet:
        """A part of the set: "1/4" is the first quarter, by the names of pictures, the same on every machine.

        Raises ``ValueError`` for another text, and for a part without pictures.
        """
        part = Part.parse(text)
        pictures = tuple(picture for picture in self.pictures if part.has(picture.name))
        if not pictures:
            raise ValueError(f"part = {text!r}: none of the {len(self)} pictures are in it")
        return replace(self, pictures=pictures, whole=self, of_part=part)

    @property
    def every(self) -> PictureSet:
        """The whole set: of a part the one that it is of."""
        return self.whole or self

    @property
    def labelled(self) -> bool:
        """Whether any of them says what is in it."""
        return any(picture.targets is not None for picture in self.pictures)

    @property
    def doubtful(self) -> bool:
        """Whether a note says that the labels may mean something else."""
        return any(note.startswith(DOUBTFUL_LABELS) for note in self.notes)

    def __len__(self) -> int:
        return len(self.pictures)

    def __iter__(self) -> Iterator[Picture]:
        return iter(self.pictures)


def size_group(width: float, height: float, label: str) -> str:
    """COCO's size classes: small below 32^2 px of box area, large from 96^2 px on.

    >>> size_group(40, 30, "car")
    'car, medium (32-96 px)'
    """
    area = width * height
    if area < 32**2:
        return f"{label}, small (< 32 px)"
    return f"{label}, medium (32-96 px)" if area < 96**2 else f"{label}, large (> 96 px)"
