"""Intervals hold the truth as often as they say, in populations of pictures that can be drawn without end."""

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import windows
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.scoring import uncertainty
from made_tables import curve, table

EXPOSURES_S = tuple(ms / 1e3 for ms in (1, 2, 5, 10, 15, 20, 30, 45, 60, 90))
DECADES = 0.25  # by which a picture shifts both edges, one sigma each
OWN = 0.1  # decades: what of that is one detector's only
SLOPE = 0.12  # of a picture's logistic curve, decades
SAMPLES = 600
# 93 to 98 % are wanted; a share of 600 samples is known to 2 standard deviations, 2.1 %.
LEAST, MOST = 0.93 - 0.021, 0.98 + 0.021


def window(dark, bright, noise):
    """Logistic edges at 3 and 40 ms over the logarithm of the exposure, moved by decades, noise on the logits."""
    at = np.log10(EXPOSURES_S)
    rise, fall = (at + 2.523 - dark) / SLOPE + noise, (-1.398 + bright - at) / SLOPE + noise
    return np.asarray(1 / (1 + np.exp(-rise)) / (1 + np.exp(-fall)))


def one_sign(rng, pictures, samples):
    """One target per picture in three noise fields: (pictures, targets, samples, exposures), of two detectors."""
    shared = np.sqrt(DECADES**2 - OWN**2) * rng.normal(size=(2, pictures, 1, samples, 1))

    def detector(later):
        dark, bright = shared + OWN * rng.normal(size=shared.shape)
        return 0.97 * window(
            dark + later, bright, 0.5 * rng.normal(size=(pictures, 3, samples, len(EXPOSURES_S)))
        )

    return detector(0.0), detector(0.06)


def small_targets(rng, pictures, samples):
    """1 to 60 targets per picture, 8 on average: most confidences near 0, more so in crowded pictures; else NaN."""
    count = np.minimum(rng.geometric(1 / 8, size=(pictures, 1, samples, 1)), 60)
    there = np.arange(int(count.max()))[:, None, None] < count
    ease = 0.8 * rng.normal(size=count.shape) - 0.4 * np.log(count / 8)
    target = 1.5 * rng.normal(size=(pictures, int(count.max()), samples, 1))
    shared = np.sqrt(DECADES**2 - OWN**2) * rng.normal(size=(2, *count.shape))

    def detector(later):
        dark, bright = shared + OWN * rng.normal(size=shared.shape)
        known = 1 / (1 + np.exp(3.0 - ease - target - 0.3 * rng.normal(size=target.shape)))
        return np.where(there, known * window(dark + later, bright, 0.0), np.nan)

    return detector(0.0), detector(0.06)


def sums(seen):
    """Of both detectors' confidences and their number, (pictures, samples, exposures)."""
    first, second = (np.nansum(each, axis=1) for each in seen)
    return first, second, np.isfinite(seen[0]).sum(axis=1).astype(float)


