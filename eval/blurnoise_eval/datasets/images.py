"""Pictures as files: 8 or 16 bit or linear light, grey or colour, turned as their EXIF orientation says."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
import PIL.Image
import PIL.ImageOps
import torch
from numpy.typing import NDArray

from blurnoise.camera.colour import srgb_from_linear
from blurnoise_eval.datasets import netpbm, tiff
from blurnoise_eval.datasets.records import Coded, Image, Picture, PictureSet, UnreadablePicture
from blurnoise_eval.system.files import check_regular, write_whole
from blurnoise_eval.system.urls import Location, for_each, local_file, location

EXR = ".exr"
OF_LIGHT = (EXR, ".hdr")
"""Files of floats: linear light. A TIFF may be one, too."""
SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".webp", *netpbm.SUFFIXES, *tiff.SUFFIXES, *OF_LIGHT)
MOST_MEGAPIXELS = 178.0
"""Of any picture: of a larger one the reader of headers, Pillow, does not say the size."""
_HEAD = 4096  # bytes that hold the headers of PNG and Netpbm
_PNG_BITS = 24  # the byte with the depth
_ORIENTATION = 0x0112  # EXIF's tag; its values 5 to 8 swap width and height
_BITS_PER_SAMPLE = 258  # TIFF's tag


class _PictureHeader(NamedTuple):
    """What a picture's first bytes say. size_px: (width, height), turned; multiplied: whether OpenCV would multiply
    the colours by the transparency, as it does for TIFFs of 8 bits."""

    size_px: tuple[int, int]
    format: str | None
    multiplied: bool


def decode(path: Location, max_megapixels: float = MOST_MEGAPIXELS, known: str | None = None) -> Coded:
    """Read a picture, (H, W) grey or (H, W, 3) RGB, 8 or 16 bit, turned as its EXIF orientation says.

    Transparency is left out: the colours are those under it. Raises :class:`UnreadablePicture` when the file is
    missing, empty, no picture, of floats, or of more than ``max_megapixels``, by its header. known: an object's
    version, where it has been looked up.
    """
    values = decode_any(path, max_megapixels, known)
    if values.dtype == np.float32:
        raise UnreadablePicture(
            f"{path}: holds floats, which are linear light; must be an 8- or 16-bit picture"
        )
    return cast(Coded, values)


def decode_any(path: Location, max_megapixels: float = MOST_MEGAPIXELS, known: str | None = None) -> Image:
    """As :func:`decode`; files of floats are read as linear light, float32, 1 is white.

    Of the formats with floats OpenCV reads .hdr, .tiff and .pfm, the package OpenEXR .exr. Raises
    :class:`UnreadablePicture` also for light that is negative or not finite.
    """
    exr = str(path).lower().endswith(EXR)
    values = _openexr(path, max_megapixels, known) if exr else _stored(path, max_megapixels, known)
    if values is None or (values.dtype not in (np.uint8, np.uint16) and values.dtype.kind != "f"):
        must = "must be an 8- or 16-bit picture that OpenCV can decode"
        raise UnreadablePicture(f"{path}: {must}")
    if values.dtype.kind == "u":
        return cast(Coded, values)
    light = values.astype(np.float32)
    if not np.isfinite(light).all() or light.min() < 0:
        raise UnreadablePicture(f"{path}: contains negative or infinite light; must be finite and >= 0")
    return light


def unit(picture: Image) -> NDArray[np.float32]:
    """Values as shares of full scale, of 8 and 16 bits; light as it is.

    >>> unit(np.array([[51, 255]], np.uint8)).tolist(), unit(np.array([[40.0]], np.float32)).tolist()
    ([[0.20000000298023224, 1.0]], [[40.0]])
    """
    most = {1: 255, 2: 65535, 4: 1}[picture.itemsize]
    return picture.astype(np.float32) / np.float32(most)


def _check_size(path: Location, size_px: tuple[int, int], max_megapixels: float) -> None:
    width, height = size_px
    if (megapixels := width * height / 1e6) > max_megapixels:
        size = f"{width} x {height} px, {megapixels:.0f} megapixels"
        raise UnreadablePicture(f"{path}: {size}; must be at most {max_megapixels:g}")


def _openexr(path: Location, max_megapixels: float, known: str | None) -> NDArray[np.float32]:
    """The light of the first part, of its data window: channels R, G and B, or Y."""
    try:
        import OpenEXR

        source = local_file(path, known=known)
        check_regular(source)
        with OpenEXR.File(str(source), header_only=True) as file:
            low, high = file.header()["dataWindow"]
        width, height = (np.subtract(high, low) + 1).tolist()
        _check_size(path, (width, height), max_megapixels)
        with OpenEXR.File(str(source), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
        if counts := [
            name for name, pixels in channels.items() if name in "RGBY" and pixels.dtype.kind == "u"
        ]:
            integers = f"the channels {', '.join(counts)} are UINT, of numbers such as object ids"
            raise UnreadablePicture(f"{path}: {integers}, not light; must be HALF or FLOAT")
        planes = [np.asarray(channels[name], np.float32) for name in ("RGB" if "R" in channels else "Y")]
        return planes[0] if len(planes) == 1 else np.stack(planes, axis=-1)
    except ImportError:
        why = "needs the package OpenEXR (pip install OpenEXR); or convert it to .hdr or 32-bit .tiff"
    except KeyError:
        why = f"has the channels {', '.join(channels)}; must have R, G, B or Y"
    except (OSError, RuntimeError) as error:
        why = getattr(error, "strerror", None) or str(error)
    raise UnreadablePicture(f"{path}: {why}")


def _stored(path: Location, max_megapixels: float, known: str | None = None) -> NDArray[Any] | None:
    """What the file holds, of any type; None where it cannot be decoded."""
    source, header = _header(path, known)
    if header:
        _check_size(path, header.size_px, max_megapixels)
    data = source.read_bytes()
    if not data:
        raise UnreadablePicture(f"{path}: is empty (0 bytes)")
    try:
        if portable := netpbm.header(data):
            _check_size(path, (portable.width, portable.height), max_megapixels)
            return netpbm.decode(data, portable)
        if page := tiff.first_page(data):
            _check_size(path, page.size_px, max_megapixels)
        if header and header.multiplied:
            # Colours as they are stored, where OpenCV would make transparent pixels dark.
            with PIL.Image.open(BytesIO(data)) as opened:  # its mapped files it turns wrongly
                return np.asarray(PIL.ImageOps.exif_transpose(opened).convert("RGB"))
        decoded = tiff.decode(data, page) if page else _by_opencv(data)
    except UnreadablePicture:
        raise
    except ValueError as error:
        raise UnreadablePicture(f"{path}: {error}") from None
    except (cv2.error, OSError, SyntaxError):  # a header that promises too much
        return None
    return decoded if decoded is None or decoded.ndim == 2 else np.ascontiguousarray(decoded[..., ::-1])


def _by_opencv(data: bytes) -> NDArray[Any] | None:
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)


def _header(path: Location, known: str | None = None) -> tuple[Path, _PictureHeader | None]:
    """The file on this machine, and what it says; None where Pillow does not know the format.

    Raises :class:`UnreadablePicture` for one that is missing, or of more pixels than Pillow opens.
    """
    try:
        source = local_file(path, known=known)
        check_regular(source)
        source.open("rb").close()
    except OSError as error:
        raise UnreadablePicture(f"{path}: {error.strerror or error}") from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of many pixels, which are not read here
            with PIL.Image.open(source) as header:
                exif = PIL.Image.Exif()
                exif.load(header.info.get("exif", b""))
                turned = exif.get(_ORIENTATION, 1) in (5, 6, 7, 8)
                depths = getattr(header, "tag_v2", {}).get(_BITS_PER_SAMPLE, ())
                multiplied = header.mode == "RGBA" and 8 in depths
                width, height = header.size
                size = (height, width) if turned else (width, height)
                return source, _PictureHeader(size, header.format, multiplied)
    except PIL.Image.DecompressionBombError:
        raise UnreadablePicture(f"{path}: must have at most {MOST_MEGAPIXELS:g} megapixels") from None
    except Exception:  # Pillow raises all sorts; what a picture is, OpenCV says
        return source, None


class Depth(NamedTuple):
    """Bits of a value, 0 where only decoding would say them, whether the file has further pages, and whether its
    values are floats."""

    bits: int
    more_pages: bool = False
    light: bool = False


def depth_and_pages(path: Location) -> Depth:
    """What the header of a PNG, TIFF or Netpbm file says. Raises :class:`UnreadablePicture`."""
    try:
        source = local_file(path)
        check_regular(source)
        with source.open("rb") as file:
            head = file.read(_HEAD)
            if page := tiff.first_page(head + file.read() if head[:2] in (b"II", b"MM") else b""):
                return Depth(16 if page.bits > 8 else page.bits, page.more, page.floats)
        if head.startswith(b"\x89PNG\r\n\x1a\n") and len(head) > _PNG_BITS:
            return Depth(head[_PNG_BITS])
        portable = netpbm.header(head)
        return Depth(0 if portable is None else 16 if portable.maximum > 255 else 8)
    except (OSError, ValueError) as error:
        raise UnreadablePicture(f"{path}: {getattr(error, 'strerror', None) or error}") from None


def size_px(path: Location) -> tuple[int, int]:
    """(width, height) of the picture as :func:`decode` gives it, from the file's header where that says it.

    Raises :class:`UnreadablePicture` where ``decode`` does, but not for a sound header before a broken rest.
    """
    _, header = _header(path)
    if header and header.format != "TIFF":  # some releases of OpenCV turn a TIFF's
        return header.size_px
    height, width = decode_any(path).shape[:2]
    return width, height


def sizes_px(folder: Location, names: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Sizes of a folder's pictures by name, without those that cannot be read, which loading them says."""

    def size(file: Location) -> tuple[int, int] | None:
        try:
            return size_px(file)
        except UnreadablePicture:
            return None

    sizes = for_each({name: folder / name for name in names}, size)
    return {name: known_size for name, known_size in sizes.items() if known_size}


