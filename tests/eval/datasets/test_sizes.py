"""Sizes of pictures: those that labels are for, those that are too large, and what is under transparency."""

from __future__ import annotations

import json
import os
import struct
import zlib
from pathlib import Path
from typing import Any

import commands
import cv2
import numpy as np
import PIL.Image
import pytest
from blurnoise_eval.datasets import (
    PictureSet,
    UnreadablePicture,
    bdd,
    coco,
    decode,
    image_folder,
    size_px,
    texts,
    yolo,
)

ORIENTATION = 0x0112


def jpeg(path: Path, size_px: tuple[int, int], orientation: int = 1) -> None:
    exif = PIL.Image.Exif()
    exif[ORIENTATION] = orientation
    PIL.Image.new("RGB", size_px, (90, 120, 150)).save(path, exif=exif)


def of_coco(folder: Path, width: Any, height: Any) -> PictureSet:
    document = {
        "images": [{"id": 1, "file_name": "a.jpg", "width": width, "height": height}],
        "categories": [{"id": 1, "name": "sign"}],
        "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "bbox": [2, 3, 10, 11]}],
    }
    (folder / "coco.json").write_text(json.dumps(document))
    return coco(folder / "coco.json")


def of_bdd(folder: Path, width: Any, height: Any) -> PictureSet:
    frame = {"name": "a.jpg", "size": {"width": width, "height": height}, "labels": []}
    (folder / "bdd.json").write_text(json.dumps([frame]))
    return bdd(folder / "bdd.json")


@pytest.mark.parametrize("labelled", [of_coco, of_bdd])
@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_labels_are_for_the_upright_picture(tmp_path: Path, labelled: Any, orientation: int) -> None:
    jpeg(tmp_path / "a.jpg", (33, 21), orientation)
    upright = (21, 33) if orientation > 4 else (33, 21)
    (picture,) = labelled(tmp_path, *upright)
    assert picture.load().shape == (*upright[::-1], 3)
    (picture,) = labelled(tmp_path, *upright[::-1])
    width, height = upright
    with pytest.raises(
        UnreadablePicture, match=rf"a\.jpg: {width} x {height} px .* labels are for {height} x {width}$"
    ):
        picture.load()


@pytest.mark.parametrize("size_px", [(66, 42), (33, 22), (1e9, 21), (33.5, 21)])
def test_resized_pictures_are_named(tmp_path: Path, size_px: tuple[float, float]) -> None:
    jpeg(tmp_path / "a.jpg", (33, 21))
    for labelled in (of_coco, of_bdd):
        (picture,) = labelled(tmp_path, *size_px)
        with pytest.raises(UnreadablePicture, match="labels are for"):
            picture.load()


def test_labels_without_a_size_are_taken(tmp_path: Path) -> None:
    jpeg(tmp_path / "a.jpg", (33, 21), 6)
    (picture,) = of_coco(tmp_path, None, None)
    assert picture.load().shape == (33, 21, 3)
    (tmp_path / "bdd.json").write_text('[{"name": "a.jpg", "labels": []}]')
    (picture,) = bdd(tmp_path / "bdd.json")
    assert picture.load().shape == (33, 21, 3)


def huge_png(path: Path, width: int, height: int) -> None:
    """A sound grey PNG of zeros; its pixels are compressed to a thousandth."""
    packed, rows = zlib.compressobj(1), bytes(width + 1)
    data = b"".join(packed.compress(rows) for _ in range(height)) + packed.flush()

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")
    )


