"""BDD100K's detection labels."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.datasets import bdd, write_picture

BOX = {"x1": 10, "y1": 20, "x2": 40.5, "y2": 60}


def frames() -> list[dict[str, Any]]:
    """Four frames: two boxes and a lane; nothing, in three ways of saying it."""
    return [
        {
            "name": "b1c6.jpg",
            "attributes": {"weather": "rainy"},
            "labels": [
                {"id": "4", "category": "traffic sign", "box2d": BOX, "attributes": {"occluded": False}},
                {"category": "lane/road curb", "poly2d": [{"vertices": [[1, 2]]}]},
                {"category": "person", "box2d": {**BOX, "x1": 0}, "attributes": {"crowd": True}},
            ],
        },
        {"name": "day/a.jpg", "labels": None},
        {"name": "day/b.jpg"},
        {"name": "day/c.jpg", "labels": []},
    ]


def write(path: Path, data: object) -> Path:
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


@pytest.mark.parametrize("wrapped", [False, True])
def test_boxes_become_targets_under_their_own_names(tmp_path: Path, wrapped: bool) -> None:
    found = bdd(write(tmp_path / "det.json", {"frames": frames()} if wrapped else frames()))
    assert [picture.name for picture in found] == ["b1c6.jpg", "day/a.jpg", "day/b.jpg", "day/c.jpg"]
    assert [picture.image_id for picture in found] == [1, 2, 3, 4]
    assert (found.kind, found.categories, found.notes) == ("bdd", {"person": 1, "traffic sign": 2}, ())
    sign, person = found.pictures[0].targets or ()
    assert (sign.label, sign.box_xyxy, sign.crowd) == ("traffic sign", (10.0, 20.0, 40.5, 60.0), False)
    assert sign.annotation == {"attributes": {"occluded": False}}
    assert (person.label, person.crowd) == ("person", True)
    assert [picture.targets for picture in found.pictures[1:]] == [(), (), ()]


def test_pictures_lie_beside_the_file_or_elsewhere(tmp_path: Path) -> None:
    write_picture(tmp_path / "b1c6.jpg", np.zeros((8, 9, 3), np.uint8))
    (tmp_path / "labels").mkdir()
    file = write(tmp_path / "labels" / "det.json", frames()[:1])
    assert bdd(file, images=tmp_path).pictures[0].load().shape == (8, 9, 3)


def test_labels_choose_pictures(tmp_path: Path) -> None:
    file = write(tmp_path / "det.json", frames())
    (picture,) = bdd(file, labels=["traffic sign"])
    assert [target.group for target in picture.targets or ()] == ["traffic sign, medium (32-96 px)"]
    assert len(bdd(file, labels=["traffic sign"], keep_empty=True)) == 4
    with pytest.raises(
        ValueError, match=r"\['stop sign'\]: not among the categories \['person', 'traffic sign'\]"
    ):
        bdd(file, labels=["stop sign"])
    with pytest.raises(ValueError, match="lists no pictures with"):  # only a crowd of it
        bdd(file, labels=["person"])


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        ({}, "frames = None: must be a list"),
        ({"frames": 3}, "frames = 3"),
        ([3], r"frames\[0\] = 3: must be an object"),
        ([{}], r"frames\[0\]: has no 'name'"),
        ([{"name": None}], "name = None: must be text"),
        ([{"name": "../a.jpg"}], "leaves the folder"),
        ([{"name": "C:\\a.jpg"}], "leaves the folder"),
        ([{"name": "a.jpg"}, {"name": "./a.jpg"}], r"lists 'a\.jpg' twice"),
        ([{"name": "a.jpg", "labels": {"0": 1}}], r"frames\[0\]: labels = .*must be a list"),
        ([{"name": "a.jpg", "labels": [{"box2d": 5}]}], r"labels\[0\]: box2d = 5: must be an object"),
        ([{"name": "a.jpg", "labels": [{"box2d": {"x1": 1}}]}], r"labels\[0\]: box2d: has no 'y1'"),
        ([{"name": "a.jpg", "labels": [{"box2d": {**BOX, "x2": "9"}}]}], "x2 = '9': must be a number"),
        ([{"name": "a.jpg", "labels": [{"box2d": BOX}]}], "has no 'category'"),
        ([{"name": "a.jpg", "labels": [{"box2d": BOX, "category": 3}]}], "category = 3: must be text"),
        ([{"name": "a.jpg", "size": 3}], r"frames\[0\]: size = 3: must be an object"),
        ([{"name": "a.jpg", "size": {"width": 3}}], "has no 'height'"),
        ([], "lists no pictures"),
    ],
)
def test_what_is_no_bdd_file_is_named(tmp_path: Path, data: object, fault: str) -> None:
    with pytest.raises(ValueError, match=rf"bdd = '.*det\.json': .*{fault}"):
        bdd(write(tmp_path / "det.json", data))
