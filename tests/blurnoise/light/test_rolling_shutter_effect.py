"""The rolling shutter in the chain: what it is of, what it leaves alone, boxes, plans, batches."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from brute_force import photograph, rms_dn, rolled
from path_oracle import straight_path

from blurnoise import Camera, Exposure, RandomExposure, Trajectory, plan, simulate
from blurnoise.blur import convolution
from blurnoise.light import effects
from blurnoise.light.conditions import Conditions
from blurnoise.optics.lens import Distortion, Lens

SIZE = (40, 64)
GLOBAL = replace(Camera.preset("imx250"), width_px=64, height_px=40)
ROLLING = replace(GLOBAL, row_time_s=3e-4, shutter="rolling")
RESET = replace(ROLLING, shutter="global-reset")
TAKEN: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 100.0}


def seen(
    camera: Camera,
    velocity: tuple[float, float],
    trajectory: Trajectory | None = None,
    exposure_s: float = 0.01,
) -> np.ndarray:
    """A picture's light after all effects."""
    light = torch.from_numpy(photograph(*SIZE))
    at = Conditions.of(
        light,
        camera,
        exposure_s=exposure_s,
        illuminance_lux=100.0,
        velocity_px_s=velocity,
        temperature_c=25.0,
        illuminant="D55",
        trajectory=trajectory,
    )
    return effects.through(light, at, border="circular").numpy()


