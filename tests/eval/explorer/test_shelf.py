"""The shelf: uploads that are taken, and those that are refused with a line; what is named but not there."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import tempfile
import threading
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.datasets import encode
from blurnoise_eval.explorer import shelf as shelves
from blurnoise_eval.explorer.shelf import Shelf
from blurnoise_eval.explorer.state import State
from blurnoise_models.detector import STOP_SIGN

CAMERA = b"base: imx250\nf_number: 2\n"
PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))


@pytest.fixture
def shelf() -> Iterator[Shelf]:
    found = Shelf(STOP_SIGN)
    yield found
    found.close()


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png_of(side_px: int) -> bytes:
    header = struct.pack(">IIBBBBB", side_px, side_px, 8, 2, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


BROKEN = {
    "text.png": (b"hello, I am no picture", "text.png: not an 8- or 16-bit picture"),
    "empty.png": (b"", "empty"),
    "cut.png": (PNG[: len(PNG) // 2], "cut.png"),
    "huge.png": (png_of(9000), "81 megapixels; must be at most 24"),
    "enormous.png": (
        png_of(200_000),
        "enormous.png: 200000 x 200000 px, 40000 megapixels; must be at most 24",
    ),
    "tiny.png": (encode(np.zeros((8, 30, 3), np.uint8)), "30 x 8 px; must be at least 16 x 16"),
    "../../etc/passwd": (b"root", "passwd: not an 8"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_no_picture_is_refused_with_a_line(name: str, shelf: Shelf) -> None:
    content, told = BROKEN[name]
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        shelf.take("picture", name, content)
    assert told in str(error.value)
    assert "/tmp" not in str(error.value)
    assert not [name for name in shelf.pictures() if name.startswith("picture-")]


def test_a_picture_is_taken_once_and_explored(shelf: Shelf) -> None:
    name = shelf.take("picture", "C:\\photos\\a b.png", PNG)
    assert name == shelf.take("picture", "a b.png", PNG)
    assert shelf.pictures()[name] == "a b.png"
    subject = shelf.subject(State(picture=name))
    assert subject is shelf.subject(State(picture=name))
    assert subject.size == (40, 52)


def test_of_many_uploads_the_oldest_go_and_their_files_with_them(
    shelf: Shelf, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shelves, "_HELD", 2)
    names = [shelf.take("picture", f"{number}.png", PNG) for number in range(4)]
    assert [name for name in shelf.pictures() if name in names] == names[2:]
    (folder,) = shelf._folders
    assert len(list(folder.iterdir())) == 2
    with pytest.raises(ValueError, match="upload it again"):
        shelf.subject(State(picture=names[0]))
    shelf.close()
    assert not folder.exists()


def test_no_visitor_pushes_out_the_uploads_of_another(shelf: Shelf, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither by their number nor by their size; where all have too many, what comes is refused."""
    size_mb = len(PNG) / 2**20
    one, other, third = shelf.of("one"), shelf.of("other"), shelf.of("third")
    kept = one.take("picture", "a.png", PNG)
    for number in range(shelves._HELD + 3):
        last = other.take("picture", f"{number}.png", PNG)
    monkeypatch.setattr(shelves, "_HELD_MB", 3.5 * size_mb)
    for number in range(4):
        last = other.take("picture", f"more-{number}.png", PNG)
    assert [name in one.pictures() for name in (kept, last)] == [True, False]
    assert sum(name.startswith("picture-") for name in other.pictures()) == 3
    monkeypatch.setattr(shelves, "_HELD_BY_ALL_MB", 4.5 * size_mb)
    newer = other.take("picture", "newer.png", PNG)
    assert sum(name.startswith("picture-") for name in other.pictures()) == 3
    with pytest.raises(ValueError, match=r"^b\.png: no room beside the uploads of other visitors"):
        third.take("picture", "b.png", PNG)
    assert kept in one.pictures()
    assert newer in other.pictures()
    (folder,) = shelf._folders
    assert len(list(folder.iterdir())) == 4


@pytest.mark.parametrize("name", ["/etc/passwd", "run/a.png", "sign-999", "picture-00", "given-picture"])
def test_a_url_names_no_files(name: str, shelf: Shelf) -> None:
    with pytest.raises(ValueError, match="picture = "):
        shelf.subject(State(picture=name))
    with pytest.raises(ValueError, match="camera = "):
        shelf.camera(State(camera=name))
    with pytest.raises(ValueError, match="model = "):
        shelf.model(State(model=name))


