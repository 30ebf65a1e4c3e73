"""What easier and harder conditions say of a score that was not measured."""

import numpy as np
import pytest
from blurnoise_eval.answers.bracketing import Order
from blurnoise_eval.plan.axes import GAIN, LIGHT, SETTING

NO = np.nan
REST, FAST = (0.0, 0.0), (800.0, 0.0)


def setting(lux=100.0, gain_db=0.0):
    values = {LIGHT.name: lux, GAIN.name: gain_db}
    return tuple(values.get(name, 0.0) for name in SETTING)


def bounds(conditions, value, saturated=0.0, *, monotone=True):
    settings, velocities = zip(*conditions, strict=True)
    order = Order.of(settings, velocities, monotone=monotone)
    values = np.array(value, float)
    most, least = order.bounds(values, np.where(np.isfinite(values), saturated, NO))
    return most.tolist(), least.tolist()


def test_more_motion_can_only_hurt():
    most, least = bounds([(setting(), REST), (setting(), FAST)], [[0.8, NO], [NO, 0.3]])
    assert most[1] == [0.8, 0.3]
    assert least[0][1] == 0.3
    apart, _ = bounds([(setting(), REST), (setting(), FAST)], [[0.8, NO], [NO, 0.3]], monotone=False)
    assert apart[1][0] == np.inf


def test_more_motion_hurts_where_light_saturates_too():
    most, least = bounds([(setting(), REST), (setting(), FAST)], [[0.8, NO], [NO, 0.3]], 0.5)
    assert (most[1][0], least[0][1]) == (0.8, 0.3)


def test_more_light_cannot_hurt_at_the_same_exposure():
    lights = [(setting(1.0), FAST), (setting(20.0), FAST), (setting(400.0), FAST)]
    most, least = bounds(lights, [[0.2, NO], [NO, NO], [0.7, 0.5]])
    assert (most[1], least[1]) == ([0.7, 0.5], [0.2, 0.0])


def test_unless_it_saturates():
    """The brightest light says nothing of darker ones, and is itself not as good as these."""
    lights = [(setting(1.0), FAST), (setting(20.0), FAST), (setting(400.0), FAST)]
    most, least = bounds(lights, [[0.6], [NO], [0.1]], [[0.0], [0.0], [0.5]])
    assert (most[1], least[1]) == ([np.inf], [0.0])
    assert least[2] == [0.1]


def test_a_light_that_may_saturate_is_not_surely_better():
    """Nothing was measured in as much light, or at as long an exposure: the bright one may be all white."""
    lights = [(setting(1.0), FAST), (setting(400.0), FAST)]
    _, least = bounds(lights, [[NO, 0.6, 0.6], [0.7, NO, NO]])
    assert least[1] == [0.7, 0.0, 0.0]
    _, least = bounds(lights, [[NO, 0.6, 0.6], [NO, NO, 0.7]])
    assert least[1] == [0.0, 0.6, 0.7]


def test_at_rest_a_longer_exposure_cannot_hurt():
    for velocity, expected in ((REST, ([0.4, 0.4, 0.9, np.inf], [0.0, 0.4, 0.9, 0.0])), (FAST, None)):
        most, least = bounds([(setting(), velocity)], [[NO, 0.4, 0.9, NO]])
        if expected is None:
            expected = [np.inf, 0.4, 0.9, np.inf], [0.0, 0.4, 0.9, 0.0]
        assert (most[0], least[0]) == expected


@pytest.mark.parametrize("other", [setting(gain_db=24.0)])
def test_settings_that_differ_by_more_than_light_are_not_compared(other):
    most, least = bounds([(setting(), REST), (other, REST)], [[0.5], [NO]])
    assert (most[1], least[1]) == ([np.inf], [0.0])


@pytest.mark.parametrize(
    ("velocities", "slower"),
    [
        (((0.0, 0.0), (300.0, 400.0), (600.0, 800.0)), [[1, 0, 0], [1, 1, 0], [1, 1, 1]]),
        (((300.0, 0.0), (0.0, 600.0), (-900.0, 0.0)), [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ],
)
def test_slower_is_of_one_direction_or_rest(velocities, slower):
    order = Order.of([setting()] * 3, velocities, monotone=True)
    assert order.slower.astype(int).tolist() == slower
