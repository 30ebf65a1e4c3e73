"""The part of a labelled set that is used, in whatever format its labels are."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from blurnoise_eval.datasets.folder import Listed, from_files, picture_doubts
from blurnoise_eval.datasets.images import sizes_px
from blurnoise_eval.datasets.label_doubts import area_doubts, box_doubts, set_doubts
from blurnoise_eval.datasets.places import Places, found_in
from blurnoise_eval.datasets.records import DOUBTFUL_LABELS, PictureSet, Target, size_group
from blurnoise_eval.datasets.segmentation import LARGEST_PX
from blurnoise_eval.system.urls import Location, location

_LOOKED_AT = 32  # pictures whose sizes are read where the labels do not say them


class Selection:
    """The part of a labelled set that is used: boxes of these ``labels`` (all, if empty), and pictures with them.

    Every reader goes the same way: :meth:`names` finds the pictures, :meth:`target` makes a target of each box or
    counts why not, :meth:`picture_set` checks the whole. What was assumed or left out is a note of the set.

    images: folder of the pictures, by default that of the file, or one beside it that holds them. keep_empty: also
    use pictures without any of the labels; all detections in them are false positives. layout: what the four numbers
    of a box are in the file.
    """

    def __init__(
        self,
        kind: str,
        file: str | Location,
        images: str | Location | None = None,
        labels: Sequence[str] = (),
        keep_empty: bool = True,
        layout: str = "corners x0, y0, x1, y1",
    ) -> None:
        self.kind, self.file, self._layout = kind, location(file), layout
        self._chosen_folder = bool(images)
        self.folder = location(images) if images else self.file.parent
        self.notes: list[str] = []
        self._labels, self._keep_empty = tuple(labels), keep_empty
        self._seen: set[str] = set()
        self._left_out: Counter[str] = Counter()
        # Numbers of all boxes, which are checked together: as objects, those of the largest sets fill the memory.
        self._boxes, self._areas = array("d"), array("d")
        self._sizes: dict[str, tuple[int, int]] = {}

    def names(self, written: Sequence[str], *, sized: bool = False) -> list[str]:
        """Names in the folder of the pictures, from the paths in the labels, as :class:`Places`.

        sized: the labels say the pictures' sizes; else those of some are read, which boxes are checked by.
        """
        places = Places(self.folder)
        names = places.names(written)
        self.notes += places.notes
        folder, start = found_in(names, self.folder)
        if start:
            names = [name.removeprefix(start) for name in names]
            self.notes.append(f"paths are read without their start {start!r}")
        if folder != self.folder and not self._chosen_folder:
            self.folder = folder
            self.notes.append(f"pictures are in {str(folder)!r}")
        if not sized:
            self.look_at(names)
        return names

    def look_at(self, names: Sequence[str]) -> None:
        """Read the sizes of some pictures, which boxes are checked by."""
        if not names:
            return
        # Evenly spread, as files next to each other are often of one camera.
        some = np.linspace(0, len(names) - 1, min(_LOOKED_AT, len(names))).round().astype(int)
        self._sizes = sizes_px(self.folder, [names[index] for index in np.unique(some)])

    def note(self, text: str, count: int) -> None:
        """Note how often something occurs, if it does."""
        if count:
            self.notes.append(f"{text}: {count}")

    def target(
        self,
        label: str,
        box_xyxy: tuple[float, float, float, float],
        size_px: tuple[float, float] | None = None,
        *,
        picture: str = "",
        group: str | None = None,
        **others: Any,
    ) -> list[Target]:
        """The box as a target, or nothing. size_px: (width, height) of the picture, where that is known.

        picture: its name. group: by default its size class. ``others``: the target's other fields. Boxes partly
        outside the picture stay as they are.
        """
        self._seen.add(label)
        if self._labels and label not in self._labels:
            return []
        self._boxes.extend((*box_xyxy, *(size_px or self._sizes.get(picture) or (math.nan, math.nan))))
        self._areas.append(math.nan if (area := others.get("area_px2")) is None else area)
        x0, y0, x1, y1 = box_xyxy
        width, height = x1 - x0, y1 - y0
        if not all(abs(number) <= LARGEST_PX for number in (x0, y0, width, height)):  # NaN is not, either
            return self.leave_out("with coordinates that are not finite or beyond 1e6 px")
        if width <= 0 or height <= 0:
            return self.leave_out("without area")
        if size_px and (x1 <= 0 or y1 <= 0 or x0 >= size_px[0] or y0 >= size_px[1]):
            return self.leave_out("outside the picture")
        # Without chosen labels a set has too many classes for a curve of each: all count in three sizes.
        group = group or size_group(width, height, label if self._labels else "objects")
        return [Target(label, group, box_xyxy, **others)]

    def leave_out(self, why: str, label: str | None = None) -> list[Target]:
        """Count a box that is left out. Returns no target."""
        if label is not None:
            self._seen.add(label)
        self._left_out[why] += 1
        return []

    def picture_set(
        self,
        entries: Iterable[Listed],
        categories: Mapping[str, int] | None = None,
        unlabelled: int = 0,
    ) -> PictureSet:
        """The pictures that are used; a picture with crowds only is not.

        categories: ids by label, by default from 1 on in alphabetical order. unlabelled: pictures without a target
        that are noted already.

        Raises ``ValueError`` for a label that is not a category, if no picture is left, and for boxes that cannot be
        in px.
        """
        if categories is None:
            categories = {label: number for number, label in enumerate(sorted(self._seen), start=1)}
        all_pictures = self._keep_empty or not self._labels
        used = [
            entry
            for entry in entries
            if all_pictures or not all(target.crowd for target in entry.targets or ())
        ]
        if unknown := [label for label in self._labels if label not in categories]:
            raise ValueError(f"target = {unknown}: must be among the categories {sorted(categories)}")
        if not used:
            raise ValueError(f"contains no pictures{f' with {list(self._labels)}' if self._labels else ''}")
        boxes = np.frombuffer(self._boxes).reshape(-1, 6)
        doubts = box_doubts(boxes, self._layout)
        doubts += area_doubts(boxes, np.frombuffer(self._areas), self._layout)
        doubts += set_doubts(used, len(used) if self._labels else unlabelled)
        pictures = from_files(self.folder, used)
        empty = ["pictures without targets"] * (self._keep_empty and bool(self._labels))
        chosen = ", ".join([*sorted(self._labels), *empty])
        counted = (f"{n} {'box' if n == 1 else 'boxes'} {why} left out" for why, n in self._left_out.items())
        doubtful = (f"{DOUBTFUL_LABELS}{doubt}" for doubt in doubts)
        of_pictures = picture_doubts(self.folder, [entry.name for entry in used])
        every_note = (*counted, *self.notes, *doubtful, *of_pictures)
        return PictureSet(self.kind, str(self.file), pictures, categories, every_note, chosen, self.folder)
