"""Contracts as they are typed and as files hold them: each way back gives it; what is wrong is named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.detectors.contract import COCO80, Contract, ModelError
from blurnoise_eval.detectors.contract_files import (
    contract_document,
    contract_option,
    load_contract,
    parse_contract,
    preset,
)
from blurnoise_eval.detectors.formats import PRESETS

OLD_YOLOX = replace(
    preset("yolox"), colour="rgb", value_range="0-1", mean=(0.485, 0.456, 0.406), std=(0.229, 0.224, 0.225)
)


@pytest.mark.parametrize(
    "typed",
    [
        "yolox,colour=rgb,value_range=0-1,mean=0.485/0.456/0.406,std=0.229/0.224/0.225",
        "yolox, color=rgb, range=0-1, mean=0.485/0.456/0.406, std=0.229/0.224/0.225",
    ],
)
def test_what_differs_is_typed_after_the_preset(typed: str) -> None:
    found = load_contract(typed)
    assert found == OLD_YOLOX
    assert found.sources["colour"] == "--contract yolox,..."
    assert found.sources["resize"] == "preset yolox"


@pytest.mark.parametrize(
    ("typed", "field", "value"),
    [
        ("yolox,size=416x640", "input_size_px", (416, 640)),
        ("yolox,iou=none", "nms_iou", None),
        ("nanodet,mean=none", "mean", None),
        ("yolox,classes=stop sign/yield", "classes", ("stop sign", "yield")),
        ("detr,classes=coco80", "classes", COCO80),
    ],
)
def test_each_field_can_be_typed(typed: str, field: str, value: object) -> None:
    assert getattr(load_contract(typed), field) == value


def test_a_file_may_say_what_differs_from_its_base() -> None:
    stated = {"base": "yolox", "color": "rgb", "range": "0-1", "mean": OLD_YOLOX.mean, "std": OLD_YOLOX.std}
    assert parse_contract(stated, "file x") == OLD_YOLOX
    assert parse_contract({"base": "yolox", "classes": ["a"]}, "file x").classes == ("a",)
    with pytest.raises(ModelError, match="colour is stated twice"):
        parse_contract({"base": "yolox", "color": "rgb", "colour": "bgr"}, "file x")
    with pytest.raises(ModelError, match="family 'yolo99' is unknown"):
        parse_contract({"base": "yolo99"}, "file x")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tint": "rgb"}, "key 'tint' is unknown; Known are"),
        ({"colours": "rgb"}, "did you mean 'colour'. Known are"),
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
def test_bad_contracts_say_what_is_wrong(change: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message) as caught:
        parse_contract({"family": "yolox", "classes": ["a"], **change}, "file x")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("name", "text"),
    [("m.json", "[" * 100_000), ("m.json", '{"family": "yolox"'), ("m.yaml", "a: ["), ("m.yaml", "aliases")],
)
def test_contract_file_that_cannot_be_read_is_named(tmp_path: Path, name: str, text: str) -> None:
    doubled = (f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12))
    bomb = "\n".join(["a0: &a0 [ha]", *doubled, "family: *a11"])
    (tmp_path / name).write_text(bomb if text == "aliases" else text, encoding="utf-8")
    with pytest.raises(ModelError, match=f"contract file {name}: cannot be read") as caught:
        load_contract(tmp_path / name)
    assert "\n" not in str(caught.value)


CONTRACTS: dict[str, Contract] = {
    **PRESETS,
    "old yolox": OLD_YOLOX,
    "own classes": replace(OLD_YOLOX, classes=("stop, sign", "a/b"), nms_iou=None, input_size_px=(32, 64)),
}


@pytest.mark.parametrize("name", CONTRACTS)
def test_what_is_written_is_read_again(name: str, tmp_path: Path) -> None:
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
