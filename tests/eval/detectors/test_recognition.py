"""Which family a graph is of, and what its contract says: by shapes, names, metadata, files and a probe."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.detectors import recognition
from blurnoise_eval.detectors.contract import COCO80, Contract, ModelError
from blurnoise_eval.detectors.contract_files import (
    contract_document,
    contract_option,
    load_contract,
    parse_contract,
    preset,
    stated_contract,
)
from blurnoise_eval.detectors.formats import PRESETS
from blurnoise_eval.detectors.formats.family import Signature
from blurnoise_eval.detectors.model import TensorInfo

NOWHERE = Path("nowhere/model.onnx")


def signature(size_px, *shapes, metadata=None, names=(), answer=None):
    """A graph of float NCHW; ``answer`` is what it gives to any picture."""
    names = names or tuple(f"out{i}" for i in range(len(shapes)))
    outputs = tuple(TensorInfo(*pair, "tensor(float)") for pair in zip(names, shapes, strict=True))
    images = TensorInfo("images", (1, 3, *size_px), "tensor(float)")
    found = None if answer is None else lambda blob: [answer]
    return Signature((images,), outputs, metadata or {}, size_px, found)


def resolve(path, graph, contract=None):
    """As for a model at that path."""
    contract, layout = recognition.resolve(graph, stated_contract(PRESETS, path, graph.metadata, contract))
    return layout.family, contract, layout


def rows(count, width, *, objectness, size):
    """An answer [1, count, width] of one objectness and one box size."""
    made = np.full((1, count, width), 0.01, np.float32)
    made[..., 2:4], made[..., 4] = size, objectness
    return made


@pytest.mark.parametrize(
    ("name", "size_px", "shape"),
    [
        ("yolov5", (1280, 1280), (1, 3 * (160**2 + 80**2 + 40**2 + 20**2), 85)),
        ("yolov5", (32, 32), (1, 63, 85)),  # fewer boxes than columns
        ("yolov8", (384, 640), (1, 84, 5040)),
        ("yolov8", (32, 32), (1, 21, 84)),  # turned, though the classes' axis is the longer one
        ("yolox", (32, 64), (1, 42, 85)),
        ("fastestdet", (320, 352), (1, 85, 20, 22)),
        ("nanodetplus", (416, 416), (1, 3598, 112)),
    ],
)
def test_families_are_told_apart_by_their_cells(name, size_px, shape):
    raw = rows(*shape[1:], objectness=0.5, size=1) if name == "yolox" else None
    family, contract, _ = resolve(NOWHERE, signature(size_px, shape, answer=raw))
    assert family.name == contract.family == name
    assert contract.classes == COCO80
    assert contract.input_size_px == size_px
    assert contract.sources["input_size_px"] == "graph"
    assumed = " ".join(contract.assumptions)
    for field in ("colour", "value_range", "mean", "std", "resize", "pad_value", "classes"):
        assert f"{field} = " in assumed
    assert "head" not in assumed
    assert "contract.json" in assumed


@pytest.mark.parametrize(("name", "objectness", "size"), [("yolov6", 1, 3), ("yolox", 0.999, 15)])
def test_a_probe_tells_yolov6_from_yolox(name, objectness, size):
    answer = rows(8400, 85, objectness=objectness, size=size)
    family, contract, _ = resolve(NOWHERE, signature((640, 640), (1, 8400, 85), answer=answer))
    assert (family.name, contract.family) == (name, name)
    assert "of a test picture" in contract.sources["family"]


@pytest.mark.parametrize(
    ("name", "shapes", "names"),
    [
        ("yolov6e2e", [(1, 1), (1, 100, 4), (1, 100), (1, 100)],
         ("num_dets", "det_boxes", "det_scores", "det_classes")),
        ("rtdetr", [(1, 300), (1, 300, 4), (1, 300)], ("labels", "boxes", "scores")),
        ("mmdeploy", [(1, 100, 5), (1, 100), (1, 100, 28, 28)], ("dets", "labels", "masks")),
        ("tfod", [(1,), (1, 10, 4), (1, 10), (1, 10)], ("num", "boxes", "scores", "classes")),
        ("tfod", [(1, 10, 4), (1, 10), (1, 10), (1,), (1, 1917, 4)],
         ("detection_boxes:0", "detection_classes:0", "detection_scores:0", "num_detections:0",
          "raw_detection_boxes:0")),
        ("nanodet", [(1, 1600, 80), (1, 400, 80), (1, 100, 80), (1, 1600, 32), (1, 400, 32), (1, 100, 32)], ()),
        ("nanodet", [(100, 32), (100, 80), (400, 32), (400, 80), (1600, 80), (1600, 32)], ()),
    ],
)  # fmt: skip
def test_families_are_told_apart_by_names_ranks_and_widths(name, shapes, names):
    family, _, layout = resolve(NOWHERE, signature((320, 320), *shapes, names=names))
    assert name == family.name
    assert set(layout.outputs) <= {"out0", "out1", "out2", "out3", "out4", "out5", *names}
    if name == "nanodet":  # scores and sides in turn, of the finest stride first
        by_name = dict(zip([f"out{i}" for i in range(6)], shapes, strict=True))
        assert [by_name[output][-2:] for output in layout.outputs] == [
            (count, width) for count in (1600, 400, 100) for width in (80, 32)
        ]


def test_metadata_comes_before_shapes():
    """[1, 8400, 6] is a one-class YOLOX by its cells, but not where Ultralytics says that it has suppressed."""
    exported = {"author": "Ultralytics", "task": "detect", "names": "['a', 'b']"}
    graph = signature((640, 640), (1, 8400, 6), metadata={**exported, "args": "{'nms': True, 'half': False}"})
    assert resolve(NOWHERE, graph)[0].name == "yolov10"
    assert resolve(NOWHERE, replace(graph, metadata={**exported, "end2end": "True"}))[0].name == "yolov10"
    for args in ("{'nms': False}", "[1]", "__import__('os')", "{" * 500):
        plain = replace(graph, metadata={**exported, "args": args})
        assert resolve(NOWHERE, plain)[0].name == "yolov8"


def test_ultralytics_metadata_names_classes_and_pre_processing():
    metadata = {"author": "Ultralytics", "task": "detect", "stride": "32", "imgsz": "[640, 640]"}
    named = signature((640, 640), (1, 6, 8400), metadata={**metadata, "names": "{0: 'stop', 1: 'yield'}"})
    _, contract, _ = resolve(NOWHERE, named)
    assert contract.classes == ("stop", "yield")
    assert contract.assumptions == []
    with pytest.raises(ModelError, match="segment"):
        resolve(NOWHERE, replace(named, metadata={**named.metadata, "task": "segment"}))
    with pytest.raises(ModelError, match="names"):
        resolve(NOWHERE, replace(named, metadata={**metadata, "names": "__import__('os')"}))
    with pytest.raises(ModelError, match=r"2 classes but the contract names 1 \(metadata\)"):
        resolve(NOWHERE, replace(named, metadata={**metadata, "names": "['stop']"}))


def test_order_of_contracts(tmp_path):
    """The caller's, then the file beside the model, then the metadata; ``<stem>.json`` is none."""

    def stated(name):
        return json.dumps({"family": "yolov8", "classes": [name]})

    model = tmp_path / "model.onnx"
    graph = signature((32, 32), (1, 5, 21), metadata={"blurnoise.contract": stated("metadata")})
    (tmp_path / "model.json").write_text(stated("wrong"))
    assert resolve(model, graph)[1].classes == ("metadata",)
    (tmp_path / "model.contract.yml").write_text("family: yolov8\nclasses: [beside]\nvalue_range: 0-255\n")
    contract = resolve(model, graph)[1]
    assert contract.classes == ("beside",)
    assert contract.value_range == "0-255"
    assert contract.sources["value_range"] == "file model.contract.yml"
    assert contract.sources["colour"] == "preset yolov8"
    mine = tmp_path / "mine.json"
    mine.write_text(stated("caller"))
    assert resolve(model, graph, mine)[1].classes == ("caller",)


