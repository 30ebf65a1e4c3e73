"""Boxes with classes that another one leads: asked for above a score, they are those of all with a higher one."""

from __future__ import annotations

import numpy as np
from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, suppress


def test_what_is_left_out_below_a_score_changes_nothing_above_it() -> None:
    """300 boxes about 12 places, 5 classes: doubles are there to suppress, with equal scores among them."""
    rng = np.random.default_rng(3)
    corners = rng.uniform(0, 90, (12, 2))[rng.integers(0, 12, 300)] + rng.normal(0, 4, (300, 2))
    boxes = np.concatenate([corners, corners + rng.uniform(20, 40, (300, 2))], axis=1).astype(np.float32)
    each = (rng.uniform(0, 1, (300, 5)).round(2) ** 2).astype(np.float32)
    candidates = Candidates(boxes, *best_class(each), each)
    asked, above = np.array([1, 4]), np.array([0.3, 0.0], np.float32)
    every = suppress(candidates.with_classes(0.01, asked), 0.5, 200, per_class=100)
    some = suppress(candidates.with_classes(0.01, asked, above), 0.5, 200, per_class=100)
    higher = every[every.scores > np.where(every.class_ids == 1, above[0], above[1])]
    assert 20 < len(some) == len(higher) < len(every)
    assert (some.class_ids == 1).any()
    np.testing.assert_array_equal(some.boxes_xyxy, higher.boxes_xyxy)
    np.testing.assert_array_equal(some.scores, higher.scores)
    np.testing.assert_array_equal(some.class_ids, higher.class_ids)
