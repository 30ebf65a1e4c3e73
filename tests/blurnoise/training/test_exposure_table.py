"""Conditions drawn from a table: as a run met them, between its values and nowhere else; and refusals."""

from __future__ import annotations

import copy
import json
import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from batches import pictures
from scipy import stats
from torch import Tensor

from blurnoise import Camera, RandomExposure, photoelectrons
from blurnoise.scene.metering import AutoExposure
from blurnoise.training.augmentation import expose_pictures
from blurnoise.training.ranges import ExposureRanges
from blurnoise.training.table import FILE, Condition, ExposureTable

LEVEL = 1e-3  # of the Kolmogorov-Smirnov tests, on fixed seeds
IMX250 = Camera.preset("imx250")
GRID: dict[str, Any] = {
    "exposure_s": (0.001, 0.004, 0.016),
    "illuminance_lux": (1.0, 100.0),
    "speed_px_s": (0.0, 100.0, 500.0),
}


def table(**changes: Any) -> ExposureTable:
    return ExposureTable.of_grid("imx250", **{**GRID, **changes})


def drawn(draws: Any, count: int = 6000) -> dict[str, Tensor]:
    uniform = torch.rand(count, draws.draws, generator=torch.Generator().manual_seed(3))
    found: dict[str, Tensor] = draws.conditions(uniform)
    return found


def run(folder: Path, **changes: Any) -> Path:
    """A sweep's folder, of which only the table of conditions stands."""
    row = {"velocity_x_px_s": 30.0, "velocity_y_px_s": -40.0, "temperature_c": 40.0, "gain_db": 6.0}
    held = {
        "cameras": [IMX250.to_dict(), replace(IMX250, f_number=4.0).to_dict()],
        "auto_exposure": None,
        "conditions": [
            {"exposure_s": 0.01, "illuminance_lux": 5.0, **row, "moves": "all", "camera": 0},
            {"exposure_s": 0.02, "illuminance_lux": 5.0, **row, "moves": "targets", "camera": 1},
        ],
        **changes,
    }
    (folder / FILE).write_text(json.dumps(held))
    return folder


# In what matters


def test_electrons_of_white_are_log_uniform_whatever_camera_and_time() -> None:
    cameras = ("imx250", "ar0237")
    ranges = ExposureRanges(cameras, white_e=(20.0, 5000.0))
    params = drawn(ranges)
    each = zip(*(params[k].tolist() for k in ("camera_index", "illuminance_lux", "exposure_s")), strict=True)
    white = [photoelectrons(ranges.cameras[camera], lux, time) for camera, lux, time in each]
    law = stats.uniform(math.log(20), math.log(250))
    assert stats.kstest([math.log(e) for e in white], law.cdf).pvalue > LEVEL
    other = stats.uniform(math.log(20), 1.1 * math.log(250))
    assert stats.kstest([math.log(e) for e in white], other.cdf).pvalue < LEVEL
    assert abs(
        float(torch.corrcoef(torch.stack([torch.tensor(white).log(), params["exposure_s"].log()]))[0, 1])
    ) < (5 / math.sqrt(6000))  # of n independent pairs, by 1 / sqrt(n)


def test_blur_is_uniform_whatever_the_time() -> None:
    params = drawn(ExposureRanges(blur_px=(0.0, 40.0)))
    blur = params["speed_px_s"] * params["exposure_s"]
    assert stats.kstest(blur.numpy(), stats.uniform(0, 40).cdf).pvalue > LEVEL
    assert stats.kstest(blur.numpy(), stats.uniform(0, 44).cdf).pvalue < LEVEL


def test_what_is_stated_in_electrons_and_px_is_what_is_seen() -> None:
    """A white picture at rest holds those electrons: its linear level is their share of full scale."""
    camera = replace(IMX250, read_noise_e=0.0, prnu=0.0)
    torch.manual_seed(1)
    aug = RandomExposure(camera, white_e=2000.0, blur_px=7.0, encoding="linear", p=1.0)
    seen = aug(torch.ones(2, 1, 65, 63))
    full_e = (camera.full_scale_dn - camera.black_level_dn) / camera.system_gain_dn_per_e
    # of n pixels the mean is known to sigma / sqrt(n), sigma = sqrt(2000) e
    assert float(seen.mean()) * full_e == pytest.approx(2000, abs=5 * math.sqrt(2000 / seen.numel()) + 0.5)
    assert torch.allclose(aug._params["speed_px_s"] * aug._params["exposure_s"], torch.tensor(7.0))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"white_e": (0.0, 10.0)}, "white_e"),
        ({"white_e": (10.0, 1.0)}, "white_e"),
        ({"white_e": 1e12}, "white_e = .*illuminance_lux"),
        ({"blur_px": (-1.0, 10.0)}, "blur_px"),
        ({"blur_px": 2e5}, "blur_px"),
        ({"blur_px": 1e5, "exposure_s": (1e-3, 1e-2)}, "blur_px = .*speed_px_s"),
    ],
)
def test_ranges_that_nothing_gives_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ExposureRanges(**given)


