"""YOLO's text labels: layouts, lines, and what can be wrong with either."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import yaml
from blurnoise_eval.datasets import Target, write_picture, yolo

NAMES = {0: "sign", 1: "<b>car</b>"}


def make(root: Path, files: Mapping[str, str | tuple[int, int]]) -> Path:
    """Write a data set: text files, and pictures of (width, height) px."""
    for name, content in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, str):
            path.write_text(content, encoding="utf-8")
        else:
            write_picture(path, np.zeros((content[1], content[0], 3), np.uint8))
    return root


def described(**entries: object) -> str:
    return yaml.safe_dump({"names": NAMES, **entries})


def only(targets: tuple[Target, ...] | None) -> Target:
    assert targets is not None
    (target,) = targets
    return target


def test_shares_become_pixels(tmp_path: Path) -> None:
    """A box of 0.2 x 0.5 around (0.3, 0.5) of 200 x 80 px, and a triangle as the box around it."""
    make(
        tmp_path,
        {
            "data.yaml": described(val="images"),
            "images/a.png": (200, 80),
            "images/b.jpg": (64, 64),
            "labels/a.txt": "0 0.3 0.5 0.2 0.5\n\n1 0.5 0.25 0.75 0.5 0.625 0.75\r\n",
        },
    )
    found = yolo(tmp_path / "data.yaml")
    assert (found.kind, found.categories) == ("yolo", {"sign": 1, "<b>car</b>": 2})
    assert [(picture.image_id, picture.name) for picture in found] == [(1, "a.png"), (2, "b.jpg")]
    box, triangle = found.pictures[0].targets or ()
    assert (box.label, box.group) == ("sign", "objects, medium (32-96 px)")
    np.testing.assert_allclose(box.box_xyxy, (40, 20, 80, 60), atol=1e-9)
    assert triangle.label == "<b>car</b>"
    assert triangle.box_xyxy == (100.0, 20.0, 150.0, 60.0)
    assert found.pictures[1].targets == ()
    assert found.notes == ("without a label file, and so without an object: 1 of the pictures",)
    assert found.pictures[1].load().shape == (64, 64, 3)


def test_boxes_are_of_the_picture_as_it_is_shown(tmp_path: Path) -> None:
    """A file of 40 x 20 px, held upright: the left half of what is seen is 10 x 40 px."""
    make(tmp_path, {"data.yaml": described(val="images"), "labels/a.txt": "0 0.25 0.5 0.5 1\n"})
    (tmp_path / "images").mkdir()
    exif = PIL.Image.Exif()
    exif[0x0112] = 6
    PIL.Image.new("RGB", (40, 20)).save(tmp_path / "images" / "a.jpg", exif=exif)
    (picture,) = yolo(tmp_path)
    assert picture.load().shape == (40, 20, 3)
    assert only(picture.targets).box_xyxy == (0.0, 0.0, 10.0, 40.0)


LINE = "0 0.5 0.5 0.5 0.5\n"
LAYOUTS = {
    "coco8": {
        "data.yaml": described(path=".", train="images/train", val="images/val"),
        "images/train/t.png": (8, 8), "labels/train/t.txt": LINE,
        "images/val/v.png": (8, 8), "labels/val/v.txt": LINE,
    },
    "roboflow": {
        "data.yaml": described(train="../train/images", val="../valid/images", names=["sign", "car"]),
        "train/images/t.png": (8, 8), "train/labels/t.txt": LINE,
        "valid/images/v.png": (8, 8), "valid/labels/v.txt": LINE,
    },
    "darknet": {
        "data.yaml": described(path="set", train="train.txt", val="val.txt"),
        "set/train.txt": "images/t.png\n", "set/val.txt": "./images/v.png\n\n",
        "set/images/t.png": (8, 8), "set/labels/t.txt": LINE, "set/images/v.png": (8, 8), "set/labels/v.txt": LINE,
    },
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts(tmp_path: Path, layout: str) -> None:
    make(tmp_path, LAYOUTS[layout])
    for path in (tmp_path, tmp_path / "data.yaml"):
        for split, stem in ((None, "v"), ("val", "v"), ("train", "t")):
            (picture,) = yolo(path, split=split)
            assert Path(picture.name).stem == stem
            assert only(picture.targets).box_xyxy == (2.0, 2.0, 6.0, 6.0)
            assert picture.load().shape == (8, 8, 3)


@pytest.mark.parametrize(
    "files",
    [
        {"classes.txt": "sign\n", "images/sub/a.png": (8, 8), "labels/sub/a.txt": LINE},
        {"labels/classes.txt": "\ufeffsign\r\ncar\r\n", "images/sub/a.png": (8, 8), "labels/sub/a.txt": LINE},
        {"classes.txt": "sign\n", "sub/a.png": (8, 8), "sub/a.txt": LINE},
        {"classes.txt": "sign\n", "images/sub/a.png": (8, 8), "images/sub/a.txt": LINE},
        {"data.yaml": described(), "images/sub/a.png": (8, 8), "labels/sub/a.txt": LINE},
        {"data.yaml": described(val=["images/sub"]), "images/sub/a.png": (8, 8), "labels/sub/a.txt": LINE},
    ],
)
def test_folders(tmp_path: Path, files: Mapping[str, str | tuple[int, int]]) -> None:
    (picture,) = yolo(make(tmp_path, files))
    assert picture.name in ("sub/a.png", "a.png")
    assert only(picture.targets).label == "sign"


def test_pictures_may_lie_elsewhere_where_the_user_says_so(tmp_path: Path) -> None:
    make(tmp_path / "moved", {"images/a.png": (8, 8), "labels/a.txt": LINE})
    for path in ("/nowhere", "..", "../moved", f"{tmp_path}/../moved"):  # named by the file, not by the user
        make(tmp_path, {"data.yaml": described(path=path, val="images")})
        with pytest.raises(ValueError, match=r"leaves the folder .*--images"):
            yolo(tmp_path / "data.yaml")
    assert len(yolo(tmp_path / "data.yaml", images=tmp_path / "moved" / "images")) == 1
    make(tmp_path, {"data.yaml": described(path=str(tmp_path / "moved"), val="images")})
    assert len(yolo(tmp_path / "data.yaml")) == 1
