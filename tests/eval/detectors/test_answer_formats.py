"""Generated graphs in exactly the layouts of the families, with known answers, through onnxruntime."""

import numpy as np
import pytest
from blurnoise_eval.detectors import recognition
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.formats import FAMILIES as FAMILIES_BY_NAME
from blurnoise_eval.detectors.formats import PRESETS
from blurnoise_eval.detectors.formats.boxes import best_class, select
from blurnoise_eval.detectors.formats.family import Family
from constant_graphs import answering_graph
from onnx import TensorProto

SIZE_PX = (64, 96)
BOXES_XYXY = np.array([[10.0, 5.0, 40.0, 25.0], [12.0, 6.0, 42.0, 26.0], [50.0, 30.0, 90.0, 60.0]])
CLASSES = np.array([2, 2, 0])
SCORES = np.array([0.6, 0.5, 0.9])  # of a white picture; of a black one 0
ANSWERING = ("yolov10", "yolov7", "mmdeploy", "rtdetr", "ppyoloe", "yolov6e2e", "tfod", "torchvision")
FAMILIES = (*ANSWERING, "rfdetr", "detr")
AXES = {"tfod": "nhwc", "torchvision": "chw"}
NAMES = ("first", "second", "third")
EXTRAS = {
    "rtdetr": [("orig_target_sizes", TensorProto.INT64, [2])],
    "ppyoloe": [("scale_factor", TensorProto.FLOAT, [2]), ("im_shape", TensorProto.FLOAT, [2])],
    "detr": [("pixel_mask", TensorProto.INT64, ["mask height", "mask width"])],
}


def logit(score):
    return np.log(score / (1 - score))


def tensors(family):
    """Each output's value for a black picture, and what white adds to it. int64 where nothing is added."""
    score, klass = SCORES[:, None], CLASSES[:, None].astype(float)
    none, boxes = np.zeros((3, 4)), BOXES_XYXY
    if family == "yolov10":
        padded = np.zeros((1, 5, 6))
        padded[0, :3] = np.hstack([boxes, 0 * score, klass])
        gain = np.zeros((1, 5, 6))
        gain[0, :3, 4] = SCORES
        return {"output0": (padded, gain)}
    if family == "yolov7":
        first = np.hstack([0 * score, boxes, klass, 0 * score])
        other = np.array([[1, 0, 0, 96, 64, 1, 0.99]])  # of another picture of the batch
        gain = np.vstack([np.hstack([np.zeros((3, 6)), score]), np.zeros((1, 7))])
        return {"output": (np.vstack([first, other]), gain)}
    if family == "mmdeploy":
        dets = np.hstack([boxes, 0 * score])[None], np.hstack([none, score])[None]
        return {"dets": dets, "labels": (CLASSES[None].astype(np.int64), np.zeros(0))}
    if family == "rtdetr":  # in a graph's own order, which is not the family's
        return {
            "scores": (np.zeros((1, 3)), SCORES[None]),
            "labels": (CLASSES[None].astype(np.int64), np.zeros(0)),
            "boxes": (boxes[None], none[None]),
        }
    if family == "ppyoloe":
        rows = np.vstack([np.hstack([klass, 0 * score, boxes]), [-1, 0.7, 0, 0, 9, 9], [1, 0.99, 0, 0, 9, 9]])
        gain = np.zeros((5, 6))
        gain[:3, 1] = SCORES
        # the fifth: another's
        return {"nms_0": (rows, gain), "nms_1": (np.array([4], np.int64), np.zeros(0))}
    if family in ("tfod", "yolov6e2e"):
        shares = boxes[:, [1, 0, 3, 2]] / np.array([SIZE_PX[0], SIZE_PX[1]] * 2)
        zero, padding, beyond = np.zeros((1, 5)), np.array([[9.0, 9.0]]), np.array([[0.0, 0.99]])
        answers = {
            "num_detections": (np.array([4.0]), np.zeros(1)),
            "detection_boxes": (np.vstack([shares, np.zeros((2, 4))])[None], np.zeros((1, 5, 4))),
            "detection_scores": (
                np.hstack([0 * SCORES[None], beyond]),
                np.hstack([SCORES[None], 0 * beyond]),
            ),
            "detection_classes": (np.hstack([CLASSES[None] * 1.0, padding]), zero),
        }
        if family == "tfod":
            answers["raw_detection_scores"] = (zero, zero)
            return answers
        whole = np.vstack([boxes, np.zeros((2, 4))])[None]
        return {
            "num_dets": (np.array([[4]], np.int32), np.zeros(0)),
            "det_boxes": (whole, np.zeros((1, 5, 4))),
            "det_scores": answers["detection_scores"],
            "det_classes": (answers["detection_classes"][0].astype(np.int32), np.zeros(0)),
        }
    if family == "torchvision":
        return {
            "3120": (boxes, none),
            "3125": (np.zeros(3), SCORES),
            "3130": (CLASSES.astype(np.int64), np.zeros(0)),
        }
    centres = np.hstack([(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]])
    shares = centres / np.array([SIZE_PX[1], SIZE_PX[0]] * 2)
    base, gain = np.full((1, 3, 4), -20.0), np.zeros((1, 3, 4))  # four wide, as the boxes
    gain[0, np.arange(3), CLASSES] = logit(SCORES) + 20
    if family == "detr":
        odds = np.zeros((1, 3, 4))  # beside three logits of 0 and -20: softmax is the sigmoid, nearly
        base[0, :, 3] = 0
        odds[0, np.arange(3), CLASSES] = logit(SCORES) + 20
        return {"logits": (base, odds), "pred_boxes": (shares[None], np.zeros_like(shares)[None])}
    return {"labels": (base, gain), "dets": (shares[None], np.zeros_like(shares)[None])}


