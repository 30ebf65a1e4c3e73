from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.contract import (
    COCO80,
    PRESETS,
    Contract,
    ModelError,
    load_contract,
    parse_contract,
    preset,
)
from blurnoise_eval.formats import fastestdet, resolve, yolov5, yolov8, yolox
from blurnoise_eval.formats.candidates import Candidates, suppress
from blurnoise_eval.formats.placement import lay_in
from blurnoise_eval.formats.signature import Signature, TensorInfo, cells
from numpy.typing import NDArray

NOWHERE = Path("nowhere/model.onnx")


def signature(
    size_px: tuple[int, int], *shapes: tuple[int, ...], metadata: dict[str, str] | None = None
) -> Signature:
    outputs = tuple(TensorInfo(f"out{i}", shape, "tensor(float)") for i, shape in enumerate(shapes))
    images = TensorInfo("images", (1, 3, *size_px), "tensor(float)")
    return Signature((images,), outputs, metadata or {}, size_px)


# --- decoding: answers worked out by hand ---


def test_yolov5_score_is_objectness_times_class() -> None:
    rows = np.zeros((1, 9, 7), np.float32)
    rows[0, 4] = [100, 50, 20, 10, 0.5, 0.25, 0.75]
    found = yolov5.decode([rows], (64, 96), 0.001)
    np.testing.assert_allclose(found.boxes_xyxy, [[90, 45, 110, 55]])
    np.testing.assert_allclose(found.scores, [0.375])
    assert found.class_ids.tolist() == [1]


def test_yolov8_has_no_objectness() -> None:
    columns = np.zeros((1, 6, 21), np.float32)
    columns[0, :, 7] = [100, 50, 20, 10, 0.25, 0.75]
    found = yolov8.decode([columns], (32, 32), 0.001)
    np.testing.assert_allclose(found.boxes_xyxy, [[90, 45, 110, 55]])
    np.testing.assert_allclose(found.scores, [0.75])
    assert found.class_ids.tolist() == [1]