def test_a_limit_of_pixels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the header: nothing of such a picture is decoded."""
    huge_png(tmp_path / "a.png", 1300, 1000)
    (tmp_path / "classes.txt").write_text("sign\n")
    (tmp_path / "a.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    (tmp_path / "texts").write_text("a.png\tSTOP\n")
    (tmp_path / "bdd.json").write_text('[{"name": "a.png"}]')
    document = {"images": [{"id": 1, "file_name": "a.png"}], "categories": [], "annotations": []}
    (tmp_path / "coco.json").write_text(json.dumps(document))
    sources = [
        (image_folder, tmp_path),
        (yolo, tmp_path),
        (texts, tmp_path / "texts"),
        (bdd, tmp_path / "bdd.json"),
        (coco, tmp_path / "coco.json"),
    ]
    for read, path in sources:
        (picture,) = read(path, max_megapixels=1.3)
        assert picture.load().shape == (1000, 1300, 3)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    for read, path in sources:
        (picture,) = read(path, max_megapixels=1.29)
        with pytest.raises(UnreadablePicture, match=r"a\.png: 1300 x 1000 px, 1 megapixels; must be at most"):
            picture.load()


@pytest.mark.parametrize("side_px", [11_000, 20_000])
def test_a_huge_picture_is_named(tmp_path: Path, side_px: int) -> None:
    huge_png(tmp_path / "huge.png", side_px, side_px)
    (picture,) = image_folder(tmp_path)
    with pytest.raises(UnreadablePicture, match=r"huge\.png: .*megapixels"):
        picture.load()


@pytest.mark.slow
def test_a_sweep_goes_on_without_what_is_too_large_or_too_small(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, size in (("a", (1, 1)), ("b", (61, 47)), ("c", (1, 2)), ("d", (1100, 1000))):
        PIL.Image.new("RGB", size).save(tmp_path / f"{name}.png")
    grid = ["--exposure-ms", "10", "--lux", "50", "--dx", "200"]
    where = ["--images", str(tmp_path), "-o", str(tmp_path / "run"), "--max-megapixels", "1", "--json"]
    assert commands.main(["sweep", *where, *grid]) == 0
    done = json.loads(capsys.readouterr().out)
    assert [each["image"] for each in done["skipped"]] == ["a.png", "d.png"]
    assert done["cells"] == 4


@pytest.mark.parametrize("given", ["0", "-1", "nan", "179", "1e9"])
def test_a_limit_of_pixels_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], given: str
) -> None:
    assert commands.main(["sweep", "-o", str(tmp_path / "run"), "--max-megapixels", given]) == 2
    assert "max_megapixels" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


COLOUR = (200, 100, 50)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("a.png", {}),
        ("a.webp", {"lossless": True, "exact": True}),
        ("a.tif", {}),
        ("lzw.tif", {"compression": "tiff_lzw"}),
    ],
)
@pytest.mark.parametrize("alpha", [0, 64, 255])
def test_colours_are_those_under_the_transparency(
    tmp_path: Path, name: str, options: dict[str, Any], alpha: int
) -> None:
    pixels = np.full((5, 7, 4), (*COLOUR, alpha), np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / name, **options)
    seen = decode(tmp_path / name)
    assert seen.shape == (5, 7, 3)
    assert (seen == COLOUR).all()


@pytest.mark.parametrize("compression", ["raw", "tiff_lzw"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_turned_tiff_with_transparency(tmp_path: Path, orientation: int, compression: str) -> None:
    """Turned as OpenCV turns an opaque one, whose colours nothing multiplies."""
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 4), np.uint8)
    exif = PIL.Image.Exif()
    exif[ORIENTATION] = orientation
    for name, alpha in (("opaque.tif", 255), ("sheer.tif", 64)):
        pixels[..., 3] = alpha
        PIL.Image.fromarray(pixels).save(tmp_path / name, exif=exif, compression=compression)
    opaque = cv2.imdecode(np.fromfile(tmp_path / "opaque.tif", np.uint8), cv2.IMREAD_ANYCOLOR)
    assert opaque is not None
    assert np.array_equal(decode(tmp_path / "sheer.tif"), opaque[..., ::-1])
    assert size_px(tmp_path / "sheer.tif") == opaque.shape[1::-1]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes")
def test_pipes_are_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "a.txt"
    os.mkfifo(pipe)
    (tmp_path / "classes.txt").write_text("sign\n")
    PIL.Image.new("RGB", (9, 7)).save(tmp_path / "a.png")
    for read in (coco, bdd, texts):
        with pytest.raises(ValueError, match=r"a\.txt.*pipe, no file"):
            read(pipe)
    with pytest.raises(ValueError, match=r"a\.txt.*pipe, no file"):
        yolo(tmp_path)
    with pytest.raises(ValueError, match=r"a\.txt.*pipe, no file"):
        yolo(pipe)
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "texts").write_text("pipe.png\tSTOP\n")
    (picture,) = texts(tmp_path / "texts")
    with pytest.raises(UnreadablePicture, match="pipe, no file"):
        picture.load()


def test_a_limit_of_boxes(tmp_path: Path) -> None:
    """Each box is a row in every cell: beyond the limit a sweep would not end."""
    (tmp_path / "classes.txt").write_text("sign\n")
    PIL.Image.new("RGB", (9, 7)).save(tmp_path / "a.png")
    (tmp_path / "a.txt").write_text("0 0.5 0.5 0.5 0.5\n" * 20_000)
    (picture,) = yolo(tmp_path)
    assert len(picture.targets or ()) == 20_000
    (tmp_path / "a.txt").write_text("0 0.5 0.5 0.5 0.5\n" * 20_001)
    with pytest.raises(ValueError, match=r"picture 'a\.png': 20001 boxes; must be at most 20000"):
        yolo(tmp_path)