def windows(rows: int = 40, row_s: float = 3e-4, reset: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Written anew: rows about the middle one; with reset all begin together."""
    tau = (np.arange(rows) - (rows - 1) / 2) * row_s
    if not reset:
        return tau - 0.005, tau + 0.005
    start = -(0.01 + (rows - 1) / 2 * row_s) / 2 + 0 * tau
    return start, start + 0.01 + np.arange(rows) * row_s


@pytest.mark.parametrize("velocity", [(600.0, 0.0), (0.0, 300.0), (500.0, -400.0)])
@pytest.mark.parametrize("reset", [False, True])
def test_brute_force(velocity: tuple[float, float], reset: bool) -> None:
    starts, stops = windows(reset=reset)
    x, y = velocity
    brute = rolled(photograph(*SIZE), lambda s: (x * s, y * s), starts, stops)
    brute *= ((stops - starts) / 0.01)[:, None]
    assert rms_dn(seen(RESET if reset else ROLLING, velocity), brute) < (0.15 if reset else 0.1)
    assert rms_dn(seen(GLOBAL, velocity), brute) > 2.0


@pytest.mark.parametrize("camera", [ROLLING, RESET])
def test_a_straight_trajectory_is_a_velocity(camera: Camera) -> None:
    by_path = seen(camera, (0.0, 0.0), straight_path((600.0, 0.0), 1.0))
    assert rms_dn(by_path, seen(camera, (600.0, 0.0))) < 0.05
    both = seen(camera, (400.0, 0.0), straight_path((200.0, 0.0), 1.0))
    np.testing.assert_allclose(both, by_path, atol=1e-9)


def test_off_is_as_it_was() -> None:
    """To the bit: no row time; and a rolling shutter before a scene at rest."""
    light = torch.rand(2, 3, *SIZE, generator=torch.Generator().manual_seed(1))
    moving: dict[str, Any] = {**TAKEN, "velocity_px_s": [(500.0, 300.0), (90.0, -20.0)], "generator": [1, 2]}
    none = replace(GLOBAL, shutter="rolling")
    assert torch.equal(simulate(light, none, **moving), simulate(light, GLOBAL, **moving))
    still = {**TAKEN, "generator": [1, 2]}
    assert torch.equal(simulate(light, ROLLING, **still), simulate(light, GLOBAL, **still))
    assert not torch.equal(simulate(light, ROLLING, **moving), simulate(light, GLOBAL, **moving))


def test_pictures_of_a_batch_do_not_meet() -> None:
    light = torch.rand(3, 3, *SIZE, generator=torch.Generator().manual_seed(1))
    velocities = [(500.0, 300.0), (90.0, -20.0), (300.0, 0.0)]
    paths = [
        None,
        Trajectory.sinusoid(3.0, 80.0, 0.1, direction_deg=20.0),
        Trajectory.sinusoid(3.0, 80.0, 0.1),
    ]
    camera = replace(ROLLING, defocus_radius_px=1.0)
    together = simulate(
        light, camera, **TAKEN, velocity_px_s=velocities, trajectory=paths, generator=[1, 2, 3]
    )
    for item, (velocity, path) in enumerate(zip(velocities, paths, strict=True)):
        alone = simulate(
            light[item : item + 1],
            camera,
            **TAKEN,
            velocity_px_s=velocity,
            trajectory=path,
            generator=[item + 1],
        )
        assert torch.equal(together[item : item + 1], alone)


def test_upwards_is_downwards_of_the_flipped() -> None:
    up, velocity = replace(ROLLING, scan="up"), (500.0, 300.0)
    light = torch.rand(1, 1, *SIZE, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    mean: dict[str, Any] = {**TAKEN, "noise": False, "quantised": False, "fidelity": "full"}
    straight = simulate(light, up, **mean, velocity_px_s=velocity)
    flipped = simulate(light.flip(-2), ROLLING, **mean, velocity_px_s=(500.0, -300.0)).flip(-2)
    torch.testing.assert_close(straight, flipped, rtol=0, atol=1e-6)


def test_rows_of_a_picture_are_read_in_the_sensor_s_time() -> None:
    """A picture of half the sensor's rows rolls by as much of its height."""
    twice = replace(ROLLING, width_px=128, height_px=80, row_time_s=1.5e-4)
    np.testing.assert_allclose(seen(twice, (500.0, 300.0)), seen(ROLLING, (500.0, 300.0)), atol=1e-12)


def test_reset_brightens_below() -> None:
    mean: dict[str, Any] = {**TAKEN, "noise": False, "quantised": False}
    dn = simulate(torch.full((1, 1, *SIZE), 0.1), RESET, **mean, encoding="linear")[0, 0, :, 5]
    light = dn - RESET.black_level_dn
    assert float(light[-1] / light[0]) == pytest.approx(1 + 39 * 3e-4 / 0.01, rel=1e-3)


def test_boxes_follow() -> None:
    """y' = m + (y - m) / (1 - v_y t), x' by the middle row; between the pixels' edges, hence half a pixel."""
    box = torch.tensor([[10.0, 12.0, 20.0, 22.0]], dtype=torch.float64)
    taken = Exposure(ROLLING, 0.01, 100.0, velocity_px_s=(500.0, 300.0))
    middle, factor = 19.5, 1 / (1 - 300 * 3e-4)
    top, bottom = (middle + (y - 0.5 - middle) * factor + 0.5 for y in (12.0, 22.0))
    x = 500 * 3e-4 * ((top + bottom) / 2 - 0.5 - middle)
    moved = taken.move_boxes(box, SIZE)
    torch.testing.assert_close(moved, torch.tensor([[10 + x, top, 20 + x, bottom]], dtype=torch.float64))
    swept = taken.sweep_boxes(box, SIZE)
    widths = (swept - moved)[0] * torch.tensor([-1, -1, 1, 1])
    apart = 500 * 3e-4 * (10 / 2 + 1.5) * factor  # of the rows that see the box first and last
    torch.testing.assert_close(widths[0::2], torch.full((2,), 2.5 + apart).double(), rtol=0, atol=0.02)
    torch.testing.assert_close(widths[1::2], torch.full((2,), 1.5).double() * factor, rtol=0, atol=0.02)
    assert torch.equal(replace(taken, camera=GLOBAL).move_boxes(box, SIZE), box)


def test_boxes_are_where_the_picture_has_them() -> None:
    """A bright square's centroid, in uniform motion and along a path, over a dark ground."""
    path = Trajectory.sinusoid(4.0, 30.0, 0.2, direction_deg=35.0, phase_rad=0.8)
    for trajectory, velocity in ((None, (400.0, -200.0)), (path, (0.0, 0.0))):
        light = torch.zeros(1, 1, *SIZE, dtype=torch.float64)
        light[..., 24:30, 24:32] = 1.0
        mean: dict[str, Any] = {**TAKEN, "noise": False, "quantised": False, "fidelity": "full"}
        dn = simulate(
            light, ROLLING, **mean, encoding="linear", velocity_px_s=velocity, trajectory=trajectory
        )
        weight = (dn - ROLLING.black_level_dn)[0, 0].clamp_min(0)
        y = float((weight.sum(1) * (torch.arange(40) + 0.5)).sum() / weight.sum())
        x = float((weight.sum(0) * (torch.arange(64) + 0.5)).sum() / weight.sum())
        box = torch.tensor([[24.0, 24.0, 32.0, 30.0]], dtype=torch.float64)
        taken = Exposure(ROLLING, 0.01, 100.0, velocity_px_s=velocity, trajectory=trajectory)
        left, top, right, bottom = taken.move_boxes(box, SIZE)[0].tolist()
        assert ((left + right) / 2, (top + bottom) / 2) == pytest.approx((x, y), abs=0.15)
        assert np.hypot(x - 28, y - 27) > 0.5
        low_x, low_y, high_x, high_y = taken.sweep_boxes(box, SIZE)[0].tolist()
        inside = weight[round(low_y) - 1 : round(high_y) + 1, round(low_x) - 1 : round(high_x) + 1]
        assert float(inside.sum() / weight.sum()) > 0.97


def test_boxes_before_a_lens_that_distorts() -> None:
    """A square's centroid, off the axis, where barrel lens and rows have it; either alone is elsewhere."""
    size, row_s = (120, 160), 1.5e-4
    sides = {"width_px": size[1], "height_px": size[0]}
    lens = Lens(distortion=Distortion("opencv", (-0.2, 0.02, 0.001, -0.0005)))
    camera = replace(ROLLING, **sides, row_time_s=row_s, lens=lens)
    places = ((118.0, 86.0), (30.0, 84.0), (120.0, 24.0))
    boxes = torch.tensor([[x, y, x + 8, y + 8] for x, y in places], dtype=torch.float64)
    moving: dict[str, Any] = {"velocity_px_s": (600.0, -400.0)}
    taken = Exposure(camera, 0.01, 100.0, **moving)
    known = taken.move_boxes(boxes, size)
    for box, expected in zip(boxes.int().tolist(), known, strict=True):
        left, top, right, bottom = box
        light = torch.zeros(1, 1, *size, dtype=torch.float64)
        light[..., top:bottom, left:right] = 1.0
        mean: dict[str, Any] = {**TAKEN, "noise": False, "quantised": False, "fidelity": "full"}
        dn = simulate(light, camera, **mean, encoding="linear", **moving)
        weight = (dn - camera.black_level_dn)[0, 0].clamp_min(0)
        y = float((weight.sum(1) * (torch.arange(size[0]) + 0.5)).sum() / weight.sum())
        x = float((weight.sum(0) * (torch.arange(size[1]) + 0.5)).sum() / weight.sum())
        middle = ((expected[:2] + expected[2:]) / 2).tolist()
        assert middle == pytest.approx((x, y), abs=0.35)
        for wrong in (replace(camera, row_time_s=0.0), replace(camera, lens=Lens())):
            other = replace(taken, camera=wrong).move_boxes(boxes, size)[
                boxes.tolist().index([*map(float, box)])
            ]
            apart = (other[:2] + other[2:]) / 2 - torch.tensor([x, y])
            assert float(apart.norm()) > 1.0


def test_augmented_boxes_follow() -> None:
    taken = RandomExposure(
        ROLLING, exposure_s=0.01, illuminance_lux=100.0, speed_px_s=500.0, direction_deg=0.0, p=1.0
    )
    from kornia.augmentation import AugmentationSequential

    box = torch.tensor([[[10.0, 5.0, 20.0, 15.0]]])
    _, moved = AugmentationSequential(taken, data_keys=["input", "bbox_xyxy"])(torch.rand(1, 3, *SIZE), box)
    assert float(moved[0, 0, 0]) == pytest.approx(10 + 500 * 3e-4 * (10 - 0.5 - 19.5), abs=0.2)


def test_plan() -> None:
    told = {stage.name: stage for stage in plan(ROLLING, **TAKEN, displacement_px=(5.0, 3.0)).stages}
    assert told["rolling shutter"].kept
    assert "+0.15, +0.09 px per row, after the blur" in told["rolling shutter"].how
    assert not plan(ROLLING, **TAKEN).stages[6].kept
    assert "rolling shutter" in plan(ROLLING, **TAKEN, displacement_px=(1e-5, 0.0)).without
    path = plan(ROLLING, **TAKEN, trajectory=Trajectory.sinusoid(3.0, 80.0, 0.2))
    assert "every row in its own window" in {each.name: each.how for each in path.stages}["rolling shutter"]
    assert "rolling shutter" not in path.without
    assert "rolling shutter" not in plan(RESET, **TAKEN).without


def test_bound_holds() -> None:
    """Of what leaving it out changes a picture of black and white pixels."""
    light = (torch.rand(1, 1, *SIZE, generator=torch.Generator().manual_seed(1)) > 0.5).double()
    for velocity in ((20.0, 0.0), (0.0, 15.0), (60.0, -50.0)):
        displacement_px = velocity[0] / 100, velocity[1] / 100
        moved = convolution.motion_blur(light, displacement_px, method="transfer")
        at = Conditions(ROLLING, 0.01, 25.0, 100.0, displacement_px, size=SIZE)
        effect = next(each for each in effects.EFFECTS if each.name == "rolling shutter")
        from blurs import warped

        changed = float((warped(moved, velocity, 3e-4, "reflect") - moved).square().mean().sqrt())
        assert 0.1 * effect.bound(at) < changed <= effect.bound(at)


def test_overtaken_and_contradicted() -> None:
    with pytest.raises(ValueError, match="velocity_px_s = 4000 down"):
        simulate(torch.rand(1, 1, *SIZE), ROLLING, **TAKEN, velocity_px_s=(0.0, 4000.0))
    with pytest.raises(ValueError, match=r"row_time_s = 1e-05: must be 0 where shutter is 'global'"):
        replace(GLOBAL, row_time_s=1e-5)
    with pytest.raises(ValueError, match="must hold the exposure"):
        simulate(torch.rand(1, 1, *SIZE), ROLLING, **TAKEN, trajectory=Trajectory.sinusoid(1.0, 80.0, 0.011))


def test_presets_that_roll() -> None:
    rows = {"mt9m034": 22.2, "ar0132at": 22.2, "ar0237": 15.3}
    for name in ("imx250", "imx250c", "imx249", "blackfly", "lin2024", *rows):
        camera = Camera.preset(name)
        assert 1e6 * camera.row_time_s == pytest.approx(rows.get(name, 0.0), abs=0.05)
        assert camera.shutter == ("rolling" if name in rows else "global")
        assert {"row_time_s", "shutter", "scan"} <= set(camera.sources)


def test_the_sensor_s_pattern_stays() -> None:
    """What the sensor adds is not carried along: an even scene's picture is the same however it moves."""
    even = torch.full((1, 1, *SIZE), 0.4)
    taken: dict[str, Any] = {**TAKEN, "generator": [7], "fidelity": "full", "pattern_seed": 3}
    uneven = replace(ROLLING, prnu=0.05, dsnu_e=20.0)
    still = simulate(even, uneven, **taken)
    assert float(still.std()) > 10
    assert torch.equal(simulate(even, uneven, **taken, velocity_px_s=(900.0, -400.0)), still)


@pytest.mark.parametrize("velocity", [(0.0, 1500.0), (1200.0, 900.0)])
def test_rows_read_within_a_pixel_see_what_was_beyond_a_black_border(velocity: tuple[float, float]) -> None:
    """What a long exposure sweeps over the border is there for the rows at it, too; truth: an analytic spot."""
    (height, width), exposure_s, row_s, (x_px_s, y_px_s) = SIZE, 0.06, 1e-5, velocity
    x, y = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))

    def spot(at: float | np.ndarray) -> np.ndarray:
        across, down = x - x_px_s * at - 31.5, y - y_px_s * at - 19.5
        return np.exp(-(across**2 + down**2) / 18)

    at = Conditions.of(
        light := torch.from_numpy(spot(0.0))[None, None],
        replace(ROLLING, row_time_s=row_s),
        exposure_s=exposure_s,
        illuminance_lux=100.0,
        velocity_px_s=velocity,
        temperature_c=25.0,
        illuminant="D55",
    )
    read = (np.arange(height)[:, None] - (height - 1) / 2) * row_s
    moments = ((np.arange(400) + 0.5) / 400 - 0.5) * exposure_s
    brute = sum(spot(read + moment) for moment in moments) / 400
    assert brute[0].max() > 0.05
    assert np.abs(effects.through(light, at, border="constant")[0, 0].numpy() - brute).max() < 1e-3


