"""``blurnoise inspect``: what it tells of a model, what it draws, and what it refuses."""

import json

import cv2
import numpy as np
import pytest
import signs_in_memory
from blurnoise_eval.detectors.contract import Contract
from commands import main, told
from constant_graphs import answering_graph
from signs_in_memory import matched_detector


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return matched_detector(tmp_path_factory.mktemp("model")).path


@pytest.fixture
def sign(tmp_path, monkeypatch):
    """A sign that the model finds, in the working folder."""
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("sign.png", signs_in_memory.sign())
    return tmp_path / "sign.png"


def answering(path, rows, **metadata):
    """A network for 64 x 64 px that gives ``rows`` to any picture."""
    output = {"output": (np.array([rows], np.float32), None)}
    return answering_graph(path, output, [1, 3, 64, 64], metadata=metadata)


def test_what_the_file_states(capsys, model):
    facts = told(capsys, "inspect", model)
    assert facts["contract"]["family"] == facts["family"] == "yolov8"
    assert facts["contract"]["classes"] == ["stop sign"]
    assert facts["inputs"] == ["images [1, 3, 64, 64] tensor(float)"]
    assert len(facts["sha256"]) == 64
    assert json.loads(facts["metadata"]["blurnoise.contract"])["family"] == "yolov8"
    assert facts["recognised"].startswith("metadata blurnoise.contract; the graph agrees: output")
    assert facts["assumed"] == facts["unknown"] == facts["warnings"] == []
    assert facts["sources"].keys() == set(Contract.names())
    assert main(["inspect", str(model)]) == 0
    out, err = capsys.readouterr()
    for words in ("metadata blurnoise.contract", "output0 [1, 5, 84]", "none with a test picture", "nms_iou"):
        assert words in out
    assert err == ""


def test_what_is_assumed_and_unknown(tmp_path, capsys):
    path = answering(tmp_path / "m.onnx", [[0, 0, 9, 9, 0.5, 2]] * 3, producer="x" * 200)
    facts = told(capsys, "inspect", path)
    assert facts["recognised"] == "graph: output 'output' [1, 3, 6] as b n 6, and its values"
    assert "inside the graph" in facts["unknown"][0]
    assert any(text.startswith("colour = 'rgb' is assumed") for text in facts["assumed"])
    assert main(["inspect", str(path)]) == 0
    out = capsys.readouterr().out
    assert any(
        "COCO's 80 classes, because the graph does not show how many" in text for text in facts["assumed"]
    )
    assert "COCO's" in out
    assert "x" * 25 in out
    assert "x" * 100 not in out


def test_probe_lists_and_draws(capsys, model, sign):
    facts = told(capsys, "inspect", model, "--probe", sign)
    probed = facts["probe"]
    assert probed["output"] == "small-sign-probe.png"
    (found,) = probed["detections"]
    assert found["class"] == "stop sign"
    assert found["score"] > 0.9
    np.testing.assert_allclose(found["box_xyxy"], signs_in_memory.BOX, atol=2)
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
        ([32, 32, 9, 9, 4.0], "the column read as scores goes from 4 to 4"),
        ([32, 32, 9, float("nan"), 0.5], "84 NaN or"),
    ],
)
def test_warnings(tmp_path, capsys, row, words):
    columns = np.repeat(np.array(row)[:, None], 84, axis=1)
    path = answering(tmp_path / "m.onnx", columns, names="['sign']")
    (warning,) = told(capsys, "inspect", path)["warnings"]
    assert words in warning
    assert main(["inspect", str(path)]) == 0
    assert words in capsys.readouterr().out


def test_labels_are_probed_with_their_notes(tmp_path, capsys, model, sign):
    box = {"x1": 10, "y1": 10, "x2": 2000, "y2": 90}
    labels = tmp_path / "bdd.json"
    labels.write_text(json.dumps([{"name": sign.name, "labels": [{"category": "stop sign", "box2d": box}]}]))
    facts = told(capsys, "inspect", model, "--probe", labels)
    assert facts["probe"]["detections"][0]["class"] == "stop sign"
    assert "1 of 1 boxes end outside of their picture" in facts["warnings"][-1]


def test_the_contract_is_kept_beside_the_model_and_found_there(tmp_path, capsys, sign):
    path = answering(tmp_path / "m.onnx", [[9, 9, 40, 40, 0.9, 0]] * 3)
    first = told(capsys, "inspect", path, "--save-contract")
    kept = tmp_path / "m.contract.json"
    assert first["saved"] == str(kept)
    again = told(capsys, "inspect", path)
    assert again["contract"] | {"sources": {}} == first["contract"] | {"sources": {}}
    assert again["sources"]["colour"] == "file m.contract.json"
    assert again["assumed"] == []
    typed = told(capsys, "inspect", path, "--contract", again["--contract"])
    assert typed["contract"] | {"sources": {}} == first["contract"] | {"sources": {}}
    assert main(["inspect", str(path), "--save-contract"]) == 2
    assert "exists already" in capsys.readouterr().err
