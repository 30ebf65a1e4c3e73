"""What is kept of a score: a ratio of sums over the same targets, its interval, and what is said of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.recommendation import averages, recommendations
from blurnoise_eval.answers.table import ScoreTable
from made_tables import Named, answers, curve, endurances, tables
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


def test_a_ratio_of_sums() -> None:
    """a: 0.8 and 0.1 untouched, 0.4 in two noise fields each; b: 0.5 and 0; c has no original picture."""
    clean = {("a", 0): 0.8, ("a", 1): 0.1, ("b", 0): 0.5, ("b", 1): 0.0}
    seen = {("a", 0): (0.4, 0.6), ("a", 1): (0.2, 0.2), ("b", 0): (0.5, 0.4), ("b", 1): (0.1, 0.0)}
    found = kept_table(clean, {0.01: {**seen, ("c", 0): (0.9, 0.9)}})
    assert found.clusters == ("a", "b")
    assert found.counts[:, 0] == pytest.approx([2 * 0.9, 2 * 0.5])
    assert found.mean[0] == pytest.approx((1.4 + 1.0) / 2.8)
    assert (found.n_targets, found.clean, found.reference) == (8, pytest.approx(0.35), pytest.approx(1.4))
    assert found.most == pytest.approx(8 / 2.8)  # if all had confidence 1


def test_a_picture_that_was_not_known_counts_by_what_is_found() -> None:
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


def test_more_than_all_can_be_kept() -> None:
    """Twice the original confidence is the most there is; the best may exceed it by far."""
    found = answer({0.01: [0.5] * 24, 0.02: [1.2] * 24, 0.04: [1.19] * 24, 0.08: [1.0] * 24})
    assert found.verdict == "works"
    assert (found.best_s, found.best_value) == (0.02, pytest.approx(1.2))
    assert found.best_low is not None
    assert found.best_high is not None
    assert 0.9 < found.best_low < 1.2 < found.best_high < 2.0
    assert found.recommended_s in (0.02, 0.04)  # within 0.02 of the best
    assert found.criterion == "keeps 0.9 of its confidence"
    assert found.clean_value == pytest.approx(0.5)
    assert found.high is not None
    assert max(answer({0.01: [2.0] * 24}).high or ()) == pytest.approx(2.0)
    assert max(answer({0.01: [0.99] * 24}, known=1.0).high or ()) <= 1.0


def test_of_equals_the_shortest_is_the_best() -> None:
    found = answer({0.01: [1.1] * 24, 0.02: [1.1] * 24})
    assert (found.best_s, found.recommended_s) == (0.01, 0.01)


def test_there_is_a_best_where_nothing_works() -> None:
    found = answer({0.01: [0.3] * 40, 0.02: [0.5] * 40, 0.04: [0.1] * 40})
    assert (found.verdict, found.recommended_s, found.windows_s) == ("no exposure works", None, [])
    assert (found.best_s, found.best_value) == (0.02, pytest.approx(0.5))
    assert found.best_low is not None
    assert found.best_low < 0.5 < (found.best_high or 0)
    assert answer({0.01: [0.3] * 5, 0.02: [0.5] * 5}).best_value == pytest.approx(0.5)


def test_pictures_to_tell_know_how_far_the_bound_is() -> None:
    """Below the level: the farther what a picture can keep at most, the more pictures it takes."""
    values = np.linspace(0.7, 1.0, 12).tolist()
    needed = [answer({0.01: values}, known).pictures_to_tell or 0 for known in (1.0, 0.1)]
    assert 0 < needed[0] < needed[1]


def test_curves_of_what_is_kept() -> None:
    clean = {(f"p{place}", 0): 0.5 for place in range(10)}
    found = kept_table(
        clean, {s: dict.fromkeys(clean, (0.5 * kept,)) for s, kept in ((0.01, 1.2), (0.1, 0.6))}
    )
    (over,) = endurances(found, KEEP)
    assert over.confidence == pytest.approx((1.2, 0.6))
    assert over.auc == pytest.approx(0.9)  # trapezium in s
    assert over.fails_at == pytest.approx(10**-1.5)  # half a decade on
    assert (over.auc_high or 0) > 1
    assert over.criterion == KEEP.text


EXPOSURES_S = (1e-3, 2e-3, 5e-3, 10e-3, 20e-3, 45e-3, 90e-3)


def photographs(
    generator: np.random.Generator, pictures: int, samples: int, hardness: float
) -> tuple[Any, ...]:
    """References (pictures, samples), sums (pictures, samples, exposures), numbers of targets (pictures, samples).

    Up to 20 targets a picture, 4 on average, of very different confidence; below 0.05 nothing is listed, so that in
    some pictures nothing is known. Edges differ by picture, as ``bench intervals`` has them.
    """
    count = np.minimum(generator.geometric(1 / 4, size=(pictures, samples)), 20)
    there = np.arange(20)[:, None, None] < count
    logits = generator.normal(size=(pictures, samples)) - hardness + 1.5 * generator.normal(size=there.shape)
    moved = 0.25 * generator.normal(size=(2, pictures, samples))

    def listed(at: np.ndarray[Any, Any]) -> Any:
        confidence = np.where(there, 1 / (1 + np.exp(-at)), 0.0)
        return np.where(confidence < 0.05, 0.0, confidence).sum(axis=0)

    sums = []
    for at in np.log10(EXPOSURES_S):
        rise, fall = at - np.log10(3e-3) - moved[0], np.log10(4e-2) + moved[1] - at
        window = 1 / (1 + np.exp(-rise / 0.12)) / (1 + np.exp(-fall / 0.12))
        sums.append(listed(logits + 4 * (window - 1) + 0.6 * generator.normal(size=there.shape)))
    return listed(logits), np.stack(sums, axis=-1), count


@pytest.mark.slow
@pytest.mark.parametrize("hardness", [0.0, 2.0, 3.5])
def test_intervals_and_verdicts_hold_on_pictures_like_photographs(hardness: float) -> None:
    """Untouched means of 0.5, 0.2 and 0.07, with 1, 11 and 35 % of pictures in which nothing is known.

    300 samples of 35 pictures: a true coverage of 0.95 shows 0.95 -+ 0.0126 at each exposure; 0.91 is three of that
    below, 0.94 the mean of seven. A verdict is wrong where one of several exposures misses on one side: 5 % at most.
    """
    generator = np.random.default_rng(5)
    known, sums, _ = photographs(generator, 1000, 60, hardness)
    truth = sums.sum((0, 1)) / known.sum()
    known, sums, count = photographs(generator, 35, 300, hardness)
    held, verdicts, wrong = [], 0, 0
    for sample in range(300):
        counts = np.repeat(known[:, sample, None], len(EXPOSURES_S), axis=1)
        most = float(count[:, sample].sum() / known[:, sample].sum())
        values = np.divide(sums[:, sample], counts, out=np.zeros_like(counts), where=counts > 0)
        of = curve(values, EXPOSURES_S, counts, kept=True, clean=1 / most)
        ends = of.interval()
        if ends is None:
            continue
        held.append((ends.low <= truth) & (truth <= ends.high))
        for level in (0.8, 0.9):
            works = any(low <= x <= high for x in EXPOSURES_S for low, high in of.sure(level))
            fails = not of.possible(level)
            verdicts += works or fails
            wrong += (works and truth.max() < level) or (fails and truth.max() >= level)
    assert len(held) > 240
    coverage = np.mean(held, axis=0)
    assert coverage.min() > 0.91
    assert coverage.mean() > 0.94
    assert verdicts > 20
    assert wrong <= 0.05 * len(held)
