"""The conditions of training pictures: drawn from ranges or a table, their distributions, and refusals."""

import json
import math
from typing import Any

import numpy as np
import pytest
import torch
from batches import pictures
from exposures import exposed
from scipy import stats
from torch import Tensor

from blurnoise import Camera, RandomExposure, photoelectrons
from blurnoise.scene.metering import AutoExposure
from blurnoise.training.ranges import ExposureRanges
from blurnoise.training.table import FILE, ConditionRow, ExposureTable

LEVEL = 1e-3  # of the Kolmogorov-Smirnov tests, on fixed seeds
TWO = ("imx250", "ar0237")
IMX250 = Camera.preset("imx250")
GRID: dict[str, Any] = {
    "exposure_s": (0.001, 0.004, 0.016),
    "illuminance_lux": (1.0, 100.0),
    "speed_px_s": (0.0, 100.0, 500.0),
}


def table(**changes):
    return ExposureTable.of_grid("imx250", **{**GRID, **changes})


def drawn(draws, count=6000):
    uniform = torch.rand(count, draws.draws, generator=torch.Generator().manual_seed(3))
    found: dict[str, Tensor] = draws.conditions(uniform)
    return found


def run(folder, **changes):
    """A sweep's folder, of which only the table of conditions stands."""
    row = {"velocity_x_px_s": 30.0, "velocity_y_px_s": -40.0, "temperature_c": 40.0, "gain_db": 6.0}
    held = {
        "cameras": [IMX250.to_dict(), IMX250.with_figures(f_number=4.0).to_dict()],
        "auto_exposure": None,
        "conditions": [
            {"exposure_s": 0.01, "illuminance_lux": 5.0, **row, "moves": "all", "camera": 0},
            {"exposure_s": 0.02, "illuminance_lux": 5.0, **row, "moves": "targets", "camera": 1},
        ],
        **changes,
    }
    (folder / FILE).write_text(json.dumps(held))
    return folder


def spread_evenly(values, low, high):
    """Uniform, and told from a range 10 % longer."""
    assert stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > LEVEL
    assert stats.kstest(values, stats.uniform(low, 1.1 * (high - low)).cdf).pvalue < LEVEL


def test_each_condition_is_spread_over_its_range_and_apart_from_the_others():
    """Light evenly in its logarithm, the rest evenly; correlations of n independent pairs scatter by 1 / sqrt(n)."""
    ranges = ExposureRanges(
        TWO, temperature_c=(0.0, 50.0), speed_px_s=(20.0, 80.0), direction_deg=(20.0, 80.0)
    )
    params = drawn(ranges)
    for name in ("exposure_s", "illuminance_lux"):
        spread_evenly(params[name].log().numpy(), *map(math.log, getattr(ranges, name)))
    for name in ("speed_px_s", "direction_deg", "temperature_c"):
        spread_evenly(params[name].numpy(), *getattr(ranges, name))
    correlation = torch.corrcoef(torch.stack([value.double() for value in params.values()]))
    assert len(correlation) == 6
    assert float(correlation.fill_diagonal_(0.0).abs().max()) < 5 / math.sqrt(6000)
    counts = torch.bincount(drawn(ExposureRanges((*TWO, "imx249")))["camera_index"], minlength=3)
    assert stats.chisquare(counts.numpy()).pvalue > LEVEL


def test_ends_of_the_ranges_are_kept():
    ranges = ExposureRanges(TWO, exposure_s=(0.0013, 0.0519), speed_px_s=(1.1, 9.7))
    for uniform, end in ((torch.zeros(1, 6), 0), (torch.ones(1, 6), 1)):  # rounding may reach 1
        conditions = ranges.conditions(uniform)
        assert float(conditions["exposure_s"]) == pytest.approx(ranges.exposure_s[end])
        assert float(conditions["speed_px_s"]) == pytest.approx(ranges.speed_px_s[end])
        assert int(conditions["camera_index"]) == end


@pytest.mark.parametrize("name", ["illuminance_lux", "gain_db"])
@pytest.mark.parametrize("value", [np.True_, torch.tensor(True), torch.tensor(1j), np.array([0, 3])])
def test_what_is_no_number_is_no_range(name, value):
    with pytest.raises(TypeError, match=f"{name} = .*: must be a number"):
        ExposureRanges(**{name: value})


