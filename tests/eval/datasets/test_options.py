"""How the sweep's options name pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.cli import given
from blurnoise_eval.datasets import PictureSet, write_picture
from blurnoise_eval.grid.plan_file import PlanFile


def chosen(*, reads: bool = False, **settings: Any) -> PictureSet:
    """What a sweep with these settings would see. Raises what the choice raises."""
    stated = {name: str(value) if isinstance(value, Path) else value for name, value in settings.items()}
    return given.pictures(PlanFile().stating(stated), reads=reads)


@pytest.fixture
def sets(tmp_path: Path) -> dict[str, Path]:
    """The same two pictures, the first with a sign, as every kind of set."""
    images = tmp_path / "images"
    images.mkdir()
    for name in ("a.png", "b.png"):
        write_picture(images / name, np.zeros((20, 20, 3), np.uint8))
    instances = {
        "images": [{"id": 1, "file_name": "a.png"}, {"id": 2, "file_name": "b.png"}],
        "categories": [{"id": 1, "name": "sign"}],
        "annotations": [{"image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4]}],
    }
    box = {"x1": 1, "y1": 2, "x2": 4, "y2": 6}
    frames = [{"name": "a.png", "labels": [{"category": "sign", "box2d": box}]}, {"name": "b.png"}]
    contents = {
        "coco": ("instances.json", json.dumps(instances)),
        "bdd": ("det.json", json.dumps(frames)),
        "text": ("gt.txt", "a.png\tSTOP\nb.png\tYIELD\n"),
        "yolo": ("data.yaml", "names: [sign]\nval: images\ntrain: none"),
    }
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "a.txt").write_text("0 0.5 0.5 0.5 0.5")
    for name, content in contents.values():
        (tmp_path / name).write_text(content)
    return {"images": images, **{kind: tmp_path / name for kind, (name, _) in contents.items()}}


@pytest.mark.parametrize("kind", ["coco", "bdd", "yolo", "text"])
def test_each_kind_is_recognised_and_read(sets: dict[str, Path], kind: str) -> None:
    found = chosen(labels=sets[kind], images=sets["images"])
    assert (found.kind, [picture.name for picture in found]) == (kind, ["a.png", "b.png"])
    assert found.pictures[1].load().shape == (20, 20, 3)
    limited = chosen(labels=sets[kind], images=sets["images"], limit=1)
    assert ([picture.name for picture in limited], limited.categories) == (["a.png"], found.categories)


def test_labels_are_told_apart_by_name_and_first_bytes(tmp_path: Path) -> None:
    for name, text, kind in (
        ("a.json", '{"info": 1}', "coco"), ("b.json", ' [{"name": "a.png"}]', "bdd"),
        ("c.json", '{"frames": []}', "bdd"), ("d", '{"images": []}', "coco"), ("e.txt", "a.png\tSTOP", "text"),
        ("f.yml", "names: []", "yolo"), ("missing.json", None, "coco"), ("missing.txt", None, "text"),
    ):  # fmt: skip
        if text is not None:
            (tmp_path / name).write_text(text)
        assert given.kind_of(tmp_path / name) == kind, name
    assert given.kind_of(tmp_path) == "yolo"


def test_without_labels(sets: dict[str, Path]) -> None:
    assert chosen(images=sets["images"]).kind == "folder"
    assert [target.label for each in chosen() for target in each.targets or ()] == ["stop sign"] * 60
    assert [target.text for each in chosen(reads=True) for target in each.targets or ()] == ["STOP"] * 60


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        ({"target": "sign"}, "target: goes with --labels of COCO, YOLO or BDD100K"),
        ({"labels": "a.txt", "target": "sign"}, "target: goes with --labels of COCO"),
        ({"labels": "a.json", "reads": True}, "take PP-OCR's labels"),
        ({"limit": 0}, "limit = 0: must be >= 1"),
        ({"images": ""}, "images = '': must name a file or folder"),
    ],
)
def test_settings_that_do_not_go_together(settings: Any, fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        chosen(**settings)


def test_notes_are_told(tmp_path: Path, sets: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    data = json.loads(sets["coco"].read_text())
    data["annotations"].append({**data["annotations"][0], "bbox": [0, 0, 0, 5]})
    (tmp_path / "instances.json").write_text(json.dumps(data))
    chosen(labels=tmp_path / "instances.json", images=sets["images"])
    assert "1 box of no area left out." in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(("name", "mebibytes"), [("coco", 2048), ("bdd", 2048), ("text", 2048), ("yolo", 64)])
def test_label_files_have_a_largest_size(sets: dict[str, Path], name: str, mebibytes: int) -> None:
    """Of holes alone, which take no room."""
    file = sets["images"].parent / "labels" / "a.txt" if name == "yolo" else sets[name]
    with file.open("wb") as huge:
        huge.truncate((mebibytes << 20) + 1)
    with pytest.raises(ValueError, match=f"larger than {mebibytes << 20} bytes"):
        chosen(labels=sets[name])