@pytest.mark.parametrize(
    ("row", "column", "stride", "first"), [(1, 3, 8, 0), (2, 5, 16, 8 * 12), (0, 1, 32, 8 * 12 + 4 * 6)]
)
def test_yolox_adds_the_cell_and_scales_by_the_stride(row: int, column: int, stride: int, first: int) -> None:
    """Input 64 x 96 px: rows and columns differ, so that a swap shows."""
    rows = np.zeros((1, cells((64, 96)), 7), np.float32)
    rows[0, first + row * (96 // stride) + column] = [0.5, 0.25, math.log(2), 0, 0.5, 0.25, 0.75]
    found = yolox.decode([rows], (64, 96), 0.001)
    x, y = (column + 0.5) * stride, (row + 0.25) * stride
    expected = [[x - stride, y - stride / 2, x + stride, y + stride / 2]]
    np.testing.assert_allclose(found.boxes_xyxy, expected, rtol=1e-6)
    np.testing.assert_allclose(found.scores, [0.375])
    assert found.class_ids.tolist() == [1]


def test_fastestdet_on_its_single_grid() -> None:
    """Input 64 x 96 px, grid 4 x 6: tanh(0.5493) = 0.5; sigmoid(0) = 1/2, sigmoid(log 3) = 3/4."""
    grid = np.zeros((1, 7, 4, 6), np.float32)
    grid[0, :, 2, 5] = [0.5, math.atanh(0.5), 0, 0, math.log(3), 0.25, 0.75]
    found = fastestdet.decode([grid], (64, 96), 0.001)
    x, y, width, height = (5 + 0.5) * 16, 2 * 16, 96 / 2, 64 * 3 / 4
    expected = [[x - width / 2, y - height / 2, x + width / 2, y + height / 2]]
    np.testing.assert_allclose(found.boxes_xyxy, expected, rtol=1e-5)
    np.testing.assert_allclose(found.scores, [0.5**0.6 * 0.75**0.4], rtol=1e-6)
    assert found.class_ids.tolist() == [1]


@pytest.mark.parametrize("position", [0, 3, 4, 6])
def test_rows_with_nan_or_infinity_are_dropped(position: int) -> None:
    good, bad = [0, 0, 0, 0, 0.5, 0.25, 0.75], [0, 0, 0, 0, 0.5, 0.25, 0.75]
    bad[position] = math.nan
    for poison in (math.nan, math.inf):
        bad[position] = poison if position < 4 else math.nan
        rows = np.zeros((1, 21, 7), np.float32)
        rows[0, 2], rows[0, 5] = good, bad
        assert len(yolox.decode([rows], (32, 32), 0.001)) == 1
        assert len(yolov5.decode([rows], (32, 32), 0.001)) == 1
        columns = np.delete(rows, 4, axis=2).transpose(0, 2, 1)
        assert len(yolov8.decode([columns], (32, 32), 0.001)) == (2 if position == 4 else 1)


def test_yolox_drops_boxes_that_overflow() -> None:
    rows = np.zeros((1, 21, 6), np.float32)
    rows[0, 3] = [0, 0, 1000, 0, 1, 1]
    assert len(yolox.decode([rows], (32, 32), 0.001)) == 0


@pytest.mark.parametrize("family", [yolov5, yolov8, yolox, fastestdet], ids=lambda family: family.NAME)
def test_threshold_is_inclusive_and_zero_keeps_all(family) -> None:
    shape = {"yolov5": (1, 63, 6), "yolov8": (1, 5, 21), "yolox": (1, 21, 6), "fastestdet": (1, 6, 2, 2)}
    zeros = np.zeros(shape[family.NAME], np.float32)
    assert len(family.decode([zeros], (32, 32), 0.001)) == 0
    everything = family.decode([zeros], (32, 32), 0.0)
    assert len(everything) == max(shape[family.NAME][1:3]) or family.NAME == "fastestdet"
    assert everything.scores.max() == 0
    ones = family.decode([np.ones_like(zeros)], (32, 32), 1.0)
    assert len(ones) == len(everything)


# --- suppression ---


def greedy_reference(candidates: Candidates, nms_iou: float, most: int) -> set[int]:
    kept: list[int] = []
    for i in np.argsort(-candidates.scores, kind="stable"):
        box = candidates.boxes_xyxy[i].astype(np.float64)
        for j in kept:
            if candidates.class_ids[i] != candidates.class_ids[j]:
                continue
            other = candidates.boxes_xyxy[j].astype(np.float64)
            sides = np.clip(np.minimum(box[2:], other[2:]) - np.maximum(box[:2], other[:2]), 0, None)
            union = (box[2:] - box[:2]).prod() + (other[2:] - other[:2]).prod() - sides.prod()
            if sides.prod() / union > nms_iou:
                break
        else:
            kept.append(int(i))
    return set(kept[:most])


def random_candidates(count: int, classes: int, seed: int) -> Candidates:
    rng = np.random.default_rng(seed)
    corner = rng.uniform(-80, 120, (count, 2))  # beyond the input on both sides
    boxes = np.concatenate([corner, corner + rng.uniform(20, 90, (count, 2))], axis=1).astype(np.float32)
    return Candidates(boxes, rng.uniform(0, 1, count).astype(np.float32), rng.integers(0, classes, count))


@pytest.mark.parametrize(
    ("count", "classes", "most"),
    [(0, 1, 300), (1, 1, 300), (200, 1, 300), (300, 5, 300), (300, 5, 20), (400, 1, 30)],
)
def test_suppression_equals_the_plain_reference(count: int, classes: int, most: int) -> None:
    candidates = random_candidates(count, classes, seed=count + classes)
    kept = suppress(candidates, 0.5, most)
    expected = greedy_reference(candidates, 0.5, most)
    assert set(kept.scores.tolist()) == {float(candidates.scores[i]) for i in expected}
    assert (np.diff(kept.scores) <= 0).all()


def test_suppression_keeps_classes_apart_and_the_stronger_box() -> None:
    boxes = np.array([[0, 0, 10, 10], [0, 0, 10, 11], [0, 0, 10, 10]], np.float32)
    candidates = Candidates(boxes, np.array([0.25, 0.75, 0.5], np.float32), np.array([0, 0, 1]))
    kept = suppress(candidates, 0.5, 300)
    assert list(zip(kept.class_ids.tolist(), kept.scores.tolist(), strict=True)) == [
        (0, 0.75),
        (1, 0.5),
    ]


def test_suppression_looks_past_a_crowd_of_duplicates() -> None:
    crowd = np.tile(np.array([[0, 0, 10, 10]], np.float32), (50, 1))
    boxes = np.concatenate([crowd, [[20, 20, 30, 30]]]).astype(np.float32)
    scores = np.linspace(0.9, 0.1, 51, dtype=np.float32)
    kept = suppress(Candidates(boxes, scores, np.zeros(51, np.int64)), 0.5, 10)
    np.testing.assert_array_equal(kept.boxes_xyxy, [[0, 0, 10, 10], [20, 20, 30, 30]])


# --- recognition and contracts ---


@pytest.mark.parametrize(
    ("name", "size_px", "shape"),
    [
        ("yolov5", (640, 640), (1, 25200, 85)),
        ("yolov5", (1280, 1280), (1, 3 * (160**2 + 80**2 + 40**2 + 20**2), 85)),
        ("yolov5", (32, 32), (1, 63, 85)),  # fewer boxes than columns
        ("yolov8", (640, 640), (1, 84, 8400)),
        ("yolov8", (384, 640), (1, 84, 5040)),
        ("yolov8", (32, 32), (1, 84, 21)),
        ("yolox", (416, 416), (1, 3549, 85)),
        ("yolox", (32, 64), (1, 42, 85)),
        ("fastestdet", (352, 352), (1, 85, 22, 22)),
        ("fastestdet", (320, 352), (1, 85, 20, 22)),
    ],
)
def test_families_are_told_apart_by_their_cells(
    name: str, size_px: tuple[int, int], shape: tuple[int, ...]
) -> None:
    family, contract = resolve(NOWHERE, signature(size_px, shape))
    assert family.NAME == contract.family == name
    assert contract.classes == COCO80
    assert contract.input_size_px == size_px
    assert contract.sources["input_size_px"] == "graph"
    assumed = " ".join(contract.assumptions)
    for field in ("colour", "value_range", "mean", "std", "resize", "pad_value", "classes"):
        assert f"{field} = " in assumed
    assert "contract.json" in assumed
    assert ("YOLOv6" in assumed) == (name == "yolox")


def test_a_graph_that_fits_two_families_asks_which() -> None:
    """At 64 x 64 px there are 84 cells, as many as YOLOv8 has rows for 80 classes."""
    both = signature((64, 64), (1, 84, 84))
    with pytest.raises(ModelError, match="yolov8, yolox"):
        resolve(NOWHERE, both)
    family, contract = resolve(NOWHERE, both, "yolov8")
    assert family is yolov8
    assert contract.assumptions == []


@pytest.mark.parametrize("shape", [(1, 300, 8), (1, 1000), (1, 5, 8400, 1), (100,), (1, 84, 8401)])
def test_an_unknown_graph_is_described(shape: tuple[int, ...]) -> None:
    unknown = signature((640, 640), shape, metadata={"colour of the sky": "blue"})
    with pytest.raises(ModelError) as caught:
        resolve(NOWHERE, unknown)
    for part in ("'images' [1, 3, 640, 640] tensor(float)", "'out0'", str(list(shape)), "colour of the sky"):
        assert part in str(caught.value)
    assert '{"family": ' in str(caught.value)


def test_ultralytics_metadata_names_classes_and_pre_processing() -> None:
    metadata = {"author": "Ultralytics", "task": "detect", "stride": "32", "imgsz": "[640, 640]"}
    named = signature((640, 640), (1, 6, 8400), metadata={**metadata, "names": "{0: 'stop', 1: 'yield'}"})
    _, contract = resolve(NOWHERE, named)
    assert contract.classes == ("stop", "yield")
    assert contract.assumptions == []
    with pytest.raises(ModelError, match="segment"):
        resolve(NOWHERE, replace(named, metadata={**named.metadata, "task": "segment"}))
    with pytest.raises(ModelError, match="names"):
        resolve(NOWHERE, replace(named, metadata={**metadata, "names": "__import__('os')"}))
    with pytest.raises(ModelError, match=r"2 classes but the contract names 1 \(metadata\)"):
        resolve(NOWHERE, replace(named, metadata={**metadata, "names": "['stop']"}))


def test_yolov5_metadata_with_a_list_of_names() -> None:
    metadata = {"stride": "32", "names": "['stop', 'yield']"}
    _, contract = resolve(NOWHERE, signature((640, 640), (1, 25200, 7), metadata=metadata))
    assert (contract.classes, contract.family) == (("stop", "yield"), "yolov5")
    assert contract.assumptions == []


def test_unnamed_classes_are_not_guessed() -> None:
    with pytest.raises(ModelError, match="3 classes but nothing names them"):
        resolve(NOWHERE, signature((640, 640), (1, 7, 8400)))
    with pytest.raises(ModelError, match="3 classes but the contract names 80"):
        resolve(NOWHERE, signature((640, 640), (1, 7, 8400)), "yolov8")


def test_contract_and_graph_must_agree() -> None:
    graph = signature((640, 640), (1, 6, 8400))
    two = {"family": "yolov8", "classes": ["a", "b"]}
    with pytest.raises(ModelError, match="says yolox"):
        resolve(NOWHERE, graph, parse_contract({**two, "family": "yolox"}, "file x"))
    with pytest.raises(ModelError, match="takes only"):
        resolve(NOWHERE, graph, parse_contract({**two, "input_size_px": [320, 320]}, "file x"))
    _, contract = resolve(NOWHERE, graph, parse_contract({**two, "input_size_px": 640}, "file x"))
    assert contract.input_size_px == (640, 640)


def test_order_of_contracts(tmp_path: Path) -> None:
    """The caller's, then the file beside the model, then the metadata; ``<stem>.json`` is none."""

    def stated(name: str) -> str:
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


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_contracts_survive_json(name: str) -> None:
    contract = replace(preset(name), mean=(1.0, 2.0, 3.0), std=(0.5, 0.5, 0.5), classes=("a", "b"))
    again = parse_contract(json.loads(json.dumps(contract.to_dict())), "file x")
    assert again == contract
    assert set(again.sources.values()) == {"file x"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"color": "rgb"}, "unknown key 'color'"),
        ({"colour": "grb"}, "colour = 'grb'"),
        ({"value_range": "0-2"}, "value_range = '0-2'"),
        ({"resize": "crop"}, "resize = 'crop'"),
        ({"mean": [1, 2]}, "mean = "),
        ({"std": [1, 0, 1]}, "std = "),
        ({"pad_value": 300}, "pad_value = 300"),
        ({"nms_iou": "high"}, "nms_iou = 'high'"),
        ({"classes": []}, "classes = "),
        ({"classes": "stop sign"}, "classes = 'stop sign'"),
        ({"classes": {"1": "a", "3": "b"}}, "classes: ids"),
        ({"input_size_px": [0, 32]}, "input_size_px = "),
        ({"input_size_px": True}, "input_size_px = True"),
        ({"family": "yolo99"}, "'yolo99' is unknown"),
    ],
)
def test_bad_contracts_say_what_is_wrong(change: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        parse_contract({"family": "yolox", "classes": ["a"], **change}, "file x")


def test_unreadable_contract_files(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="missing key 'classes'"):
        parse_contract({"family": "yolox"}, "file x")
    with pytest.raises(ModelError, match="must map"):
        parse_contract(["yolox"], "file x")
    by_id = {"family": "yolox", "classes": {"1": "b", "0": "a"}}
    assert parse_contract(by_id, "file x").classes == ("a", "b")
    with pytest.raises(ModelError, match="neither a file nor a preset"):
        load_contract(tmp_path / "absent.json")
    for name, text in (("a.json", "{"), ("b.yaml", "a: [")):
        (tmp_path / name).write_text(text)
        with pytest.raises(ModelError, match=f"file {name}: cannot be read"):
            load_contract(tmp_path / name)
    assert parse_contract({"family": "yolox", "classes": "coco80"}, "x").classes[11] == "stop sign"


# --- pictures into the network, boxes back ---


def corner_marks(height: int, width: int) -> NDArray[np.uint8]:
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0], image[..., 1], image[..., 2] = 200, 100, 50
    return image