@pytest.mark.parametrize(
    ("exposure_s", "meant"), [((1, 60), r"\(1, 60\).*\(0.001, 0.06\)"), (33, r"\(33\).*\(0.033\)")]
)
def test_milliseconds_in_place_of_seconds_are_warned_about(exposure_s, meant):
    with pytest.warns(UserWarning, match=f"exposure_s = {meant} if milliseconds are meant") as told:
        RandomExposure(exposure_s=exposure_s)
    assert len(told) == 1
    with pytest.warns(UserWarning, match="milliseconds"):
        ExposureTable.of_grid("imx250", exposure_s=[5, 33], illuminance_lux=[50.0])


def test_electrons_of_white_are_log_uniform_whatever_camera_and_time():
    ranges = ExposureRanges(TWO, white_e=(20.0, 5000.0))
    params = drawn(ranges)
    each = zip(*(params[k].tolist() for k in ("camera_index", "illuminance_lux", "exposure_s")), strict=True)
    white = [math.log(photoelectrons(ranges.cameras[camera], lux, time)) for camera, lux, time in each]
    spread_evenly(white, math.log(20), math.log(5000))
    both = torch.stack([torch.tensor(white), params["exposure_s"].log()])
    assert abs(float(torch.corrcoef(both)[0, 1])) < 5 / math.sqrt(6000)
    params = drawn(ExposureRanges(blur_px=(0.0, 40.0)))
    spread_evenly((params["speed_px_s"] * params["exposure_s"]).numpy(), 0, 40)


def test_every_row_is_as_likely_and_spread_to_the_middles():
    params = drawn(table(direction_deg=None))
    low, middle = math.sqrt(0.001 * 0.004), math.sqrt(0.004 * 0.016)
    times = torch.bucketize(params["exposure_s"], torch.tensor([low, middle]))
    assert stats.chisquare(torch.bincount(times, minlength=3).numpy()).pvalue > LEVEL
    assert 0.001 <= float(params["exposure_s"].min()) < 0.00101
    assert 0.0158 < float(params["exposure_s"].max()) <= 0.016
    still = params["speed_px_s"] == 0
    assert float(still.double().mean()) == pytest.approx(1 / 3, abs=5 * math.sqrt(2 / 9 / 6000))
    moving = params["speed_px_s"][~still]
    assert (float(moving.min()), float(moving.max())) == pytest.approx((50, 500), rel=0.02)
    slow = moving[moving < 300]
    assert float((moving < 300).double().mean()) == pytest.approx(0.5, abs=0.04)
    assert stats.kstest(slow.numpy(), stats.uniform(50, 250).cdf).pvalue > LEVEL
    light = params["illuminance_lux"].log10().numpy()
    assert stats.kstest(light, stats.uniform(0, 2).cdf).pvalue > LEVEL
    assert not params["direction_deg"].any()


def test_a_single_condition_stays_as_it_is():
    one = ConditionRow(0.01, 0.0, 30.0, direction_deg=-45.0, temperature_c=60.0, gain_db=3.0, moves="targets")
    params = drawn(ExposureTable("imx250", (one,)), 7)
    for name in ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg", "temperature_c", "gain_db"):
        assert torch.equal(params[name], torch.full((7,), getattr(one, name))), name
    assert not params["moves_index"].any()
    assert not params["camera_index"].any()


def test_a_run_draws_what_its_camera_would_use(tmp_path):
    """At 50 lux 3 ms is recommended; at 1000 lux 1 ms is, and no answer may ask for 10 ms, which saturate."""
    met = [
        {"exposure_s": t, "illuminance_lux": lux, "gain_db": 0.0, "saturated": share, "recommended": chosen}
        for lux, of in {
            50.0: ((0.001, 0.0, False), (0.003, 0.0, True), (0.01, 0.0, False)),
            1000.0: ((0.001, 0.0, True), (0.003, 0.05, False), (0.01, 0.6, True)),
            5000.0: ((0.001, 0.3, False), (0.003, 0.7, False), (0.01, 1.0, False)),
        }.items()
        for t, share, chosen in of
    ]
    table = ExposureTable.of_run(run(tmp_path, conditions=met))
    assert [row[:2] for row in table.rows] == [(0.003, 50.0), (0.001, 1000.0), (0.001, 5000.0)]
    params = drawn(table, 4000)
    light = params["exposure_s"] * params["illuminance_lux"]
    dim = params["illuminance_lux"] < math.sqrt(1000 * 5000)
    assert float(light[dim].max()) <= 3.0 * (1 + 1e-5)  # 3 ms at 1000 lux, the most that did not saturate
    assert float(light.max()) <= 5.0 * (1 + 1e-5)
    assert float(params["exposure_s"].min()) >= 0.001 * (1 - 1e-5)
    for row in met:
        del row["saturated"], row["recommended"]
    assert len(ExposureTable.of_run(run(tmp_path, conditions=met)).rows) == 9


