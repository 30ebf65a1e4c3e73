"""Planes: the digital numbers of a frame as the converter gave them, (H, W) uint8 or uint16.

PNG, TIFF and PGM of one channel, NPY, headerless little-endian 16-bit planes (.raw, .bin) of a stated size, and
whatever LibRaw reads (DNG and cameras' raw files) where the package rawpy is installed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NoReturn

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.system.files import check_regular

Plane = NDArray[np.uint8] | NDArray[np.uint16]
SMALLEST_PX = 32
_BARE = (".raw", ".bin")
_PICTURES = (".png", ".tif", ".tiff", ".pgm")
_LOSSY = {b"\xff\xd8\xff": "JPEG", b"RIFF": "WebP", b"\x00\x00\x00\x0cJXL": "JPEG XL"}
_LOSSY_SUFFIXES = (".jpg", ".jpeg", ".webp", ".heic", ".heif", ".avif", ".jxl")


def read_plane(path: Path, raw_size_px: tuple[int, int] | None = None) -> Plane:
    """The numbers of one file. raw_size_px: (width, height) of files without a header.

    Raises ``ValueError`` for a lossy format, more than one channel, numbers that are not whole or do not fit into
    16 bits, and what cannot be read; ``OSError`` where the file is missing.
    """
    check_regular(path)
    with path.open("rb") as file:
        head = file.read(12)
    lossy = next((name for magic, name in _LOSSY.items() if head.startswith(magic)), None)
    if lossy or path.suffix.lower() in _LOSSY_SUFFIXES:
        name = lossy or path.suffix.lower()[1:].upper()
        _refuse(path, f"{name} is a lossy format, which alters the noise; must be PNG, TIFF, NPY or raw")
    if path.suffix.lower() in _BARE:
        plane = _bare(path, raw_size_px)
    elif path.suffix.lower() == ".npy":
        plane = _array(path)
    elif path.suffix.lower() in _PICTURES:
        plane = _picture(path)
    else:
        plane = _raw(path)
    if plane.ndim != 2:
        _refuse(path, f"shape {plane.shape}: must be one plane, (H, W), as the sensor gives it, not colours")
    if min(plane.shape) < SMALLEST_PX:
        height, width = plane.shape
        _refuse(path, f"{width} x {height} px: must be at least {SMALLEST_PX} x {SMALLEST_PX}")
    return plane


def _picture(path: Path) -> Plane:
    data = np.fromfile(path, np.uint8)
    try:
        plane = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        plane = None
    if plane is None or plane.dtype not in (np.uint8, np.uint16):
        _refuse(path, "must be a picture of 8 or 16 bits that OpenCV can decode")
    narrow: Plane = plane.astype(np.uint8) if plane.dtype == np.uint8 else plane.astype(np.uint16)
    return narrow


def _array(path: Path) -> Plane:
    try:
        plane = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        _refuse(path, f"is no NPY file: {error}")
    if plane.dtype.kind not in "uif" or not plane.size:
        _refuse(path, f"dtype {plane.dtype}: must be numbers")
    if not np.isfinite(plane).all() or (plane != np.round(plane)).any():
        _refuse(path, "must hold whole numbers, as the converter gives them, not averages")
    if plane.min() < 0 or plane.max() > 65535:
        _refuse(path, f"holds {plane.min():g} to {plane.max():g}: must be within 0 and 65535")
    narrow: Plane = plane.astype(np.uint8) if plane.dtype == np.uint8 else plane.astype(np.uint16)
    return narrow


def _bare(path: Path, size_px: tuple[int, int] | None) -> NDArray[Any]:
    if size_px is None:
        _refuse(path, "a file without a header: state its size with --raw-size WxH")
    width, height = size_px
    if path.stat().st_size != 2 * width * height:
        _refuse(path, f"{path.stat().st_size} bytes: must be 2 x {width} x {height}, 16 bits a pixel")
    return np.fromfile(path, "<u2").reshape(height, width).astype(np.uint16)


def _raw(path: Path) -> NDArray[Any]:
    try:
        import rawpy
    except ImportError:
        _refuse(path, "needs the package rawpy: pip install 'blurnoise[raw]'")
    try:
        with rawpy.imread(str(path)) as raw:
            return np.array(raw.raw_image_visible, np.uint16)
    except rawpy.LibRawError as error:
        told = error.args[0].decode() if error.args and isinstance(error.args[0], bytes) else str(error)
        _refuse(path, f"is no picture that OpenCV or LibRaw reads ({told})")


def _refuse(path: Path, why: str) -> NoReturn:
    raise ValueError(f"{path}: {why}") from None