# --- contracts as they are typed and as files hold them ---


OLD_YOLOX = replace(
    preset("yolox"), colour="rgb", value_range="0-1", mean=(0.485, 0.456, 0.406), std=(0.229, 0.224, 0.225)
)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tint": "rgb"}, "key 'tint' is unknown; must be one of"),
        ({"colours": "rgb"}, "did you mean 'colour'.*; must be one of"),
        ({"colour": "grb"}, "colour = 'grb': must be one of"),
        ({"mean": [1, 2]}, "mean = .1, 2.: must be three numbers, one per channel"),
        ({"std": [1, 0, 1]}, "std = .1, 0, 1.: must be three numbers > 0"),
        ({"pad_value": 300}, "pad_value = 300: must be finite and >= 0 and <= 255"),
        ({"input_size_px": 10**400}, "input_size_px = 1.*0: must be .height, width."),
        ({"classes": ["stop", "\ud800"]}, r"classes = '\\ud800': must be text"),
        ({"classes": ["a", ["b"] * 10**5]}, "classes = .*: must be a list of names"),
        ({"classes": {"1": "a", "3": "b"}}, "classes: ids must be 0 to 1"),
    ],
)
def test_bad_contracts_say_what_is_wrong(change, message):
    with pytest.raises(ModelError, match=message) as caught:
        parse_contract({"family": "yolox", "classes": ["a"], **change}, "file x")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_classes_by_id_from_0_or_as_google_numbers_them():
    for classes, names in (({"1": "b", "0": "a"}, ("a", "b")), ({1: "a", 2: "b"}, ("unused 0", "a", "b"))):
        assert parse_contract({"family": "tfod", "classes": classes}, "file x").classes == names


@pytest.mark.parametrize(
    ("name", "text"),
    [("m.json", "[" * 100_000), ("m.json", '{"family": "yolox"'), ("m.yaml", "a: ["), ("m.yaml", "aliases")],
)
def test_contract_file_that_cannot_be_read_is_named(tmp_path, name, text):
    doubled = (f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12))
    bomb = "\n".join(["a0: &a0 [ha]", *doubled, "family: *a11"])
    (tmp_path / name).write_text(bomb if text == "aliases" else text, encoding="utf-8")
    with pytest.raises(ModelError, match=f"contract file {name} cannot be read") as caught:
        load_contract(tmp_path / name)
    assert "\n" not in str(caught.value)


CONTRACTS: dict[str, Contract] = {
    **PRESETS,
    "old yolox": OLD_YOLOX,
    "own classes": replace(OLD_YOLOX, classes=("stop, sign", "a/b"), nms_iou=None, input_size_px=(32, 64)),
}


@pytest.mark.parametrize("name", CONTRACTS)
def test_what_is_written_is_read_again(name, tmp_path):
    contract = CONTRACTS[name]
    path = tmp_path / "m.contract.json"
    path.write_text(json.dumps(contract_document(contract)))
    assert load_contract(path) == contract
    shown: dict[str, Any] = json.loads(json.dumps(contract.to_dict()))  # as inspect --json prints it
    assert parse_contract(shown, "file x") == contract
    typed = contract_option(contract)
    if name == "own classes":
        assert typed is None
    else:
        assert typed is not None
        assert load_contract(typed) == contract
