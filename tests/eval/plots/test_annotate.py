"""Boxes on example pictures: many, and far outside."""

from typing import Any

import numpy as np
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.plots import annotate
from stored_rows import answer


def drawn_targets(folder, boxes):
    write_picture(folder / "p.png", np.full((40, 60, 3), 90, np.uint8))
    targets = [
        answer(x0=x0, y0=y0, x1=x1, y1=y1, width_px=x1 - x0, height_px=y1 - y0, confidence=0.0)
        for x0, y0, x1, y1 in boxes
    ]
    return annotate.drawn_example(folder / "p.png", [], targets, 60, 0.6)


def test_of_many_targets_the_largest_are_drawn(tmp_path, monkeypatch):
    drawn: list[float] = []
    monkeypatch.setattr(annotate, "_draw_box", lambda _, box, *rest, **options: drawn.append(box[2]))
    sides = np.random.default_rng(3).permutation(1000) + 1.0
    drawn_targets(tmp_path, [(0.0, 0.0, side, 9.0) for side in sides.tolist()])
    assert drawn == sorted((side for side in sides.tolist() if side > 700), reverse=True)
    drawn.clear()
    drawn_targets(tmp_path, [(0.0, 0.0, 5.0, 5.0)] * 300)
    assert len(drawn) == 300


def test_boxes_that_reach_anywhere(tmp_path, monkeypatch):
    """The part inside the picture is drawn as ever, in a number of dashes that the picture bounds."""
    lines: list[Any] = []
    line = annotate.cv2.line
    monkeypatch.setattr(annotate.cv2, "line", lambda *given: (lines.append(given), line(*given))[1])
    picture = drawn_targets(tmp_path, [(-1e12, 20.0, 1e12, 1e300)])
    assert picture is not None
    assert 4 < len(lines) < 200
    assert (picture[19:22] == annotate.MISSED_RGB).all(axis=-1).any()
