"""What COCO's rules give, box by box and by COCO's own tools and faster-coco-eval. Boxes are (x0, y0, x1, y1) px."""

from collections.abc import Sequence
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import pycocotools.coco
from faster_coco_eval import COCO, COCOeval_faster
from pycocotools.cocoeval import COCOeval

Box = Sequence[float]


def overlap(one, other):
    """Intersection over union."""
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    shared = max(width, 0) * max(height, 0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (one, other)]
    return shared / (sum(areas) - shared) if shared else 0.0


def target_confidence(detections, box_xyxy, class_id):
    """Highest score of the class with an IoU of at least 0.5 with the box, else 0."""
    rows = zip(
        detections.boxes_xyxy.tolist(), detections.scores.tolist(), detections.class_ids.tolist(), strict=True
    )
    right = [score for box, score, own in rows if own == class_id and overlap(box, box_xyxy) >= 0.5]
    return max(right, default=0.0)


def hits(detections, targets_xyxy, class_id):
    """Which detections of the class, highest score first, match a target of their own at an IoU of 0.5, (n,)."""
    free = np.asarray(targets_xyxy, float).reshape(-1, 4).tolist()
    found = []
    for box in detections.boxes_xyxy[detections.class_ids == class_id].tolist():
        best = max(free, key=lambda target, box=box: overlap(box, target), default=None)  # type: ignore[misc]
        found.append(best is not None and overlap(box, best) >= 0.5)
        if found[-1]:
            free.remove(best)
    return np.array(found, bool)


def average_precision(detections, targets_xyxy, class_id):
    """AP, AP50 and AP75 of one class over pictures, by the library."""

    def sides(boxes):
        corners = np.asarray(boxes, float).reshape(-1, 4)
        return np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1).tolist()

    shared = {"category_id": 1, "iscrowd": 0}
    truth = [
        {**shared, "image_id": picture, "bbox": box, "area": box[2] * box[3]}
        for picture, boxes in enumerate(targets_xyxy)
        for box in sides(boxes)
    ]
    answers = [
        {"image_id": picture, "category_id": 1, "bbox": box, "score": score}
        for picture, each in enumerate(detections)
        for box, score in zip(
            sides(each.boxes_xyxy[each.class_ids == class_id]),
            each.scores[each.class_ids == class_id].tolist(),
            strict=True,
        )
    ]
    coco = COCO(
        {
            "images": [{"id": picture} for picture in range(len(targets_xyxy))],
            "annotations": [{**each, "id": number} for number, each in enumerate(truth, start=1)],
            "categories": [{"id": 1, "name": "target"}],
        }
    )
    judge = COCOeval_faster(coco, coco.loadRes(answers), "bbox", print_function=lambda *_: None)
    judge.run()
    ap, ap50, ap75 = map(float, judge.stats[:3])
    return ap, ap50, ap75


def stats_of_cocos_tools(truth, results):
    """The twelve numbers of pycocotools' summary. truth: a file of instances, or its document."""
    with redirect_stdout(StringIO()):
        coco = pycocotools.coco.COCO(None if isinstance(truth, dict) else str(truth))
        if isinstance(truth, dict):
            coco.dataset = truth
            coco.createIndex()
        judge = COCOeval(coco, coco.loadRes(results), "bbox")
        judge.evaluate()
        judge.accumulate()
        judge.summarize()
    return judge.stats
