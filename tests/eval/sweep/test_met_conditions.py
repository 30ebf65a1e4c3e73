"""What a run leaves for training: the conditions that it met, as the augmentation draws them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from blurnoise_eval import evaluate
from blurnoise_eval.grid.axes import AUTOMATIC, SETTING
from blurnoise_eval.grid.conditions import SweepPlan, with_lens
from blurnoise_eval.report.run import write_tables
from blurnoise_eval.sweep.met_conditions import met_conditions
from plans import IMX250
from plans import plan as swept
from signs_in_memory import matched_detector, picture, picture_set

from blurnoise import RandomExposure
from blurnoise.training.table import FILE, ExposureTable

PLAN = swept((0.002, 0.01), (5.0, 50.0), (0.0, 400.0), gain_db=(6.0,), f_number=(2.0, 4.0))


def rows(plan: SweepPlan) -> list[dict[str, Any]]:
    """Scores of two models: the clean picture, and every condition."""
    met = [{"clean": False, **at.on(IMX250)} for at in plan.conditions()]
    return 2 * [{"clean": True}, *met]


def table(plan: SweepPlan, **manifest: Any) -> dict[str, Any]:
    found = met_conditions(rows(plan), {"camera": IMX250.to_dict(), "plan": plan.to_dict(), **manifest})
    plain: dict[str, Any] = json.loads(json.dumps(found, allow_nan=False))
    return plain


def test_every_condition_stands_there_once_with_its_camera(tmp_path: Path) -> None:
    held = table(PLAN)
    assert len(held["conditions"]) == 16
    (tmp_path / FILE).write_text(json.dumps(held))
    read = ExposureTable.of_run(tmp_path)
    assert read.cameras == (with_lens(IMX250, f_number=2.0), with_lens(IMX250, f_number=4.0))
    met = {
        (at.exposure_s, at.illuminance_lux, at.speed_px_s, at.gain_db, read.cameras[at.camera].f_number)
        for at in read.rows
    }
    wanted = {
        (at["exposure_s"], at["illuminance_lux"], at["velocity_x_px_s"], at["gain_db"], at["f_number"])
        for at in PLAN.conditions()
    }
    assert met == wanted


def test_the_exposures_of_the_one_rule_are_marked_and_saturation_stands_beside() -> None:
    """Those for each light at each speed, at the gain that they are for; not what a light's or all average says."""
    plan = swept((0.002, 0.01), (5.0, 50.0), (0.0, 400.0), gain_db=(6.0, 12.0))
    met = [{**row, "saturated": 0.25} if not row["clean"] else row for row in rows(plan)]
    setting = {name: next(row for row in met if not row["clean"])[name] for name in SETTING}
    told = [
        {
            **setting,
            "scope": scope,
            "illuminance_lux": lux,
            "gain_db": gain,
            "speed": speed,
            "exposure_s": used,
        }
        for scope, lux, speed, gain, used in (
            ("condition", 5.0, 400.0, 12.0, 0.002),
            ("condition", 50.0, 0.0, None, 0.01),
            ("light", 50.0, 400.0, None, 0.002),
        )
    ]
    held = met_conditions(met, {"camera": IMX250.to_dict(), "plan": plan.to_dict()}, told)["conditions"]
    assert len(held) == 16
    assert {each["saturated"] for each in held} == {0.25}
    chosen = {
        (each["illuminance_lux"], each["velocity_x_px_s"], each["gain_db"], each["exposure_s"])
        for each in held
        if each["recommended"]
    }
    assert chosen == {(5.0, 400.0, 12.0, 0.002), (50.0, 0.0, 6.0, 0.01), (50.0, 0.0, 12.0, 0.01)}


def test_what_the_camera_sets_itself_is_auto_as_it_was_set(tmp_path: Path) -> None:
    plan = swept((0.002,), (5.0,), gain_db=(AUTOMATIC,), moves=(1.0,))
    held = table(replace(plan, auto_exposure=replace(plan.auto_exposure, target=0.3)))
    (only,) = held["conditions"]
    assert (only["gain_db"], only["moves"]) == ("auto", "targets")
    (tmp_path / FILE).write_text(json.dumps(held))
    read = ExposureTable.of_run(tmp_path)
    assert read.cameras == (IMX250,)
    assert read.rows[0].gain_db is None
    assert read.gain_db == replace(plan.auto_exposure, target=0.3)


def test_training_draws_what_a_finished_run_has_met(tmp_path: Path) -> None:
    plan = swept((0.002, 0.01), (50.0,), (0.0, 400.0), gain_db=(0.0,))
    found = evaluate(
        matched_detector(tmp_path).path,
        picture_set(picture("a")),
        plan=plan,
        output=tmp_path / "run",
        threads=1,
    )
    written = write_tables(found.data, found.output)
    assert written[-1].name == FILE
    augmentation = RandomExposure.for_run(tmp_path / "run", p=1.0)
    torch.manual_seed(0)
    params = augmentation.generate_parameters((400, 3, 8, 8))
    assert 0.002 <= float(params["exposure_s"].min()) < float(params["exposure_s"].max()) <= 0.0101
    assert params["illuminance_lux"].unique().tolist() == [50.0]
    assert 150 < int((params["speed_px_s"] == 0).sum()) < 250
    assert float(params["speed_px_s"].max()) <= 400