@pytest.mark.filterwarnings("ignore:exposure_s")
def test_a_longest_blur_does_not_bound_the_speeds_that_it_replaces() -> None:
    assert ExposureRanges(exposure_s=(1.0, 100.0), blur_px=3.0).draws == ExposureRanges().draws


# A table


def test_every_row_is_as_likely_and_spread_to_the_middles() -> None:
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


def test_what_is_spread_stays_within_the_longest_motion() -> None:
    """Though the row of the long exposure would reach half-way to the fast one's speed."""
    far = ExposureTable("imx250", (Condition(10.0, 5.0, 1000.0), Condition(1e-3, 5.0, 1e6)))
    params = drawn(far, 200)
    assert float((params["speed_px_s"] * params["exposure_s"]).max()) == pytest.approx(1e5, rel=1e-3)
    torch.manual_seed(1)
    assert bool(RandomExposure.for_conditions(far, p=1.0)(torch.rand(8, 1, 4, 4)).isfinite().all())


def test_grids_and_tables_that_are_none_are_told_by_name() -> None:
    with pytest.raises(TypeError, match=r"exposure_s = 0\.01: must be a sequence"):
        table(exposure_s=0.01)
    with pytest.raises(TypeError, match="moves = 'targets': must be a sequence"):
        table(moves="targets")
    with pytest.raises(TypeError, match=r"table: must be a .*ExposureTable, got dict"):
        RandomExposure.for_conditions({"exposure_s": 0.01})  # type: ignore[arg-type]
    assert table(gain_db="auto") == table(gain_db=AutoExposure())


def test_a_single_condition_stays_as_it_is() -> None:
    one = Condition(0.01, 0.0, 30.0, direction_deg=-45.0, temperature_c=60.0, gain_db=3.0, moves="targets")
    params = drawn(ExposureTable("imx250", (one,)), 7)
    for name in ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg", "temperature_c", "gain_db"):
        assert torch.equal(params[name], torch.full((7,), getattr(one, name))), name
    assert not params["moves_index"].any()
    assert not params["camera_index"].any()


def test_a_run_draws_what_its_camera_would_use(tmp_path: Path) -> None:
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


def test_a_runs_rows_keep_what_belongs_together(tmp_path: Path) -> None:
    aug = RandomExposure.for_run(run(tmp_path), p=1.0)
    torch.manual_seed(2)
    params = aug.generate_parameters((200, 3, 8, 8))
    first = params["exposure_s"] < math.sqrt(0.01 * 0.02)
    assert 60 < int(first.sum()) < 140
    moves = aug.ranges.arguments(params)["moves"]
    assert moves == ["all" if own else "targets" for own in first.tolist()]
    assert torch.equal(params["camera_index"] == 0, first)
    assert [camera.f_number for camera in aug.ranges.cameras] == [1.4, 4.0]
    assert torch.allclose(params["speed_px_s"], torch.tensor(50.0))
    assert params["direction_deg"].numpy() == pytest.approx(math.degrees(math.atan2(4, 3)))  # up as displayed
    assert params["gain_db"].unique().tolist() == [6.0]
    assert params["temperature_c"].unique().tolist() == [40.0]


def test_directions_may_be_drawn_in_place_of_the_runs(tmp_path: Path) -> None:
    params = drawn(ExposureTable.of_run(run(tmp_path), direction_deg=(0.0, 360.0)))
    assert stats.kstest(params["direction_deg"].numpy(), stats.uniform(0, 360).cdf).pvalue > LEVEL


