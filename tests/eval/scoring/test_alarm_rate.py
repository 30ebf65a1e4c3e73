"""The confidence at which the original pictures give a rate of false alarms: by hand."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.scoring.evaluated import Evaluated, Truth

AT, ELSEWHERE, CROWD = (10.0, 10.0, 30.0, 40.0), (60.0, 60.0, 70.0, 90.0), (100.0, 0.0, 200.0, 100.0)


def found(*seen: tuple[tuple[float, ...], float, int]) -> Detections:
    boxes, scores, classes = zip(*seen, strict=True)
    return Detections(np.array(boxes, np.float32), np.array(scores, np.float32), np.array(classes, np.int64))


def judged() -> Evaluated:
    """Two pictures with a target each, and false alarms of 0.7, 0.4 (a second answer to one target) and 0.03."""

    def annotation(image: int, box: tuple[float, ...], crowd: int = 0) -> dict[str, object]:
        x0, y0, x1, y1 = box
        sides = [x0, y0, x1 - x0, y1 - y0]
        return {
            "image_id": image,
            "category_id": 5,
            "bbox": sides,
            "area": sides[2] * sides[3],
            "iscrowd": crowd,
        }

    truth = Truth(
        {"annotations": [annotation(1, AT), annotation(2, AT), annotation(2, CROWD, 1)]},
        {"a": 1, "b": 2},
        {0: 5},
    )
    cells = [
        ("a", 0, found((AT, 0.9, 0), (AT, 0.4, 0), (ELSEWHERE, 0.99, 1))),  # class 1 is not judged
        (
            "b",
            0,
            found((ELSEWHERE, 0.7, 0), (AT, 0.5, 0), (ELSEWHERE, 0.03, 0), ((110, 10, 150, 60), 0.8, 0)),
        ),
    ]
    return Evaluated({}, truth, Answers.of(cells))


@pytest.mark.parametrize(
    ("rate", "expected"), [(0.1, 0.7), (0.49, 0.7), (0.5, 0.4), (1.0, 0.03), (1.5, 0.0), (100.0, 0.0)]
)
def test_confidence_at_a_rate(rate: float, expected: float) -> None:
    alarms = judged().alarms_from(0.0)
    assert alarms.confidence_at(rate) == pytest.approx(expected)
    wrong = (~alarms.right & (alarms.scores > alarms.confidence_at(rate))).sum()
    assert wrong / 2 <= rate
