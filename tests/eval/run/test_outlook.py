"""What a search may still gain, and which cell it measures next, of lines and scores that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.answers.recommendation import Averages
from blurnoise_eval.plan.axes import GAIN, LIGHT, SETTING
from blurnoise_eval.run.outlook import Cells, Outlook, most_promising
from blurnoise_eval.run.surface import USUAL

EXPOSURES_S = tuple(np.geomspace(1e-3, 1.6e-2, 5).tolist())
SPEEDS_PX_S = 0.0, 400.0, 800.0


def setting(lux=100.0, gain_db=0.0):
    values = {LIGHT.name: lux, GAIN.name: gain_db}
    return tuple(values.get(name, 0.0) for name in SETTING)


def cells_of(settings, speeds=SPEEDS_PX_S, **fields):
    lines = [(each, (speed, 0.0)) for each in settings for speed in speeds]
    at = [
        [(np.log2(s * each[SETTING.index(LIGHT.name)]), np.log2(max(s * v[0], 0.5))) for s in EXPOSURES_S]
        for each, v in lines
    ]
    settings, velocities = zip(*lines, strict=True)
    return Cells(settings, velocities, EXPOSURES_S, np.ones(5, bool), np.array(at), **fields)


def outlook(cells, value, saturated=0.0, ceiling=1.0):
    value = np.array(value, float)
    none = np.zeros((1, *value.shape))
    measured = Averages(
        "made", 0.5, cells.settings, cells.velocities_px_s, EXPOSURES_S, value, none, none[0], none[0],
        np.ones(len(value)), np.where(np.isnan(value), np.nan, saturated), np.ones(5, bool),
    )  # fmt: skip
    return Outlook(measured, cells, ceiling, USUAL)


NO = np.nan
ONE_LINE = cells_of([setting()], speeds=(400.0,))


def test_beside_the_best_exposure_is_measured_whatever_the_surface_says():
    """Three scores on a straight line to the left of a cliff: no surface promises more beyond."""
    asked = most_promising([outlook(ONE_LINE, [[0.2, 0.3, 0.4, NO, 0.0]])], 1)
    assert asked == [(0, 3)]


def test_what_reaches_the_score_on_the_original_pictures_is_not_improved_on():
    assert most_promising([outlook(ONE_LINE, [[0.2, NO, 0.88, NO, 0.1]], ceiling=0.9)], 5) == []
    assert most_promising([outlook(ONE_LINE, [[0.2, NO, 0.88, NO, 0.1]], ceiling=0.95)], 5) != []


def test_more_motion_can_only_hurt():
    """At rest one exposure keeps as little as that of the faster line: there is nothing to gain at it."""
    at_rest, fast = [0.1, 0.5, 0.1, 0.1, 0.1], [0.1, 0.48, NO, 0.1, 0.1]
    both = cells_of([setting()], speeds=(0.0, 800.0))
    assert most_promising([outlook(both, [at_rest, fast])], 5) == []
    apart = cells_of([setting()], speeds=(0.0, 800.0), monotone=False)
    assert most_promising([outlook(apart, [at_rest, fast])], 5) == [(1, 2)]


def searched_to_its_end(cells, value, truth, batch=15):
    """The values that are known after a search, of these at first; and how many cells each batch had."""
    known, batches = np.array(value, float), []
    while asked := most_promising([outlook(cells, known, ceiling=0.9)], batch):
        batches.append(asked)
        for cell in asked:
            known[cell] = truth[cell]
    return known, batches


def test_an_exposure_for_all_speeds_is_measured_at_each():
    """Each line has its own best; no exposure has all three at first."""
    truth = np.array([[0.5, 0.8, 0.85, 0.9, 0.9], [0.45, 0.7, 0.6, 0.4, 0.2], [0.4, 0.3, 0.2, 0.1, 0.0]])
    value = np.where(np.eye(3, 5)[::-1] > 0, truth, NO)
    known, _ = searched_to_its_end(cells_of([setting()]), value, truth)
    assert np.isfinite(known).all(axis=0).any()
    assert np.isfinite(known).sum() < known.size


def test_a_batch_has_one_cell_of_a_line():
    """What is to be measured next of a line depends on what is found there."""
    truth = np.array([[0.5, 0.8, 0.85, 0.9, 0.9], [0.45, 0.7, 0.6, 0.4, 0.2], [0.4, 0.3, 0.2, 0.1, 0.0]])
    value = np.where(np.eye(3, 5)[::-1] > 0, truth, NO)
    _, batches = searched_to_its_end(cells_of([setting()]), value, truth)
    assert len(batches) > 1
    assert all(len({n for n, _ in batch}) == len(batch) for batch in batches)


def test_between_two_speeds_that_score_alike_nothing_is_measured_for_all():
    """At 400 px/s the best exposure of all speeds scores between 0.90 and 0.89; its own best is another one."""
    cells = cells_of([setting()])
    value = [[0.2, 0.9, 0.9, 0.9, 0.9], [0.2, NO, 0.9, 0.2, 0.1], [0.2, 0.89, 0.3, 0.1, 0.0]]
    seen = outlook(cells, value, ceiling=0.9)
    assert most_promising([seen], 5) == []
    assert seen.bracketed.value[1, 1] == pytest.approx(0.895)
    assert seen.bracketed.sigma[1, 1] == pytest.approx(0.005)
    chosen = replace(seen.measured, bracketed=seen.bracketed).choose()
    assert chosen.exposure_s == EXPOSURES_S[1]
    apart = [[0.2, 0.9, 0.9, 0.9, 0.9], [0.2, NO, 0.9, 0.2, 0.1], [0.2, 0.8, 0.3, 0.1, 0.0]]
    assert (1, 1) in most_promising([outlook(cells, apart, ceiling=0.9)], 5)


def test_a_shorter_exposure_that_saturates_says_that_longer_ones_do():
    """The bright line's second exposure saturates by a half: of the longer ones nothing is measured to know it."""
    value, shares = [[0.5, 0.9, NO, NO, NO]], [[0.0, 0.5, NO, NO, NO]]
    (cell,) = most_promising([outlook(ONE_LINE, value, shares, ceiling=1.0)], 5) or [None]
    assert cell is None


