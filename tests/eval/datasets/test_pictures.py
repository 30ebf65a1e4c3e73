"""Pictures as they come, in files and folders: depths, orientations, sizes, transparency, all that can be wrong."""

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
    bdd,
    coco,
    decode,
    decode_linear,
    eight_bit,
    folder,
    image_folder,
    images,
    read_picture,
    rendered_signs,
    size_group,
    size_px,
    texts,
    write_picture,
    yolo,
)
from numpy.typing import NDArray

ORIENTATION = 0x0112
COLOUR = (200, 100, 50)


def pixels(shape: tuple[int, ...], dtype: type = np.uint8) -> NDArray[Any]:
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


def png(width: int, height: int, rows: bytes = b"0") -> bytes:
    """A grey PNG of 8 bits, whose pixels may be missing."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def saved(path: Path, picture: NDArray[Any], orientation: int = 1, **options: Any) -> Path:
    exif = PIL.Image.Exif()
    exif[ORIENTATION] = orientation
    PIL.Image.fromarray(picture).save(path, exif=exif, **options)
    return path


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
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


@pytest.mark.parametrize(
    ("orientation", "turned"),
    [
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
    seen = decode(saved(tmp_path / "turned.jpg", quadrants, orientation, quality=100))
    expected = turned(quadrants)
    assert seen.shape == expected.shape
    assert np.abs(seen.astype(int) - expected).max() <= 2  # of 255: JPEG's rounding


@pytest.mark.parametrize("orientation", [1, 4, 5, 8])
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".tiff", ".bmp"])
def test_size_of_a_file_is_that_of_its_decoded_picture(tmp_path: Path, suffix: str, orientation: int) -> None:
    path = saved(tmp_path / f"turned{suffix}", pixels((11, 17, 3)), orientation)
    height, width = decode(path).shape[:2]
    assert size_px(path) == (width, height)
    assert sorted(size_px(path)) == [11, 17]


@pytest.mark.parametrize(
    ("name", "options"), [("a.png", {}), ("a.webp", {"lossless": True, "exact": True}), ("a.tif", {})]
)
@pytest.mark.parametrize("alpha", [0, 64])
def test_colours_are_those_under_the_transparency(
    tmp_path: Path, name: str, options: dict[str, Any], alpha: int
) -> None:
    seen = decode(saved(tmp_path / name, np.full((5, 7, 4), (*COLOUR, alpha), np.uint8), **options))
    assert seen.shape == (5, 7, 3)
    assert (seen == COLOUR).all()


@pytest.mark.parametrize("compression", ["raw", "tiff_lzw"])
@pytest.mark.parametrize("orientation", [2, 5, 6, 7, 8])
def test_a_turned_tiff_with_transparency(tmp_path: Path, orientation: int, compression: str) -> None:
    """Turned as OpenCV turns an opaque one, whose colours nothing multiplies."""
    picture = pixels((5, 7, 4))
    opaque = saved(tmp_path / "opaque.tif", picture[..., :3].copy(), orientation, compression=compression)
    sheer = saved(tmp_path / "sheer.tif", picture, orientation, compression=compression)
    assert np.array_equal(decode(sheer), decode(opaque))
    assert size_px(sheer) == decode(opaque).shape[1::-1]


def test_eight_bit_rounds() -> None:
    codes = np.arange(256, dtype=np.uint16)
    np.testing.assert_array_equal(eight_bit(codes * 257), codes)
    np.testing.assert_array_equal(eight_bit(np.array([128, 129, 65535], np.uint16)), [0, 1, 255])
    picture = pixels((3, 4))
    assert eight_bit(picture) is picture


def test_size_comes_from_the_header_and_nobody_is_warned(tmp_path: Path) -> None:
    """Of a picture that cannot be decoded, too; no pixel of a huge one is read."""
    (tmp_path / "huge.png").write_bytes(png(12_000, 9_000))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert size_px(tmp_path / "huge.png") == (12_000, 9_000)


def test_unreadable_pictures_say_why(tmp_path: Path) -> None:
    jpeg = cv2.imencode(".jpg", pixels((64, 64, 3)))[1].tobytes()
    cv2.imwrite(str(tmp_path / "float.tiff"), np.zeros((4, 4, 3), np.float32))
    (tmp_path / "folder.png").mkdir()
    contents = {
        "empty.png": b"",
        "text.jpg": b"text\n",
        "cut.jpg": jpeg[:500],
        "bomb.png": png(100_000, 100_000),
    }
    for name, data in contents.items():
        (tmp_path / name).write_bytes(data)
    os.mkfifo(tmp_path / "pipe.png")
    for name, fault in {
        **dict.fromkeys((*contents, "float.tiff"), "not an 8- or 16-bit"),
        "empty.png": "0 bytes", "missing.png": "No such file", "folder.png": "directory",
        "bomb.png": "more than 178 megapixels", "pipe.png": "pipe, no file",
    }.items():  # fmt: skip
        with pytest.raises(UnreadablePicture, match=f"{name}: .*{fault}"):
            decode(tmp_path / name)


def test_a_limit_of_pixels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the header: nothing of such a picture is decoded."""
    (tmp_path / "a.png").write_bytes(png(1300, 1000, bytes(1301 * 1000)))
    files = {
        "classes.txt": "sign\n", "a.txt": "0 0.5 0.5 0.1 0.1\n", "texts": "a.png\tSTOP\n",
        "bdd.json": '[{"name": "a.png"}]',
        "coco.json": '{"images": [{"id": 1, "file_name": "a.png"}], "categories": [], "annotations": []}',
    }  # fmt: skip
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    sources: list[tuple[Callable[..., PictureSet], str]] = [
        (image_folder, "."), (yolo, "."), (texts, "texts"), (bdd, "bdd.json"), (coco, "coco.json"),
    ]  # fmt: skip
    monkeypatch.setattr(folder, "MAX_MEGAPIXELS", 1.3)
    for read, name in sources:
        (picture,) = read(tmp_path / name)
        assert picture.load().shape == (1000, 1300, 3)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    monkeypatch.setattr(folder, "MAX_MEGAPIXELS", 1.29)
    for read, name in sources:
        (picture,) = read(tmp_path / name)
        with pytest.raises(UnreadablePicture, match=r"a\.png: 1300 x 1000 px, 1 megapixels; must be at most"):
            picture.load()


