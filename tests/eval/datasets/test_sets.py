"""Sets of every kind, as the options name them, in folders and by URL; what is missing, empty or new is told."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval import datasets
from blurnoise_eval.cli import inputs
from blurnoise_eval.datasets import PictureSet, UnreadablePicture
from blurnoise_eval.plan.files import PlanFile
from blurnoise_eval.system.urls import location

fsspec = pytest.importorskip("fsspec")
pytest.importorskip("upath")
URL = "memory://bucket/set"
NAMES = ("a.png", "sub/b c.png", "größe.jpg")
BOX = [3.0, 4.0, 10.0, 12.0]
Reader = Callable[[Any], PictureSet]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A set of every kind, here; :func:`put` makes it one at ``URL``."""
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "set"
    for seed, name in enumerate(NAMES):
        for root in ("images", "."):
            (folder / root / name).parent.mkdir(parents=True, exist_ok=True)
            pixels = np.random.default_rng(seed).integers(0, 256, (31, 42, 3), np.uint8)
            cv2.imwrite(str(folder / root / name), pixels)
    write_labels(folder)
    yield folder
    fsspec.filesystem("memory").store.clear()


def write_labels(folder):
    def write(name, text):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)

    coco = {
        "images": [{"id": n, "file_name": name, "width": 42, "height": 31} for n, name in enumerate(NAMES)],
        "categories": [{"id": 1, "name": "sign"}],
        "annotations": [{"id": n + 1, "image_id": n, "category_id": 1, "bbox": BOX} for n in range(3)],
    }
    write("coco.json", json.dumps(coco))
    box2d = {"x1": 3, "y1": 4, "x2": 13, "y2": 16}
    frames = [{"name": name, "labels": [{"category": "sign", "box2d": box2d}]} for name in NAMES]
    write("bdd.json", json.dumps(frames))
    write("data.yaml", "names: [sign]\nval: images\n")
    write("labels/a.txt", "0 0.5 0.5 0.2 0.2\n")
    write("labels/sub/b c.txt", "0 0.4 0.4 0.2 0.2\n0 0.5 0.5 0 0\n")
    points = json.dumps([{"transcription": "STOP", "points": [[3, 4], [13, 16]]}])
    write("places.txt", "".join(f"{name}\t{points}\n" for name in NAMES))
    write("whole.txt", "".join(f"{name}\tSTOP\n" for name in NAMES))


def put(folder):
    for file in folder.rglob("*"):
        if file.is_file():
            (location(URL) / file.relative_to(folder).as_posix()).write_bytes(file.read_bytes())


READERS: dict[str, Reader] = {
    "folder": lambda root: datasets.image_folder(f"{root}/images"),
    "coco": lambda root: datasets.coco(f"{root}/coco.json"),
    "coco, images": lambda root: datasets.coco(f"{root}/coco.json", images=f"{root}/images"),
    "bdd": lambda root: datasets.bdd(f"{root}/bdd.json"),
    "yolo": lambda root: datasets.yolo(f"{root}/data.yaml"),
    "yolo, folder": lambda root: datasets.yolo(f"{root}"),
    "yolo, images": lambda root: datasets.yolo(f"{root}", images=f"{root}/images/sub"),
    "text, places": lambda root: datasets.texts(f"{root}/places.txt"),
    "text, whole": lambda root: datasets.texts(f"{root}/whole.txt"),
}


@pytest.mark.parametrize("read", READERS.values(), ids=list(READERS))
def test_as_of_a_folder(read, folder):
    """Named by text, here and there; another version is another identity."""
    put(folder)
    here, there = read(folder), read(URL)
    assert (there.kind, there.categories, there.notes) == (here.kind, here.categories, here.notes)
    assert there.source == here.source.replace(str(folder), URL)
    assert len(there) >= 1
    for own, other in zip(here, there, strict=True):
        assert (other.name, other.targets, other.image_id) == (own.name, own.targets, own.image_id)
        travelled = pickle.loads(pickle.dumps(other))
        assert np.array_equal(travelled.load(), own.load())
        assert travelled.identity == other.identity
    before = [picture.identity for picture in there]
    assert [picture.identity for picture in read(URL)] == before
    put(folder)
    assert not {picture.identity for picture in read(URL)} & set(before)


def test_pictures_that_cannot_be_read(folder):
    put(folder)
    root = location(URL)
    (root / "a.png").unlink()
    (root / "größe.jpg").write_bytes(b"")
    found = datasets.coco(root / "coco.json")
    told = []
    for picture in found:
        try:
            picture.load()
        except UnreadablePicture as error:
            told.append(str(error))
    assert told == [f"{URL}/a.png: no such object, folder or bucket", f"{URL}/größe.jpg: is empty (0 bytes)"]


# --- as options ---


def chosen(*, reads=False, **settings):
    """What a sweep with these settings would see. Raises what the choice raises."""
    stated = {name: str(value) if isinstance(value, Path) else value for name, value in settings.items()}
    return inputs.pictures(PlanFile.of(stated), reads=reads)


FILES = {"coco": "coco.json", "bdd": "bdd.json", "yolo": "data.yaml", "text": "whole.txt"}


@pytest.mark.parametrize("kind", FILES)
def test_each_kind_is_recognised_and_read(kind, folder):
    found = chosen(labels=folder / FILES[kind], images=folder / "images")
    assert (found.kind, {picture.name for picture in found}) == (kind, set(NAMES))
    assert found.pictures[0].load().shape == (31, 42, 3)
    limited = chosen(labels=folder / FILES[kind], images=folder / "images", limit=1)
    assert (len(limited), limited.categories) == (1, found.categories)


def test_without_labels(folder):
    assert chosen(images=folder / "images").kind == "folder"
    assert [target.label for each in chosen() for target in each.targets or ()] == ["stop sign"] * 60
    assert [target.text for each in chosen(reads=True) for target in each.targets or ()] == ["STOP"] * 60


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        ({"target": "sign"}, "target: needs labels"),
        ({"labels": "a.txt", "target": "sign"}, "target: needs labels"),
        ({"labels": "a.json", "reads": True}, "PP-OCR labels"),
        ({"limit": 0}, "limit = 0: must be >= 1"),
        ({"images": ""}, "images = '': must be the name of a file or folder"),
    ],
)
def test_settings_that_do_not_go_together(settings, fault):
    with pytest.raises(ValueError, match=fault):
        chosen(**settings)
