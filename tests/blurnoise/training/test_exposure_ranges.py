"""The conditions of training pictures: their distributions, their ends, and the seed that they follow."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from batches import pictures
from scipy import stats
from torch import Tensor

from blurnoise import Camera
from blurnoise.training.augmentation import RandomExposure
from blurnoise.training.ranges import ExposureRanges
from blurnoise.training.table import ExposureTable

LEVEL = 1e-3  # of the Kolmogorov-Smirnov tests, on fixed seeds
TWO = ("imx250", "ar0237")


def drawn(count: int = 4000, **ranges: Any) -> dict[str, Tensor]:
    torch.manual_seed(11)
    return RandomExposure(**ranges, p=1.0).generate_parameters((count, 3, 8, 8))


@pytest.mark.parametrize("name", ["exposure_s", "illuminance_lux"])
def test_light_is_log_uniform_over_its_range(name: str) -> None:
    low, high = getattr(ExposureRanges(), name)
    logs = drawn()[name].log().numpy()
    assert stats.kstest(logs, stats.uniform(math.log(low), math.log(high / low)).cdf).pvalue > LEVEL
    off = stats.uniform(math.log(low), math.log(high / low) * 1.1)  # a range 10 % longer is told from it
    assert stats.kstest(logs, off.cdf).pvalue < LEVEL


@pytest.mark.parametrize("name", ["speed_px_s", "direction_deg", "temperature_c"])
def test_motion_and_temperature_are_uniform_over_their_range(name: str) -> None:
    low, high = 20.0, 80.0
    values = drawn(**{name: (low, high)})[name].numpy()
    assert stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > LEVEL
    assert stats.kstest(values, stats.uniform(low, 1.1 * (high - low)).cdf).pvalue < LEVEL


def test_conditions_do_not_depend_on_each_other() -> None:
    """Correlations of n independent pairs scatter by 1 / sqrt(n)."""
    params = drawn(camera=TWO, temperature_c=(0.0, 50.0))
    columns = torch.stack([value.double() for value in params.values()])
    correlation = torch.corrcoef(columns).fill_diagonal_(0.0)
    assert len(columns) == 7
    assert float(correlation.abs().max()) < 5 / math.sqrt(4000)


def test_every_camera_is_as_likely() -> None:
    cameras = ("imx250", "ar0237", Camera.preset("imx249"))
    counts = torch.bincount(drawn(camera=cameras)["camera_index"], minlength=3)
    assert stats.chisquare(counts.numpy()).pvalue > LEVEL


def test_a_range_may_be_a_single_value() -> None:
    params = drawn(50, exposure_s=(0.0137, 0.0137), illuminance_lux=77.7, speed_px_s=3.0, direction_deg=-45)
    for name, value in (("exposure_s", 0.0137), ("illuminance_lux", 77.7), ("speed_px_s", 3.0)):
        assert torch.equal(params[name], torch.full((50,), value))
    assert params["direction_deg"].unique().tolist() == [-45.0]


def test_ends_of_the_ranges_are_kept() -> None:
    ranges = ExposureRanges(TWO, exposure_s=(0.0013, 0.0519), speed_px_s=(1.1, 9.7))
    for uniform, end in ((torch.zeros(1, 6), 0), (torch.ones(1, 6), 1)):  # rounding may reach 1
        conditions = ranges.conditions(uniform)
        assert float(conditions["exposure_s"]) == pytest.approx(ranges.exposure_s[end])
        assert float(conditions["speed_px_s"]) == pytest.approx(ranges.speed_px_s[end])
        assert int(conditions["camera_index"]) == end


def test_draws_follow_torchs_seed() -> None:
    aug = RandomExposure(TWO, p=0.5)
    outs = []
    for seed in (3, 3, 4):
        torch.manual_seed(seed)
        outs.append(aug(pictures()))
    assert torch.equal(outs[0], outs[1])
    assert not torch.equal(outs[0], outs[2])
    again = aug(pictures())
    assert not torch.equal(again, outs[2])  # the next call draws anew


def test_noise_seed_is_of_63_bits_and_survives_replay() -> None:
    seeds = drawn(2000)["noise_seed"]
    assert seeds.dtype == torch.int64
    assert len(seeds.unique()) == 2000
    assert 0 <= int(seeds.min()) < int(seeds.max())
    assert float(seeds.double().mean()) == pytest.approx(2**62, rel=5 / math.sqrt(12 * 2000) * 2)


def test_half_precision_modules_draw_in_float32() -> None:
    aug = RandomExposure(p=1.0).half()
    assert aug.generate_parameters((4, 3, 8, 8))["exposure_s"].dtype == torch.float32


@pytest.mark.parametrize("name", ["exposure_s", "white_e", "blur_px", "gain_db", "shake_px", "p"])
@pytest.mark.parametrize("value", [True, np.True_])
def test_yes_is_no_number(name: str, value: bool) -> None:
    with pytest.raises(TypeError, match=f"{name} = .*True"):
        RandomExposure(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("number", [np.float32(5), np.int64(5), torch.tensor(5.0), np.array(5)])
def test_any_real_number_is_a_range(number: Any) -> None:
    ranges = ExposureRanges(illuminance_lux=number, gain_db=number)
    assert (ranges.illuminance_lux, ranges.gain_db) == ((5.0, 5.0), 5.0)


@pytest.mark.parametrize("name", ["illuminance_lux", "gain_db"])
@pytest.mark.parametrize("value", [np.True_, torch.tensor(True), torch.tensor(1j), np.array([0, 3])])
def test_what_is_no_number_is_no_range(name: Any, value: Any) -> None:
    with pytest.raises(TypeError, match=f"{name} = .*: must be a number"):
        ExposureRanges(**{name: value})


@pytest.mark.parametrize(
    ("exposure_s", "meant"), [((1, 60), r"\(1, 60\).*\(0.001, 0.06\)"), (33, r"\(33\).*\(0.033\)")]
)
def test_milliseconds_in_place_of_seconds_are_warned_about(exposure_s: Any, meant: str) -> None:
    with pytest.warns(UserWarning, match=f"exposure_s = {meant} if milliseconds are meant") as told:
        RandomExposure(exposure_s=exposure_s)
    assert len(told) == 1
    with pytest.warns(UserWarning, match="milliseconds"):
        ExposureTable.of_grid("imx250", exposure_s=[5, 33], illuminance_lux=[50.0])


@pytest.mark.filterwarnings("ignore:exposure_s")
def test_a_drive_too_far_is_told_by_speed_and_time() -> None:
    with pytest.raises(ValueError, match=r"^ego_kmh, exposure_s = 50, 60 at most: [^\[]*$"):
        ExposureRanges(ego_kmh=50, exposure_s=60.0)
