"""The catalogue: uploads that are taken, and those that are refused with a line; what is named but not there."""

from __future__ import annotations

import struct
import tempfile
import threading
import zlib
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.datasets import encode, write_picture
from blurnoise_eval.explorer import catalogue as catalogues
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.state import State

CAMERA = b"base: imx250\nf_number: 2\n"
PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))


@pytest.fixture
def catalogue() -> Catalogue:
    return Catalogue()


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
    "enormous.png": (png_of(200_000), "enormous.png: more than 178 megapixels"),
    "tiny.png": (encode(np.zeros((8, 30, 3), np.uint8)), "30 x 8 px; must be at least 16 x 16"),
    "../../etc/passwd": (b"root", "passwd: not an 8"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_no_picture_is_refused_with_a_line(name: str, catalogue: Catalogue) -> None:
    content, told = BROKEN[name]
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        catalogue.take("picture", name, content)
    assert told in str(error.value)
    assert "/tmp" not in str(error.value)


@pytest.mark.parametrize("content", [b"a: [", b"base: imx250\nf_number: -1\n", b"\xff\xfe\x00", b"- 1\n"])
def test_a_broken_camera_is_refused(content: bytes, catalogue: Catalogue) -> None:
    with pytest.raises(ValueError, match=r"mine\.yaml"):
        catalogue.take("camera", "mine.yaml", content)


def test_uploads_are_listed_for_who_can_name_them_and_leave_no_file(
    catalogue: Catalogue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    name = catalogue.take("picture", "C:\\photos\\a b.png", PNG)
    camera = catalogue.take("camera", "mine.yaml", CAMERA)
    assert list(tmp_path.iterdir()) == []
    assert name == catalogue.take("picture", "a b.png", PNG)
    assert len(name) == 32
    assert name != Catalogue().take("picture", "a b.png", PNG), "nobody can guess it"
    assert name not in catalogue.titles("picture")
    assert catalogue.titles("picture", {name, camera})[name] == "a b.png"
    assert camera not in catalogue.titles("picture", {camera})
    state = State(picture=name, camera=camera, model="none")
    assert catalogue.resolved(state.query(catalogue.base)) == (state, ())
    assert catalogue.subject(state) is catalogue.subject(state)
    assert catalogue.subject(state).size == (40, 52)
    assert catalogue.camera(state).f_number == 2


def test_of_many_uploads_the_oldest_go(catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogues, "_MOST_UPLOADS", 2)
    names = [catalogue.take("picture", f"{number}.png", PNG) for number in range(4)]
    assert [name for name in names if catalogue.uploaded(name)] == names[2:]
    monkeypatch.setattr(catalogues, "_UPLOADED_MB", 1.5 * 40 * 52 * 3 / 2**20)
    last = catalogue.take("picture", "last.png", PNG)
    assert [name for name in (*names, last) if catalogue.uploaded(name)] == [last]
    with pytest.raises(ValueError, match="upload it again"):
        catalogue.subject(State(picture=names[0]))


@pytest.mark.parametrize("name", ["/etc/passwd", "run/a.png", "sign-999", "0f", "given"])
def test_a_url_names_no_files(name: str, catalogue: Catalogue) -> None:
    for kind, opened in (
        ("picture", catalogue.subject),
        ("camera", catalogue.camera),
        ("model", catalogue.model),
    ):
        with pytest.raises(ValueError, match=f"{kind} = "):
            opened(State(**{kind: name}))


def test_of_what_is_not_here_the_rest_of_the_state_is_kept(catalogue: Catalogue) -> None:
    lux = State().put("illuminance_lux", 7.0)
    state, lines = catalogue.resolved("lux=7&moves=targets&picture=00&model=11&cell=a")
    assert state == lux
    for line, word in zip(lines, ("picture = '00'", "model = '11'", "cell: goes with a run"), strict=True):
        assert word in line
    state, lines = catalogue.resolved("lux=7&f_number=-1&along=wild&camera=wild")
    assert state == lux
    for line, word in zip(lines, ("camera = 'wild'", "f_number = -1", "along = 'wild'"), strict=True):
        assert word in line
    with pytest.raises(ValueError, match="along = 'wild'"):
        catalogue.start("along=wild")


def test_files_that_the_command_names_are_given(tmp_path: Path) -> None:
    write_picture(tmp_path / "grey.png", np.full((40, 50, 3), 90, np.uint8))
    catalogue = Catalogue(tmp_path / "grey.png", model="none")
    assert (catalogue.base.picture, catalogue.base.model, catalogue.base.camera) == (
        "given",
        "none",
        "imx250m",
    )
    assert catalogue.titles("picture")["given"] == "grey.png"
    with pytest.raises(ValueError, match="trust: goes with a run"):
        Catalogue(tmp_path / "grey.png", trust=True)
    with pytest.raises(ValueError, match="gone"):
        Catalogue(tmp_path / "gone.png", model="none")


def test_who_waits_for_a_picture_keeps_nobody_else_waiting() -> None:
    slow, begun, made = threading.Event(), threading.Event(), list[int]()

    def make() -> int:
        begun.set()
        slow.wait(20)
        made.append(1)
        return len(made)

    once = catalogues._Once(make)
    waiting = [threading.Thread(target=once) for _ in range(2)]
    for each in waiting:
        each.start()
    begun.wait(20)
    assert catalogues._Once(lambda: "other")() == "other"
    slow.set()
    for each in waiting:
        each.join(20)
    assert once() == 1
