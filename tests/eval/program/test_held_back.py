"""How wrong a surface is between tested conditions, from scores that it has not seen."""

import numpy as np
import pytest
from blurnoise_eval.program import held_back
from blurnoise_eval.program.by_speed import places_at
from blurnoise_eval.program.held_back import UNKNOWN, share_of_spread, spread_around
from blurnoise_eval.run.surface import Kriging

TIMES_S = 2.0 ** np.arange(-12.0, -4.5, 0.5)
LIGHTS = 10.0 ** np.arange(0.0, 3.5, 0.5)
SPEED = 600.0


def scores_of(seed, places):
    """Of 30 pictures, each lost in the dark and in motion at places of its own, and each found or not: (N,)."""
    generator = np.random.default_rng(seed)
    dark, blur = generator.normal(-5.0, 1.0, (30, 1)), generator.normal(3.0, 0.7, (30, 1))
    found = 1 / (1 + np.exp(-4 * (places[:, 0] - dark))) / (1 + 4.0 ** (places[:, 1] - blur))
    return np.round(found).mean(axis=0)


def every(times_s, lights):
    """(N, 2) places of each exposure under each light, and their lights (N,)."""
    lux = np.repeat(lights, len(times_s))
    return places_at(np.tile(times_s, len(lights)), lux, SPEED), lux


@pytest.mark.parametrize("held", ["exposures", "lights"])
def test_of_what_is_not_seen_95_percent_lie_within_the_interval(held):
    """In 12 sets of pictures, each with its own share. Scores this smooth lie there more often: what is held back to
    find the share is twice as far from its neighbours."""
    times_s, lights = (TIMES_S[::2], LIGHTS) if held == "exposures" else (TIMES_S, LIGHTS[::2])
    (known, lux), (places, _) = every(times_s, lights), every(TIMES_S, LIGHTS)
    unseen = places[(np.abs(places[:, None] - known).sum(axis=2) > 1e-6).all(axis=1)]
    within = []
    for seed in range(12):
        surface = Kriging.fit(known, scores_of(seed, known))
        share = share_of_spread([(surface, lux)], lights[1:-1].tolist())
        predicted = surface.mean(unseen).clip(0.0, 1.0)
        sigma = share * spread_around(surface, unseen, predicted)
        error = np.abs(predicted - scores_of(seed, unseen))
        within += (error[:, None] <= 1.96 * np.outer(sigma, (1.0, 0.25)) + 1e-9).tolist()
    assert len(within) == 12 * len(unseen) >= 500
    whole, quarter = np.mean(within, axis=0)
    assert quarter < 0.93 <= whole


def test_rougher_scores_have_a_larger_share():
    """Scores of few pictures jump from one exposure to the next."""
    places, lux = every(TIMES_S, LIGHTS)
    smooth = scores_of(3, places)
    rough = np.clip(smooth + np.random.default_rng(0).normal(0.0, 0.1, len(smooth)), 0.0, 1.0)
    shares = [share_of_spread([(Kriging.fit(places, each), lux)], []) for each in (smooth, rough)]
    assert 2 * shares[0] < shares[1]


def test_lights_that_are_held_back_count():
    """What goes with the light alone, from one to the next, no exposure shows."""
    places, lux = every(TIMES_S, LIGHTS)
    of_light = np.array([0.2, 0.7, 0.1, 0.9, 0.3, 0.8, 0.2])[np.searchsorted(LIGHTS, lux)]
    surface = Kriging.fit(places, of_light + 0.01 * scores_of(3, places))
    exposures, both = (share_of_spread([(surface, lux)], held) for held in ([], LIGHTS[1:-1].tolist()))
    assert 2 * exposures < both


def test_of_two_exposures_and_lights_nothing_can_be_held_back():
    places, lux = every(TIMES_S[:2], LIGHTS[:2])
    assert share_of_spread([(Kriging.fit(places, scores_of(3, places)), lux)], []) == UNKNOWN


def test_scores_that_are_all_alike_show_no_share():
    places, lux = every(TIMES_S, LIGHTS)
    assert share_of_spread([(Kriging.fit(places, np.ones(len(places))), lux)], []) == UNKNOWN


def test_a_light_between_other_kinds_cannot_be_held_back():
    assert held_back.can_be_held_back({1.0: "a", 2.0: "a", 3.0: "b", 4.0: "a"}) == []
    assert held_back.can_be_held_back({1.0: "a", 2.0: "a", 3.0: "a", 4.0: "b", 5.0: "b"}) == [2.0]
