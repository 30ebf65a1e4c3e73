"""Label files that are almost right, or nothing at all: pictures come of them, or one line that says why not."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.datasets import PictureSet, bdd, coco, texts, write_picture, yolo
from hypothesis import example, given, settings
from hypothesis import strategies as st

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=12,
)
COCO = {
    "images": [{"id": 7, "file_name": "a.png", "width": 9, "height": 9}],
    "categories": [{"id": 1, "name": "sign"}],
    "annotations": [
        {"id": 1, "image_id": 7, "category_id": 1, "bbox": [1, 2, 3, 4], "area": 9, "iscrowd": 0}
    ],
}
CORNERS = {"x1": 1, "y1": 2, "x2": 3, "y2": 4}
LABEL = {"id": 1, "category": "car", "box2d": CORNERS, "attributes": {"crowd": False}}
BDD = {"frames": [{"name": "a.png", "labels": [LABEL]}]}
TEXTS = [{"transcription": "STOP", "points": [[1, 2], [3, 2], [3, 4], [1, 4]]}]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile")
    write_picture(folder / "a.png", np.zeros((9, 9), np.uint8))
    (folder / "classes.txt").write_text("sign\n")
    return folder


def places(document: Any) -> list[tuple[Any, ...]]:
    """The paths to every part of a document, the whole first."""
    parts = document.items() if isinstance(document, dict) else enumerate(document)
    inner = ((key, path) for key, part in parts if isinstance(part, (dict, list)) for path in places(part))
    keys = document if isinstance(document, dict) else range(len(document))
    return [(), *((key,) for key in keys), *((key, *path) for key, path in inner if path)]


def replaced(document: Any, place: tuple[Any, ...], part: Any) -> Any:
    if not place:
        return part
    copy = document.copy()
    copy[place[0]] = replaced(document[place[0]], place[1:], part)
    return copy


def complaint(read: Callable[[Path], PictureSet], file: Path) -> str:
    """What ``read`` says against the file, as ValueError; nothing where it takes it."""
    try:
        pictures = read(file)
    except ValueError as error:
        return str(error)
    for picture in pictures:
        for target in picture.targets or ():
            x0, y0, x1, y1 = target.box_xyxy
            assert 0 < (x1 - x0) * (y1 - y0) < np.inf
    return ""


@pytest.mark.slow
@pytest.mark.parametrize(("read", "sound"), [(coco, COCO), (bdd, BDD)])
@given(data=st.data())
@settings(max_examples=400, deadline=None)
def test_json_with_anything_in_any_place(
    folder: Path, read: Callable[[Path], PictureSet], sound: Any, data: st.DataObject
) -> None:
    file = folder / "labels.json"
    file.write_text(json.dumps(sound))
    assert complaint(read, file) == ""
    place = data.draw(st.sampled_from(places(sound)))
    file.write_text(json.dumps(replaced(sound, place, data.draw(JSON))))
    said = complaint(read, file)
    assert not said or said.startswith(f"{read.__name__} = {str(file)!r}: ")
    assert "\n" not in said
    assert len(said) < 500


@pytest.mark.parametrize("read", [coco, bdd, texts])
@given(content=st.binary(max_size=40))
@example(content=b"")
@example(content=b"\xef\xbb\xbf")
@example(content=b"\xff")
@example(content=b"[" * 10_000)
@example(content=b'a.png\t[{"a": ' + b"[" * 10_000)
@settings(max_examples=60, deadline=None)
def test_files_of_any_bytes(folder: Path, read: Callable[[Path], PictureSet], content: bytes) -> None:
    file = folder / "bytes"
    file.write_bytes(content)
    said = complaint(read, file)
    assert said.startswith(f"{'text' if read is texts else read.__name__} = {str(file)!r}: ") or read is texts
    assert "\n" not in said


@given(data=st.data())
@settings(max_examples=200, deadline=None)
def test_text_lines_with_anything_in_any_place(folder: Path, data: st.DataObject) -> None:
    file = folder / "texts.txt"
    place = data.draw(st.sampled_from(places(TEXTS)[1:]))
    file.write_text(f"a.png\t{json.dumps(replaced(TEXTS, place, data.draw(JSON)))}\n")
    said = complaint(texts, file)
    assert not said or said.startswith(f"text = {str(file)!r}: line 1: ")
    assert "\n" not in said


@pytest.mark.slow
@given(
    line=st.lists(st.floats(width=16).map(str) | st.just("0") | st.text(max_size=3), max_size=9).map(" ".join)
)
@example(line="0 nan inf 0.1 0.1")
@settings(max_examples=200, deadline=None)
def test_yolo_lines_of_anything(folder: Path, line: str) -> None:
    (folder / "a.txt").write_text(line, encoding="utf-8", errors="replace")
    said = complaint(yolo, folder)
    assert not said or said.startswith(f"yolo = {str(folder)!r}: labels = {str(folder / 'a.txt')!r}: ")
    assert "\n" not in said


@pytest.mark.parametrize(
    "content",
    [
        "",
        "a: [",
        "- 1",
        "names: !!int ''",
        "!!python/object:os.system {}",
        "a: *b",
        "[" * 3_000,
        "\0",
        "a: 2020-99-99",
        "names: &a [x]\n" + "\n".join(f"a{n}: {{<<: [*a, *a]}}" for n in range(99)),
        "names: &a [x, &b [*a, *b]]",
        "names: {0: 1" + "0" * 5000 + "}",
        'names: ["\\uD800"]',
        "names: [" * 100_000,
    ],
)
def test_yaml_of_anything(tmp_path: Path, content: str) -> None:
    (tmp_path / "data.yaml").write_text(content)
    said = complaint(yolo, tmp_path / "data.yaml")
    assert said.startswith(f"yolo = {str(tmp_path / 'data.yaml')!r}: ")
    assert "\n" not in said
