"""``blurnoise inspect``: what it tells of a model, what it draws, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import matched_filter
import numpy as np
import onnx
import pytest
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.detectors.contract import Contract
from commands import main
from onnx import TensorProto, helper, numpy_helper

from blurnoise import charts
from blurnoise.optics.colour import srgb_from_linear

Output = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    return matched_filter.build(path, sizes_px=(24, 16, 10), input_px=64)


@pytest.fixture
def sign(tmp_path: Path) -> Path:
    """A sign of 24 px in the middle of 64 x 64 px, which the model finds."""
    linear = charts.stop_sign(24, height_px=64, width_px=64)
    picture = srgb_from_linear(linear)[0].mul(255).round().byte().permute(1, 2, 0).numpy()
    write_picture(tmp_path / "sign.png", picture)
    return tmp_path / "sign.png"


def answering(
    path: Path,
    rows: list[list[float]],
    *,
    metadata: dict[str, str] | None = None,
    shape: tuple[int, ...] = (),
) -> Path:
    """A network for 64 x 64 px that gives ``rows`` to any picture."""
    answer = np.array(rows, np.float32).reshape(shape or (1, len(rows), -1))
    nodes = [
        helper.make_node("ReduceMin", ["images"], ["least"], keepdims=0),
        helper.make_node("Mul", ["least", "none"], ["nothing"]),
        helper.make_node("Add", ["rows", "nothing"], ["output"]),
    ]
    graph = helper.make_graph(
        nodes,
        "fixed",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, 64, 64])],
        [helper.make_tensor_value_info("output", TensorProto.FLOAT, answer.shape)],
        [numpy_helper.from_array(answer, "rows"), numpy_helper.from_array(np.float32(0), "none")],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(made, metadata or {})
    onnx.save(made, path)
    return path


def told(capsys: Output, *arguments: object) -> Any:
    """The JSON that the command prints, which must succeed."""
    capsys.readouterr()
    assert main(["inspect", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_what_the_file_states(capsys: Output, model: Path) -> None:
    facts = told(capsys, model)
    assert facts["contract"]["family"] == facts["family"] == "yolov8"
    assert facts["contract"]["classes"] == ["stop sign"]
    assert facts["inputs"] == ["images [1, 3, 64, 64] tensor(float)"]
    assert len(facts["sha256"]) == 64
    assert json.loads(facts["metadata"]["blurnoise.contract"])["family"] == "yolov8"
    assert facts["recognised"].startswith("stated (metadata blurnoise.contract); the graph agrees: output")
    assert facts["assumed"] == facts["unknown"] == facts["warnings"] == []
    assert facts["sources"].keys() == set(Contract.names())
    assert main(["inspect", str(model)]) == 0
    out, err = capsys.readouterr()
    for words in ("metadata blurnoise.contract", "output0 [1, 5, 84]", "none on a drawn picture", "nms_iou"):
        assert words in out
    assert err == ""


def test_what_is_assumed_and_unknown(tmp_path: Path, capsys: Output) -> None:
    path = answering(tmp_path / "m.onnx", [[0, 0, 9, 9, 0.5, 2]] * 3, metadata={"producer": "x" * 200})
    facts = told(capsys, path)
    assert facts["recognised"] == "graph: output 'output' [1, 3, 6] as b n 6"
    assert "baked into the graph" in facts["unknown"][0]
    assert any(text.startswith("colour = 'rgb' is assumed") for text in facts["assumed"])
    assert main(["inspect", str(path)]) == 0
    out = capsys.readouterr().out
    assert any(
        "COCO's 80 classes, because the graph does not show how many" in text for text in facts["assumed"]
    )
    assert "COCO's" in out
    assert "x" * 25 in out
    assert "x" * 100 not in out


def test_probe_lists_and_draws(
    tmp_path: Path, capsys: Output, model: Path, sign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    facts = told(capsys, model, "--probe", sign)
    probed = facts["probe"]
    assert probed["output"] == "small-sign-probe.png"
    (found,) = probed["detections"]
    assert found["class"] == "stop sign"
    assert found["score"] > 0.9
    np.testing.assert_allclose(found["box_xyxy"], charts.stop_sign_box(24, height_px=64, width_px=64), atol=2)
    before, after = cv2.imread(str(sign)), cv2.imread("small-sign-probe.png")
    assert after.shape == before.shape
    left, top, right, bottom = (round(edge) for edge in found["box_xyxy"])
    changed = (before != after).any(axis=2)
    assert changed[top : bottom + 1, left].mean() > 0.9
    assert changed[top : bottom + 1, right].mean() > 0.9
    assert not changed[top + 3 : bottom - 3, left + 3 : right - 3].any()
    assert main(["inspect", str(model), "--probe", str(sign)]) == 0
    out = capsys.readouterr().out
    assert f"  {found['score']:.3f} at {left}.0, {top}.0" in out
    assert out.strip().endswith("small-sign-probe.png")


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ([32, 32, 9, 9, 0.0], "every score is exactly 0"),
        ([32, 32, 9, 9, 4.0], "score 4 > 1"),
        ([32, 32, 9, float("nan"), 0.5], "84 NaN or"),
    ],
)
def test_warnings(tmp_path: Path, capsys: Output, row: list[float], words: str) -> None:
    columns = np.repeat(np.array(row)[:, None], 84, axis=1)
    metadata = {"names": "['sign']"}
    path = answering(tmp_path / "m.onnx", columns.tolist(), metadata=metadata)
    (warning,) = told(capsys, path)["warnings"]
    assert words in warning
    assert main(["inspect", str(path)]) == 0
    assert words in capsys.readouterr().out


def test_a_text_recogniser(tmp_path: Path, capsys: Output, sign: Path) -> None:
    """Three steps over blank, a, b and the space: "ab"."""
    steps = [[0.1, 0.8, 0.1, 0], [1, 0, 0, 0], [0.1, 0, 0.9, 0]]
    path = answering(tmp_path / "m.onnx", steps, metadata={"character": "a\nb"})
    facts = told(capsys, path, "--probe", sign)
    assert facts["family"] == "ppocr"
    assert (facts["probe"]["text"], facts["probe"]["score"]) == ("ab", pytest.approx(0.85))
    assert main(["inspect", str(path), "--probe", str(sign)]) == 0
    assert "'ab' 0.850" in capsys.readouterr().out
    assert main(["inspect", str(path), "--save-contract"]) == 2
    assert "none is written for a text recogniser" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--probe", "absent.png"], "absent.png"),
        (["--contract", "yolov99"], "neither a file nor a preset"),
        (["--contract", "yolox"], "no outputs of that shape"),
    ],
)
def test_refusals(
    options: list[str], named: str, model: Path, sign: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(sign.parent)
    before = sorted(sign.parent.iterdir())
    assert main(["inspect", str(model), *options]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("blurnoise: error: ")
    assert named in err
    assert sorted(sign.parent.iterdir()) == before


def test_class_names_and_metadata_cannot_break_lines(
    tmp_path: Path, capsys: Output, sign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    metadata = {"names": repr(["evil\n\x1b[31mname"]), "note": "a\nb"}
    path = answering(tmp_path / "m.onnx", [[9, 9, 40, 40, 0.9, 0]] * 3, metadata=metadata)
    assert main(["inspect", str(path), "--probe", str(sign)]) == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert "note: a b" in out
    assert "evil" in out


def test_the_contract_is_kept_beside_the_model_and_found_there(
    tmp_path: Path, capsys: Output, sign: Path
) -> None:
    path = answering(tmp_path / "m.onnx", [[9, 9, 40, 40, 0.9, 0]] * 3)
    first = told(capsys, path, "--save-contract")
    kept = tmp_path / "m.contract.json"
    assert first["saved"] == str(kept)
    again = told(capsys, path)
    assert again["contract"] | {"sources": {}} == first["contract"] | {"sources": {}}
    assert again["sources"]["colour"] == "file m.contract.json"
    assert again["assumed"] == []
    typed = told(capsys, path, "--contract", again["--contract"])
    assert typed["contract"] | {"sources": {}} == first["contract"] | {"sources": {}}
    assert main(["inspect", str(path), "--save-contract"]) == 2
    assert "exists; must be a new file" in capsys.readouterr().err


def test_a_folder_is_probed_by_its_pictures(
    tmp_path: Path, capsys: Output, model: Path, sign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "photos"
    folder.mkdir()
    for name in ("b.png", "a.png"):
        (folder / name).write_bytes(sign.read_bytes())
    facts = told(capsys, model, "--probe", folder)
    assert "variants on 2 pictures" in facts["compared"]
    assert facts["warnings"] == []
    assert facts["probe"]["image"] == str(folder / "a.png")