@pytest.mark.parametrize("orientation", [1, 6])
def test_labels_are_for_the_upright_picture(tmp_path: Path, orientation: int) -> None:
    saved(tmp_path / "a.jpg", pixels((21, 33, 3)), orientation)
    width, height = (21, 33) if orientation > 4 else (33, 21)
    other = {"width": height, "height": width}
    for size in ({}, {"width": width, "height": height}, other):
        frames = [{"name": "a.jpg", "size": size, "labels": []}]
        images = [{"id": 1, "file_name": "a.jpg", **size}]
        document = {"images": images, "categories": [], "annotations": []}
        (tmp_path / "bdd.json").write_text(str(frames).replace("'", '"'))
        (tmp_path / "coco.json").write_text(str(document).replace("'", '"'))
        for (picture,) in (bdd(tmp_path / "bdd.json"), coco(tmp_path / "coco.json")):
            if size is not other:
                assert picture.load().shape == (height, width, 3)
                continue
            said = rf"a\.jpg: {width} x {height} px .* labels are for {height} x {width}$"
            with pytest.raises(UnreadablePicture, match=said):
                picture.load()


@pytest.mark.parametrize(
    ("name", "dtype", "fault"),
    [
        ("picture", np.uint8, "suffix"),
        ("picture.foo", np.uint8, "suffix"),
        ("picture.jpg", np.uint16, "16 bits"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path: Path, name: str, dtype: type, fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        write_picture(tmp_path / name, pixels((4, 4), dtype))
    assert not list(tmp_path.iterdir())


def test_a_folder_is_read_in_order_and_below(tmp_path: Path) -> None:
    """What is no file is passed: a circle of folders, links to nowhere."""
    (tmp_path / "sub").mkdir()
    for name in ("b.png", "a.JPG", "sub/<c>.tiff"):
        write_picture(tmp_path / name, pixels((4, 6, 3)))
    (tmp_path / "notes.txt").write_text("no picture")
    (tmp_path / "empty.png").write_bytes(b"")
    (tmp_path / "link.png").symlink_to(tmp_path / "b.png")
    (tmp_path / "loop.png").symlink_to(tmp_path / "loop.png")
    (tmp_path / "again").symlink_to(tmp_path)
    found = image_folder(tmp_path)
    names = ["a.JPG", "b.png", "empty.png", "link.png", "sub/<c>.tiff"]
    assert [(picture.image_id, picture.name) for picture in found] == list(enumerate(names, start=1))
    assert all(picture.targets is None for picture in found)
    assert found.pictures[3].load().shape == (4, 6, 3)
    with pytest.raises(UnreadablePicture, match="0 bytes"):
        found.pictures[2].load()
    before = [picture.identity for picture in found]
    assert [picture.identity for picture in image_folder(tmp_path)] == before
    write_picture(tmp_path / "b.png", pixels((9, 9)))
    assert [picture.identity for picture in image_folder(tmp_path)][1] != before[1]


def test_missing_and_empty_folders(tmp_path: Path) -> None:
    (tmp_path / "file.png").write_bytes(b"x")
    (tmp_path / "empty").mkdir()
    for name, fault in (
        ("nothing", "no such folder"),
        ("file.png", "no such folder"),
        ("empty", "holds no picture"),
    ):
        with pytest.raises(ValueError, match=fault):
            image_folder(tmp_path / name)


def test_name_that_is_no_utf8_can_be_stored(tmp_path: Path) -> None:
    try:
        (tmp_path / os.fsdecode(b"caf\xe9.png")).write_bytes(b"")
    except OSError:
        pytest.skip("this file system takes only UTF-8")
    (picture,) = image_folder(tmp_path)
    assert picture.name.encode("utf-8") == b"caf\\udce9.png"
    with pytest.raises(UnreadablePicture, match="0 bytes"):
        picture.load()


def test_names_are_unique_and_annotations_change_no_target() -> None:
    """Runs are told apart by their targets: what a file says beside them is no difference."""
    picture = rendered_signs([50]).pictures[0]
    with pytest.raises(ValueError, match=r"folder = 'here': lists 'stop-signs-50px-01' twice"):
        PictureSet("folder", "here", (picture, picture))
    plain = Target("sign", "signs", (0.0, 0.0, 1.0, 1.0))
    annotated = replace(plain, annotation={"segmentation": [[1, 2]]})
    assert (plain, repr(plain), hash(plain)) == (annotated, repr(annotated), hash(annotated))
    assert replace(plain, crowd=True) != plain != replace(plain, text="STOP")


@pytest.mark.parametrize(
    ("width", "height", "group"),
    [(31, 33, "small"), (32, 32, "medium"), (16, 64, "medium"), (95, 97, "medium"), (96, 96, "large")],
)
def test_size_groups_follow_the_area(width: float, height: float, group: str) -> None:
    assert size_group(width, height, "sign").startswith(f"sign, {group}")


# --- linear light from OpenEXR files ---


@pytest.mark.parametrize(
    ("channels", "fault"),
    [
        ({"RGB": 1.0, "Z": 0.0}, None),
        ({"Y": 1.0}, None),
        ({"Z": 1.0}, "must have R, G, B or Y"),
        ({"Y": -1.0}, "negative or not finite"),
    ],
)
def test_light_of_openexr(
    tmp_path: Path, channels: dict[str, float], fault: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    openexr = pytest.importorskip("OpenEXR")
    light = np.random.default_rng(3).uniform(0, 60, (7, 11, 3)).astype(np.float16)
    planes = {name: gain * (light if name == "RGB" else light[..., 0]) for name, gain in channels.items()}
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    path = tmp_path / "a.exr"
    openexr.File(header, {name: plane.astype(np.float16) for name, plane in planes.items()}).write(str(path))
    if fault is None:
        expected = light if "RGB" in channels else light[..., 0]
        np.testing.assert_array_equal(decode_linear(path), expected.astype(np.float32))
        with monkeypatch.context() as patch:
            patch.setattr(images, "MOST_MEGAPIXELS", 1e-5)
            with pytest.raises(UnreadablePicture, match="11 x 7 px"):
                decode_linear(path)
        path.write_bytes(path.read_bytes()[:200])
        fault = r"a\.exr"
    with pytest.raises(UnreadablePicture, match=fault):
        decode_linear(path)
