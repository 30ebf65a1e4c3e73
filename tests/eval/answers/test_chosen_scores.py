"""Scores of exposures that were chosen for them: how much too high they are, and what is left once corrected."""

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.recommendation import averages, recommendations
from blurnoise_eval.scoring import uncertainty
from made_tables import table

EXPOSURES_S = tuple(ms / 1e3 for ms in (0.5, 1, 2, 4, 8, 16, 32))
EDGES = {"wide": (-3.0, -1.8, 0.25), "narrow": (-2.6, -2.2, 0.25), "apart": (-2.6, -2.0, 0.45)}
"""Log10 of the exposures, s, from which on pictures are light enough, and too blurred; by how much they differ."""


def found_or_missed(rng, dark, bright, spread, count):
    """The confidence at each exposure of targets that are found or missed by chance, (count, E), and their scores in
    the original pictures, (count, 1)."""
    at = np.log10(EXPOSURES_S)
    rise, fall = (edge + spread * rng.normal(size=(count, 1)) for edge in (dark, bright))
    share = 1 / (1 + np.exp((rise - at) / 0.12)) / (1 + np.exp((at - fall) / 0.12))
    found = rng.uniform(size=share.shape) < share
    return found * rng.uniform(0.6, 1.0, size=share.shape), rng.gamma(3, size=(count, 1))


def of_pictures(confidence, weight, *, kept):
    counts = np.broadcast_to(weight if kept else 1.0, confidence.shape)[:, :, None]
    return table(confidence[:, :, None] * counts, EXPOSURES_S, counts=counts, kept=kept, clean=0.9)


def largest(values):
    return values.argmax(axis=-1)


@pytest.mark.parametrize(("led", "least"), [(False, 0.9), (True, 0.7)])
def test_the_best_of_some_that_are_alike_is_too_high_by_the_expected_maximum(led, least):
    """Of five equal means, each known to 0.3 / sqrt(20), the largest is 1.163 of that too high on average (Tippett,
    Biometrika 17 (1925) 364). The mean of 200 estimates has 0.95 of it, sqrt(19 / 21), where no mean leads in the
    pictures, and 0.77 with the leads that they have by chance, which are shrunk but not gone."""
    rng, found = np.random.default_rng(0), []
    for _ in range(200):
        values = rng.normal(scale=0.3, size=(20, 5))
        mean = values.mean(axis=0)
        away = (values - mean)[:, None]
        found.append(float(uncertainty.selection_bias(led * mean, away, int(mean.argmax()), largest)[0]))
    assert least < np.mean(found) / (1.163 * 0.3 / np.sqrt(20)) < 1.0


def test_one_that_leads_surely_was_not_chosen_by_chance():
    away = np.random.default_rng(0).normal(scale=0.1, size=(20, 1, 2))
    assert uncertainty.selection_bias([0.9, 0.2], away, 0, largest) == 0


def test_the_bias_of_a_mean_is_the_mean_of_that_of_its_parts():
    away = np.random.default_rng(1).normal(scale=0.3, size=(20, 3, 5))
    away[..., 2, :] = 0.0  # the third part is the same at every exposure
    bias = uncertainty.selection_bias(np.zeros(5), away, 2, largest)
    whole = uncertainty.selection_bias(np.zeros(5), away.mean(axis=1)[:, None], 2, largest)
    assert bias.mean() == pytest.approx(float(whole[0]))
    assert bias[2] == 0 < whole[0]


def alike(pictures=20):
    """Two exposures of one mean, 0.75, whose pictures differ."""
    rng = np.random.default_rng(3)
    own = 0.1 * rng.normal(size=(pictures, 2))
    return table((0.75 + own - own.mean(axis=0))[:, :, None], (0.001, 0.002), clean=0.9)


def test_score_low_end_and_verdict_are_corrected_and_the_high_end_is_not():
    of = averages([alike()], 0.5)
    away = of.influence[:, 0, :]
    plain = uncertainty.of_level(0.75, away[:, of.exposures_s.index(of.choose().exposure_s)])
    bias = float(of.choose().bias[0])
    row = next(row for row in recommendations(of) if row.scope == "all")
    assert 0.01 < bias < 0.03  # 0.56 of the error of the difference, 0.1 sqrt(2 / 20), is 0.018
    assert tuple(row.score) == pytest.approx((0.75 - bias, plain.low - bias, plain.high))
    assert row.score_at_overall_exposure == pytest.approx(row.score.value)
    between = float(plain.low) - bias / 2
    assert averages([alike()], between).choose().verdict == "cannot tell"
    assert averages([alike()], between).choose().n_works == 0


def test_the_answer_of_a_kind_of_target_is_corrected_alike():
    (answer,) = answers(alike(), Criterion(0.5, kept=False))
    row = next(iter(recommendations(averages([alike()], 0.5))))
    assert tuple(answer.score_at_recommended) == pytest.approx(tuple(row.score))
    level = max(answer.low) - 0.005
    assert answers(alike(), Criterion(level, kept=False))[0].verdict == "cannot tell"


@pytest.mark.slow
@pytest.mark.parametrize("count", [12, 20, 35])
@pytest.mark.parametrize("kept", [False, True])
@pytest.mark.parametrize("edges", EDGES)
def test_corrected_scores_are_nearly_unbiased_and_their_intervals_hold(edges, kept, count):
    """Of 400 samples of pictures whose true means are known from 200 000. The mean error is known to 0.01: that of
    the truly best exposure, 0 on average, is taken from it. A share of 0.95 is known to 2 x 0.011."""
    truth_rng, rng = np.random.default_rng(1), np.random.default_rng([count, 7])
    confidence, weight = found_or_missed(truth_rng, *EDGES[edges], 200_000)
    weight = weight if kept else np.ones_like(weight)
    truth = (confidence * weight).sum(axis=0) / weight.sum()
    found = []
    for _ in range(400):
        of = averages([of_pictures(*found_or_missed(rng, *EDGES[edges], count), kept=kept)], 0.9)
        choice = of.choose()
        place = of.exposures_s.index(choice.exposure_s)
        error = of.value[0, place] - truth[place]
        by_chance = of.value[0, truth.argmax()] - truth.max()
        value, low, high = choice.score
        held = [np.nan] * 2  # of weights so uneven that there is no interval
        if low is not None:
            held = [end <= truth[place] <= high for end in (low + of.value[0, place] - value, low)]
        found.append((error - by_chance, value - truth[place] - by_chance, *held))
    before, after, plain, corrected = np.nanmean(np.array(found, float), axis=0)
    print(f"{edges}, kept {kept}, {count} pictures: bias {before:+.3f} -> {after:+.3f}", end=", ")
    print(f"covered {plain:.3f} -> {corrected:.3f}")
    assert abs(after) <= max(0.02, abs(before) / 3)
    assert plain <= corrected
    assert corrected >= 0.9