def graph(
    path, family, *, size = SIZE_PX, batch = 1,
    squeezed = False, names = None, asks = True, **form,
):  # fmt: skip
    """Write a detector whose scores grow with the picture's mean: 0 for black, ``SCORES`` for white.

    squeezed: outputs without their batch. names: of outputs, others than the family's. asks: for inputs beside
    the picture, where the family does.
    """
    outputs, shapes = {}, {}
    for own, parts in tensors(family).items():
        base, gain = (each[0] if squeezed and each.ndim > 1 else each for each in parts)
        outputs[(names or {}).get(own, own)] = base, None if base.dtype.kind == "i" else gain
        if family in ("yolov7", "ppyoloe") and base.ndim == 2:
            shapes[own] = ["answers", base.shape[1]]
    taken = {"nhwc": [batch, *size, 3], "chw": [3, *size]}.get(AXES.get(family, ""), [batch, 3, *size])
    if family == "tfod":
        form |= {"takes": TensorProto.UINT8, "white": 255.0}
    else:
        form["takes"] = form.get("dtype", TensorProto.FLOAT)
    extras = [(name, kind, [batch, *shape]) for name, kind, shape in EXTRAS.get(family, ()) if asks]
    return answering_graph(path, outputs, taken, shapes=shapes, extras=extras, **form)


def stated(family):
    classes = (*NAMES, "background") if family == "rfdetr" else NAMES
    value_range = "0-255" if family == "tfod" else "0-1"
    return Contract(
        family, classes, value_range=value_range, resize="stretch", input_size_px=SIZE_PX, nms_iou=None
    )


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(
    "form",
    [{"opset": 13}, {"dtype": TensorProto.FLOAT16}, {"size": ("height", "width")}, {"batch": 2}],
    ids=str,
)
def test_known_answers(family, form, tmp_path):
    detector = Detector(graph(tmp_path / "m.onnx", family, **form), contract=stated(family))
    white = np.full((128, 192, 3), 255, np.uint8)  # twice the input
    found = detector.detect(white)
    order = [2, 0, 1]  # by score; the second overlaps the first and stays: the graph has answered
    half = form.get("dtype") == TensorProto.FLOAT16
    np.testing.assert_allclose(found.scores, SCORES[order], atol=5e-3 if half else 1e-5)
    np.testing.assert_allclose(found.boxes_xyxy, 2 * BOXES_XYXY[order], atol=0.25 if half else 1e-3)
    assert found.class_ids.tolist() == CLASSES[order].tolist()
    assert len(detector.detect(np.zeros_like(white))) == 0
    assert len(detector.detect(white, max_detections=2)) == 2


@pytest.mark.parametrize("family", ["tfod", "torchvision"])
def test_graphs_that_resize_by_themselves_get_the_picture_as_it_is(family, tmp_path):
    """Boxes come back in px of that picture: shares of it for TensorFlow's, px for torchvision's."""
    path = graph(tmp_path / "m.onnx", family, size=("height", "width"))
    detector = Detector(path)
    assert detector.contract.resize == "none"
    assert detector.takes_bytes == (family == "tfod")
    for shape in ((100, 150), (77, 120)):
        white = np.full((*shape, 3), 255, np.uint8)
        blob, _ = detector.prepare(white)
        assert blob.shape == ((1, *shape, 3) if family == "tfod" else (3, *shape))
        found = detector.detect(white)
        scale = np.array(shape[::-1] * 2) / (SIZE_PX[::-1] * 2) if family == "tfod" else 1
        np.testing.assert_allclose(found.boxes_xyxy, (BOXES_XYXY * scale)[[2, 0, 1]], rtol=1e-5)
        assert found.class_ids.tolist() == [0, 2, 2]
    fixed = Detector(graph(tmp_path / "fixed.onnx", family))
    assert fixed.contract.resize == ("stretch" if family == "tfod" else "letterbox-top-left")


def test_a_family_is_one_entry_and_one_line_in_the_table(tmp_path, monkeypatch):
    """Made up: halves of centre and size, one class after the other, under names that no other family has."""

    def decode(outputs, size_px, min_score):
        halves, scores = (output[0] for output in outputs)
        return select(2 * halves, *best_class(scores), min_score, scores)

    made_up = Family(Contract("made up", NAMES), ("halves: b n 4, odds: b n C",), decode)
    monkeypatch.setattr(recognition, "BY_EVIDENCE", ((made_up,), *recognition.BY_EVIDENCE))
    monkeypatch.setitem(FAMILIES_BY_NAME, "made up", made_up)
    monkeypatch.setitem(PRESETS, "made up", made_up.preset)
    answers = np.array([[[20, 10, 5, 5]]], np.float32), np.array([[[0.1, 0.7, 0.2]]], np.float32)
    outputs = {"halves": (answers[0], None), "odds": (answers[1], None)}
    path = answering_graph(tmp_path / "m.onnx", outputs, [1, 3, *SIZE_PX])
    for contract in (None, "made up", {"family": "made up", "classes": NAMES}):
        detector = Detector(path, contract=contract)
        found = detector.detect(np.zeros((*SIZE_PX, 3), np.uint8))
        assert (detector.contract.family, found.class_ids.tolist()) == ("made up", [1])
        np.testing.assert_allclose(found.boxes_xyxy, [[35, 15, 45, 25]])
