"""Pictures as they come, in files, folders and rendered: depths, orientations, all that can be wrong."""

from __future__ import annotations

import os
import struct
import warnings
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import PIL.Image
import pytest
from blurnoise_eval.datasets import (
    PictureSet,
    Target,
    UnreadablePicture,
    decode,
    eight_bit,
    image_folder,
    read_picture,
    rendered_signs,
    size_group,
    size_px,
    write_picture,
)
from numpy.typing import NDArray


def pixels(shape: tuple[int, ...], dtype: type = np.uint8) -> NDArray[Any]:
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3), (1, 1)])
@pytest.mark.parametrize("suffix", [".png", ".TIFF"])
def test_written_pictures_come_back(tmp_path: Path, dtype: type, shape: tuple[int, ...], suffix: str) -> None:
    picture = pixels(shape, dtype)
    path = tmp_path / f"picture{suffix}"
    write_picture(path, picture)
    again = decode(path)
    assert again.dtype == dtype
    np.testing.assert_array_equal(again, picture)
    colour = read_picture(path)
    assert colour.shape == (*shape[:2], 3)
    np.testing.assert_array_equal(colour[..., 1], picture if picture.ndim == 2 else picture[..., 1])
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_channels_are_red_green_blue(tmp_path: Path) -> None:
    red = np.zeros((4, 6, 3), np.uint8)
    red[..., 2] = 255  # OpenCV's order
    cv2.imwrite(str(tmp_path / "red.png"), red)
    assert decode(tmp_path / "red.png")[0, 0].tolist() == [255, 0, 0]


@pytest.mark.parametrize(
    ("orientation", "turned"),
    [
        (1, lambda a: a),
        (2, lambda a: a[:, ::-1]),
        (3, lambda a: a[::-1, ::-1]),
        (6, lambda a: np.rot90(a, -1)),  # the camera was held upright: turn clockwise
        (8, lambda a: np.rot90(a, 1)),
    ],
)
def test_exif_orientation(
    tmp_path: Path, orientation: int, turned: Callable[[NDArray[Any]], NDArray[Any]]
) -> None:
    quadrants = np.kron(np.array([[0, 80], [160, 240]], np.uint8), np.ones((16, 32), np.uint8))
    jpeg = cv2.imencode(".jpg", quadrants, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    entry = struct.pack(">HHIHH", 0x0112, 3, 1, orientation, 0)
    exif = b"Exif\0\0MM\0*\0\0\0\x08" + struct.pack(">H", 1) + entry + b"\0\0\0\0"
    path = tmp_path / "turned.jpg"
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:])
    expected = turned(quadrants)
    seen = decode(path)
    assert seen.shape == expected.shape
    assert np.abs(seen.astype(int) - expected).max() <= 2  # of 255: JPEG's rounding


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".tiff", ".bmp", ".ppm"])
def test_size_of_a_file_is_that_of_its_decoded_picture(tmp_path: Path, suffix: str, orientation: int) -> None:
    path = tmp_path / f"turned{suffix}"
    exif = PIL.Image.Exif()
    exif[0x0112] = orientation
    PIL.Image.fromarray(pixels((11, 17, 3))).save(path, exif=exif)
    height, width = decode(path).shape[:2]
    assert size_px(path) == (width, height)
    assert sorted(size_px(path)) == [11, 17]


