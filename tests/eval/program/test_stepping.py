"""libcamera's division of an exposure over a mode's stages."""

import pytest
from blurnoise_eval.program.stepping import LibcameraMode

MODE = {"shutter": [100, 10000, 30000], "gain": [1.0, 2.0, 8.0]}


@pytest.mark.parametrize(
    ("total_ms", "time_ms", "gain"),
    [
        (0.01, 0.1, 1.0),  # never below the first stage
        (5.0, 5.0, 1.0),  # the time rises first
        (15.0, 10.0, 1.5),  # then the gain
        (50.0, 25.0, 2.0),
        (120.0, 30.0, 4.0),
        (1e3, 30.0, 8.0),  # never above the last
    ],
)
def test_it_starts_at_the_first_stage_and_goes_up(total_ms, time_ms, gain):
    reached = LibcameraMode.read(MODE).divided(total_ms / 1e3)
    assert reached == pytest.approx((time_ms / 1e3, gain))


@pytest.mark.parametrize(("total_ms", "time_ms"), [(5.0, 5.0), (10.0, 10.0), (50.0, 20.0), (59.0, 20.0)])
def test_periods_are_cut_only_above_one(total_ms, time_ms):
    time_s, gain = LibcameraMode.read(MODE, mains_hz=50.0).divided(total_ms / 1e3)
    assert (1e3 * time_s, 1e3 * time_s * gain) == pytest.approx((time_ms, total_ms))


@pytest.mark.parametrize("mode", [((20,), (1.0,)), ((20, 30), (1.0,))])
def test_what_libcamera_refuses(mode):
    with pytest.raises(ValueError, match=r"exposure mode: . shutters and 1 gains: must be as many of both"):
        LibcameraMode(*mode)