@pytest.mark.parametrize(
    ("resize", "window"),
    [
        ("letterbox", (slice(16, 48), slice(0, 96))),
        ("letterbox-top-left", (slice(0, 32), slice(0, 96))),
        ("stretch", (slice(0, 64), slice(0, 96))),
    ],
)
@pytest.mark.parametrize(("colour", "order"), [("rgb", [200, 100, 50]), ("bgr", [50, 100, 200])])
@pytest.mark.parametrize(("value_range", "full_scale"), [("0-1", 255), ("0-255", 1)])
def test_pictures_are_laid_in_as_the_contract_says(
    resize: str,
    window: tuple[slice, slice],
    colour: str,
    order: list[int],
    value_range: str,
    full_scale: int,
) -> None:
    """A picture of 16 x 48 px into 64 x 96: letterboxed it is 32 x 96."""
    mean, std = (0.1, 0.2, 0.3), (2.0, 4.0, 8.0)
    contract = Contract(
        "yolov8", ("a",), colour=colour, value_range=value_range, mean=mean, std=std, resize=resize
    )
    blob, placement = lay_in(corner_marks(16, 48), contract, (64, 96))
    assert blob.shape == (1, 3, 64, 96)
    assert blob.dtype == np.float32
    expected = np.full((64, 96, 3), 114.0)
    expected[window] = order
    expected = (expected / full_scale - mean) / std
    np.testing.assert_allclose(blob[0], expected.transpose(2, 0, 1), rtol=1e-5)
    box = np.array([[window[1].start, window[0].start, window[1].stop, window[0].stop]], np.float32)
    np.testing.assert_allclose(placement.to_picture(box), [[0, 0, 48, 16]], atol=1e-5)
    np.testing.assert_allclose(placement.to_picture(box + np.float32([-99, -99, 99, 99])), [[0, 0, 48, 16]])


