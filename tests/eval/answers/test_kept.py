"""What is kept of a score: a ratio of sums over the same targets, its interval, and what is said of it."""

from collections.abc import Iterator
from typing import Any

import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.recommendation import averages, recommendations
from blurnoise_eval.answers.table import ScoreTable
from made_tables import Named, answers, tables
from plans import OWN

KEEP = Criterion(0.9, kept=True)
Known = dict[tuple[str, int], float]
"""Confidence in the original picture by picture and target."""


def kept_table(clean: Known, seen: dict[float, dict[tuple[str, int], tuple[float, ...]]]) -> ScoreTable:
    """Confidences by exposure, picture and target, one for each noise field."""

    def rows() -> Iterator[dict[str, Any]]:
        for exposure_s, targets in seen.items():
            for (image, target), fields in targets.items():
                for repeat, confidence in enumerate(fields):
                    at = {"illuminance_lux": 50.0, "velocity_x_px_s": 0.0, "velocity_y_px_s": 0.0, **OWN}
                    at |= {"model": "m", "group": "g", "image": image, "target_id": target, "repeat": repeat}
                    yield at | {"exposure_s": exposure_s, "confidence": confidence}

    (found,) = tables(rows(), clean_of=lambda row: clean.get((row["image"], row["target_id"])), kept=True)
    return found


def test_a_ratio_of_sums():
    """a: 0.8 and 0.1 untouched, 0.4 in two noise fields each; b: 0.5 and 0; c has no original picture."""
    clean = {("a", 0): 0.8, ("a", 1): 0.1, ("b", 0): 0.5, ("b", 1): 0.0}
    seen = {("a", 0): (0.4, 0.6), ("a", 1): (0.2, 0.2), ("b", 0): (0.5, 0.4), ("b", 1): (0.1, 0.0)}
    found = kept_table(clean, {0.01: {**seen, ("c", 0): (0.9, 0.9)}})
    assert found.clusters == ("a", "b")
    assert found.counts[:, 0] == pytest.approx([2 * 0.9, 2 * 0.5])
    assert found.mean[0] == pytest.approx((1.4 + 1.0) / 2.8)
    assert (found.n_targets, found.clean, found.reference) == (8, pytest.approx(0.35), pytest.approx(1.4))
    assert found.most == pytest.approx(8 / 2.8)  # if all had confidence 1


def test_a_picture_that_was_not_known_counts_by_what_is_found():
    """It has a part in the mean and in its departures: without it the mean is 0.75 instead of 0.85."""
    clean = {(f"p{place}", 0): 0.8 for place in range(8)} | {("late", 0): 0.0}
    found = kept_table(clean, {0.01: {key: (0.6 if value else 0.64,) for key, value in clean.items()}})
    assert found.mean[0] == pytest.approx((8 * 0.6 + 0.64) / 6.4)
    assert found.n_clusters == 9
    assert found.influence[-1, 0] == pytest.approx(8 * (found.mean[0] - 4.8 / 6.4))
    (row,) = (each for each in recommendations(averages([found], 0.9)) if each["scope"] == "condition")
    (answer,) = answers(found, KEEP)
    assert (row["low"], row["high"]) == pytest.approx((answer.low[0], answer.high[0]))


def answer(kept: dict[float, list[float]], known: float = 0.5) -> Named:
    """Of pictures with one target each, what each keeps."""
    clean = {(f"p{place}", 0): known for place in range(len(next(iter(kept.values()))))}
    seen = {
        exposure_s: {(f"p{place}", 0): (known * value,) for place, value in enumerate(values)}
        for exposure_s, values in kept.items()
    }
    (found,) = answers(kept_table(clean, seen), KEEP)
    return found


def test_more_than_all_can_be_kept():
    """Twice the original confidence is the most there is; the best may exceed it by far."""
    found = answer({0.01: [0.5] * 24, 0.02: [1.2] * 24, 0.04: [1.19] * 24, 0.08: [1.0] * 24})
    assert found.verdict == "works"
    assert (found.best_s, found.best_value) == (0.02, pytest.approx(1.2))
    assert 0.9 < found.best_low < 1.2 < found.best_high < 2.0
    assert found.recommended_s in (0.02, 0.04)  # within 0.02 of the best
    assert found.criterion == "keeps 0.9 of its confidence"
    assert found.clean_value == pytest.approx(0.5)
    assert found.high is not None
    assert max(answer({0.01: [2.0] * 24}).high or ()) == pytest.approx(2.0)
    assert max(answer({0.01: [0.99] * 24}, known=1.0).high or ()) <= 1.0
