"""Pictures and boxes as they come: depths, orientations, COCO files and everything that can be wrong."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval import datasets
from blurnoise_eval.datasets import (
    UnreadablePicture,
    coco,
    decode,
    eight_bit,
    image_folder,
    read_picture,
    rendered_signs,
    size_group,
    write_picture,
)
from numpy.typing import NDArray

SHARED = Path(__file__).resolve().parents[2].parent / "shared" / "real"


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
    reasons = {"empty.png": "0 bytes", "missing.png": "No such file", "folder.png": "directory"}
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


def test_picture_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").write_text("x")
    before = sorted(tmp_path.rglob("*"))
    for path in (tmp_path / "folder.png", tmp_path / "no" / "a.png", tmp_path / "file" / "a.png"):
        with pytest.raises(OSError, match="irectory") as caught:
            write_picture(path, pixels((4, 4)))
        assert str(path) in str(caught.value)
        assert "partial" not in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before


def test_write_that_fails_half_way_keeps_the_picture_of_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "picture.png"
    write_picture(path, pixels((4, 4)))
    before, write_bytes = path.read_bytes(), Path.write_bytes

    def full(target: Path, data: bytes) -> int:
        write_bytes(target, data[: len(data) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space left"):
        write_picture(path, pixels((9, 9)))
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["picture.png"]


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


def instances(**changes: Any) -> dict[str, Any]:
    """A COCO file of three pictures: two objects, a crowd and an empty box; nothing; one small sign."""
    data: dict[str, Any] = {
        "images": [
            {"id": 7, "file_name": "a.png"},
            {"id": 8, "file_name": "b.png"},
            {"id": 9, "file_name": "sub/c.png"},
        ],
        "categories": [{"id": 13, "name": "stop sign"}, {"id": 1, "name": "person"}],
        "annotations": [
            {"image_id": 7, "category_id": 13, "bbox": [10, 20, 30, 40.5], "iscrowd": 0},
            {"image_id": 7, "category_id": 1, "bbox": [0, 0, 100, 200]},
            {"image_id": 7, "category_id": 1, "bbox": [0, 0, 50, 50], "iscrowd": 1},
            {"image_id": 7, "category_id": 1, "bbox": [5, 5, 0, 9]},
            {"image_id": 7, "category_id": 1, "bbox": [5, 5, 9, 0]},
            {"image_id": 9, "category_id": 13, "bbox": [1, 2, 10, 10]},
        ],
    }
    return {**data, **changes}


def write(path: Path, data: object) -> Path:
    path.write_text(data if isinstance(data, str) else json.dumps(data), encoding="utf-8")
    return path


def test_coco_boxes_become_targets(tmp_path: Path) -> None:
    found = coco(write(tmp_path / "instances.json", instances()))
    a, b, c = found
    assert (found.kind, [picture.name for picture in found]) == ("coco", ["a.png", "b.png", "sub/c.png"])
    assert a.targets is not None
    assert [(target.label, target.box_xyxy) for target in a.targets] == [
        ("stop sign", (10.0, 20.0, 40.0, 60.5)),
        ("person", (0.0, 0.0, 100.0, 200.0)),
    ]
    assert [target.group for target in a.targets] == [
        "objects, medium (32-96 px)",
        "objects, large (> 96 px)",
    ]
    assert b.targets == ()  # annotated as holding nothing, which differs from not annotated
    assert c.targets is not None
    assert c.targets[0].group == "objects, small (< 32 px)"


def test_coco_labels_choose_pictures_and_name_groups(tmp_path: Path) -> None:
    found = coco(write(tmp_path / "instances.json", instances()), labels=["stop sign"])
    assert [picture.name for picture in found] == ["a.png", "sub/c.png"]
    assert [target.group for picture in found for target in picture.targets or ()] == [
        "stop sign, medium (32-96 px)",
        "stop sign, small (< 32 px)",
    ]


def test_coco_pictures_without_the_label_may_stay(tmp_path: Path) -> None:
    file = write(tmp_path / "instances.json", instances())
    found = coco(file, labels=["stop sign"], keep_empty=True)
    assert [(picture.name, len(picture.targets or ())) for picture in found] == [
        ("a.png", 1), ("b.png", 0), ("sub/c.png", 1),
    ]  # fmt: skip
    assert found.pictures[1].targets == ()  # None would make targets of whatever is found there


def test_coco_pictures_may_lie_elsewhere_or_be_missing(tmp_path: Path) -> None:
    (tmp_path / "pictures" / "sub").mkdir(parents=True)
    write_picture(tmp_path / "real.png", pixels((4, 4)))
    (tmp_path / "pictures" / "a.png").symlink_to(tmp_path / "real.png")  # as subsets of COCO are made
    found = coco(write(tmp_path / "instances.json", instances()), images=tmp_path / "pictures")
    assert found.pictures[0].load().shape == (4, 4, 3)
    with pytest.raises(UnreadablePicture, match=r"b\.png.*No such file"):
        found.pictures[1].load()


@pytest.mark.parametrize(
    "name", ["../secret.png", "sub/../../secret.png", "/etc/passwd", "..", "sub/../../x/../secret.png"]
)
def test_coco_file_names_stay_in_the_folder(tmp_path: Path, name: str) -> None:
    file = write(tmp_path / "instances.json", instances(images=[{"id": 7, "file_name": name}]))
    with pytest.raises(ValueError, match="leaves the folder"):
        coco(file)


@pytest.mark.parametrize("name", ["sub/../a.png", "./a.png", "a..png"])
def test_coco_file_names_may_wander_inside(tmp_path: Path, name: str) -> None:
    write_picture(tmp_path / Path(os.path.normpath(name)), pixels((4, 4)))
    (picture,) = coco(write(tmp_path / "instances.json", instances(images=[{"id": 7, "file_name": name}])))
    assert picture.load().shape == (4, 4, 3)


def test_coco_picture_listed_twice_is_refused(tmp_path: Path) -> None:
    """Cells are told apart by the picture's name."""
    images = [{"id": 1, "file_name": "a.png"}, {"id": 2, "file_name": "./a.png"}]
    with pytest.raises(ValueError, match=r"a\.png' twice"):
        coco(write(tmp_path / "instances.json", instances(images=images)))