def test_a_runs_rows_keep_what_belongs_together(tmp_path):
    aug = RandomExposure.for_run(run(tmp_path), p=1.0)
    torch.manual_seed(2)
    params = aug.generate_parameters((200, 3, 8, 8))
    first = params["exposure_s"] < math.sqrt(0.01 * 0.02)
    assert 60 < int(first.sum()) < 140
    moves = [exposure.moves for exposure in aug.ranges.exposures(params)]
    assert moves == ["all" if own else "targets" for own in first.tolist()]
    assert torch.equal(params["camera_index"] == 0, first)
    assert [camera.lens.f_number for camera in aug.ranges.cameras] == [1.4, 4.0]
    assert torch.allclose(params["speed_px_s"], torch.tensor(50.0))
    assert params["direction_deg"].numpy() == pytest.approx(math.degrees(math.atan2(4, 3)))  # up as displayed
    assert params["gain_db"].unique().tolist() == [6.0]
    assert params["temperature_c"].unique().tolist() == [40.0]


def test_is_expose_pictures_under_what_was_drawn():
    """With the gain that auto-exposure sets."""
    auto = AutoExposure(target=0.1)
    aug = RandomExposure(table=table(gain_db=auto), p=1.0, grow_boxes=True)
    seen, params = aug(pictures()), aug._params
    given = {name: params[name] for name in ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg")}
    given |= {"gain_db": auto, "seeds": params["noise_seed"].tolist()}
    assert torch.equal(seen, exposed(pictures(), "imx250", **given))
    assert "18 conditions" in repr(aug)


def test_gains_that_are_stated_stand_beside_those_that_the_camera_sets(tmp_path):
    row = {"exposure_s": 0.01, "illuminance_lux": 5.0}
    held = [{**row, "gain_db": "auto"}, {**row, "gain_db": 6.0}]
    aug = RandomExposure.for_run(run(tmp_path, conditions=held, auto_exposure={"target": 0.3}), p=1.0)
    torch.manual_seed(4)
    seen, params = aug(pictures(8)), aug._params
    auto = params["gain_auto"]
    assert 0 < int(auto.sum()) < 8
    given = {name: params[name] for name in row} | {"seeds": params["noise_seed"].tolist()}
    for gain, chosen in ((AutoExposure(target=0.3), auto), (6.0, ~auto)):
        alone = exposed(pictures(8), IMX250, gain_db=gain, **given)
        assert torch.equal(seen[chosen], alone[chosen])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectory": "shake 3 px"}, "trajectory"),
        ({"speeds": [["person", 0.3]]}, "has speeds; not supported in training"),
        ({"conditions": [{"exposure_s": "auto", "illuminance_lux": 5.0, "gain_db": "auto"}]}, "exposures"),
        ({"conditions": [{"exposure_s": 0.01}]}, "no table of conditions"),
        ({"conditions": [{"exposure_s": 1, "illuminance_lux": 5.0, "camera": 9}]}, "camera"),
        ({"conditions": [{"exposure_s": 1, "illuminance_lux": 5.0, "camera": math.inf}]}, "no table of cond"),
        ({"cameras": [{"name": "x"}]}, "must be stated|missing|needs|camera"),
    ],
)
def test_runs_that_pictures_are_not_taken_under_are_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message) as caught:
        RandomExposure.for_run(run(tmp_path, **changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: RandomExposure.for_run("/dev"), f"run = .*holds no {FILE}"),
        (lambda: ExposureTable.of_run("s3://bucket/run"), r"run = 's3:.*: holds no .*; must be .*location\(URL\)"),
        (lambda: RandomExposure(table=table(), exposure_s=0.01), "exposure_s = 0.01: is part of the table"),
        (lambda: RandomExposure("imx250", table=table()), "camera = .*: is part of the table"),
        (lambda: RandomExposure(table={}), "table: must be a .*ExposureTable, got dict"),
        (lambda: table(exposure_s=0.01), "exposure_s = 0.01: must be a sequence"),
        (lambda: ExposureRanges(white_e=(10.0, 1.0)), "white_e"),
    ],
)  # fmt: skip
def test_tables_and_ranges_that_are_none_are_named(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()
