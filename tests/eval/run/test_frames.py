"""Frames and boxes of cells: exposures that the camera sets, saturation, noise, paths, vehicles, objects."""

import math

import numpy as np
import pytest
import torch
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.plan.conditions import Cell, Conditions
from blurnoise_eval.plan.objects import ObjectSettings
from blurnoise_eval.run.exposing import PictureScene, frames, snr_db
from blurnoise_eval.scoring.movers import box_mover, box_sweeper
from commands import main, stated
from plans import plan as swept
from signs_in_memory import CAMERA, noise, picture, picture_set

from blurnoise import AutoExposure, Exposure, photoelectrons, simulate
from blurnoise.motion import trajectory as paths
from blurnoise.motion.ego import Vehicle
from blurnoise.picture.develop import develop_8bit

AUTO = {"exposure_s": math.inf, "gain_db": math.inf}
SMALL_WELL = CAMERA.with_figures(full_well_e=0.3 * CAMERA.sensor.full_well_e)


def frame_of(image, at, camera=CAMERA, seed=3, plan=None):
    return next(frames(PictureScene(image, plan), [Cell("p", 0, at, seed)], camera))


def simulated(image, camera, seed, **conditions):
    light = torch.from_numpy(image).permute(2, 0, 1)[None] / 255
    dn = simulate(light, camera, generator=[seed], **conditions)
    return develop_8bit(dn, camera)[0].permute(1, 2, 0).numpy()


def grey(reflectance_srgb):
    image = np.full((30, 44, 3), reflectance_srgb, np.uint8)
    image[:15] //= 2
    return image


@pytest.mark.parametrize(("lux", "limited"), [(5000.0, False), (0.02, True)])
def test_the_camera_sets_time_first_then_gain(lux, limited):
    """Where no limit is reached the mean of the linear picture is the meter's target, 18 %."""
    scene = PictureScene(grey(150))
    (frame,) = frames(scene, [Cell("p", 0, Conditions(**AUTO, illuminance_lux=lux), 3)], CAMERA)
    setting = AutoExposure().setting(
        CAMERA, mean_light=scene.light.mean_light(Exposure(CAMERA, 0.01, lux)), illuminance_lux=lux
    )
    given = {"exposure_s": frame.exposure.exposure_s, "gain_db": frame.exposure.gain_db}
    assert given == {"exposure_s": setting.exposure_s, "gain_db": setting.gain_db}
    assert (given["gain_db"] > 0) == limited
    same = frame_of(grey(150), Conditions(**given, illuminance_lux=lux))
    np.testing.assert_array_equal(frame.image, same.image)
    if not limited:
        linear = ((frame.image / 255 + 0.055) / 1.055) ** 2.4
        assert linear.mean() == pytest.approx(0.18, rel=0.01)


@pytest.mark.parametrize("camera", [CAMERA, SMALL_WELL])
@pytest.mark.parametrize(("lux_s", "share"), [(0.1, 0.0), (2.0, 0.25), (15.0, 0.75)])
def test_share_of_values_at_the_well_or_at_full_scale(camera, lux_s, share):
    """A quarter white, half 18 % grey, a quarter black. White: 6906 e- per lux s. Grey reaches the small well from
    2.6 lux s on, the other from 8.5; noise of 1 % of the well moves no grey or black there."""
    image = np.zeros((40, 52, 3), np.uint8)
    image[:10], image[10:30] = 255, 118  # sRGB of 0.18
    frame = frame_of(image, Conditions(exposure_s=0.01, illuminance_lux=lux_s / 0.01), camera)
    assert frame.saturated == pytest.approx(share, abs=0.002)
    assert frame_of(image, None, camera).saturated is None


def test_signal_to_noise_has_shot_dark_and_read_noise():
    """EMVA 1288: white of 0.02 lux s beside 300 e- of dark charge, 10 e- of read noise and the rounding to codes."""
    camera = CAMERA.with_figures(dark_current_e_s=3000.0, read_noise_e=10.0, prnu=0.0, dsnu_e=0.0)
    exposure = Exposure(
        camera, exposure_s=0.1, illuminance_lux=0.2, temperature_c=camera.sensor.dark_reference_c
    )
    white_e = photoelectrons(camera, 0.2, 0.1)
    noise_e = math.sqrt(white_e + 300.0 + 10.0**2 + 1 / 12 / camera.sensor.system_gain_dn_per_e**2)
    assert snr_db(exposure, 1.0) == pytest.approx(20 * math.log10(white_e / noise_e), abs=1e-3)


def test_a_frame_is_simulates_along_the_shake_of_its_cell():
    image, plan = (
        noise(41, 53),
        SweepPlan({"exposure_s": (0.02,), "illuminance_lux": (100.0,)}, trajectory="shake:9"),
    )
    for exposure_s in (0.004, 0.02):
        at = Conditions(exposure_s=exposure_s, illuminance_lux=100.0, velocity_x_px_s=200.0)
        first, other = (frame_of(image, at, seed=seed, plan=plan) for seed in (5, 6))
        shake = paths.shake(5, 9.0, 0.02)
        same = {"exposure_s": exposure_s, "illuminance_lux": 100.0, "velocity_px_s": (200.0, 0.0)}
        np.testing.assert_array_equal(first.image, simulated(image, CAMERA, 5, **same, trajectory=shake))
        assert np.abs(first.image.astype(int) - other.image).mean() > 2  # whose path is its own
        box = np.array([[20.0, 10.0, 30.0, 20.0]])
        grown = first.sweep_boxes(box, np.array([[53.0, 41.0]]))[0] - box[0]
        np.testing.assert_allclose(grown, shake.seen(exposure_s, (200.0, 0.0)).box, atol=1e-6)


