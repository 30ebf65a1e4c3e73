"""Label files that are almost right, or nothing at all: pictures come of them, or one line that says why not."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from blurnoise_eval.datasets import PictureSet, bdd, coco, texts, write_picture, yolo

Read = Callable[..., PictureSet]
IMAGE = {"id": 7, "file_name": "a.png", "width": 9, "height": 9}
SIGN = {"id": 1, "name": "sign"}
ANNOTATION = {"id": 1, "image_id": 7, "category_id": 1, "bbox": [1, 2, 3, 4], "area": 9, "iscrowd": 0}
COCO: Any = {"images": [IMAGE], "categories": [SIGN], "annotations": [ANNOTATION]}
TEXTS = [{"transcription": "STOP", "points": [[1, 2], [3, 2], [3, 4], [1, 4]]}]
LINE = "0 0.5 0.5 0.5 0.5\n"


def of_coco(part: str, **change: Any) -> dict[str, Any]:
    return {**COCO, part: [{**COCO[part][0], **change}]}


def of_text(**change: Any) -> str:
    return f"a.png\t{json.dumps([{**TEXTS[0], **change}])}"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_picture(tmp_path / "a.png", np.zeros((9, 9), np.uint8))
    (tmp_path / "classes.txt").write_text("sign\ncar\n")
    return tmp_path


@pytest.mark.parametrize(
    ("read", "content", "fault"),
    [
        (coco, "", "not a COCO instances file"),
        (coco, {}, "has no 'images'"),
        (coco, {**COCO, "images": [IMAGE, IMAGE]}, "images: id 7 twice"),
        (coco, {**COCO, "images": [{"id": 1}]}, r"images\[0\]: has no 'file_name'"),
        (coco, {**COCO, "images": [], "annotations": []}, "lists no pictures"),
        (coco, of_coco("images", file_name="\ud800.png"), r"images\[0\]: file_name = .*: must be a valid string"),
        (coco, of_coco("images", file_name="sub/../../secret.png"), "leaves the folder"),
        (coco, of_coco("categories", name=None), r"categories\[0\]: name = None: must be a valid string"),
        (coco, of_coco("annotations", bbox=[1, 2, 3]), r"annotations\[0\]: bbox = \[1, 2, 3\]: must have at least 4"),
        (coco, of_coco("annotations", category_id=99), r"annotations\[0\]: category_id = 99: not among"),
        (bdd, {}, "frames = None: must be a list"),
        (bdd, [{"name": "a.jpg"}, {"name": "./a.jpg"}], r"lists 'a\.jpg' twice"),
        (bdd, [{"name": "a.jpg", "labels": [{"box2d": {"x1": 1}}]}], r"labels\[0\]: box2d: has no 'y1'"),
        (texts, "a.png STOP", "line 1: 'a.png STOP': must be a picture's name, a tab and its text"),
        (texts, "a.png\tA\n./a.png\tB", r"lists 'a\.png' twice"),
        (texts, f"{of_text()}\nb.png\tB", "line 2: not a list of texts and points"),
        (texts, of_text(transcription=5), r"texts\[0\]: transcription = 5: must be a valid string"),
        (texts, of_text(points=[[1, 2]]), r"points = \[\[1, 2\]\]: must have at least 2 items"),
    ],
)  # fmt: skip
def test_the_fault_is_named(folder: Path, read: Read, content: Any, fault: str) -> None:
    file = folder / "labels"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    name = "text" if read is texts else read.__name__
    with pytest.raises(ValueError, match=rf"^{name} = '.*labels': .*{fault}") as caught:
        read(file)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("0 0.5 0.5 0.5", "must be 'class x y width height' or"),
        ("2 0.5 0.5 0.5 0.5", "class 2: not among the 2 names"),
        ("0 320 240 50 60", "no pixels"),
    ],
)
def test_a_bad_line_of_yolo_is_named(folder: Path, line: str, fault: str) -> None:
    (folder / "a.txt").write_text(f"{LINE}\n{line}\n")
    with pytest.raises(ValueError, match=rf"yolo = .*a\.txt': line 3: .*{fault}") as caught:
        yolo(folder)
    assert "\n" not in str(caught.value)


def described(**entries: object) -> str:
    return yaml.safe_dump({"names": ["sign"], **entries})


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (None, "holds neither data.yaml nor classes.txt"),
        ("names: [", "while parsing"),
        ("!!python/object:os.system {}", "constructor"),
        ("val: images", "has no 'names'"),
        ("names: {zero: sign}", "names: zero: .*must be a valid integer"),
        (
            "names: [yes, no]",
            r"names\[0\] = True: must be a valid string",
        ),  # which YAML takes for truth values
        (described(val="missing"), "missing': no such folder or list"),
        (described(val="list.txt"), r"list\.txt': line 1: .*leaves the folder"),
        (described(val="."), "no label file for any of 1 pictures"),
        (described(kpt_shape=[17, 3]), "poses"),
    ],
)
def test_what_is_no_data_set_of_yolo_is_named(folder: Path, content: str | None, fault: str) -> None:
    (folder / "list.txt").write_text("../secret.png")
    (folder / "twice.txt").write_text("a.png\n./a.png")
    (folder / "classes.txt").unlink()
    if content is not None:
        (folder / "data.yaml").write_text(content)
    if "twice" in str(content):
        (folder / "a.txt").write_text(LINE)
    with pytest.raises(ValueError, match=rf"yolo = .*{fault}") as caught:
        yolo(folder)
    assert "\n" not in str(caught.value)


def test_files_that_are_none(folder: Path) -> None:
    (folder / "binary").write_bytes(b"\xff\xfe\x00\x01")
    os.mkfifo(folder / "pipe")
    faults = {"binary": "not UTF-8", "nothing": "No such file", ".": "directory", "pipe": "pipe, no file"}
    for read in (coco, bdd, texts, yolo):
        for name, fault in faults.items():
            if (read, name) != (yolo, "."):
                with pytest.raises(ValueError, match=f"{name.strip('.')}'.*{fault}"):
                    read(folder / name)
    with pytest.raises(ValueError, match="split 'test' = None"):
        yolo(folder, split="test")


# --- anything in any place ---
