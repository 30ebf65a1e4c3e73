"""Pictures as files: 8 or 16 bit, grey or colour, turned as their EXIF orientation says."""

from __future__ import annotations

import stat
import warnings
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from blurnoise_eval.datasets.records import Image, Picture, PictureSet, UnreadablePicture
from blurnoise_eval.system.files import write_whole

SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".ppm", ".tif", ".tiff", ".webp")
_ORIENTATION = 0x0112  # EXIF's tag; its values 5 to 8 swap width and height


def decode(path: Path) -> Image:
    """Read a picture, (H, W) grey or (H, W, 3) RGB, 8 or 16 bit, turned as its EXIF orientation says.

    Raises :class:`UnreadablePicture` when the file is missing, empty or no picture.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # reading a pipe would wait for ever
            raise UnreadablePicture(f"{path}: a directory, device or pipe, no file")
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


def size_px(path: Path) -> tuple[int, int]:
    """(width, height) of the picture as :func:`decode` gives it, from the file's header where that says it.

    Raises :class:`UnreadablePicture` where ``decode`` does, but not for a sound header before a broken rest.
    """
    try:
        if not path.is_file():
            raise UnreadablePicture(f"{path}: no file")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of many pixels, which are not read here
            with PIL.Image.open(path) as header:
                exif = PIL.Image.Exif()
                exif.load(header.info.get("exif", b""))
                width, height = header.size
                turns = exif.get(_ORIENTATION) in (5, 6, 7, 8)
                if header.format != "TIFF":  # whose size some releases of Pillow turn, others not
                    return (height, width) if turns else (width, height)
    except Exception:  # Pillow raises all sorts; what a picture is, decode says
        pass
    height, width = decode(path).shape[:2]
    return width, height


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
    if picture.dtype == np.uint16 and path.suffix.lower() not in (".png", ".tif", ".tiff"):
        raise ValueError(f"output = {str(path)!r}: 16 bits need .png or .tiff")
    try:
        data = encode(picture, path.suffix)
    except cv2.error:
        raise ValueError(f"output = {str(path)!r}: unknown picture suffix {path.suffix!r}") from None
    write_whole(path, data)


def encode(picture: Image, suffix: str = ".png") -> bytes:
    """The bytes of a file of (H, W) grey or (H, W, 3) RGB. Raises OpenCV's error for an unknown suffix."""
    bgr = picture if picture.ndim == 2 else np.ascontiguousarray(picture[..., ::-1])
    _, data = cv2.imencode(suffix, bgr)
    return bytes(data)


def sample(pictures: PictureSet, count: int) -> list[tuple[Picture, NDArray[np.uint8]]]:
    """At most ``count`` of the pictures, evenly spread over the set, with 8 bits; those not readable left out."""
    found = []
    for place in np.unique(np.linspace(0, len(pictures) - 1, min(count, len(pictures))).round().astype(int)):
        picture = pictures.pictures[place]
        with suppress(UnreadablePicture):
            found.append((picture, eight_bit(picture.load())))
    return found
