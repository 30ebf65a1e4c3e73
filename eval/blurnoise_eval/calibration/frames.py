"""Frames of a folder as levels: those of one gain, exposure and light; of a mosaic the green pixels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from copy import copy
from itertools import groupby
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import one_of
from blurnoise_eval.calibration.counts import Numbers, check_wrapped, scale_of, together
from blurnoise_eval.calibration.formats import Plane as Plane
from blurnoise_eval.calibration.formats import RawLayout, read_plane
from blurnoise_eval.calibration.formats import refuse as refuse
from blurnoise_eval.calibration.listing import BayerPattern, list_frames
from blurnoise_eval.calibration.listing import Frame as Frame
from blurnoise_eval.calibration.listing import Kind as Kind

Floats = NDArray[np.float64]
Size = tuple[int, int]
FEWEST_FLAT = 3
_UNLIKE = 0.05  # by which the places of a mosaic differ, of their mean
_SETTLED_C = 1.0  # over which dark current changes by some 10 %
_ALIKE = 0.02  # by which its two green ones do
_DOUBTFUL = 0.1  # by which they do not
_EVEN = 0.99  # of the pixels


class Folder:
    """Dark and flat levels of a folder: the frames of one gain, exposure and light, by rising gain and exposure.

    layout: of files without a header. cfa: the mosaic, "none" for a sensor without one; None takes it from the files,
    or from how the 2 x 2 places differ in light. Of a mosaic ``planes`` are the green pixels (the clear ones of RCCB
    and RCCC) of every other row: one colour plane, as EMVA 1288 measures them.

    Raises ``ValueError`` unless there are dark levels and three flat ones, of two frames each, and for frames of
    several sizes, depths or scales. scale: of the numbers in the files; planes are the converter's counts. size_px:
    (width, height) of whole frames. place: row and column of the plane in the mosaic, None where there is none.
    bit_depth: as the folder's list states it, or the scale; black_dn: as the files do. notes: what else to know;
    doubts: of the mosaic.
    """

    def __init__(self, folder: Path, layout: RawLayout | None = None, cfa: str | None = None) -> None:
        if cfa is not None:
            one_of("cfa", cfa, get_args(BayerPattern))
        self._layout = layout
        listing = list_frames(folder, layout)
        self.notes, self.bit_depth, self.black_dn = [*listing.notes], listing.bit_depth, listing.black_dn
        ordered = sorted(listing.frames, key=lambda frame: frame.level)
        every = [list(frames) for _, frames in groupby(ordered, lambda frame: frame.level)]
        levels = [frames for frames in every if len(frames) > 1]
        alone = [frames[0].file.name for frames in every if len(frames) == 1]
        if alone:
            self.notes.append(
                f"left out: {len(alone)} frames that are single at their exposure, such as {alone[0]}; two are needed"
            )
        self.dark = [frames for frames in levels if frames[0].kind == "dark"]
        self.flat = [frames for frames in levels if frames[0].kind == "flat"]
        left = "".join(f"; {note}" for note in listing.left_out)
        missing = "frames: dark frames are missing; take two or more at one exposure, with the lens covered"
        refuse(not self.dark, missing + left)
        few = f"frames: {len(self.flat)} flat exposures with two frames or more; must be 3 or more, better 8"
        refuse(len(self.flat) < FEWEST_FLAT, few + left)
        for gain_db in sorted({frames[0].gain_db for frames in levels} - {*self.gains_db}):
            self.notes.append(
                f"left out: the frames at {gain_db:g} dB; dark levels and {FEWEST_FLAT} flat levels are needed"
            )
        none = f"frames: no gain_db has dark levels and {FEWEST_FLAT} flat levels"
        refuse(not self.gains_db, none)
        celsius = [frame.temperature_c for frame in ordered if frame.temperature_c is not None] or [0.0]
        if max(celsius) - min(celsius) > _SETTLED_C:
            warmed = f"the temperature of the sensor varies from {min(celsius):g} to {max(celsius):g} °C"
            self.notes.append(f"{warmed}; the dark current is a mean over it")
        before = ""
        held: dict[float, list[Numbers]] = {}
        pictures: dict[int, Frame] = {}
        places: dict[Kind, list[Floats]] = {"dark": [], "flat": []}
        for frame in (frame for frames in levels for frame in frames):
            plane = read_plane(frame.file, layout, frame.page)
            held.setdefault(frame.gain_db, []).append(Numbers.by(str(frame.file), plane))
            _check_new(plane, frame, pictures)
            if frame.kind == "dark":
                check_wrapped(str(frame.file), plane)
            height, width = plane.shape
            here = f"{width} x {height} px, {8 * plane.itemsize} bits"
            before = before or here
            mixed = f"{frame.file}: frames differ in size or depth: {here}, but {before} before"
            refuse(here != before, mixed)
            means = [plane[row::2, column::2].mean() for row in (0, 1) for column in (0, 1)]
            places[frame.kind].append(np.array(means))
        self.size_px, self.scale = (width, height), together(map(scale_of, held.values()))
        self.bit_depth = self.bit_depth or self.scale.bits or None
        stated = {frame.cfa for frame in ordered} - {None}
        refuse(
            not cfa and len(stated) > 1,
            f"frames: have several colour filter arrays, {sorted(map(str, stated))}; set --cfa",
        )
        # of the frame that shows it best: neither dim nor clipped
        light = max(places["flat"], key=np.ptp) - np.mean(places["dark"])
        self.doubts: list[str] = []
        self.cfa: str | None = cfa or next(iter(stated), None) or _noticed(light)
        self.place: tuple[int, int] | None = None
        if self.cfa not in (None, "none"):
            self._take_apart(str(self.cfa), light, "" if cfa or stated else "detected: ")

    def _take_apart(self, cfa: str, light: Floats, how: str) -> None:
        """light (4,): mean signal of the four places."""
        used = cfa.index("G" if "G" in cfa else "C")
        self.place = divmod(used, 2)
        others = ", ".join(
            f"{letter} {light[place] / light[used]:.2f}" for place, letter in enumerate(cfa) if place != used
        )
        name = {"G": "green", "C": "clear"}[cfa[used]]
        where = f"those in row {self.place[0] + 1}, column {self.place[1] + 1} of each 2 x 2"
        figures = f"{how}colour filters {cfa}: values are for the {name} pixels, {where}"
        self.notes.append(f"{figures}; relative signal of the others: {others}")
        pair = [place for place, letter in enumerate(cfa) if letter == cfa[used]]
        if len(pair) > 2 or _apart(light[pair]) < _DOUBTFUL:
            return
        rest = [place for place in range(4) if place not in pair]
        turned = {"".join(row[::-1] for row in (cfa[:2], cfa[2:])), cfa[2:] + cfa[:2]}
        likely = f"; {' or '.join(sorted(turned))} is likely" if _apart(light[rest]) < _ALIKE else ""
        differ = f"the two {name} ones of {cfa} differ by {_apart(light[pair]):.0%}"
        self.doubts.append(
            f"colour filters: {differ}, the other two by {_apart(light[rest]):.0%}{likely}; set --cfa"
        )

    @property
    def gains_db(self) -> list[float]:
        """Gains with dark levels and ``FEWEST_FLAT`` flat ones, rising."""
        flat = Counter(frames[0].gain_db for frames in self.flat)
        dark = {frames[0].gain_db for frames in self.dark}
        return sorted(gain for gain, count in flat.items() if gain in dark and count >= FEWEST_FLAT)

    def at_gain(self, gain_db: float) -> Folder:
        """The levels of one gain."""
        one = copy(self)
        one.dark, one.flat = (
            [frames for frames in levels if frames[0].gain_db == gain_db] for levels in (self.dark, self.flat)
        )
        return one

    def whole(self) -> Folder:
        """The same, whose planes are whole frames also of a mosaic."""
        one = copy(self)
        one.place = None
        return one

    def planes(self, frames: Sequence[Frame]) -> Iterator[Plane]:
        """The frames' numbers in steps of the converter, one after the other."""
        for frame in frames:
            plane = self.scale.counts(read_plane(frame.file, self._layout, frame.page))
            yield plane if self.place is None else plane[self.place[0] :: 2, self.place[1] :: 2]


def _check_new(plane: Plane, frame: Frame, before: dict[int, Frame]) -> None:
    """Raise ``ValueError`` where the picture is one of those before, by hash, to which it is added.

    Frames that clip, or without noise, may be the same: nearly all of their pixels hold one number.
    """
    first = before.setdefault(hash(plane.tobytes()), frame)
    if first is frame or np.bincount(plane.ravel()).max() > _EVEN * plane.size:
        return
    same = f"page {frame.page}: is the same picture as {first.file.name}, page {first.page}"
    raise ValueError(f"{frame.file}: {same}; each frame must be a new exposure")


def _apart(light: Floats) -> float:
    """Of two signals, of their mean."""
    return float(np.ptp(light) / light.mean())


def _noticed(light: Floats) -> str | None:
    """The mosaic by the signal of its places (4,): two on a diagonal, alike, are green; X: red or blue."""
    if np.ptp(light) < _UNLIKE * light.mean():
        return None
    diagonals = {"GXXG": light[[0, 3]], "XGGX": light[[1, 2]]}
    alike = {cfa: pair for cfa, pair in diagonals.items() if np.ptp(pair) < _ALIKE * pair.mean()}
    return max(alike, key=lambda cfa: float(alike[cfa].mean()), default=None)
