"""Where pictures come from: a folder, a COCO file, or targets rendered by :mod:`blurnoise.charts`.

A picture is read when it is needed and not before, so a folder of any size streams through.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.files import write_whole

SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".ppm", ".tif", ".tiff", ".webp")
RENDERED_SIZE_PX = 320

Image = NDArray[np.uint8] | NDArray[np.uint16]


class UnreadablePicture(ValueError):
    """A picture cannot be read; the message says why."""


@dataclass(frozen=True)
class Target:
    """An object that the detector should find: class name, curve it counts for, box (x0, y0, x1, y1) px."""

    label: str
    group: str
    box_xyxy: tuple[float, float, float, float]


@dataclass(frozen=True)
class Picture:
    """A picture by name. ``targets`` None: whatever the detector finds in the clean picture.

    ``load`` returns (H, W, 3) RGB, 8 or 16 bit, sRGB-coded, and raises :class:`UnreadablePicture`.
    ``identity`` changes when the picture does (a file's size), so that a resumed run notices.
    """

    name: str
    targets: tuple[Target, ...] | None
    load: Callable[[], Image]
    identity: str


@dataclass(frozen=True)
class PictureSet:
    """Pictures of one kind ("rendered", "folder", "coco") and where they come from."""

    kind: str
    source: str
    pictures: tuple[Picture, ...]

    def __len__(self) -> int:
        return len(self.pictures)

    def __iter__(self) -> Iterator[Picture]:
        return iter(self.pictures)


def decode(path: Path) -> Image:
    """Read a picture, (H, W) grey or (H, W, 3) RGB, 8 or 16 bit, turned as its EXIF orientation says.

    Raises :class:`UnreadablePicture` when the file is missing, empty or no picture.
    """
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise UnreadablePicture(f"{path}: {error.strerror or error}") from None
    if not data.size:
        raise UnreadablePicture(f"{path}: is empty (0 bytes)")
    try:
        decoded = cv2.imdecode(data, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    except cv2.error:  # a header that promises too many pixels
        decoded = None
    if decoded is None or decoded.dtype not in (np.uint8, np.uint16):
        raise UnreadablePicture(f"{path}: not an 8- or 16-bit picture that OpenCV can decode")
    return decoded if decoded.ndim == 2 else np.ascontiguousarray(decoded[..., ::-1])


def read_picture(path: Path) -> Image:
    """As :func:`decode`, but always (H, W, 3) RGB: what detectors take."""
    picture = decode(path)
    return picture if picture.ndim == 3 else np.ascontiguousarray(np.stack([picture] * 3, axis=-1))


def eight_bit(picture: Image) -> NDArray[np.uint8]:
    """The picture with 8 bits per channel, rounded; an 8-bit one as it is."""
    if picture.dtype == np.uint8:
        return np.asarray(picture, np.uint8)
    return np.round(picture * (255.0 / 65535.0)).astype(np.uint8)


def write_picture(path: Path, picture: Image) -> None:
    """Write (H, W) grey or (H, W, 3) RGB, 8 or 16 bit; the suffix names the format.

    The file appears whole or not at all. Raises ``ValueError`` for an unknown suffix, ``OSError`` where it
    cannot be written.
    """
    bgr = picture if picture.ndim == 2 else np.ascontiguousarray(picture[..., ::-1])
    if picture.dtype == np.uint16 and path.suffix.lower() not in (".png", ".tif", ".tiff"):
        raise ValueError(f"output = {str(path)!r}: 16 bits need .png or .tiff")
    try:
        _, data = cv2.imencode(path.suffix, bgr)
    except cv2.error:
        raise ValueError(f"output = {str(path)!r}: unknown picture suffix {path.suffix!r}") from None
    write_whole(path, data.tobytes())


def image_folder(folder: Path) -> PictureSet:
    """Every picture in ``folder`` and below, by name; no boxes, so the clean picture's detections count.

    Raises ``ValueError`` when the folder is missing or holds no picture.
    """
    if not folder.is_dir():
        raise ValueError(f"images = {str(folder)!r}: no such folder")
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    if not paths:
        raise ValueError(f"images = {str(folder)!r}: holds no picture ({' '.join(SUFFIXES)})")
    return PictureSet(
        "folder",
        str(folder),
        tuple(_from_file(path, _printable(path.relative_to(folder).as_posix()), None) for path in paths),
    )


def coco(
    file: Path, *, images: Path | None = None, labels: Sequence[str] = (), keep_empty: bool = False
) -> PictureSet:
    """The pictures of a COCO instances file, with its boxes as targets; crowds and empty boxes do not count.

    images: their folder, by default the file's own. labels: category names to keep; pictures without any of
    them are left out, unless ``keep_empty``: what is found there is wrong. Raises ``ValueError`` that names
    the file for anything that is not COCO, and for a file name that leaves the folder.
    """
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        categories = {int(entry["id"]): str(entry["name"]) for entry in data["categories"]}
        boxes: dict[int, list[Target]] = {}
        for annotation in data["annotations"]:
            x, y, width, height = (float(number) for number in annotation["bbox"])
            if not math.isfinite(x + y + width + height):
                raise ValueError(f"bbox = {annotation['bbox']}: must be finite")
            label = categories[int(annotation["category_id"])]
            if annotation.get("iscrowd") or width <= 0 or height <= 0 or (labels and label not in labels):
                continue
            group = size_group(width, height, label if labels else "objects")
            target = Target(label, group, (x, y, x + width, y + height))
            boxes.setdefault(int(annotation["image_id"]), []).append(target)
        entries = [(int(entry["id"]), str(entry["file_name"])) for entry in data["images"]]
    except OSError as error:
        raise ValueError(f"coco = {str(file)!r}: {error.strerror or error}") from None
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise ValueError(f"coco = {str(file)!r}: not a COCO instances file ({error!r})") from None
    if unknown := [label for label in labels if label not in categories.values()]:
        raise ValueError(f"target = {unknown}: not among the categories {sorted(categories.values())}")
    folder = images or file.parent
    pictures: dict[str, Picture] = {}
    for image_id, name in entries:
        path = Path(os.path.normpath(name))
        if path.anchor or ".." in path.parts:
            raise ValueError(f"coco = {str(file)!r}: file_name {name!r} leaves the folder {str(folder)!r}")
        if path.as_posix() in pictures:
            raise ValueError(f"coco = {str(file)!r}: lists {name!r} twice")
        targets = tuple(boxes.get(image_id, ()))
        if targets or keep_empty or not labels:
            pictures[path.as_posix()] = _from_file(folder / path, _printable(path.as_posix()), targets)
    if not pictures:
        raise ValueError(
            f"coco = {str(file)!r}: lists no pictures{f' with {list(labels)}' if labels else ''}"
        )
    return PictureSet("coco", str(file), tuple(pictures.values()))


def rendered_signs(sizes_px: Sequence[int] = (100, 50, 32)) -> PictureSet:
    """A stop sign of each size (px across flats) in the middle of an 18 % grey square of 320 px."""
    pictures = tuple(
        Picture(
            f"stop-sign-{size}px",
            (Target("stop sign", f"stop sign {size} px", _sign_box(size)),),
            partial(_render_sign, size),
            f"rendered {size} px",
        )
        for size in sizes_px
    )
    return PictureSet("rendered", f"stop signs of {', '.join(map(str, sizes_px))} px", pictures)


def size_group(width: float, height: float, label: str) -> str:
    """COCO's size classes: small below 32^2 px of box area, large from 96^2 px on."""
    area = width * height
    if area < 32**2:
        return f"{label}, small (< 32 px)"
    return f"{label}, medium (32-96 px)" if area < 96**2 else f"{label}, large (> 96 px)"


def _from_file(path: Path, name: str, targets: tuple[Target, ...] | None) -> Picture:
    try:
        size = path.stat().st_size
    except OSError:
        size = None
    return Picture(name, targets, partial(read_picture, path), f"{name} {size} bytes")


def _printable(name: str) -> str:
    """The name with bytes that are no UTF-8 written out, so that tables can hold it."""
    return name.encode("utf-8", "backslashreplace").decode()


def _render_sign(size_px: int) -> NDArray[np.uint8]:
    from blurnoise import charts
    from blurnoise.encoding import srgb_from_linear

    linear = charts.stop_sign(size_px, height_px=RENDERED_SIZE_PX, width_px=RENDERED_SIZE_PX)
    coded: Any = srgb_from_linear(linear[0]).mul(255).round().byte().permute(1, 2, 0).contiguous().numpy()
    return np.asarray(coded, np.uint8)


def _sign_box(size_px: int) -> tuple[float, float, float, float]:
    from blurnoise import charts

    box = charts.stop_sign_box(size_px, height_px=RENDERED_SIZE_PX, width_px=RENDERED_SIZE_PX)
    return tuple(float(edge) for edge in box)  # type: ignore[return-value]
