"""Netpbm and TIFF in the variants that cameras, microscopes and tools write, against values computed by hand."""

import struct
import zlib
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.datasets import UnreadablePicture, decode, image_folder, write_picture

RGB = np.arange(5 * 7 * 3).reshape(5, 7, 3) * 600 + 100  # odd sides, every value its own
GREY = RGB[..., 0]


def netpbm(kind, values, maximum):
    """A file of values (h, w) or (h, w, channels) up to the maximum."""
    height, width = values.shape[:2]
    channels = 1 if values.ndim == 2 else values.shape[2]
    if kind == 7:
        head = f"P7\n# made\nWIDTH {width}\nHEIGHT {height}\nDEPTH {channels}\nMAXVAL {maximum}\nTUPLTYPE X\nENDHDR\n"
    else:
        head = f"P{kind}\n# made\n{width} {height}\n" + (f"{maximum}\n" if kind not in (1, 4) else "")
    body = values.astype(">u2" if maximum > 255 else "u1").tobytes()
    if kind < 4:
        body = " ".join(map(str, values.ravel().tolist())).encode()
    if kind == 4:
        body = np.packbits(values, axis=1).tobytes()
    return head.encode() + body


def tiff(values, *, order="<", big=False, bits=16, pages=1, **tags):
    """A TIFF of values (h, w) or (h, w, channels), two rows a strip; tags: by number, as t262=0."""
    height, width = values.shape[:2]
    planes = [values[..., n] for n in range(values.shape[2])] if tags.get("t284") == 2 else [values]
    strips = [
        plane[row : row + 2].astype(f"{order}u{bits // 8}").tobytes()
        for plane in planes
        for row in range(0, height, 2)
    ]
    if tags.get("t259") == 8:
        strips = [zlib.compress(strip) for strip in strips]
    channels = 1 if values.ndim == 2 else values.shape[2]
    at = 16 if big else 8
    begins = [at + sum(map(len, strips[:n])) for n in range(len(strips))]
    entries: dict[int, Any] = {
        256: (width,), 257: (height,), 258: (bits,) * channels, 259: (1,), 262: (2 if channels > 2 else 1,),
        273: tuple(begins), 277: (channels,), 278: (2,), 279: tuple(map(len, strips)), 284: (1,),
    }  # fmt: skip
    entries |= {int(name[1:]): (value,) for name, value in tags.items()}
    body, number = b"".join(strips), "Q" if big else "I"
    place = directory = at + len(body)
    for page in range(pages):
        size = (8 if big else 2) + len(entries) * (20 if big else 12) + (8 if big else 4)
        table, values_beyond = struct.pack(f"{order}{'Q' if big else 'H'}", len(entries)), b""
        for tag, numbers in sorted(entries.items()):
            packed = struct.pack(f"{order}{len(numbers)}I", *numbers)
            inline = packed.ljust(8 if big else 4, b"\0")
            if len(packed) > (8 if big else 4):
                inline = struct.pack(order + number, place + size + len(values_beyond))
                values_beyond += packed
            table += struct.pack(f"{order}HH{number}", tag, 4, len(numbers)) + inline
        following = place + size + len(values_beyond) if page < pages - 1 else 0
        body += table + struct.pack(order + number, following) + values_beyond
        place = following
    head = (
        struct.pack(f"{order}HHHQ", 43, 8, 0, directory) if big else struct.pack(f"{order}HI", 42, directory)
    )
    return (b"II" if order == "<" else b"MM") + head + body


def read(tmp_path, data, name="a.tif"):
    (tmp_path / name).write_bytes(data)
    return decode(tmp_path / name)


@pytest.mark.parametrize("maximum", [1, 15, 100, 254, 255, 256, 1023, 4095, 65534, 65535])
def test_a_value_of_netpbm_is_a_share_of_the_maximum(tmp_path, maximum):
    values = RGB % (maximum + 1)
    full = 255 if maximum < 256 else 65535
    for kind, own in ((2, values[..., 0]), (3, values), (5, values[..., 0]), (6, values), (7, values[..., :1]),
                      (7, values[..., :2]), (7, values), (7, np.dstack([values, values[..., 0]]))):  # fmt: skip
        seen = read(tmp_path, netpbm(kind, own, maximum), "a.pnm")
        colour = own.ndim == 3 and own.shape[2] > 2
        expected = (values if colour else values[..., 0]) * (full / maximum)
        assert (seen.shape, seen.dtype.itemsize) == (expected.shape, 1 if full == 255 else 2)
        assert np.abs(seen - expected).max() <= 0.5