def test_of_what_is_not_held_the_rest_of_the_state_is_kept(shelf: Shelf) -> None:
    lux = State().put("illuminance_lux", 7.0)
    assert shelves.held(shelf, lux, State()) == (lux, [])
    asked = replace(lux.put("moves", 1.0), picture="picture-00", model="model-00", cell="a")
    state, (told,) = shelves.held(shelf, asked, State(picture="sign-2"))
    assert state == replace(lux, picture="sign-2")
    assert told == "picture = 'picture-00', model = 'model-00': not held here (any more); upload again"
    wrong = replace(lux.put_figure("f_number", -1.0), along="wild", camera="wild", cell="a")
    state, lines = shelves.held(shelf, wrong, State())
    assert state == lux
    for line, word in zip(lines, ("camera = 'wild'", "f_number = -1", "along = 'wild'"), strict=True):
        assert word in line


def test_a_broken_camera_is_refused(shelf: Shelf) -> None:
    for content in (b"a: [", b"base: imx250\nf_number: -1\n", b"\xff\xfe\x00", b"- 1\n"):
        with pytest.raises(ValueError, match=r"mine\.yaml"):
            shelf.take("camera", "mine.yaml", content)
    name = shelf.take("camera", "mine.yaml", CAMERA)
    assert shelf.camera(State(camera=name)).f_number == 2


def test_visitors_see_their_own_uploads_alone(shelf: Shelf) -> None:
    """Not by name either, whoever has it open; what was given at the start everybody sees."""
    one, other = shelf.of("one"), shelf.of("other")
    name, camera = one.take("picture", "a.png", PNG), one.take("camera", "a.yaml", CAMERA)
    state = State(picture=name, camera=camera, model="none")
    assert one.subject(state).size == (40, 52)
    assert one.camera(state).f_number == 2
    assert name in one.pictures()
    assert other.pictures() == shelf.pictures()
    assert other.cameras() == shelf.cameras()
    for opened in (other.subject, other.camera):
        with pytest.raises(ValueError, match="not held here"):
            opened(state)
    assert shelves.held(other, state, State(model="none"))[0] == State(model="none")
    assert other.take("picture", "a.png", PNG) != name
    assert other.files(state).where == name  # not even what the file was called
    assert shelf.subject(State()) is one.subject(State()) is other.subject(State())


def test_no_model_is_uploaded(shelf: Shelf) -> None:
    with pytest.raises(KeyError):
        shelf.take("model", "mine.onnx", Path(STOP_SIGN).read_bytes())
    assert shelf.models() == {"built-in": "built-in stop-sign detector", "none": "no model"}


def test_folders_of_killed_explorers_are_cleared_and_no_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    kept = [f"blurnoise-explore-{process}" for process in (f"{os.getpid()}-a", "1-a", "x", "abc123")]
    kept += ["blurnoise-explorer", f"other-{ended.pid}-a"]
    for name in (*kept, f"blurnoise-explore-{ended.pid}-a", f"blurnoise-explore-{ended.pid}-b"):
        (tmp_path / name / "picture-0").mkdir(parents=True)
        (tmp_path / name / "picture-0" / "a.png").write_bytes(PNG)
    outside = tmp_path / "outside"
    outside.mkdir()
    (tmp_path / f"blurnoise-explore-{ended.pid}-link").symlink_to(outside)
    (tmp_path / f"blurnoise-explore-{ended.pid}-file").write_bytes(b"")
    shelves.clear_stale_uploads()
    left = {each.name for each in tmp_path.iterdir()}
    assert left == {
        *kept,
        "outside",
        f"blurnoise-explore-{ended.pid}-link",
        f"blurnoise-explore-{ended.pid}-file",
    }


def test_who_waits_for_a_picture_keeps_nobody_else_waiting(shelf: Shelf) -> None:
    slow, begun = threading.Event(), threading.Event()

    def make() -> str:
        begun.set()
        slow.wait(20)
        return "made"

    waiting = [threading.Thread(target=shelf._once, args=(("picture", "slow"), make, 2)) for _ in range(2)]
    for each in waiting:
        each.start()
    begun.wait(20)
    assert shelf._once(("picture", "quick"), lambda: "other", 2) == "other"
    slow.set()
    for each in waiting:
        each.join(20)
    assert shelf._once(("picture", "slow"), lambda: "again", 2) == "made"
