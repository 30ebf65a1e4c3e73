"""Exposures that the camera sets for each picture of a sweep."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from statistics import fmean

import numpy as np
import pytest
from blurnoise_eval import SweepPlan, datasets, evaluate
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.store.queries import write_exports
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.exposing import Scene, frames

from blurnoise import AutoExposure, Camera, Exposure

IMX250 = Camera.preset("imx250")
AUTO = {"exposure_s": math.inf, "gain_db": math.inf}


def _picture(reflectance_srgb: int) -> np.ndarray:
    picture = np.full((30, 44, 3), reflectance_srgb, np.uint8)
    picture[:15] //= 2
    return picture


@pytest.mark.parametrize(("lux", "limited"), [(5000.0, False), (200.0, False), (0.02, True)])
def test_what_the_camera_sets_is_time_first_then_gain(lux: float, limited: bool) -> None:
    """Where no limit is reached the mean of the linear picture is the meter's target, 18 %."""
    scene = Scene(_picture(150))
    at = Conditions(**AUTO, illuminance_lux=lux)
    (frame,) = frames(scene, [Cell("p", 0, at, 3)], IMX250)
    assert frame.exposure is not None
    setting = AutoExposure().setting(IMX250, mean_light=scene.mean_light(IMX250), illuminance_lux=lux)
    assert (frame.exposure.exposure_s, frame.exposure.gain_db) == (setting.exposure_s, setting.gain_db)
    assert frame.exposure.exposure_s <= 1 / 30
    assert (frame.exposure.gain_db > 0) == limited
    if not limited:
        linear = ((frame.image / 255 + 0.055) / 1.055) ** 2.4
        assert linear.mean() == pytest.approx(0.18, rel=0.01)


def test_the_frame_is_that_of_the_exposure_stated() -> None:
    scene = Scene(_picture(90))
    at = Conditions(**AUTO, illuminance_lux=30.0, velocity_x_px_s=400.0)
    (own,) = frames(scene, [Cell("p", 0, at, 3)], IMX250)
    assert isinstance(own.exposure, Exposure)
    stated = {"exposure_s": own.exposure.exposure_s, "gain_db": own.exposure.gain_db}
    same = Conditions(**stated, illuminance_lux=30.0, velocity_x_px_s=400.0)
    (told,) = frames(scene, [Cell("p", 0, same, 3)], IMX250)
    np.testing.assert_array_equal(own.image, told.image)


def test_whole_periods_of_the_mains_and_the_frame_rate() -> None:
    rule = AutoExposure(frame_rate_hz=15.0, mains_hz=50.0)
    conditions = [Conditions(**AUTO, illuminance_lux=lux) for lux in (1.0, 10.0, 200.0)]
    cells = [Cell("p", 0, at, 3) for at in conditions]
    taken = [frame.exposure for frame in frames(Scene(_picture(90)), cells, IMX250, rule)]
    times = [each.exposure_s for each in taken if each is not None]
    assert times == pytest.approx([0.06, 0.06, 0.02])


@pytest.mark.slow
def test_rows_have_the_times_that_were_set_and_tables_their_mean(tmp_path: Path) -> None:
    plan = SweepPlan(
        {"exposure_s": ("auto",), "illuminance_lux": (20.0, 400.0), "velocity_x_px_s": (0.0, 500.0)},
        examples=False,
    )
    pictures = datasets.rendered_signs(sizes_px=(50,), count=2)
    done = evaluate(plan=plan, pictures=pictures, output=tmp_path, threads=1)
    exposed = [row for row in done.cells if not row["clean"]]
    assert {row["exposure_s"] for row in exposed} == {math.inf}
    for row in exposed:
        assert row["blur_px"] == pytest.approx(row["velocity_x_px_s"] * row["applied_exposure_s"])
    bright = [row["applied_exposure_s"] for row in exposed if row["illuminance_lux"] == 400.0]
    assert len(set(bright)) == 2, "pictures of other means have exposures of their own"
    for row in done.scores:
        if not row["clean"] and row["illuminance_lux"] == 400.0:
            assert row["exposure_s"] == pytest.approx(fmean(bright))
    for answer in done.answers:
        assert len(answer["exposures_s"]) == 1
        assert 0 < answer["exposures_s"][0] <= 1 / 30
    with Store(tmp_path) as store:
        write_exports(store)
    with (tmp_path / "results.csv").open() as table:
        assert {row["exposure_s"] for row in csv.DictReader(table) if row["clean"] == "0"} <= {"auto"}
    again = evaluate(plan=plan, pictures=pictures, output=tmp_path, threads=1)
    assert again.outcome is not None
    assert again.outcome.computed == 0