def content(picture: Image) -> str:
    """What tells a picture from any other: a hash of its pixels."""
    digest = hashlib.blake2b(f"{picture.shape} {picture.dtype}".encode(), digest_size=16)
    digest.update(np.ascontiguousarray(picture).data)
    return digest.hexdigest()


def read_picture(
    path: str | Location, max_megapixels: float = MOST_MEGAPIXELS, known: str | None = None
) -> Image:
    """As :func:`decode_any`, but always (H, W, 3) RGB.

    >>> import numpy as np
    >>> write_picture("grey.png", np.full((60, 80), 128, np.uint8))
    >>> read_picture("grey.png").shape
    (60, 80, 3)
    """
    picture = decode_any(location(path), max_megapixels, known)
    return picture if picture.ndim == 3 else np.ascontiguousarray(np.stack([picture] * 3, axis=-1))


def eight_bit(picture: Image) -> NDArray[np.uint8]:
    """The picture with 8 bits per channel, rounded; an 8-bit one as it is, linear light up to white coded as sRGB.

    >>> import numpy as np
    >>> eight_bit(np.array([[0, 32768, 65535]], np.uint16))
    array([[  0, 128, 255]], dtype=uint8)
    >>> eight_bit(np.array([[0.0, 0.214, 40.0]], np.float32))
    array([[  0, 127, 255]], dtype=uint8)
    """
    if picture.dtype == np.uint8:
        return np.asarray(picture, np.uint8)
    if picture.dtype == np.uint16:
        return np.round(picture * (255.0 / 65535.0)).astype(np.uint8)
    coded = srgb_from_linear(torch.from_numpy(np.ascontiguousarray(picture)))
    return np.asarray(coded.mul(255.0).round().byte().numpy(), np.uint8)


