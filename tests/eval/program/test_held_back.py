"""How wrong a surface is between tested conditions, from scores that it has not seen."""

import numpy as np
import pytest
from blurnoise_eval.program import held_back
from blurnoise_eval.program.by_speed import places_at
from blurnoise_eval.program.held_back import LEAST, UNKNOWN, Errors, hold_back, spread_around
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
    """In 3 sets of pictures, each with its own share. Scores this smooth lie there more often: what is held back to
    find the share is twice as far from its neighbours."""
    times_s, lights = (TIMES_S[::2], LIGHTS[:4]) if held == "exposures" else (TIMES_S, LIGHTS[::2])
    (known, lux), (places, _) = (
        every(times_s, lights),
        every(TIMES_S, LIGHTS[: 1 + LIGHTS.tolist().index(lights[-1])]),
    )
    unseen = places[(np.abs(places[:, None] - known).sum(axis=2) > 1e-6).all(axis=1)]
    within = []
    for seed in range(3):
        surface = Kriging.fit(known, scores_of(seed, known))
        share = hold_back([(surface, lux)], lights[1:-1].tolist()).shares_at(unseen, known)
        predicted = surface.mean(unseen).clip(0.0, 1.0)
        sigma = share * spread_around(surface, unseen, predicted)
        error = np.abs(predicted - scores_of(seed, unseen))
        within += (error[:, None] <= 1.96 * np.outer(sigma, (1.0, 0.15)) + 1e-9).tolist()
    assert len(within) == 3 * len(unseen) > 80
    whole, part = np.mean(within, axis=0)
    assert part < 0.93 <= whole


def test_rougher_scores_have_a_larger_share():
    """Scores of few pictures jump from one exposure to the next."""
    places, lux = every(TIMES_S[4:12], LIGHTS[1:6])
    smooth = scores_of(3, places)
    rough = np.clip(smooth + np.random.default_rng(0).normal(0.0, 0.1, len(smooth)), 0.0, 1.0)
    shares = [
        hold_back([(Kriging.fit(places, each), lux)], []).exposures.share(0.5) for each in (smooth, rough)
    ]
    assert 2 * shares[0] < shares[1]


def test_what_goes_with_the_light_alone_no_exposure_shows():
    places, lux = every(TIMES_S[4:12], LIGHTS[1:6])
    of_light = np.array([0.2, 0.7, 0.1, 0.9, 0.3])[np.searchsorted(LIGHTS[1:6], lux)]
    surface = Kriging.fit(places, of_light + 0.01 * scores_of(3, places))
    lights, exposures = hold_back([(surface, lux)], LIGHTS[2:5].tolist())
    assert 2 * exposures.share(0.5) < lights.share(1.6)


def test_what_is_held_back_is_as_far_from_its_neighbours_as_the_grid_is_wide():
    """Half a stop between exposures, of lights log2(10) / 2."""
    places, lux = every(TIMES_S[:5], LIGHTS[:4])
    lights, exposures = hold_back([(Kriging.fit(places, scores_of(3, places)), lux)], LIGHTS[1:3].tolist())
    assert (len(lights.stops), len(exposures.stops)) == (2 * 5, 4 * 3)
    assert exposures.stops == pytest.approx(0.5)
    assert lights.stops == pytest.approx(np.log2(10.0) / 2)


def test_a_gap_is_known_up_to_twice_what_was_held_back():
    """And by what was held back so far from its neighbours alone, however much was close to them."""
    errors = Errors(np.repeat([0.1, 2.0], [500, LEAST]), np.repeat([0.01, 0.98], [500, LEAST]))
    assert errors.share(4.0) == pytest.approx(0.5)
    assert errors.share(0.2) == pytest.approx(0.01 / 1.96)
    assert errors.share(4.1) == UNKNOWN


def test_of_fewer_than_19_errors_none_is_exceeded_in_5_percent():
    shares = np.linspace(0.1, 0.98, LEAST)
    assert Errors(np.ones(LEAST), shares).share(1.0) == pytest.approx(0.5)
    assert Errors(np.ones(LEAST - 1), shares[1:]).share(1.0) == UNKNOWN


def test_scores_that_are_all_alike_show_no_share():
    places, lux = every(TIMES_S[:8], LIGHTS[:4])
    held = hold_back([(Kriging.fit(places, np.ones(len(places))), lux)], [])
    assert held.exposures.share(0.5) == UNKNOWN


def test_a_light_between_other_kinds_cannot_be_held_back():
    assert held_back.can_be_held_back({1.0: "a", 2.0: "a", 3.0: "b", 4.0: "a"}) == []
    assert held_back.can_be_held_back({1.0: "a", 2.0: "a", 3.0: "a", 4.0: "b", 5.0: "b"}) == [2.0]
