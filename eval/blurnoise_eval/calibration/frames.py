"""The frames of a folder as levels: frames of one gain, exposure and light; of a mosaic, the green pixels."""

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
from blurnoise_eval.calibration.counts import FrameNumbers, check_wrapped, common_scale, scale_of
from blurnoise_eval.calibration.formats import Plane as Plane
from blurnoise_eval.calibration.formats import RawLayout, read_plane
from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.labels import FrameSeen, contradicted
from blurnoise_eval.calibration.listing import BayerPattern, FrameFile, Kind, list_frames

Floats = NDArray[np.float64]
Size = tuple[int, int]
FEWEST_FLAT = 3
_UNLIKE = 0.05  # relative difference of the sites of a mosaic
_ALIKE = 0.02  # relative difference of its green sites
_DOUBTFUL = 0.1  # relative difference of green sites that makes the pattern doubtful
_SETTLED_C = 1.0  # change of temperature that changes dark current by some 10 %
_EVEN = 0.99  # share of the pixels with one number, above which two frames may be equal by chance


class Folder:
    """Dark and flat levels of a folder: frames of one gain, exposure and light, by rising gain and exposure.

    layout: of files without a header. cfa: the mosaic, "none" for a sensor without one; by default from the files, or
    from the light of the four sites. ``planes`` of a mosaic are its green pixels (the clear ones of RCCB and RCCC) of
    every other row: one colour plane, as EMVA 1288 measures it.

    Raises ``ValueError`` unless there are dark levels and three flat ones, with two frames each, and for frames of
    different sizes, depths or scales. scale: of the numbers in the files; planes have the counts of the converter.
    Left out are levels called leave_out, and flat ones whose labels the others contradict.
    size_px: (width, height) of whole frames. site: row and column of the plane in the mosaic, None without one.
    bit_depth: by the list of frames or the scale; black_dn: by the files. notes: assumptions; doubts: of the mosaic.
    """

    def __init__(
        self,
        folder: Path,
        layout: RawLayout | None = None,
        cfa: str | None = None,
        leave_out: Sequence[str] = (),
    ) -> None:
        if cfa is not None:
            one_of("cfa", cfa, get_args(BayerPattern))
        self._layout = layout
        listing = list_frames(folder, layout)
        self.notes, self.black_dn = [*listing.notes], listing.black_dn
        frames = _without(sorted(listing.frames, key=lambda frame: frame.level), leave_out)
        levels = self._group(frames, "".join(f"; {note}" for note in listing.left_out))
        light = self._read(levels)
        self._check_labels()
        self.bit_depth = listing.bit_depth or self.scale.bits or None
        by_files = {frame.cfa for frame in frames} - {None}
        several = f"frames: have several colour filter arrays, {sorted(map(str, by_files))}; set --cfa"
        refuse(not cfa and len(by_files) > 1, several)
        self.doubts: list[str] = []
        found = _detected(light)
        self.cfa: str | None = cfa or next(iter(by_files), None) or found
        self.site: tuple[int, int] | None = None
        if self.cfa not in (None, "none"):
            self._use_site(str(self.cfa), light, "" if cfa or by_files else "detected: ")
        elif self.cfa and found:
            unlike = f"the four pixels of each 2 x 2 differ by {_difference(light):.0%} in light, as those of {found}"
            self.doubts.append(f"colour filters: none by --cfa or the files, but {unlike}; set --cfa")

    def _group(self, frames: Sequence[FrameFile], left_out: str) -> list[list[FrameFile]]:
        """Group the frames in levels. Raises ``ValueError`` for too few; left_out: the end of its text."""
        every = [list(level) for _, level in groupby(frames, lambda frame: frame.level)]
        levels = [level for level in every if len(level) > 1]
        if single := [level[0].file.name for level in every if len(level) == 1]:
            two = f"single at their exposure, such as {single[0]}; two are needed"
            self.notes.append(f"left out: {len(single)} frames that are {two}")
        self.dark = [level for level in levels if level[0].kind == "dark"]
        self.flat = [level for level in levels if level[0].kind == "flat"]
        missing = "frames: dark frames are missing; take two or more at one exposure, with the lens covered"
        refuse(not self.dark, missing + left_out)
        few = f"frames: {len(self.flat)} flat exposures with two frames or more; must be 3 or more, better 8"
        refuse(len(self.flat) < FEWEST_FLAT, few + left_out)
        needed = f"dark levels and {FEWEST_FLAT} flat levels"
        for gain_db in sorted({level[0].gain_db for level in levels} - {*self.gains_db}):
            self.notes.append(f"left out: the frames at {gain_db:g} dB; {needed} are needed")
        refuse(not self.gains_db, f"frames: no gain_db has {needed}")
        celsius = [frame.temperature_c for frame in frames if frame.temperature_c is not None] or [0.0]
        if max(celsius) - min(celsius) > _SETTLED_C:
            varies = f"the temperature of the sensor varies from {min(celsius):g} to {max(celsius):g} °C"
            self.notes.append(f"{varies}; the dark current is a mean over it")
        return levels

    def _read(self, levels: Sequence[Sequence[FrameFile]]) -> Floats:
        """Read all frames once: check them, set scale and size, and return the light of the four sites (4,)."""
        first_size = ""
        numbers: dict[float, list[FrameNumbers]] = {}
        pictures: dict[int, FrameFile] = {}
        self._seen: dict[FrameFile, FrameSeen] = {}
        sites: dict[Kind, list[Floats]] = {"dark": [], "flat": []}
        for frame in (frame for level in levels for frame in level):
            plane = read_plane(frame.file, self._layout, frame.page)
            numbers.setdefault(frame.gain_db, []).append(FrameNumbers.of(str(frame.file), plane))
            self._seen[frame] = FrameSeen.of(plane)
            _check_new(plane, frame, pictures)
            if frame.kind == "dark":
                check_wrapped(str(frame.file), plane)
            height, width = plane.shape
            size = f"{width} x {height} px, {8 * plane.itemsize} bits"
            first_size = first_size or size
            mixed = f"{frame.file}: frames differ in size or depth: {size}, but {first_size} before"
            refuse(size != first_size, mixed)
            means = [plane[row::2, column::2].mean() for row in (0, 1) for column in (0, 1)]
            sites[frame.kind].append(np.array(means))
        self.size_px, self.scale = (
            (width, height),
            common_scale({gain_db: scale_of(frames) for gain_db, frames in numbers.items()}),
        )
        # the flat frame with the largest differences is neither dim nor clipped
        return np.asarray(max(sites["flat"], key=np.ptp) - np.mean(sites["dark"]))

    def _check_labels(self) -> None:
        """Leave out flat levels whose labels the others of their gain contradict, with a note on each."""
        wrong = []
        for gain_db in self.gains_db:
            files = self.at_gain(gain_db)
            for index, note in contradicted(files.dark, files.flat, self._seen).items():
                wrong.append(files.flat[index])
                self.notes.append(note)
        self.flat = [level for level in self.flat if level not in wrong]

    def _use_site(self, cfa: str, light: Floats, how: str) -> None:
        """Measure the green pixels of one row of the mosaic. light (4,): mean signal of the four sites."""
        used = cfa.index("G" if "G" in cfa else "C")
        self.site = divmod(used, 2)
        others = ", ".join(
            f"{letter} {light[site] / light[used]:.2f}" for site, letter in enumerate(cfa) if site != used
        )
        name = {"G": "green", "C": "clear"}[cfa[used]]
        where = f"those in row {self.site[0] + 1}, column {self.site[1] + 1} of each 2 x 2"
        figures = f"{how}colour filters {cfa}: values are for the {name} pixels, {where}"
        self.notes.append(f"{figures}; relative signal of the others: {others}")
        pair = [site for site, letter in enumerate(cfa) if letter == cfa[used]]
        if _difference(light) < _ALIKE:
            alike = f"the four pixels of each 2 x 2 get the same light, within {_ALIKE:.0%}"
            self.doubts.append(f"colour filters: {cfa} by --cfa or the files, but {alike}; set --cfa none")
        if _difference(light[pair]) < _DOUBTFUL:
            return
        if len(pair) > 2:
            of_pair = f"the three {name} ones of {cfa} differ by {_difference(light[pair]):.0%}"
            self.doubts.append(f"colour filters: {of_pair}; set --cfa")
            return
        rest = [site for site in range(4) if site not in pair]
        mirrored = {"".join(row[::-1] for row in (cfa[:2], cfa[2:])), cfa[2:] + cfa[:2]}
        likely = f"; {' or '.join(sorted(mirrored))} is likely" if _difference(light[rest]) < _ALIKE else ""
        differ = f"the two {name} ones of {cfa} differ by {_difference(light[pair]):.0%}"
        of_rest = f"the other two by {_difference(light[rest]):.0%}"
        self.doubts.append(f"colour filters: {differ}, {of_rest}{likely}; set --cfa")

    @property
    def gains_db(self) -> list[float]:
        """Gains with dark levels and ``FEWEST_FLAT`` flat ones, in rising order."""
        flat = Counter(frames[0].gain_db for frames in self.flat)
        dark = {frames[0].gain_db for frames in self.dark}
        return sorted(gain for gain, count in flat.items() if gain in dark and count >= FEWEST_FLAT)

    def at_gain(self, gain_db: float) -> Folder:
        """The folder with the levels of one gain only."""
        one = copy(self)
        one.dark, one.flat = (
            [frames for frames in levels if frames[0].gain_db == gain_db] for levels in (self.dark, self.flat)
        )
        return one

    def whole(self) -> Folder:
        """The folder with planes that are whole frames, also of a mosaic."""
        one = copy(self)
        one.site = None
        return one

    def planes(self, frames: Sequence[FrameFile]) -> Iterator[Plane]:
        """Read the frames in steps of the converter, one after the other."""
        for frame in frames:
            plane = self.scale.counts(read_plane(frame.file, self._layout, frame.page))
            yield plane if self.site is None else plane[self.site[0] :: 2, self.site[1] :: 2]


