"""Rolling shutter: against rows exposed one by one and closed forms; in the chain: boxes, plans, batches."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from brute_force import photograph, rms_dn, rolled
from exposed_frames import budget
from path_oracle import straight_path, vibration

from blurnoise import Camera, Exposure, Trajectory, simulate
from blurnoise._core.borders import extended
from blurnoise.blur import convolution, rows
from blurnoise.blur.displacement import Displacement, Readout
from blurnoise.blur.layers import moved
from blurnoise.camera.distortion import Distortion
from blurnoise.light import effects
from blurnoise.light.resolved import Resolved

ROW_S, EXPOSURE_S = 3e-4, 0.01
SIZE = (41, 67)
GLOBAL = Camera.preset("imx250").with_figures(width_px=SIZE[1], height_px=SIZE[0])
ROLLING = GLOBAL.with_figures(row_time_s=ROW_S, shutter="rolling")
RESET = ROLLING.with_figures(shutter="global-reset")
TAKEN: dict[str, Any] = {"exposure_s": EXPOSURE_S, "illuminance_lux": 100.0}
MEAN: dict[str, Any] = {**TAKEN, "noise": False, "quantised": False, "fidelity": "full", "encoding": "linear"}


def picture():
    return torch.from_numpy(photograph(*SIZE))


def of_rows(light, path, readout, border):
    """Each row exposed in its own window of a path, as bright as that is long."""
    still, exposure = light.new_zeros(2), light.new_tensor(readout.exposure_s)
    seen = moved(light, Displacement(still, exposure, readout, path), border)
    return seen * torch.from_numpy(readout.light).to(light)[:, None]


def rolled_at_once(light, moved, exposure, row_s, border):
    readout = Readout(light.shape[-2], row_s, float(exposure.detach()))
    return rows.rolled(light, Displacement(moved, exposure, readout), border)


def warped(light, velocity_px_s, row_s, border):
    """Pictures of which row i shows what was at (x - v_x tau_i, i - v_y tau_i)."""
    x, y = velocity_px_s
    height = light.shape[-2]
    tau = (torch.arange(height, dtype=torch.float64) - (height - 1) / 2) * row_s
    if y:
        light = rows.mixed(light, *rows._lanczos_taps(-y * tau), border)
    return rows.shifted_rows(light, x * tau, border)  # of rows as they are read, hence afterwards


def in_uniform_motion(velocity, row_s=ROW_S, light=None, border="circular"):
    light = picture() if light is None else light
    moved_px = EXPOSURE_S * torch.tensor(velocity, dtype=torch.float64)
    return rolled_at_once(light, moved_px, torch.tensor(EXPOSURE_S), row_s, border)


def along(path):
    """Places at times, about that of mid-exposure."""
    origin = path.origin_px(EXPOSURE_S)
    return lambda s: tuple(np.interp(s, path.time_s, x) - o for x, o in zip((path.x_px, path.y_px), origin))  # noqa: B905


@pytest.mark.parametrize("velocity", [(600, 0), (0, 300), (500, -400)])
@pytest.mark.parametrize("scan", [1, -1])
def test_uniform_motion_by_brute_force(velocity, scan):
    """Every row by 128 Lanczos sub-exposures; to 0.1 DN both of the warp and of rows in their own windows.

    Those of a path that runs along rows and across them are sub-exposures a pixel apart themselves: to 0.2 DN.
    """
    readout = Readout(SIZE[0], scan * ROW_S, EXPOSURE_S)
    x, y = velocity
    brute = rolled(picture().numpy(), lambda s: (x * s, y * s), *readout.windows_s)
    seen = in_uniform_motion(velocity, scan * ROW_S)
    assert rms_dn(seen.numpy(), brute) < 0.1
    path = straight_path(velocity, 0.1)
    by_rows = of_rows(picture(), path, readout, "circular").numpy()
    assert rms_dn(by_rows, brute) < (0.2 if x and y else 0.1)
    assert rms_dn(in_uniform_motion(velocity, -scan * ROW_S).numpy(), brute) > 2.0


@pytest.mark.parametrize("border", ["reflect", "replicate", "constant", "circular"])
@pytest.mark.parametrize("velocity", [(900.0, -500.0), (900.0, 0.0), (0.0, 500.0)])
def test_the_whole_picture_up_to_its_border(velocity, border):
    """As of a scene that is continued far beyond what comes in, with gradients as without."""
    size, row_s, far = (120, 160 if velocity[0] else 8), 96e-6, 64
    light = torch.from_numpy(photograph(*size))
    moved, exposure = torch.tensor(velocity, dtype=torch.float64) * EXPOSURE_S, torch.tensor(EXPOSURE_S)
    scene = extended(light, (far, far), (size[0] + 2 * far, size[1] + 2 * far), border)
    if velocity[0]:
        blurred = convolution.motion_blur(scene, moved.tolist(), method="transfer", border="replicate")
        truth = warped(blurred, velocity, row_s, "replicate")[..., far:-far, far:-far].numpy()
    else:
        windows = Readout(size[0] + 2 * far, row_s, EXPOSURE_S).windows_s
        truth = rolled(scene[..., far:-far].numpy(), lambda s: (0 * s, velocity[1] * s), *windows, moments=64)
        truth = truth[..., far:-far, :]
    seen = rolled_at_once(light, moved, exposure, row_s, border)
    assert 255 * np.abs(seen.numpy() - truth).max() < 0.1
    if border != "constant":  # beyond which the blur alone would be cut off
        asked = moved.requires_grad_()
        follows = rolled_at_once(light, asked, exposure, row_s, border)
        assert 255 * float((seen - follows.detach()).abs().max()) < (0.25 if velocity[0] == 0 else 0.06)
        follows.square().mean().backward()
        assert asked.grad is not None
        assert float(asked.grad.abs().max()) > 0


@pytest.mark.parametrize(
    ("amplitude_px", "frequency_hz", "exposure_s"),
    [(3.0, 2400.0, 0.01), (0.5, 1600.0, 0.01), (1.0, 480.0, 1 / 30)],
)
def test_fast_vibration_down_the_rows(amplitude_px, frequency_hz, exposure_s):
    """Whole periods in each window: J0 of the frequency. 24 or 16 even moments hit the same phase in every period:
    15.6, 5.0 and 8.0 DN, more than not blurring at all."""
    readout = Readout(SIZE[0], 2e-5, exposure_s)
    path = Trajectory.sinusoid(amplitude_px, frequency_hz, 0.1, direction_deg=90.0, phase_rad=0.3)
    seen = of_rows(picture(), path, readout, "circular").numpy()
    f = np.fft.fftfreq(SIZE[0])[:, None] * amplitude_px
    light = picture().numpy()
    blurred = np.fft.ifft2(np.fft.fft2(light) * vibration(f, frequency_hz, exposure_s)).real
    assert rms_dn(seen, blurred) < 0.05
    assert rms_dn(seen, light) > 1.0


def test_global_reset():
    """The last of 1280 rows is 4.08 times as bright as the first; a flash within all windows freezes all rows."""
    readout = Readout(1280, 24.098e-6, 0.01, reset=True)
    assert readout.light[-1] / readout.light[0] == pytest.approx(4.08, abs=0.005)
    starts, stops = readout.windows_s
    assert starts.min() == starts.max()
    assert stops.min() - starts.max() == pytest.approx(0.01)
    assert (starts + stops)[639:641].mean() == pytest.approx(0.0, abs=1e-12)
    still = straight_path((0.0, 0.0), 1.0)
    seen = of_rows(torch.ones(1, 1, 1280, 2), still, readout, "reflect")
    np.testing.assert_allclose(seen[0, 0, :, 0].numpy(), readout.light, rtol=1e-6)


def test_limits():
    with pytest.raises(ValueError, match=r"velocity_px_s = 4000 down: must be below 3333\.33"):
        simulate(torch.rand(1, 1, *SIZE), ROLLING, **TAKEN, velocity_px_s=(0.0, 4000.0))
    constant = torch.full((1, 1, 41, 67), 0.37, dtype=torch.float64)
    torch.testing.assert_close(in_uniform_motion((500.0, 300.0), light=constant, border="reflect"), constant)


def test_off_is_as_it_was():
    """To the bit: no row time; and a rolling shutter before a scene at rest."""
    light = torch.rand(2, 3, *SIZE, generator=torch.Generator().manual_seed(1))
    moving: dict[str, Any] = {**TAKEN, "velocity_px_s": [(500.0, 300.0), (90.0, -20.0)], "generator": [1, 2]}
    none, still = GLOBAL.with_figures(shutter="rolling"), {**TAKEN, "generator": [1, 2]}
    assert torch.equal(simulate(light, none, **moving), simulate(light, GLOBAL, **moving))
    assert torch.equal(simulate(light, ROLLING, **still), simulate(light, GLOBAL, **still))
    assert not torch.equal(simulate(light, ROLLING, **moving), simulate(light, GLOBAL, **moving))


def test_rows_are_read_in_the_sensor_s_time_and_upwards_as_downwards_of_the_flipped():
    """A picture of half the sensor's rows rolls by as much of its height."""
    light = torch.rand(1, 1, *SIZE, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    down = simulate(light, ROLLING, **MEAN, velocity_px_s=(500.0, 300.0))
    twice = ROLLING.with_figures(width_px=2 * SIZE[1], height_px=2 * SIZE[0], row_time_s=ROW_S / 2)
    torch.testing.assert_close(simulate(light, twice, **MEAN, velocity_px_s=(500.0, 300.0)), down)
    upwards = simulate(light.flip(-2), ROLLING.with_figures(scan="up"), **MEAN, velocity_px_s=(500.0, -300.0))
    torch.testing.assert_close(upwards.flip(-2), down, rtol=0, atol=1e-6)


BARREL = Distortion("opencv", (-0.2, 0.02, 0.001, -0.0005))
PATH = Trajectory.sinusoid(4.0, 30.0, 0.2, direction_deg=35.0, phase_rad=0.8)


@pytest.mark.parametrize(
    ("place", "moves", "distortion"),
    [
        ((24, 24), {"velocity_px_s": (400.0, -200.0)}, None),
        ((24, 24), {"trajectory": PATH}, None),
        ((118, 86), {"velocity_px_s": (600.0, -400.0)}, BARREL),
        ((30, 84), {"velocity_px_s": (600.0, -400.0)}, BARREL),
    ],
)
def test_boxes_are_where_the_picture_has_them(place, moves, distortion):
    """A bright square's centroid over a dark ground; behind a lens that distorts either alone is elsewhere."""
    size = (120, 160) if distortion else (40, 64)
    camera = ROLLING.with_figures(
        width_px=size[1], height_px=size[0], row_time_s=1.5e-4, distortion=distortion
    )
    (x, y), light = place, torch.zeros(1, 1, *size, dtype=torch.float64)
    light[..., y : y + 6, x : x + 8] = 1.0
    weight = (simulate(light, camera, **MEAN, **moves) - camera.sensor.black_level_dn)[0, 0].clamp_min(0)
    seen = [float((weight.sum(k) * (torch.arange(size[1 - k]) + 0.5)).sum() / weight.sum()) for k in (0, 1)]
    box = torch.tensor([[x, y, x + 8.0, y + 6.0]], dtype=torch.float64)
    taken = Exposure(camera, 0.01, 100.0, **moves)

    def middle(of):
        left, top, right, bottom = of.move_boxes(box, size)[0].tolist()
        return np.array([left + right, top + bottom]) / 2

    assert middle(taken) == pytest.approx(seen, abs=0.35 if distortion else 0.15)
    for wrong in (camera.with_figures(row_time_s=0.0), camera.with_figures(distortion=None)):
        if wrong != camera:
            assert np.hypot(*(middle(replace(taken, camera=wrong)) - seen)) > 0.25
    low_x, low_y, high_x, high_y = taken.sweep_boxes(box, size)[0].tolist()
    inside = weight[round(low_y) - 1 : round(high_y) + 1, round(low_x) - 1 : round(high_x) + 1]
    assert float(inside.sum() / weight.sum()) > 0.97


def test_plan():
    told = {stage.name: stage for stage in budget(ROLLING, **TAKEN, displacement_px=(5.0, 3.0)).stages}
    assert told["rolling shutter"].kept
    assert "+0.15, +0.09 px per row, after the blur" in told["rolling shutter"].how
    assert "rolling shutter" in budget(ROLLING, **TAKEN, displacement_px=(1e-5, 0.0)).without
    path = budget(ROLLING, **TAKEN, trajectory=Trajectory.sinusoid(3.0, 80.0, 0.2))
    assert "every row in its own window" in {each.name: each.how for each in path.stages}["rolling shutter"]
    assert "rolling shutter" not in budget(RESET, **TAKEN).without


def test_bound_holds():
    """Of what leaving it out changes a picture of black and white pixels."""
    light = (torch.rand(1, 1, *SIZE, generator=torch.Generator().manual_seed(1)) > 0.5).double()
    effect = next(each for each in effects.EFFECTS if each.name == "rolling shutter")
    for velocity in ((20.0, 0.0), (0.0, 15.0), (60.0, -50.0)):
        displacement_px = velocity[0] / 100, velocity[1] / 100
        moved = convolution.motion_blur(light, displacement_px, method="transfer")
        at = Resolved(ROLLING, 0.01, 25.0, 100.0, displacement_px, size=SIZE)
        seen = in_uniform_motion(velocity, light=light, border="reflect")
        changed = float((seen - moved).square().mean().sqrt())
        assert 0.1 * effect.bound(at) < changed <= effect.bound(at)


@pytest.mark.parametrize(
    "camera", [ROLLING, ROLLING.with_figures(scan="up"), RESET], ids=["down", "up", "reset"]
)
@pytest.mark.parametrize("velocity", [(500.0, 300.0), (500.0, -300.0), (0.0, 0.0), (-300.0, 100.0)])
def test_swept_boxes_hold_what_tall_boxes_cover_and_no_more(camera, velocity):
    """Against every row of a tall box at 4000 times: where it is exposed, the box is between two sides."""
    shake = None if velocity[0] > 0 else PATH
    left, top, right, bottom = box = (20.0, 4.0, 30.0, 36.0)
    tau = (np.arange(40) - 19.5) * ROW_S * (-1 if camera.sensor.scan == "up" else 1)
    starts, stops = tau - 0.005, tau + 0.005
    if camera is RESET:
        starts = np.full(40, -(0.01 + 19.5 * ROW_S) / 2)
        stops = starts + 0.01 + np.arange(40) * ROW_S
    times = np.linspace(starts.min(), stops.max(), 4001)
    x, y = np.outer(velocity, times)
    if shake is not None:
        x, y = (straight + shaken for straight, shaken in zip((x, y), along(shake)(times), strict=True))
    row = np.arange(40)[:, None] + 0.5
    exposed = (times >= starts[:, None]) & (times <= stops[:, None])
    there = exposed & (row >= top + y) & (row <= bottom + y)
    seen_x, seen_y = np.broadcast_to(x, there.shape)[there], np.broadcast_to(row, there.shape)[there]
    camera = camera.with_figures(width_px=64, height_px=40)
    taken = Exposure(camera, 0.01, 100.0, velocity_px_s=velocity, trajectory=shake)
    swept = taken.sweep_boxes(torch.tensor([box], dtype=torch.float64), (40, 64))[0].numpy()
    # Rows are seen whole, half a pixel beyond their middles: at up to 1100 px/s in a row's time, 0.33 px.
    assert swept[[0, 2]] == pytest.approx((left + seen_x.min(), right + seen_x.max()), abs=0.25)
    assert swept[[1, 3]] == pytest.approx((seen_y.min() - 0.5, seen_y.max() + 0.5), abs=0.55)
