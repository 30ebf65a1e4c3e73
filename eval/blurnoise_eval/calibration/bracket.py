"""Brackets: pictures of one scene that a camera on a tripod took at several exposures, and whether it moved.

Domain: pictures of 8 bits, (H, W, 3). Exposures are relative: seconds times ISO / 100 over the squared f-number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.listing import table_reader, with_points
from blurnoise_eval.datasets import eight_bit, read_picture
from blurnoise_eval.datasets.exif import exif_exposure
from blurnoise_eval.system.files import inside

Bytes = NDArray[np.uint8]
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
MOST_PX = 2048
"""Longest side; larger pictures are reduced to it."""
LIST = "frames.csv"
_ALIGNED_PX = 1024  # longest side at which displacements are measured
_SMALLEST = 64  # px, of a side
_SURE, _SURE_OF_CORNER = 0.3, 0.4  # response of the phase correlation, of which 1 is a copy
_STRUCTURE = 3.0  # values, deviation below which a picture shows nothing to compare
_AT_REST_PX = 0.75  # what phase correlation finds in two pictures of a tripod, at twice its size
_MOST_MOVED = 0.02  # of the longest side, up to which pictures are aligned
_CORNERS_PX = 2.0  # by which corners of pictures at rest may seem to move


@dataclass(frozen=True)
class Shot:
    """A picture of a bracket: its file, exposure time (s), ISO and f-number, and the scene's speed, px/s (x, y).

    >>> Shot(Path("a.jpg"), exposure_s=0.01, iso=200.0, f_number=2.0).exposure
    0.005
    """

    file: Path
    exposure_s: float
    iso: float = 100.0
    f_number: float = 1.0
    speed_px_s: tuple[float, float] = (0.0, 0.0)

    @property
    def name(self) -> str:
        """The name of the file."""
        return self.file.name

    @property
    def exposure(self) -> float:
        """Exposure relative to 1 s, ISO 100 and f/1."""
        return self.exposure_s * self.iso / 100 / self.f_number**2

    @property
    def moving(self) -> bool:
        """Whether the scene moves."""
        return any(self.speed_px_s)

    @property
    def stops(self) -> float:
        """Exposure in EV."""
        return math.log2(self.exposure)


class Bracket(NamedTuple):
    """Shots by rising exposure, their aligned pictures, and notes: what was reduced, cropped or is doubtful."""

    shots: tuple[Shot, ...]
    pictures: tuple[Bytes, ...]
    notes: tuple[str, ...]


def read_bracket(folder: Path) -> Bracket:
    """The pictures of a folder, aligned to a pixel. Raises ``ValueError`` for missing exposures, pictures of several
    sizes, and a camera that moved by more than 2 % of the picture or turned; ``OSError`` as reading does."""
    shots = sorted(listed(folder), key=lambda shot: shot.exposure)
    pictures, notes = [eight_bit(read_picture(shot.file)) for shot in shots], list[str]()
    sizes = [picture.shape[1::-1] for picture in pictures]
    usual = max(set(sizes), key=sizes.count)
    for shot, size in zip(shots, sizes, strict=True):
        turned = " (turned by EXIF?)" if size == usual[::-1] else ""
        others = f"the others have {usual[0]} x {usual[1]}"
        refuse(
            size != usual, f"{shot.file}: {size[0]} x {size[1]} px{turned}, but {others}; must be one size"
        )
    refuse(
        min(usual) < _SMALLEST,
        f"{folder}: pictures of {usual[0]} x {usual[1]} px; must be {_SMALLEST} or more",
    )
    if (longest := max(usual)) > MOST_PX:
        size = round(usual[0] * MOST_PX / longest), round(usual[1] * MOST_PX / longest)
        pictures = [cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in pictures]
        notes.append(f"pictures of {usual[0]} x {usual[1]} px were reduced to {size[0]} x {size[1]}")
    still = [place for place, shot in enumerate(shots) if not shot.moving]
    aligned, moved = align([pictures[place] for place in still], [shots[place].name for place in still])
    rows, columns = aligned[0].shape[:2] if aligned else pictures[0].shape[:2]
    refuse(moved and len(still) < len(shots), f"{folder}: the camera moved between the pictures at rest")
    for place, picture in zip(still, aligned, strict=True):
        pictures[place] = picture
    if moved:
        notes.append(
            f"the camera moved: {'; '.join(moved)}; pictures are cropped to {columns} x {rows} px in common"
        )
    return Bracket(tuple(shots), tuple(pictures), tuple(notes))


def listed(folder: Path) -> list[Shot]:
    """Pictures and exposures from frames.csv, else EXIF. Raises ``ValueError`` for one without an exposure time, or
    without the ISO or f-number that others state.

    Columns of frames.csv: file, exposure_s; optionally iso, f_number, speed_px_s and direction_deg (0 to the right,
    90 down).
    """
    refuse(not folder.is_dir(), f"{folder}: must be a folder with the pictures of a bracket")
    if (folder / LIST).is_file():
        shots = _of_table(folder)
    else:
        files = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in SUFFIXES]
        shots = [_of_exif(path) for path in files]
    refuse(not shots, f"{folder}: contains no pictures ({' '.join(SUFFIXES)})")
    where = f"add it to EXIF or to {LIST} (file, exposure_s, iso, f_number)"
    for shot in shots:
        named = sum(shot.file == other.file for other in shots)
        refuse(named > 1, f"{folder / LIST}: {shot.name} is listed {named} times")
        refuse(math.isnan(shot.exposure_s), f"{shot.file}: the exposure time is missing; {where}")
        for name in ("exposure_s", "iso", "f_number"):
            value = getattr(shot, name)
            allowed = math.isnan(value) or 0 < value < math.inf
            refuse(not allowed, f"{shot.file}: {name} = {value:g}: must be > 0")
    # Of one camera and lens, what no picture states is the same in all; what only some state is not known of others.
    for name, title in (("iso", "ISO"), ("f_number", "f-number")):
        lacking = [str(shot.file) for shot in shots if math.isnan(getattr(shot, name))]
        if 0 < len(lacking) < len(shots):
            raise ValueError(f"{lacking[0]}: the {title} is missing, and others state it; {where}")
    return [
        replace(shot, iso=_or_usual(shot.iso, 100.0), f_number=_or_usual(shot.f_number, 1.0))
        for shot in shots
    ]


def _or_usual(value: float, usual: float) -> float:
    return usual if math.isnan(value) else value


_NUMBERS = {
    "exposure_s": math.nan,
    "iso": math.nan,
    "f_number": math.nan,
    "speed_px_s": 0.0,
    "direction_deg": 0.0,
}
"""Columns of frames.csv beside the file, and what an empty cell means."""


def _of_table(folder: Path) -> list[Shot]:
    reader, path = table_reader(folder / LIST), folder / LIST
    names = [name.strip().lower() for name in next(reader, [])]
    rows = [dict(zip(names, with_points(cells, reader), strict=False)) for cells in reader if any(cells)]
    refuse(not {"file", "exposure_s"} <= {*names}, f"{path}: must have the columns file and exposure_s")
    shots = []
    for row in rows:
        file = row.get("file", "").strip()
        refuse(not file, f"{path}: a row ({', '.join(row.values())}) has no file")
        numbers = {}
        for name, usual in _NUMBERS.items():
            try:
                numbers[name] = float(Fraction(text)) if (text := (row.get(name) or "").strip()) else usual
            except (ValueError, ZeroDivisionError, OverflowError):
                raise ValueError(
                    f"{path}: {name} = {text!r} of {file}: must be a number, such as 0.02 or 1/50"
                ) from None
        speed, turn = numbers.pop("speed_px_s"), math.radians(numbers.pop("direction_deg"))
        refuse(not abs(speed) < 1e7, f"{path}: speed_px_s = {speed:g} of {file}: must be below 1e7")
        velocity = speed * math.cos(turn) + 0.0, speed * math.sin(turn) + 0.0
        shots.append(Shot(folder / inside(file), speed_px_s=velocity, **numbers))
    return shots


def _of_exif(path: Path) -> Shot:
    exposure_s, iso, f_number, _ = exif_exposure(path)
    return Shot(path, exposure_s, iso, f_number)


def align(pictures: Sequence[Bytes], names: Sequence[str]) -> tuple[list[Bytes], list[str]]:
    """Pictures by rising exposure, cropped to what all show, and which of them moved, in px to the one before.

    Raises ``ValueError`` where one moved by more than 2 % of the longest side, or turned.

    >>> random = np.random.default_rng(0)
    >>> scene = cv2.blur(random.integers(0, 255, (200, 240, 3), np.uint8), (5, 5))
    >>> cut, moved = align([scene[4:-4, 4:-4], scene[2:-6, 4:-4]], ["a.png", "b.png"])
    >>> cut[0].shape, bool((cut[0] == cut[1]).all()), moved
    ((190, 232, 3), True, ['b.png by 0, 2 px'])
    """
    places, moved, most = (
        [(0, 0)],
        [],
        _MOST_MOVED * max(pictures[0].shape[:2], default=0) if pictures else 0.0,
    )
    for (one, other), name in zip(pairwise(pictures), names[1:], strict=True):
        x, y, turns = _displacement(one, other)
        must = f"must be at most {most:.0f} px, of one scene from a tripod"
        refuse(
            math.hypot(x, y) > most,
            f"{name}: the camera moved by {x:.0f}, {y:.0f} px since the picture before; {must}",
        )
        refuse(turns, f"{name}: the camera turned since the picture before ({turns}); use a tripod")
        if math.hypot(x, y) > _AT_REST_PX:
            moved.append(f"{name} by {x:.0f}, {y:.0f} px")
        else:
            x = y = 0.0
        places.append((places[-1][0] + round(x), places[-1][1] + round(y)))
    if not moved:
        return list(pictures), []
    left, top = (min(place[axis] for place in places) for axis in (0, 1))
    right, bottom = (max(place[axis] for place in places) for axis in (0, 1))
    height, width = pictures[0].shape[0] - (bottom - top), pictures[0].shape[1] - (right - left)
    cut = [
        picture[y - top : y - top + height, x - left : x - left + width]
        for picture, (x, y) in zip(pictures, places, strict=True)
    ]
    return cut, moved


def placed(picture: Bytes, over: Bytes) -> tuple[Bytes, str]:
    """A picture moved by whole px to where another shows the same, its border repeated; and by how much, in words.

    >>> random = np.random.default_rng(0)
    >>> scene = cv2.blur(random.integers(0, 255, (200, 240, 3), np.uint8), (5, 5))
    >>> moved, text = placed(np.roll(scene, 7, axis=1), scene)
    >>> text, bool((moved[:, 10:-10] == scene[:, 10:-10]).all())
    ('7, 0 px', True)
    """
    x, y, _ = _displacement(over, picture)
    left, top = round(x), round(y)
    matrix = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top]])
    size = picture.shape[1], picture.shape[0]
    moved = cv2.warpAffine(picture, matrix, size, flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.uint8), f"{left}, {top} px"


def _displacement(one: Bytes, other: Bytes) -> tuple[float, float, str]:
    """How far what one picture shows lies in the next, px right and down, and which corners move otherwise, or "".

    By phase correlation, after the values of the darker picture are mapped to those of the brighter by their ranks.
    """
    scale = max(1.0, max(one.shape[:2]) / _ALIGNED_PX)
    size = round(one.shape[1] / scale), round(one.shape[0] / scale)
    a, b = (
        cv2.cvtColor(cv2.resize(x, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
        for x in (one, other)
    )
    a = _matched(a, b)
    if min(float(picture.std()) for picture in (a, b)) < _STRUCTURE:
        return 0.0, 0.0, ""
    x, y, sure = _shift(a, b)
    if sure < _SURE:
        return 0.0, 0.0, ""
    height, width = a.shape
    corners = [(rows, columns) for rows in (slice(None, height // 2), slice(height // 2, None))
               for columns in (slice(None, width // 2), slice(width // 2, None))]  # fmt: skip
    found = [_shift(a[corner], b[corner]) for corner in corners]
    off = [
        (dx, dy)
        for dx, dy, certain in found
        if certain > _SURE_OF_CORNER and math.hypot(dx - x, dy - y) > _CORNERS_PX
    ]
    turned = "" if len(off) < 3 else ", ".join(f"{scale * dx:.1f}, {scale * dy:.1f} px" for dx, dy in off)
    return scale * x, scale * y, turned


def _shift(a: Bytes, b: Bytes) -> tuple[float, float, float]:
    """Displacement, px, and response of the phase correlation, measured again where it is more than a pixel."""
    x = y = 0.0
    for _ in range(3):
        left, top = round(x), round(y)
        rows, columns = a.shape[0] - abs(top), a.shape[1] - abs(left)
        if min(rows, columns) < _SMALLEST // 2:
            return 0.0, 0.0, 0.0
        one = a[max(0, -top) : max(0, -top) + rows, max(0, -left) : max(0, -left) + columns].astype(
            np.float32
        )
        two = b[max(0, top) : max(0, top) + rows, max(0, left) : max(0, left) + columns].astype(np.float32)
        (dx, dy), sure = cv2.phaseCorrelate(one, two, cv2.createHanningWindow((columns, rows), cv2.CV_32F))
        x, y = left + dx, top + dy
        if math.hypot(dx, dy) < 1:
            break
    return x, y, float(sure)


def _matched(a: Bytes, b: Bytes) -> Bytes:
    """The values of ``a`` mapped so that their distribution is that of ``b``."""
    of_a, of_b = (np.bincount(x.ravel(), minlength=256).cumsum() for x in (a, b))
    table = np.rint(np.interp(of_a, of_b, np.arange(256.0))).astype(np.uint8)
    return np.asarray(table[a], np.uint8)