def test_is_expose_pictures_under_what_was_drawn() -> None:
    """With the gain that auto-exposure sets, on a replay and a copy too."""
    auto = AutoExposure(target=0.1)
    aug = RandomExposure.for_conditions(table(gain_db=auto), p=1.0, grow_boxes=True)
    image = pictures()
    torch.manual_seed(4)
    seen, params = aug(image), aug._params
    given = {name: params[name] for name in ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg")}
    expected = expose_pictures(
        image, "imx250", **given, gain_db=auto, generator=params["noise_seed"].tolist()
    )
    assert torch.equal(seen, expected)
    for other in (aug, copy.deepcopy(aug), pickle.loads(pickle.dumps(aug))):
        assert torch.equal(other(image, params=params), seen)
    assert "18 conditions" in repr(aug)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectory": "shake 3 px"}, "trajectory"),
        ({"speeds": [["person", 0.3]]}, "has speeds; training pictures are taken without"),
        ({"ego": "a car"}, "has ego"),
        ({"grey_anchor": "mean"}, "has grey_anchor"),
        ({"conditions": [{"exposure_s": "auto", "illuminance_lux": 5.0, "gain_db": "auto"}]}, "exposures"),
        ({"conditions": []}, "at least one"),
        ({"conditions": [{"exposure_s": 0.01}]}, "no table of conditions"),
        ({"conditions": [{"exposure_s": -1, "illuminance_lux": 5.0}]}, "exposure_s"),
        ({"conditions": [{"exposure_s": 1, "illuminance_lux": 5.0, "camera": 9}]}, "camera"),
        (
            {"conditions": [{"exposure_s": 1, "illuminance_lux": 5.0, "camera": math.inf}]},
            "no table of conditions",
        ),
        ({"conditions": 7}, "no table of conditions"),
        ({"cameras": [{"name": "x"}]}, "must be stated|missing|needs|camera"),
    ],
)
def test_runs_that_pictures_are_not_taken_under_are_refused(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        RandomExposure.for_run(run(tmp_path, **changes))
    assert "\n" not in str(caught.value)


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=rf"run = .*holds no {FILE}"):
        RandomExposure.for_run(tmp_path)
    (tmp_path / FILE).write_text("{")
    with pytest.raises(ValueError, match="run = "):
        RandomExposure.for_run(tmp_path)
    (tmp_path / FILE).write_text("[]")
    with pytest.raises(ValueError, match="no table of conditions"):
        RandomExposure.for_run(tmp_path)


def test_what_the_conditions_state_is_not_stated_twice() -> None:
    with pytest.raises(TypeError, match=r"exposure_s = 0\.01: is stated by the conditions"):
        RandomExposure.for_conditions(table(), exposure_s=0.01)


def test_gains_that_are_stated_stand_beside_those_that_the_camera_sets(tmp_path: Path) -> None:
    row = {"exposure_s": 0.01, "illuminance_lux": 5.0}
    set_by = AutoExposure(target=0.3)
    held = [{**row, "gain_db": "auto"}, {**row, "gain_db": 6.0}]
    folder = run(tmp_path, conditions=held, auto_exposure={"target": 0.3})
    augmentation = RandomExposure.for_run(folder, p=1.0)
    torch.manual_seed(4)
    seen = augmentation(pictures(8))
    params = augmentation._params
    auto = params["gain_auto"]
    assert 0 < int(auto.sum()) < 8
    noise = params["noise_seed"].tolist()
    for gain, chosen in ((set_by, auto), (6.0, ~auto)):
        alone = expose_pictures(
            pictures(8),
            IMX250,
            exposure_s=params["exposure_s"],
            illuminance_lux=params["illuminance_lux"],
            gain_db=gain,
            generator=noise,
        )
        assert torch.equal(seen[chosen], alone[chosen])
    assert torch.equal(augmentation(pictures(8), params=params), seen)
    both = ExposureTable.of_grid("imx250", exposure_s=(0.01,), illuminance_lux=(5.0,), gain_db=("auto", 6.0))
    assert [each.gain_db for each in both.rows] == [None, 6.0]
    with pytest.raises(ValueError, match="gain_db: got 2; must be one, or 8"):
        expose_pictures(pictures(8), IMX250, exposure_s=0.01, illuminance_lux=5.0, gain_db=(set_by, 6.0))


def test_url_is_told_how_it_is_read() -> None:
    with pytest.raises(ValueError, match=r"run = 's3://bucket/run': holds no .*; must be .*location\(URL\)"):
        ExposureTable.of_run("s3://bucket/run")