def test_size_comes_from_the_header(tmp_path: Path) -> None:
    """Of a picture that cannot be decoded, too; no pixel of a huge one is read, and nobody is warned."""
    for size in ((12_000, 9_000), (100_000, 100_000)):
        (tmp_path / "huge.png").write_bytes(png_header(*size))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert size_px(tmp_path / "huge.png") == size
    for name, data in (
        ("empty.jpg", b""),
        ("text.jpg", b"not a picture"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(UnreadablePicture, match=name):
            size_px(tmp_path / name)
    with pytest.raises(UnreadablePicture, match=r"missing\.png"):
        size_px(tmp_path / "missing.png")


def test_eight_bit_rounds() -> None:
    codes = np.arange(256, dtype=np.uint16)
    np.testing.assert_array_equal(eight_bit(codes * 257), codes)
    np.testing.assert_array_equal(eight_bit(np.array([128, 129, 65535], np.uint16)), [0, 1, 255])
    picture = pixels((3, 4))
    assert eight_bit(picture) is picture


def png_header(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"0")) + chunk(b"IEND", b"")


def test_unreadable_pictures_say_why(tmp_path: Path) -> None:
    jpeg = cv2.imencode(".jpg", pixels((64, 64, 3)))[1].tobytes()
    cv2.imwrite(str(tmp_path / "float.tiff"), np.zeros((4, 4, 3), np.float32))
    (tmp_path / "folder.png").mkdir()
    contents = {
        "empty.png": b"",
        "text.jpg": b"not a picture\n",
        "cut.jpg": jpeg[: len(jpeg) // 2],
        "bomb.png": png_header(100_000, 100_000),
    }
    for name, data in contents.items():
        (tmp_path / name).write_bytes(data)
    reasons = {
        "empty.png": "0 bytes",
        "missing.png": "No such file",
        "folder.png": "directory",
        "bomb.png": "megapixels",
    }
    for name in (*contents, "float.tiff", "folder.png", "missing.png"):
        with pytest.raises(UnreadablePicture, match=reasons.get(name, "not an 8- or 16-bit")) as caught:
            decode(tmp_path / name)
        assert name in str(caught.value)


@pytest.mark.parametrize("name", ["picture", "picture.", "picture.foo", ".png", "."])
def test_unknown_suffix_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="unknown picture suffix"):
        write_picture(tmp_path / name if name != "." else Path(), pixels((4, 4)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["picture.jpg", "picture.bmp", "picture"])
def test_16_bits_need_a_format_that_has_them(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="16 bits"):
        write_picture(tmp_path / name, pixels((4, 4), np.uint16))
    assert not list(tmp_path.iterdir())


def test_folder_is_read_in_order_and_below(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    for name in ("b.png", "a.JPG", "sub/c.tiff"):
        cv2.imwrite(str(tmp_path / name), pixels((4, 6, 3)))
    (tmp_path / "notes.txt").write_text("no picture")
    (tmp_path / "empty.png").write_bytes(b"")
    found = image_folder(tmp_path)
    assert [picture.name for picture in found] == ["a.JPG", "b.png", "empty.png", "sub/c.tiff"]
    assert len(found) == 4
    assert all(picture.targets is None for picture in found)
    assert found.pictures[1].load().shape == (4, 6, 3)
    with pytest.raises(UnreadablePicture, match="0 bytes"):
        found.pictures[2].load()


def test_folder_numbers_its_pictures_and_passes_what_is_no_file(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    write_picture(tmp_path / "far" / "z.png", pixels((4, 4)))
    (tmp_path / "set.png").mkdir()
    write_picture(tmp_path / "set.png" / "<b>.png", pixels((4, 4)))
    (tmp_path / "link.png").symlink_to(tmp_path / "far" / "z.png")
    (tmp_path / "loop.png").symlink_to(tmp_path / "loop.png")
    (tmp_path / "nowhere.png").symlink_to(tmp_path / "missing.png")
    (tmp_path / "again").symlink_to(tmp_path)  # a circle of folders
    found = image_folder(tmp_path)
    assert [(picture.image_id, picture.name) for picture in found] == [
        (1, "far/z.png"), (2, "link.png"), (3, "set.png/<b>.png"),
    ]  # fmt: skip
    assert found.pictures[1].load().shape == (4, 4, 3)


def test_names_are_unique() -> None:
    picture = rendered_signs([50]).pictures[0]
    with pytest.raises(ValueError, match=r"folder = 'here': lists 'stop-signs-50px-01' twice"):
        PictureSet("folder", "here", (picture, picture))


def test_annotations_change_no_target() -> None:
    """Runs are told apart by their targets: what a file says beside them is no difference."""
    plain = Target("sign", "signs", (0.0, 0.0, 1.0, 1.0))
    annotated = replace(plain, annotation={"segmentation": [[1, 2]]})
    assert (plain, repr(plain), hash(plain)) == (annotated, repr(annotated), hash(annotated))
    assert replace(plain, crowd=True) != plain != replace(plain, text="STOP")


def test_identity_changes_with_the_picture(tmp_path: Path) -> None:
    def identities() -> list[str]:
        return [picture.identity for picture in image_folder(tmp_path)]

    write_picture(tmp_path / "a.png", pixels((8, 8)))
    before = identities()
    assert identities() == before
    write_picture(tmp_path / "a.png", pixels((9, 9)))
    assert identities() != before


@pytest.mark.skipif(os.name == "nt", reason="file names are Unicode there")
def test_name_that_is_no_utf8_can_be_stored(tmp_path: Path) -> None:
    try:
        (tmp_path / os.fsdecode(b"caf\xe9.png")).write_bytes(b"")
    except OSError:
        pytest.skip("this file system takes only UTF-8")
    (picture,) = image_folder(tmp_path)
    assert picture.name.encode("utf-8") == b"caf\\udce9.png"
    with pytest.raises(UnreadablePicture, match="0 bytes"):
        picture.load()


def test_missing_and_empty_folders(tmp_path: Path) -> None:
    (tmp_path / "file.png").write_bytes(b"x")
    for folder in (tmp_path / "nothing", tmp_path / "file.png"):
        with pytest.raises(ValueError, match="no such folder"):
            image_folder(folder)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "notes.txt").write_text("x")
    with pytest.raises(ValueError, match="holds no picture"):
        image_folder(tmp_path / "empty")


@pytest.mark.parametrize(
    ("width", "height", "group"),
    [(31, 33, "small"), (32, 32, "medium"), (16, 64, "medium"), (95, 97, "medium"), (96, 96, "large")],
)
def test_size_groups_follow_the_area(width: float, height: float, group: str) -> None:
    assert size_group(width, height, "sign").startswith(f"sign, {group}")