def _without(frames: Sequence[FrameFile], leave_out: Sequence[str]) -> list[FrameFile]:
    """The frames without levels of these names, or of names that begin so: "flat 10 ms" for "flat 10 ms, 500 lx".

    Raises ``ValueError`` for a name that no level has.
    """
    for name in leave_out:
        left = [
            frame
            for frame in frames
            if frame.level_name != name and not frame.level_name.startswith(f"{name},")
        ]
        names = ", ".join(sorted({frame.level_name for frame in frames})[:3])
        refuse(len(left) == len(frames), f"leave_out = {name!r}: must name a level, such as {names}")
        frames = left
    return [*frames]


def _check_new(plane: Plane, frame: FrameFile, before: dict[int, FrameFile]) -> None:
    """Raise ``ValueError`` if the picture is equal to one of those before, by hash; else add it to them.

    Frames that clip, or without noise, may be equal: nearly all of their pixels have one number.
    """
    first = before.setdefault(hash(plane.tobytes()), frame)
    if first is frame or np.bincount(plane.ravel()).max() > _EVEN * plane.size:
        return
    same = f"page {frame.page}: is the same picture as {first.file.name}, page {first.page}"
    raise ValueError(f"{frame.file}: {same}; each frame must be a new exposure")


def _difference(light: Floats) -> float:
    """Relative difference of two signals."""
    return float(np.ptp(light) / light.mean())


def _detected(light: Floats) -> str | None:
    """The mosaic by the signal of its sites (4,): two on a diagonal, alike, are green; X: red or blue."""
    if np.ptp(light) < _UNLIKE * light.mean():
        return None
    diagonals = {"GXXG": light[[0, 3]], "XGGX": light[[1, 2]]}
    alike = {cfa: pair for cfa, pair in diagonals.items() if np.ptp(pair) < _ALIKE * pair.mean()}
    return max(alike, key=lambda cfa: float(alike[cfa].mean()), default=None)