def test_the_better_gain_at_each_exposure_is_what_counts():
    """At 0 dB nothing is seen; at 24 dB the best exposure is known, and its neighbours are measured there alone."""
    both = cells_of([setting(gain_db=0.0), setting(gain_db=24.0)], speeds=(400.0,))
    dark, seen = [0.0, 0.0, 0.0, 0.0, 0.0], [0.1, NO, 0.6, NO, 0.1]
    (first,) = most_promising([outlook(both, [dark, seen])], 2)
    seen[first[1]] = 0.5
    (second,) = most_promising([outlook(both, [dark, seen])], 2)
    assert {first, second} == {(1, 1), (1, 3)}


def untested_gain(cells, value, place, ceiling):
    seen = outlook(cells, value, ceiling=ceiling)
    return seen.untested_gain(cells.settings, cells.velocities_px_s, EXPOSURES_S[place])


def test_what_was_not_tested_gains_at_most_what_the_original_pictures_score_more():
    """Beside the best: 0.88 of 0.9, and then of 0.95."""
    gains = [untested_gain(ONE_LINE, [[0.2, NO, 0.88, NO, 0.1]], 2, ceiling) for ceiling in (0.9, 0.95)]
    assert gains == pytest.approx([0.02, 0.07])


def test_where_all_was_tested_nothing_else_gains():
    assert untested_gain(ONE_LINE, [[0.2, 0.5, 0.88, 0.4, 0.1]], 2, 1.0) is None


def test_what_may_be_gained_is_the_mean_over_the_conditions():
    """Of 0.9 at most: 0.02 at one speed, 0.06 at the other."""
    both = cells_of([setting()], speeds=(400.0, 800.0), monotone=False)
    assert untested_gain(both, [[0.2, NO, 0.88, NO, 0.1], [0.2, NO, 0.84, NO, 0.1]], 2, 0.9) == pytest.approx(
        0.04
    )
