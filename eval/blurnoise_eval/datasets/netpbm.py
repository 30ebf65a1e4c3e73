"""Netpbm files: PBM, PGM, PPM and PAM, as text or binary, with a maximum of 1 to 65535.

A value is a share of the header's maximum: https://netpbm.sourceforge.net/doc/pam.html. OpenCV 5.0 leaves out the
maximum, Pillow 13 reads no PAM and colours with 8 bits only.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8] | NDArray[np.uint16]
SUFFIXES = (".pam", ".pbm", ".pgm", ".pnm", ".ppm")
_SPACE = rb"(?:\s|#[^\n\r]*[\n\r])"
_NUMBERS = re.compile(rb"P[1-6]" + (_SPACE + rb"+(\d{1,9})") * 2 + rb"(?:" + _SPACE + rb"+(\d{1,9}))?")
_PAM = re.compile(rb"P7\n(.*?)^ENDHDR\n", re.DOTALL | re.MULTILINE)
_LARGEST_HEADER = 1 << 16


class NetpbmHeader(NamedTuple):
    """Kind (1 to 7), sides, channels, the largest value, and where the pixels begin."""

    kind: int
    width: int
    height: int
    channels: int
    maximum: int
    begin: int


def header(data: bytes) -> NetpbmHeader | None:
    """What the file says; None for one of another format. Raises ``ValueError`` for a broken header.

    >>> header(b"P5 640 480 255 ...").width
    640
    """
    head, kind = data[:_LARGEST_HEADER], data[1:2]
    if data[:1] != b"P" or not b"1" <= kind <= b"7" or not data[2:3].isspace():
        return None
    if kind == b"7":
        parsed = _of_pam(head)
    else:
        numbers = _NUMBERS.match(head)
        if numbers is None:
            raise ValueError("has no width and height in its header")
        bitmap = kind in b"14"
        width, height = int(numbers[1]), int(numbers[2])
        maximum = 1 if bitmap else int(numbers[3] or 0)
        begin = numbers.end(2 if bitmap else 3) + 1  # one character of space
        parsed = NetpbmHeader(int(kind), width, height, 3 if kind in b"36" else 1, maximum, begin)
    if not (parsed.width and parsed.height and 1 <= parsed.maximum <= 65535 and 1 <= parsed.channels <= 4):
        *sides, channels, maximum = parsed[1:5]
        raise ValueError(
            f"has {sides[0]} x {sides[1]} px, {channels} channels and the maximum {maximum} in its header; must have "
            "at least 1 px, 1 to 4 channels and a maximum of 1 to 65535"
        )
    return parsed


def _of_pam(head: bytes) -> NetpbmHeader:
    match = _PAM.match(head)
    lines = [line.split() for line in match[1].split(b"\n") if line[:1] != b"#"] if match else []
    entries = {line[0]: line[1] for line in lines if len(line) > 1}
    try:
        width, height, depth, maximum = (
            int(entries[name]) for name in (b"WIDTH", b"HEIGHT", b"DEPTH", b"MAXVAL")
        )
    except (KeyError, ValueError):
        raise ValueError("must have WIDTH, HEIGHT, DEPTH and MAXVAL in its header") from None
    return NetpbmHeader(7, width, height, depth, maximum, match.end() if match else 0)


def decode(data: bytes, about: NetpbmHeader) -> Pixels:
    """The first picture, (H, W) grey or (H, W, 3) RGB, without transparency: value / maximum, 8 bits up to a maximum
    of 255, else 16. Raises ``ValueError`` for missing pixels and values beyond the maximum."""
    kind, width, height, channels, maximum, begin = about
    shape, count = (height, width, channels), height * width * channels
    body = memoryview(data)[begin:]
    try:
        if kind == 4:
            row = (width + 7) // 8
            rows = np.frombuffer(body, np.uint8, row * height).reshape(height, row)
            values: NDArray[Any] = np.unpackbits(rows, axis=1)[:, :width]
        elif kind < 4:
            text = re.sub(rb"#[^\n\r]*", b"", body)
            listed = re.findall(rb"[01]", text) if kind == 1 else text.split()
            values = np.array(listed[:count], np.int64)
        else:
            values = np.frombuffer(body, np.dtype(">u2") if maximum > 255 else np.uint8, count)
        values = values.reshape(shape)
    except (ValueError, OverflowError):
        raise ValueError(f"has fewer than the {count} values that its header promises") from None
    if kind in (1, 4):
        values = 1 - values.astype(np.int8)  # 1 is black
    least, largest = int(values.min()), int(values.max())
    if least < 0 or largest > maximum:
        raise ValueError(f"contains values {least} to {largest}; must be 0 to {maximum}, as its header says")
    values = values[..., :3] if channels > 2 else values[..., 0]
    full = 255 if maximum < 256 else 65535
    if maximum < full:
        values = np.round(np.arange(maximum + 1) * (full / maximum))[values]
    return np.ascontiguousarray(values, np.uint8) if full == 255 else np.ascontiguousarray(values, np.uint16)