def share_held(ends, truth):
    return float(np.mean((ends.low - 1e-12 <= truth) & (truth <= ends.high + 1e-12)))


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [8, 12, 20, 35, 100])
@pytest.mark.parametrize("draw", [one_sign, small_targets])
def test_levels_and_differences(draw, pictures):
    rng = np.random.default_rng([3, pictures])
    whole = [sums(draw(rng, 100, 100)) for _ in range(40)]
    first, second, counts = (sum(part.sum((0, 1)) for part in parts) for parts in zip(*whole, strict=True))
    truth, other = first / counts, second / counts
    batches = [sums(draw(rng, pictures, 100)) for _ in range(SAMPLES // 100)]
    own, others, number = (np.concatenate(parts, axis=1) for parts in zip(*batches, strict=True))
    centre, centre_2 = uncertainty.ratio_of_sums(own, number), uncertainty.ratio_of_sums(others, number)
    away, away_2 = uncertainty.influence(own, number), uncertainty.influence(others, number)

    held = {
        "mean confidence": share_held(uncertainty.bounded(centre, away, (0.0, 1.0)), truth),
        "difference": share_held(uncertainty.of_difference(centre - centre_2, away - away_2), truth - other),
    }
    assert all(LEAST <= share <= MOST for share in held.values()), held


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [8, 20, 35])
def test_intervals_of_edges_and_areas_hold(pictures):
    """Nominally in 95 %, of 400 replications: the fraction itself is known to 1.1 %, so three of these below 93 %."""

    def drawn(rng, count):
        dark, bright = rng.normal(0, DECADES, (2, count, 1))
        return window(dark, bright, 0.0)

    rng = np.random.default_rng(pictures)
    mean = drawn(np.random.default_rng(99), 200_000).mean(axis=0)
    ((start, end),) = windows(EXPOSURES_S, mean.tolist(), 0.5)
    area = np.trapezoid(mean, EXPOSURES_S) / (EXPOSURES_S[-1] - EXPOSURES_S[0])
    held = np.zeros(4)
    for _ in range(400):
        of = curve(drawn(rng, pictures), EXPOSURES_S)
        found = of.windows(0.5)
        bounds = [
            of.around(found[0][0], 0.5),
            of.around(found[-1][1], 0.5),
            of.fails_between(0.5),
            of.area()[1],
        ]
        for place, ((low, high), true) in enumerate(zip(bounds, (start, end, end, area), strict=True)):
            held[place] += (low is None or low <= true) and (high is None or true <= high)
    assert (held / 400 > 0.93 - 3 * 0.011).all(), held / 400


def photographs(rng, pictures, samples, hardness):
    """References (pictures, samples), sums (pictures, samples, exposures), numbers of targets (pictures, samples).

    Up to 20 targets a picture, 4 on average, of very different confidence; below 0.05 nothing is listed, so that in
    some pictures nothing is known.
    """
    count = np.minimum(rng.geometric(1 / 4, size=(pictures, samples)), 20)
    there = np.arange(20)[:, None, None] < count
    logits = rng.normal(size=(pictures, samples)) - hardness + 1.5 * rng.normal(size=there.shape)
    dark, bright = DECADES * rng.normal(size=(2, pictures, samples, 1))
    seen = window(dark, bright, 0.0)

    def listed(at):
        confidence = np.where(there, 1 / (1 + np.exp(-at)), 0.0)
        return np.asarray(np.where(confidence < 0.05, 0.0, confidence).sum(axis=0))

    every = [
        listed(logits + 4 * (at - 1) + 0.6 * rng.normal(size=there.shape)) for at in np.moveaxis(seen, -1, 0)
    ]
    return listed(logits), np.stack(every, axis=-1), count


@pytest.mark.slow
@pytest.mark.parametrize("hardness", [0.0, 2.0, 3.5])
def test_intervals_and_verdicts_hold_on_pictures_like_photographs(hardness):
    """Untouched means of 0.5, 0.2 and 0.07, with 1, 11 and 35 % of pictures in which nothing is known.

    300 samples of 35 pictures: a true coverage of 0.95 shows 0.95 -+ 0.0126 at each exposure; 0.91 is three of that
    below, 0.94 the mean of ten. A verdict is wrong where one of several exposures misses on one side: 5 % at most.
    """
    rng = np.random.default_rng(5)
    known, sums_of, _ = photographs(rng, 1000, 60, hardness)
    truth = sums_of.sum((0, 1)) / known.sum()
    known, sums_of, count = photographs(rng, 35, 300, hardness)
    held, verdicts, wrong = [], 0, 0
    for sample in range(300):
        counts = np.repeat(known[:, sample, None], len(EXPOSURES_S), axis=1)
        most = float(count[:, sample].sum() / known[:, sample].sum())
        values = np.divide(sums_of[:, sample], counts, out=np.zeros_like(counts), where=counts > 0)
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
    assert np.mean(held, axis=0).min() > 0.91
    assert np.mean(held) > 0.94
    assert verdicts > 20
    assert wrong <= 0.05 * len(held)


@pytest.mark.slow
def test_a_plateau_just_below_the_level_rarely_works():
    """The verdict is that of the best of ten exposures, each with an interval of its own: the unseen cluster makes up
    for that. Pictures of 0.8 +- 0.15, cut at 1, so that no exposure keeps 0.8 on average: at most 5 % of samples say
    that one works (Student's intervals: 19 %)."""
    rng = np.random.default_rng(0)
    works = 0
    for _ in range(100):
        values = np.clip(0.8 + 0.15 * rng.normal(size=(20, 10, 1)), 0.0, 1.0)
        (answer,) = answers(table(values, np.geomspace(0.001, 0.1, 10).tolist()), Criterion(0.8, kept=False))
        works += answer.verdict == "works"
    assert works <= 5