ANNOTATION = {"image_id": 7, "category_id": 13, "bbox": [1, 2, 3, 4]}


@pytest.mark.parametrize(
    "data",
    [
        "{ no json",
        "[" * 100_000,
        "[]",
        "null",
        "{}",
        instances(annotations=None),
        instances(images=[{"id": 1}]),
        instances(images=[{"id": "seven", "file_name": "a.png"}]),
        instances(images=[{"id": float("inf"), "file_name": "a.png"}]),
        instances(annotations=["text"]),
        instances(annotations=[{**ANNOTATION, "bbox": [1, 2, 3]}]),
        instances(annotations=[{**ANNOTATION, "bbox": [1, 2, "wide", 4]}]),
        instances(annotations=[{**ANNOTATION, "bbox": [1, 2, float("nan"), 4]}]),
        instances(annotations=[{**ANNOTATION, "bbox": [1, 2, float("inf"), 4]}]),
        instances(annotations=[{**ANNOTATION, "category_id": 99}]),
        instances(annotations=[{"image_id": 7, "category_id": 13}]),
    ],
)
def test_what_is_no_coco_file_is_named(tmp_path: Path, data: object) -> None:
    with pytest.raises(ValueError, match=r"instances\.json': not a COCO instances file"):
        coco(write(tmp_path / "instances.json", data))


def test_coco_file_that_is_binary_missing_or_lists_nothing(tmp_path: Path) -> None:
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ValueError, match="not a COCO instances file"):
        coco(tmp_path / "binary.json")
    with pytest.raises(ValueError, match=r"nothing\.json'.*No such file"):
        coco(tmp_path / "nothing.json")
    with pytest.raises(ValueError, match="lists no pictures"):
        coco(write(tmp_path / "instances.json", instances(images=[])))


def test_unknown_class_is_told_with_the_known_ones(tmp_path: Path) -> None:
    file = write(tmp_path / "instances.json", instances())
    with pytest.raises(ValueError, match=r"\['zebra'\].*'person', 'stop sign'"):
        coco(file, labels=["stop sign", "zebra"])
    file = write(tmp_path / "instances.json", instances(annotations=[]))
    with pytest.raises(ValueError, match="lists no pictures with"):
        coco(file, labels=["stop sign"])


@pytest.mark.parametrize(
    ("width", "height", "group"),
    [(31, 33, "small"), (32, 32, "medium"), (16, 64, "medium"), (95, 97, "medium"), (96, 96, "large")],
)
def test_size_groups_follow_the_area(width: float, height: float, group: str) -> None:
    assert size_group(width, height, "sign").startswith(f"sign, {group}")


def test_rendered_sign_fills_its_box() -> None:
    """Octagon of 50 px on grey: all that differs from the background lies in the box, and touches it."""
    (picture,) = rendered_signs([50])
    image = picture.load()
    assert image.shape == (datasets.RENDERED_SIZE_PX, datasets.RENDERED_SIZE_PX, 3)
    assert picture.targets is not None
    ((x0, y0, x1, y1),) = (target.box_xyxy for target in picture.targets)
    assert (x1 - x0, y1 - y0) == (50, 50)
    rows, columns = np.nonzero((image != image[0, 0]).any(axis=2))
    assert (columns.min(), columns.max() + 1) == (x0, x1)
    assert (rows.min(), rows.max() + 1) == (y0, y1)
    np.testing.assert_array_equal(picture.load(), image)


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the shared photographs")
def test_real_photographs() -> None:
    found = coco(SHARED / "photos" / "instances.json", labels=["stop sign"])
    by_name = {picture.name: picture for picture in found}
    picture = by_name["000000525891.jpg"]
    height, width = picture.load().shape[:2]
    for target in picture.targets or ():
        x0, y0, x1, y1 = target.box_xyxy
        assert 0 <= x0 < x1 <= width
        assert 0 <= y0 < y1 <= height