@pytest.mark.parametrize("camera", [ROLLING, replace(ROLLING, scan="up"), RESET], ids=["down", "up", "reset"])
@pytest.mark.parametrize("way", ["right and down", "right and up", "shake", "shake and left"])
def test_swept_boxes_hold_what_tall_boxes_cover_and_no_more(camera: Camera, way: str) -> None:
    """Against every row of a tall box at 4000 times: where it is exposed, the box is between two sides."""
    shake = Trajectory.sinusoid(3.0, 40.0, 0.3, direction_deg=35.0, phase_rad=0.8) if "shake" in way else None
    velocity = {"right and down": (500.0, 300.0), "right and up": (500.0, -300.0)}.get(way, (0.0, 0.0))
    velocity = (-300.0, 100.0) if "left" in way else velocity
    left, top, right, bottom = box = (20.0, 4.0, 30.0, 36.0)
    starts, stops = windows(reset=camera is RESET)
    if camera.scan == "up":
        starts, stops = starts[::-1], stops[::-1]
    times = np.linspace(starts.min(), stops.max(), 4001)
    x, y = np.outer(velocity, times)
    if shake is not None:
        path, durations = shake.window(times[0], times[-1])
        known = times[0] + np.concatenate([[0.0], np.cumsum(durations)])
        origin = shake.origin_px(0.01)
        x, y = (
            along + np.interp(times, known, path[axis]) - origin[axis] for axis, along in enumerate((x, y))
        )
    exposed = (times >= starts[:, None]) & (times <= stops[:, None])
    row = np.arange(40)[:, None] + 0.5
    there = exposed & (row >= top + y) & (row <= bottom + y)
    seen_x, seen_y = np.broadcast_to(x, there.shape)[there], np.broadcast_to(row, there.shape)[there]
    taken = Exposure(camera, 0.01, 100.0, velocity_px_s=velocity, trajectory=shake)
    swept = taken.sweep_boxes(torch.tensor([box], dtype=torch.float64), SIZE)[0].numpy()
    # Rows are seen whole, half a pixel beyond their middles: at up to 1100 px/s in half a row's time, 0.16 px.
    assert swept[[0, 2]] == pytest.approx((left + seen_x.min(), right + seen_x.max()), abs=0.2)
    assert swept[1] == pytest.approx(seen_y.min() - 0.5, abs=0.55)
    assert swept[3] == pytest.approx(seen_y.max() + 0.5, abs=0.55)