def write_picture(path: str | Path, picture: Coded) -> None:
    """Write (H, W) grey or (H, W, 3) RGB, 8 or 16 bit; the suffix names the format.

    The file appears whole or not at all. Raises ``ValueError`` for an unknown suffix, ``OSError`` where it
    cannot be written.
    """
    file = Path(path)
    if picture.dtype == np.uint16 and file.suffix.lower() not in (".png", ".tif", ".tiff"):
        raise ValueError(f"output = {str(file)!r}: must end in .png or .tiff for 16 bits")
    try:
        data = encode(picture, file.suffix)
    except cv2.error:
        raise ValueError(f"output = {str(file)!r}: unknown picture suffix {file.suffix!r}") from None
    write_whole(file, data)


def write_light(path: Path, light: NDArray[np.float32]) -> None:
    """Write linear light, (H, W) or (H, W, 3), as .tiff of 32-bit floats, or .hdr, which keeps 8 bits of each.

    Raises ``ValueError`` for another suffix, ``OSError`` where it cannot be written.

    >>> write_light(Path("light.tiff"), np.array([[0.5, 40.0]], np.float32))
    >>> decode_any(Path("light.tiff")).tolist()
    [[0.5, 40.0]]
    """
    if path.suffix.lower() not in (".tif", ".tiff", ".hdr"):
        raise ValueError(f"output = {str(path)!r}: must end in .tiff or .hdr for linear light")
    write_whole(path, encode(light, path.suffix))


def encode(picture: Image, suffix: str = ".png") -> bytes:
    """The bytes of a file of (H, W) grey or (H, W, 3) RGB. Raises OpenCV's error for an unknown suffix."""
    bgr = picture if picture.ndim == 2 else np.ascontiguousarray(picture[..., ::-1])
    _, data = cv2.imencode(suffix, bgr)
    return bytes(data)


def sample(
    pictures: PictureSet, count: int, *, light: bool = True
) -> list[tuple[Picture, NDArray[np.uint8]]]:
    """At most ``count`` of the pictures, evenly spread over the set, with 8 bits; those not readable left out.

    light: whether files of linear light count.
    """
    chosen = []
    for index in np.unique(np.linspace(0, len(pictures) - 1, min(count, len(pictures))).round().astype(int)):
        picture = pictures.pictures[index]
        with suppress(UnreadablePicture):
            image = picture.load()
            if light or image.dtype != np.float32:
                chosen.append((picture, eight_bit(image)))
    return chosen