@pytest.mark.parametrize("kind", [1, 4])
def test_one_is_black_in_a_bitmap(tmp_path, kind):
    bits = GREY // 600 % 2
    assert np.array_equal(read(tmp_path, netpbm(kind, bits, 1), "a.pbm"), 255 * (1 - bits))


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (b"P6\n7 5\n255\n123", "fewer than the 105 values"),
        (b"P5\n7 5\n0\n" + bytes(35), "a maximum of 1 to 65535"),
        (b"P5\n7 5\n99999\n" + bytes(70), "a maximum of 1 to 65535"),
        (b"P5\n7 5\n63\n" + bytes([64] * 35), "values 64 to 64; must be 0 to 63"),
        (b"P2\n2 1\n9\n-1 3", "values -1 to 3; must be 0 to 9"),
        (b"P2\n2 1\n9\nx 3", "fewer"),
        (b"P6\nseven 5\n255\n", "no width and height"),
        (b"P7\nWIDTH 7\nENDHDR\n", "must have WIDTH"),
        (b"P7\nWIDTH 99999\nHEIGHT 99999\nDEPTH 1\nMAXVAL 9\nENDHDR\n", "10000 megapixels"),
    ],
)
def test_broken_netpbm_is_named(tmp_path, data, fault):
    with pytest.raises(UnreadablePicture, match=rf"a\.ppm: .*({fault})"):
        read(tmp_path, data, "a.ppm")


@pytest.mark.parametrize(
    "variant", [{}, {"order": ">"}, {"big": True}, {"big": True, "order": ">"}, {"t259": 8}]
)
@pytest.mark.parametrize("bits", [8, 16])
def test_tiff_as_it_is_defined(tmp_path, variant, bits):
    """Planes apart, and white as zero, uncompressed or not."""
    rgb = RGB >> (16 - bits)
    full = 2**bits - 1
    alpha = np.dstack([rgb, np.full(GREY.shape, full)])
    for values, tags, expected in (
        (rgb, {}, rgb),
        (rgb, {"t284": 2}, rgb),
        (alpha, {"t284": 2, "t338": 2}, rgb),
        (rgb[..., 0], {}, rgb[..., 0]),
        (rgb[..., 0], {"t262": 0}, full - rgb[..., 0]),
    ):
        seen = read(tmp_path, tiff(values, bits=bits, **variant, **tags))
        assert seen.dtype.itemsize * 8 == bits
        assert np.array_equal(seen, expected), tags


def test_colours_under_transparency(tmp_path):
    """Stored multiplied by 1/4, as ExtraSamples says."""
    stored = np.dstack([RGB // 4, np.full(GREY.shape, 65535 // 4)])
    seen = read(tmp_path, tiff(stored, t338=1))
    # 4 for the division of the colours, 1.5 for that of 65535
    assert np.abs(seen.astype(int) - RGB).max() <= 6


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (tiff(GREY, t339=2), "holds signed integers"),
        (tiff(GREY, t262=32803), "a raw mosaic of colour filters with 16 bits"),
        (tiff(np.dstack([RGB, GREY]), t262=5), "CMYK with 16 bits"),
        (tiff(np.dstack([RGB, RGB]), t338=0), "6 channels; must have 1 to 4"),
        (tiff(GREY, t254=1), "begins with a smaller copy"),
        (tiff(GREY, t259=34925), "compression 34925, which OpenCV cannot decode"),
        (tiff(GREY)[:-9], "cut off"),
        (tiff(GREY, order=">", t262=0, t256=99999, t257=99999), "10000 megapixels"),  # unknown to Pillow
    ],
)  # fmt: skip
def test_what_is_not_read_of_tiff_is_named(tmp_path, data, fault):
    with pytest.raises(UnreadablePicture, match=rf"a\.tif: .*{fault}"):
        read(tmp_path, data)


def test_doubts_about_values_and_pages(tmp_path):
    """Values of 12 bits in 16; a value of 13 bits more, and nothing is doubted; a TIFF of two pages."""
    write_picture(tmp_path / "a.png", (GREY % 4096).astype(np.uint16))
    (tmp_path / "b.tif").write_bytes(tiff(GREY % 4000))
    (tmp_path / "._a.png").write_bytes(b"\0\5\x16\7")
    brightest = int((GREY % 4096).max())
    found = image_folder(tmp_path)
    assert [picture.name for picture in found] == ["a.png", "b.tif"]
    litter, doubt = found.notes
    assert litter == "files of macOS (._NAME), which are no pictures, left out: 1"
    assert doubt.startswith(f"doubtful values: the brightest of all is {brightest} of 65535 ")
    assert "12 bits?" in doubt
    (tmp_path / "b.tif").write_bytes(tiff(GREY, pages=2))
    assert image_folder(tmp_path).notes[1:] == (
        "doubtful pictures: b.tif has more than one page; only the first is read",
    )
    (tmp_path / "b.tif").write_bytes(netpbm(5, GREY % 4096, 4095))
    assert image_folder(tmp_path).notes[1:] == ()