SIZE = (103, 143)
VEHICLE = Vehicle(height_m=1.2, pitch_deg=3.0, hfov_deg=60.0, yaw_deg_s=6.0)


def test_frames_are_simulates_of_the_vehicles_flow():
    image = noise(*SIZE)
    for speed in (0.0, 20.0):
        at = Conditions(exposure_s=0.02, illuminance_lux=100.0, ego_speed_m_s=speed)
        plan = SweepPlan({name: (value,) for name, value in at.specified.items()}, vehicle=VEHICLE)
        frame = frame_of(image, at, plan=plan)
        flow = VEHICLE.flow_px_s(CAMERA, SIZE, speed)
        same = simulated(image, CAMERA, 3, exposure_s=0.02, illuminance_lux=100.0, velocity_px_s=flow)
        np.testing.assert_array_equal(frame.image, same)
    exposure = Exposure(CAMERA, 0.03, 100.0, ego_speed_m_s=20.0, vehicle=VEHICLE)
    assert box_mover(exposure) is None  # truth is that of mid-exposure


# --- what moves: all, the targets, or the background of targets that are tracked ---

BOXES = np.array([[10.0, 20.0, 30.0, 60.0], [40.0, 40.0, 80.0, 80.0]])
SIZES = np.full((2, 2), 100.0)


def taken(moves, right_px_s=0.0):
    return Exposure(CAMERA, 0.01, 300.0, (right_px_s, 0.0), moves=moves)


@pytest.mark.parametrize(
    ("objects", "labels", "moves", "lengths"),
    [
        (ObjectSettings(speeds={"slow": 0.5}), ("fast", "slow"), "targets", (30.0, 15.0)),
        (ObjectSettings(speeds={"slow": 0.5}), ("fast", "slow"), "background", (0.0, 15.0)),
    ],
)
def test_boxes_sweep_what_their_own_class_does(objects, labels, moves, lengths):
    grown = box_sweeper(taken(moves, 3000.0), objects)(BOXES, SIZES, labels)
    np.testing.assert_allclose(grown, BOXES + [[-length / 2, 0, length / 2, 0] for length in lengths])


def test_the_truth_is_the_box_that_is_asked_for():
    def truth(boxes, moves, right_px_s):
        mover = box_mover(taken(moves, right_px_s), ObjectSettings(boxes=boxes))
        return None if mover is None else mover(BOXES, SIZES, ["a", "a"])

    assert truth("object", "targets", 3000.0) is None
    np.testing.assert_allclose(
        truth("swept", "targets", 3000.0), (BOXES + np.array([-15, 0, 15, 0])).clip(0, 100)
    )


def test_a_picture_without_targets_is_background(detector, tmp_path):
    empty = picture("empty", labels=())
    plan = swept((0.01,), (300.0,), (0.0, 1600.0), moves=(0.0, 1.0, 2.0))
    run = evaluate([detector], picture_set(picture("a"), empty), CAMERA, plan, output=tmp_path / "run")
    cell_at = {
        (row["moves"], row["velocity_x_px_s"]): row["cell_id"]
        for row in run.cells
        if row["image"] == "empty" and not row["clean"]
    }
    moved, still = run.simulate(cell_at["all", 1600.0]), run.simulate(cell_at["all", 0.0])
    np.testing.assert_array_equal(run.simulate(cell_at["background", 1600.0]), moved)
    np.testing.assert_array_equal(run.simulate(cell_at["targets", 1600.0]), still)
    assert (moved != still).any()


def test_rows_say_each_targets_own_blur(detector, tmp_path):
    grid = swept((0.01,), (300.0,), (1600.0,), moves=(0.0, 1.0)).grid
    plan = SweepPlan(grid, objects=ObjectSettings(speeds={"stop sign": 2.0}))
    run = evaluate([detector], picture_set(picture("a")), CAMERA, plan, output=tmp_path / "run")
    rows = {row["moves"]: row for row in run.targets}
    assert (rows["all"]["blur_px"], rows["targets"]["blur_px"]) == pytest.approx((16, 32))
    assert rows["targets"]["confidence"] < rows["all"]["confidence"] - 0.02


@pytest.mark.parametrize(
    ("objects", "told"),
    [
        ({"speeds": {"car": 0.5}}, "speeds: car: must be classes of the targets"),
        ({"speeds": {"stop sign": 101}}, "speeds"),
    ],
)
def test_refused(objects, told, tmp_path, capsys):
    plan = stated(tmp_path, objects=objects, moves="targets")
    assert main(["sweep", "--plan", plan, "-o", str(tmp_path / "run")]) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()
