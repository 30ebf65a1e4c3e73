"""COCO's instances files, whole, hostile and broken."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.datasets import UnreadablePicture, coco, write_picture

ANNOTATION = {"image_id": 7, "category_id": 13, "bbox": [1, 2, 3, 4]}


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
    assert ([picture.image_id for picture in found], found.categories) == (
        [7, 8, 9],
        {"stop sign": 13, "person": 1},
    )
    assert a.targets is not None
    assert [(target.label, target.box_xyxy, target.crowd) for target in a.targets] == [
        ("stop sign", (10.0, 20.0, 40.0, 60.5), False),
        ("person", (0.0, 0.0, 100.0, 200.0), False),
        ("person", (0.0, 0.0, 50.0, 50.0), True),
    ]
    assert [target.group for target in a.targets] == [
        "objects, medium (32-96 px)",
        "objects, large (> 96 px)",
        "objects, medium (32-96 px)",
    ]
    assert b.targets == ()  # annotated as holding nothing, which differs from not annotated
    assert c.targets is not None
    assert c.targets[0].group == "objects, small (< 32 px)"
    assert found.notes == ("2 boxes of no area left out",)


def test_coco_keeps_what_an_annotation_says(tmp_path: Path) -> None:
    beside = {"segmentation": [[1, 2, 4, 2, 4, 6]], "score": 0.5, "iscrowd": 0, "area": 6}
    ids = [5, 5, 0, "x", 2**70, 6]  # of which pycocotools could not use five in one file
    entries = [{**ANNOTATION, **beside, "id": entry_id} for entry_id in ids]
    file = write(tmp_path / "instances.json", instances(annotations=[*entries, ANNOTATION]))
    targets = coco(file).pictures[0].targets
    assert targets is not None
    assert [dict(target.annotation) for target in targets] == [
        {**beside, "id": 5}, beside, beside, beside, beside, {**beside, "id": 6}, {},
    ]  # fmt: skip
    assert [target.area_px2 for target in targets] == [6.0] * 6 + [None]


def test_coco_notes_what_it_has_twice(tmp_path: Path) -> None:
    categories = [{"id": 13, "name": "stop sign"}, {"id": 1, "name": "person"}, {"id": 5, "name": "person"}]
    entries = [{**ANNOTATION, "id": entry_id} for entry_id in (1, 2, 2, 2)]
    data = instances(categories=categories, annotations=entries)
    assert coco(write(tmp_path / "instances.json", data)).notes == (
        "2 boxes with the id of another (its own is a new one)",
        "1 name stands for several classes, which count as one (first: 'person')",
    )


def test_coco_boxes_that_cannot_be_found_are_counted(tmp_path: Path) -> None:
    """In a picture of 100 x 80 px: four beyond its sides, three across them, two of no number or size."""
    outside = [[100, 0, 5, 5], [-5, 0, 5, 5], [0, 80, 5, 5], [0, -9, 5, 5]]
    across = [[99, 0, 5, 5], [-4.5, -4.5, 5, 5], [0, 79.5, 500, 500]]
    odd = [[1, 2, float("nan"), 4], [float("-inf"), 2, float("inf"), 4], [1, 2, 10**400, 4], [1, 2, -3, 4]]
    entries = [{**ANNOTATION, "bbox": box} for box in (*outside, *across, *odd)]
    file = write(
        tmp_path / "instances.json",
        instances(
            images=[{"id": 7, "file_name": "a.png", "width": 100, "height": 80}],
            annotations=[*entries, {**ANNOTATION, "image_id": 99}],
        ),
    )
    found = coco(file)
    x0_y0 = [target.box_xyxy[:2] for target in found.pictures[0].targets or ()]
    assert x0_y0 == [(99.0, 0.0), (-4.5, -4.5), (0.0, 79.5)]
    assert found.notes == (
        "4 boxes outside the picture left out",
        "3 boxes with numbers that are not finite left out",
        "1 box of no area left out",
        "1 box of pictures that are not listed left out",
    )
    for size in (
        {},
        {"width": None, "height": None},
        {"width": 0, "height": 0},
    ):  # unknown: nothing is outside
        images = [{"id": 7, "file_name": "a.png", **size}]
        file = write(tmp_path / "instances.json", instances(images=images, annotations=entries))
        assert len(coco(file).pictures[0].targets or ()) == 7


def test_coco_labels_choose_pictures_and_name_groups(tmp_path: Path) -> None:
    found = coco(write(tmp_path / "instances.json", instances()), labels=["stop sign"])
    assert [picture.name for picture in found] == ["a.png", "sub/c.png"]
    assert [target.group for picture in found for target in picture.targets or ()] == [
        "stop sign, medium (32-96 px)",
        "stop sign, small (< 32 px)",
    ]


def test_coco_crowds_alone_are_no_reason_to_look(tmp_path: Path) -> None:
    crowd = {**ANNOTATION, "image_id": 8, "iscrowd": 1}
    file = write(tmp_path / "instances.json", instances(annotations=[ANNOTATION, crowd]))
    assert [picture.name for picture in coco(file, labels=["stop sign"])] == ["a.png"]
    kept = coco(file, labels=["stop sign"], keep_empty=True)
    assert [target.crowd for target in kept.pictures[1].targets or ()] == [True]


def test_coco_pictures_may_lie_elsewhere_or_be_missing(tmp_path: Path) -> None:
    (tmp_path / "pictures" / "sub").mkdir(parents=True)
    write_picture(tmp_path / "real.png", np.zeros((4, 4), np.uint8))
    (tmp_path / "pictures" / "a.png").symlink_to(tmp_path / "real.png")  # as subsets of COCO are made
    found = coco(write(tmp_path / "instances.json", instances()), images=tmp_path / "pictures")
    assert found.pictures[0].load().shape == (4, 4, 3)
    with pytest.raises(UnreadablePicture, match=r"b\.png.*No such file"):
        found.pictures[1].load()


@pytest.mark.parametrize(
    "name",
    [
        "../secret.png",
        "sub/../../secret.png",
        "/etc/passwd",
        "//server/share",
        "..",
        "sub/../../x/../secret.png",
        "C:/secret.png",
        "c:secret.png",
        "..\\secret.png",
        "sub\\a.png",
        "\\\\server\\share",
        "a\0.png",
        "",
        ".",
        "sub/..",
    ],
)
def test_coco_file_names_stay_in_the_folder(tmp_path: Path, name: str) -> None:
    file = write(tmp_path / "instances.json", instances(images=[{"id": 7, "file_name": name}]))
    with pytest.raises(
        ValueError, match=re.escape(f"images[0]: file name {name!r} leaves the folder")
    ) as caught:
        coco(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        ("", "not a COCO instances file"),
        ("{ no json", "not a COCO instances file"),
        ("[" * 100_000, "nested too deeply"),
        ('{"images": ' * 100_000, "nested too deeply"),
        (json.dumps(instances())[:-20], "not a COCO instances file"),
        ("1" * 10_000, "not a COCO instances file"),
        ("[]", "must be an object with annotations, categories, images"),
        ("null", "must be an object"),
        ("{}", "must be an object"),
        (instances(annotations=None), "annotations = None: must be a list"),
        (instances(images={"id": 1}), "images = .*: must be a list"),
        (instances(images=[{"id": 1}]), r"images\[0\]: has no 'file_name'"),
        (instances(images=[{"id": 1, "file_name": "\ud800.png"}]), "file_name = .*: must be text"),
        (instances(images=[{"id": 1, "file_name": 5}]), "file_name = 5: must be text"),
        (instances(images=[{"id": "seven", "file_name": "a.png"}]), "id = 'seven': must be a number"),
        (instances(images=[{"id": True, "file_name": "a.png"}]), "id = True"),
        (instances(images=[{"id": 1.5, "file_name": "a.png"}]), "id = 1.5: must be a whole number"),
        (instances(images=[{"id": 2**63, "file_name": "a.png"}]), "64 bits"),
        (instances(images=[{"id": 10**400, "file_name": "a.png"}]), "64 bits"),
        (instances(images=[{"id": float("inf"), "file_name": "a.png"}]), "whole number"),
        (instances(images=[{"id": 1, "file_name": "a.png", "width": "9", "height": 9}]), "width = '9'"),
        (
            instances(images=[{"id": 1, "file_name": "a.png"}, {"id": 1, "file_name": "b.png"}]),
            "images: id 1 twice",
        ),
        (instances(categories=[{"id": 13, "name": None}]), r"categories\[0\]: name = None: must be text"),
        (instances(categories=[{"id": 13, "name": "\ud800"}]), r"name = '\\ud800': must be text"),
        (instances(categories=[{"id": 1, "name": "a"}, {"id": 1, "name": "b"}]), "categories: id 1 twice"),
        (instances(annotations=["text"]), r"annotations\[0\] = 'text': must be an object"),
        (instances(annotations=[ANNOTATION, {**ANNOTATION, "bbox": [1, 2, 3]}]), r"annotations\[1\]: bbox"),
        (instances(annotations=[{**ANNOTATION, "bbox": {"x": 1}}]), "bbox = .*: must be "),
        (instances(annotations=[{**ANNOTATION, "bbox": [1, 2, "wide", 4]}]), r"bbox\[2\] = 'wide': must be a number"),
        (instances(annotations=[{**ANNOTATION, "bbox": [[]] * 4}]), "must be a number"),
        (instances(annotations=[{**ANNOTATION, "category_id": 99}]), "category_id = 99: not among"),
        (instances(annotations=[{**ANNOTATION, "category_id": [13]}]), "category_id"),
        (instances(annotations=[{**ANNOTATION, "area": "big"}]), "area = 'big'"),
        (instances(annotations=[{**ANNOTATION, "area": float("nan")}]), "area = nan"),
        (instances(annotations=[{**ANNOTATION, "area": -1}]), "area = -1"),
        (instances(annotations=[{"image_id": 7, "category_id": 13}]), "has no 'bbox'"),
    ],
)  # fmt: skip
def test_what_is_no_coco_file_is_named(tmp_path: Path, data: object, fault: str) -> None:
    with pytest.raises(ValueError, match=rf"coco = '.*instances\.json': .*{fault}") as caught:
        coco(write(tmp_path / "instances.json", data))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_coco_file_that_is_binary_missing_or_lists_nothing(tmp_path: Path) -> None:
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ValueError, match=r"binary\.json': not UTF-8"):
        coco(tmp_path / "binary.json")
    with pytest.raises(ValueError, match=r"nothing\.json'.*No such file"):
        coco(tmp_path / "nothing.json")
    with pytest.raises(ValueError, match=r"directory"):
        coco(tmp_path)
    with pytest.raises(ValueError, match="lists no pictures"):
        coco(write(tmp_path / "instances.json", instances(images=[], annotations=[])))


def test_unknown_class_is_told_with_the_known_ones(tmp_path: Path) -> None:
    file = write(tmp_path / "instances.json", instances())
    with pytest.raises(ValueError, match=r"\['zebra'\].*'person', 'stop sign'"):
        coco(file, labels=["stop sign", "zebra"])
    file = write(tmp_path / "instances.json", instances(annotations=[]))
    with pytest.raises(ValueError, match="lists no pictures with"):
        coco(file, labels=["stop sign"])
