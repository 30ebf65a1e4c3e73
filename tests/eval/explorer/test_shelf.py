"""The shelf: uploads that are taken, and those that are refused with a line; what is named but not there."""

from __future__ import annotations

import struct
import threading
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from blurnoise_eval.datasets import encode
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.explorer import shelf as shelves
from blurnoise_eval.explorer.shelf import Shelf
from blurnoise_eval.explorer.state import State
from blurnoise_models.detector import STOP_SIGN
from onnx import TensorProto, helper

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
    monkeypatch.setitem(shelves._HELD, "picture", 2)
    names = [shelf.take("picture", f"{number}.png", PNG) for number in range(4)]
    assert [name for name in shelf.pictures() if name in names] == names[2:]
    assert shelf._folder is not None
    assert len(list(shelf._folder.iterdir())) == 2
    with pytest.raises(ValueError, match="upload it again"):
        shelf.subject(State(picture=names[0]))
    shelf.close()
    assert not shelf._folder.exists()


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
    name = shelf.take("camera", "mine.yaml", b"base: imx250\nf_number: 2\n")
    assert shelf.camera(State(camera=name)).f_number == 2


def endless() -> bytes:
    """A model that multiplies for ever: a loop of 2^62 turns."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["on"]), helper.make_node("Add", ["x", "x"], ["y"])],
        "body",
        [
            helper.make_tensor_value_info("turn", TensorProto.INT64, []),
            helper.make_tensor_value_info("go", TensorProto.BOOL, []),
            helper.make_tensor_value_info("x", TensorProto.FLOAT, None),
        ],
        [
            helper.make_tensor_value_info("on", TensorProto.BOOL, []),
            helper.make_tensor_value_info("y", TensorProto.FLOAT, None),
        ],
    )
    graph = helper.make_graph(
        [
            helper.make_node("GlobalAveragePool", ["images"], ["mean"]),
            helper.make_node("Loop", ["turns", "yes", "mean"], ["far"], body=body),
            helper.make_node("Expand", ["far", "shape"], ["wide"]),
            helper.make_node("Reshape", ["wide", "to"], ["output"]),
        ],
        "endless",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, 64, 64])],
        [helper.make_tensor_value_info("output", TensorProto.FLOAT, [1, 6, 84])],
        [
            helper.make_tensor("turns", TensorProto.INT64, [], [1 << 62]),
            helper.make_tensor("yes", TensorProto.BOOL, [], [True]),
            helper.make_tensor("shape", TensorProto.INT64, [4], [1, 3, 14, 12]),
            helper.make_tensor("to", TensorProto.INT64, [3], [1, 6, 84]),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {"names": "{0: 'sign', 1: 'car'}"})
    return bytes(model.SerializeToString())


def outside() -> bytes:
    """A model whose weights are said to be a file of the machine."""
    model = onnx.load(str(STOP_SIGN))
    tensor = model.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    for key, value in (("location", "../../../../../../etc/passwd"), ("offset", "0"), ("length", "64")):
        entry = tensor.external_data.add()
        entry.key, entry.value = key, value
    return bytes(model.SerializeToString())


def nameless() -> bytes:
    """A model of a known layout whose classes nobody has named."""
    graph = helper.make_graph(
        [
            helper.make_node("GlobalAveragePool", ["images"], ["mean"]),
            helper.make_node("Expand", ["mean", "shape"], ["wide"]),
            helper.make_node("Reshape", ["wide", "to"], ["output"]),
        ],
        "nameless",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, 64, 64])],
        [helper.make_tensor_value_info("output", TensorProto.FLOAT, [1, 6, 84])],
        [
            helper.make_tensor("shape", TensorProto.INT64, [4], [1, 3, 14, 12]),
            helper.make_tensor("to", TensorProto.INT64, [3], [1, 6, 84]),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    return bytes(model.SerializeToString())


def test_a_model_that_does_not_say_its_contract_is_taken_with_one(
    shelf: Shelf, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(shelves._CHECKS, "model", lambda path: open_models([path]))  # in this process: sooner
    with pytest.raises(ValueError, match=r"nothing names them(?s:.*)contract\.json"):
        shelf.take("model", "mine.onnx", nameless())
    with pytest.raises(ValueError, match=r"^file own\.json: unknown key 'clases'"):
        shelf.take("model", "mine.onnx", nameless(), ("own.json", b'{"family": "yolov8", "clases": ["a"]}'))
    contract = b"family: yolov8\nclasses: [sign, car]\n"
    name = shelf.take("model", "mine.onnx", nameless(), ("own.yaml", contract))
    found = shelf.model(State(model=name))
    assert found is not None
    assert found.contract.to_dict()["classes"] == ["sign", "car"]


@pytest.mark.slow
def test_hostile_models_are_refused_and_a_sound_one_is_taken(
    shelf: Shelf, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shelves, "_TRIAL_CPU_S", 15)
    hostile = {
        "text.onnx": (b"hi there", "is a text file"),
        "noise.onnx": (b"\x08\x07" + bytes(range(256)) * 9, "not an ONNX model"),
        "outside.onnx": (outside(), "outside.onnx"),
        "endless.onnx": (endless(), "endless.onnx: does not answer to a picture within 15 s of computing"),
    }
    for name, (content, told) in hostile.items():
        with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
            shelf.take("model", name, content)
        assert told in str(error.value)
        assert "root:" not in str(error.value)
    name = shelf.take("model", "mine.onnx", Path(STOP_SIGN).read_bytes())
    found = shelf.model(State(model=name))
    assert found is not None
    assert found.name == "mine"


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
