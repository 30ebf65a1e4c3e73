"""Sweeps along a trajectory: a path for each picture, of which a shorter exposure sees a part; a run is of one."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from blurnoise_eval import evaluate
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec
from blurnoise_eval.sweep.engines import ProcessEngine, ThreadEngine
from blurnoise_eval.sweep.exposing import Scene, frames
from plans import plan as swept
from signs_in_memory import CAMERA, TWO, matched_detector, noise, rows_of

from blurnoise import simulate
from blurnoise.motion import trajectory as paths
from blurnoise.picture.develop import develop_8bit

PLAN = swept((0.004, 0.02), (100.0,), (0.0, 200.0), gain_db=(0.0,))
LOG = "time_s,x_px,y_px\n0,0,0\n0.01,4,0\n0.03,4,9\n"


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return matched_detector(tmp_path_factory.mktemp("model"))


def test_a_frame_is_simulates_along_the_shake_of_its_cell() -> None:
    picture = noise(41, 53)
    path = TrajectorySpec.parse("shake:9"), 0.02
    for exposure_s in (0.004, 0.02):
        at = Conditions(exposure_s=exposure_s, illuminance_lux=100.0, velocity_x_px_s=200.0)
        first, other = (
            next(frames(Scene(picture), [Cell("a", 0, at, seed)], CAMERA, path=path)) for seed in (5, 6)
        )
        shake = paths.shake(5, 9.0, 0.02)
        dn = simulate(
            torch.from_numpy(picture).permute(2, 0, 1)[None] / 255,
            CAMERA,
            exposure_s=exposure_s,
            illuminance_lux=100.0,
            velocity_px_s=(200.0, 0.0),
            trajectory=shake,
            generator=[5],
        )
        np.testing.assert_array_equal(first.image, develop_8bit(dn, CAMERA)[0].permute(1, 2, 0).numpy())
        assert np.abs(first.image.astype(int) - other.image).mean() > 2  # whose path is its own
        box = np.array([[20.0, 10.0, 30.0, 20.0]])
        assert first.sweep_boxes is not None
        grown = first.sweep_boxes(box, np.array([[53.0, 41.0]]))[0] - box[0]
        expected = shake.seen(exposure_s, (200.0, 0.0)).box
        np.testing.assert_allclose(grown, expected, atol=1e-6)


@pytest.mark.slow
def test_a_logs_content_travels_and_makes_the_run(detector: Detector, tmp_path: Path) -> None:
    """Read once: it may be gone when processes compute. Another folder changes nothing, another number all."""
    log = tmp_path / "log.csv"
    log.write_text(LOG, encoding="utf-8")
    plan = replace(PLAN, trajectory=str(log))
    log.unlink()
    threads, processes = (
        rows_of(tmp_path / name, [detector], CAMERA, TWO, pickle.loads(pickle.dumps(plan)), engine=engine)
        for name, engine in (("threads", ThreadEngine(1)), ("processes", ProcessEngine(1)))
    )
    assert str(threads) == str(processes)
    straight = rows_of(tmp_path / "straight", [detector], CAMERA, TWO, PLAN)
    assert str(straight) != str(threads)
    (tmp_path / "elsewhere").mkdir()
    moved, changed = tmp_path / "elsewhere" / "log.csv", tmp_path / "log.csv"
    moved.write_text(LOG, encoding="utf-8")
    changed.write_text(LOG.replace("9", "8"), encoding="utf-8")
    assert replace(PLAN, trajectory=str(moved)).to_dict() == plan.to_dict()
    assert replace(PLAN, trajectory=str(changed)).to_dict() != plan.to_dict()


@pytest.mark.parametrize(
    ("content", "words"),
    [(LOG.replace("0.03", "0.015"), "must hold the exposure"), ("time_s,x\n", "log.csv")],
)
def test_a_log_that_does_not_do_makes_no_folder(
    detector: Detector, tmp_path: Path, content: str, words: str
) -> None:
    log = tmp_path / "log.csv"
    log.write_text(content, encoding="utf-8")
    with pytest.raises(ValueError, match=words):
        evaluate(detector, TWO, CAMERA, replace(PLAN, trajectory=str(log)), tmp_path / "run")
    assert not (tmp_path / "run").exists()