@pytest.mark.parametrize("shape", [(1, 1), (1, 500), (500, 1), (427, 640), (641, 33)])
@pytest.mark.parametrize("resize", ["letterbox", "letterbox-top-left", "stretch"])
def test_any_picture_fits_and_buffers_are_wiped(shape: tuple[int, int], resize: str) -> None:
    contract = replace(preset("yolov8"), resize=resize)
    dirty = np.full((1, 3, 64, 96), 7, np.float32)
    blob, _ = lay_in(corner_marks(*shape), contract, (64, 96), out=dirty)
    assert blob is dirty
    values = {round(v) for v in np.unique(blob * 255)}
    assert values <= {50, 100, 114, 200}
    np.testing.assert_array_equal(blob, lay_in(corner_marks(*shape), contract, (64, 96))[0])


def test_views_of_pictures_are_read_correctly() -> None:
    image = np.random.default_rng(0).integers(0, 256, (40, 30, 3), dtype=np.uint8)
    for view in (image[::-1], image[:, ::-1], image[..., ::-1], image[::2, 3:20]):
        for size in ((64, 96), view.shape[:2]):
            there, _ = lay_in(view, preset("yolov8"), size)
            np.testing.assert_array_equal(there, lay_in(view.copy(), preset("yolov8"), size)[0])


@pytest.mark.parametrize(
    ("image", "error"),
    [
        (np.zeros((8, 8, 3), np.float32), TypeError),
        ("picture.png", TypeError),
        (np.zeros((8, 8), np.uint8), ValueError),
        (np.zeros((3, 8, 8), np.uint8), ValueError),
        (np.zeros((0, 8, 3), np.uint8), ValueError),
    ],
)
def test_other_things_are_no_pictures(image, error: type[Exception]) -> None:
    with pytest.raises(error, match="image: "):
        lay_in(image, preset("yolov8"), (64, 96))
