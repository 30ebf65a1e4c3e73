"""Trajectories: closed forms, windows, shakes and logs; blur by paths, picture by picture."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from exposed_frames import budget
from path_oracle import polyline_grid, straight_path, vibration

from blurnoise import Camera, Exposure, Trajectory, simulate
from blurnoise.blur import convolution, fourier, path_otf
from blurnoise.blur.convolution import path_blur
from blurnoise.camera import transfer
from blurnoise.motion.trajectory import from_rates, from_text, shake, simplified

EXACT = 5e-8  # the points of a path err by 4e-8 at most, the window by 5e-10
FOCAL_PX = 1662.77  # 1920 px over 60 degrees
CAMERA = Camera.preset("imx250")
VIBRATION = Trajectory.sinusoid(4.0, 80.0, 0.05, direction_deg=30.0, phase_rad=0.5)
LIT: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 100.0}


def of(trajectory, exposure_s, f):
    """The transfer function at one frequency, a multiple of 0.05, of the path as it was."""
    knots, durations = trajectory.window(-exposure_s / 2, exposure_s / 2)
    found = path_otf.transfer_on((20, 20), torch.tensor(knots), torch.tensor(durations / durations.sum()))
    return complex(found(torch.tensor([f]), torch.zeros(1))[0, 0])


def random_path(count=12):
    drawn = np.random.default_rng(4)
    return drawn.normal(size=(2, count)) * 4, drawn.uniform(0.2, 2.0, count - 1)


@pytest.mark.parametrize(
    ("exposure_s", "phase", "expected"),
    [
        (0.003, 0.0, 0.724517),
        (0.0125, 0.0, 0.290564),
        (0.020, 0.0, 0.254940),
        (0.020, 0.7, 0.281657 + 0.134267j),
    ],
)
def test_vibration_has_its_series(exposure_s, phase, expected):
    """By the series, and by a polyline within 1e-3 px, hence within 2 pi f 1e-3 = 6e-4."""
    assert complex(vibration(0.3, 80.0, exposure_s, phase_rad=phase)) == pytest.approx(expected, abs=1e-6)
    path = Trajectory.sinusoid(3.0, 80.0, 0.02, phase_rad=phase)
    assert of(path, exposure_s, 0.1) == pytest.approx(expected, abs=6e-4)


@pytest.mark.parametrize(("reach_px", "count"), [(2.0, 5), (20.0, 200), (300.0, 40)])
@pytest.mark.parametrize("sides", [(64, 96), (90, 128)])
def test_paths_are_sums_over_segments(sides, reach_px, count):
    """At the grid's frequencies and their aliases, however long the path."""
    drawn = np.random.default_rng(0)
    knots, shares = drawn.uniform(-reach_px, reach_px, (2, count + 1)), drawn.uniform(size=count)
    shares /= shares.sum()
    fy, fx = fourier.frequencies(sides)
    exact = fourier.joined(lambda fx, fy: polyline_grid(fx, fy, knots, shares), fx, fy, sides)
    found = path_otf.transfer_on(sides, torch.from_numpy(knots), torch.from_numpy(shares))
    seen = fourier.joined(found, torch.from_numpy(fx), torch.from_numpy(fy), sides).numpy()
    assert np.abs(seen - exact).max() < EXACT
    assert np.abs(exact).max() > 0.99


def test_simplified_is_within_its_tolerance_at_every_time():
    path = Trajectory.sinusoid(6.0, 80.0, 0.02, direction_deg=30.0)
    time, knots = np.array(path.time_s), np.array([path.x_px, path.y_px])
    kept = simplified(time, knots, 0.05)
    again = np.stack([np.interp(time, time[kept], along[kept]) for along in knots])
    off = np.hypot(*(again - knots)).max()
    assert 0.005 < off <= 0.05
    assert len(kept) < len(time) / 4
    slowed = np.array([[0.0, 1.0, 10.0], [0.0, 0.0, 0.0]])  # one line of which the pace changes
    assert simplified(np.array([0.0, 1.0, 2.0]), slowed, 0.05) == [0, 1, 2]


@pytest.mark.parametrize("exposure_s", [0.02, 0.004])
def test_centroid_stays(exposure_s):
    seen = VIBRATION.seen(exposure_s)
    middles = (seen.knots[:, 1:] + seen.knots[:, :-1]) / 2
    assert np.abs(middles @ seen.shares).max() < 1e-12


def test_velocity_adds():
    """To a path the uniform motion that runs beside it; a straight one is what a straight trajectory is."""
    still = Trajectory((-0.1, 0.1), (0.0, 0.0), (0.0, 0.0))
    seen = still.seen(0.01, (900.0, -500.0))
    np.testing.assert_allclose(seen.knots, [[-4.5, 4.5], [2.5, -2.5]], atol=1e-12)
    assert seen.knots == pytest.approx(straight_path((900.0, -500.0), 0.1).seen(0.01).knots)


def test_error_bounds_what_it_changes():
    """The most that 1 - H is over the band of a sampled picture, over 2; of short paths that is in its corner."""
    for scale in (0.01, 0.3, 1.0, 10.0):
        knots, durations = random_path()
        path = Trajectory.of(
            np.concatenate([[0.0], np.cumsum(durations)]) - durations.sum() / 2, knots * scale
        )
        seen = path.seen(float(durations.sum()))
        f = np.linspace(-0.5, 0.5, 65)
        response = polyline_grid(f, f, seen.knots, np.array(seen.shares))
        lost = float(np.abs(1 - response).max()) / 2
        assert lost <= seen.error * (1 + 1e-9)
        if scale < 0.1:
            assert seen.error == pytest.approx(lost, rel=0.1)
    diagonal = straight_path((30.0, 30.0), 0.01).seen(0.01)
    assert diagonal.error == pytest.approx(transfer.motion_error(0.3, 0.3), rel=1e-3)


def test_a_path_holds_an_exposure_that_is_rounded_to_single_precision():
    """0.1 s is longer in single precision; a thousandth more is not held."""
    path = straight_path((100.0, 0.0), 0.1)
    rounded = float(np.float32(0.1))
    assert rounded > 0.1
    assert path.seen(rounded).box[2] == pytest.approx(5.0, rel=1e-6)
    with pytest.raises(ValueError, match="must hold the exposure"):
        path.seen(0.1001)


@pytest.mark.parametrize("seed", [0, 1, 2**62])
def test_shake_goes_as_far_as_stated(seed):
    path = shake(seed, 20.0, 0.01, duration_s=0.03)
    knots, durations = path.window(-0.005, 0.005)
    assert float(np.ptp(knots, axis=1).max()) == pytest.approx(20.0)
    steps = np.hypot(*np.diff(knots)) / durations
    assert steps[1:-1].std() < 1e-6 * steps.mean()  # its speed is kept: time fixes the length
    assert path == shake(seed, 20.0, 0.01, duration_s=0.03)
    assert path != shake(seed + 1, 20.0, 0.01, duration_s=0.03)
    left, top, right, bottom = path.seen(0.004).box
    assert max(right - left, bottom - top) < 20.0


def test_nose_up_moves_the_picture_down_and_turning_left_right():
    time = np.linspace(-0.02, 0.02, 9)
    rates = np.stack([np.full(9, 0.3), np.full(9, -0.2), np.full(9, 5.0)])
    x, y = np.ptp(from_rates(time, rates, focal_px=1000.0).window(-0.005, 0.005)[0], axis=1)
    assert (x, y) == pytest.approx((2.0, 3.0))
    path = from_rates(time, rates, focal_px=1000.0)
    assert path.x_px[-1] > path.x_px[0]
    assert path.y_px[-1] > path.y_px[0]


def test_logs():
    path = from_text("# a comment\ntime_s,x_px,y_px\n100.00,0,1\n100.01,2,1\n100.02,5,3\n", "places.csv")
    assert path.time_s == pytest.approx((-0.01, 0.0, 0.01))
    assert path.y_px == (1.0, 1.0, 3.0)
    rates = "time_s,wx_deg_s,wy_deg_s\n0,10,0\n0.01,10,0\n0.02,10,0\n"
    along = from_text(rates, "rates.csv", focal_px=FOCAL_PX)
    assert np.ptp(along.window(-0.005, 0.005)[0], axis=1) == pytest.approx((0.0, 2.902), abs=1e-3)
    with pytest.raises(ValueError, match=r"rates.csv: focal_px: must be the camera's"):
        from_text(rates, "rates.csv")


LOGS = {
    "": "is empty",
    "[" * 200_000: "field larger than field limit",
    "time_s,x_px\n0,1\n1,2\n": "must be time_s and x_px, y_px or",
    "time_s,x_px,y_px\n0,1,1\n0,2,2\n": "must be at least two times that increase",
    "time_s,x_px,y_px\n0,1,left\n": "must hold numbers",
    "time_s,x_px,y_px\n0,1,nan\n1,1,1\n": "y_px = nan: must be finite",
    "time_s,x_px,y_px\n0,1\n": "as many values in every row",
    "time_ms,x_px,y_px\n0,1,1\n1,2,2\n": "must hold time_s",
    "time_s,wx,wy\n0,1,1\n1,2,2\n": "wx_rad_s, wy_rad_s or in deg_s",
    "time_s,x_px,y_px,wx_rad_s,wy_rad_s\n0,1,1,0,0\n1,2,2,0,0\n": "must be places or rates, not both",
}


def test_what_is_no_log():
    for text, words in LOGS.items():
        with pytest.raises(ValueError, match=f"log.csv: .*{words}"):
            from_text(text, "log.csv")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Trajectory((0.0, 0.0), (0.0, 1.0), (0.0, 1.0)), "time_s: 0.0 follows 0.0; must increase"),
        (lambda: Trajectory((0.0, 1.0), (0.0, 1.0), (0.0,)), "must be as many of each, at least 2"),
        (lambda: Trajectory((0.0, 1.0), (0.0, 2e5), (0.0, 0.0)), "x_px: spans 200000 px"),
        (lambda: straight_path((1.0, 0.0), 0.01).seen(0.02), "must hold the exposure, -0.01 to 0.01 s"),
        (lambda: Trajectory.sinusoid(1e3, 1e6, 100.0), "knots; at most"),
        (lambda: Trajectory.of([0.0, 1.0], np.zeros((3, 2))), r"must be \(K,\), \(2, K\)"),
        (lambda: shake(1, 10.0, 0.01, duration_s=0.001), "duration_s"),
        (lambda: from_rates(np.arange(3.0), np.zeros((2, 3)), focal_px=1.0), "time_s, rates_rad_s: shapes are"),
        (lambda: simulate(torch.rand(2, 1, 5, 7), CAMERA, **LIT, trajectory="left"), "must be a blurnoise.Traj"),
        (lambda: simulate(torch.rand(2, 1, 5, 7), CAMERA, **LIT, trajectory=[None]), "got 1 for a batch of 2"),
    ],
)  # fmt: skip
def test_what_is_no_trajectory(make, words):
    with pytest.raises((TypeError, ValueError), match=words):
        make()


@pytest.mark.parametrize("border", ["reflect", "replicate", "circular", "constant"])
@pytest.mark.parametrize("moved", [(9.0, -5.0), (0.0, 3.0), (90.0, 20.0)])
def test_two_knots_are_straight_motion(border, moved):
    """To what a small grid leaves out: 1e-4 RMS of white noise."""
    light = torch.rand(1, 2, 61, 95, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    x, y = moved
    seen = path_blur(light, straight_path((100 * x, 100 * y), 0.01).seen(0.01), border=border)
    straight = convolution.motion_blur(light, moved, method="transfer", border=border)
    assert float((seen - straight).square().mean().sqrt()) < 1e-4
    knots = torch.tensor([[-x / 2, -y / 2], [x / 2, y / 2]], dtype=torch.float64)
    torch.testing.assert_close(path_blur(light, knots, border=border), seen)


@pytest.mark.parametrize("radius_px", [0.0, 3.0])
def test_a_picture_of_one_row_or_column_is_blurred_as_one_of_many_alike(radius_px):
    line = torch.rand(1, 2, 1, 300, generator=torch.Generator().manual_seed(1))
    optics = transfer.Optics(defocus_radius_px=radius_px)
    along = Trajectory((-0.02, 0.0, 0.02), (-100.0, 20.0, 160.0), (0.0, 0.0, 0.0))
    path = along.seen(0.03)
    down = replace(along, x_px=along.y_px, y_px=along.x_px).seen(0.03)
    expected = path_blur(line.expand(-1, -1, 9, -1).contiguous(), path, optics)[..., 4:5, :]
    torch.testing.assert_close(path_blur(line, path, optics), expected, atol=1e-5, rtol=0.0)
    torch.testing.assert_close(
        path_blur(line.mT.contiguous(), down, optics).mT, expected, atol=1e-5, rtol=0.0
    )


def test_too_short_to_be_seen_and_too_large_to_hold():
    light = torch.rand(1, 1, 61, 95)
    assert path_blur(light, straight_path((0.5, 0.0), 0.1).seen(0.01)) is light
    far = Trajectory((-1.0, 1.0), (0.0, 9e4), (0.0, 9e4)).seen(2.0)
    with pytest.raises(ValueError, match=r"path over .* border 'replicate' needs a plane"):
        path_blur(light, far, border="replicate")


def test_gradients_of_picture_and_knots():
    light = torch.rand(1, 1, 13, 17, dtype=torch.float64).requires_grad_()
    knots = torch.tensor([[-1.5, 0.4], [0.3, -1.0], [1.8, 0.9]], dtype=torch.float64, requires_grad=True)
    weights = torch.rand(1, 1, 13, 17, dtype=torch.float64, generator=torch.Generator().manual_seed(2))

    def seen(light, knots):
        return (path_blur(light, knots) * weights).sum()

    assert torch.autograd.gradcheck(seen, (light, knots), fast_mode=True)
    (of_knots,) = torch.autograd.grad(seen(light, knots), knots)
    assert float(of_knots.abs().min()) > 1e-6


def test_plan_names_the_path_and_leaves_out_what_is_short():
    told = {stage.name: stage for stage in budget(CAMERA, trajectory=VIBRATION, **LIT).stages}["motion"]
    assert told.kept
    assert "segments over 6.92x3.99 px" in told.how
    short = Trajectory.sinusoid(0.01, 80.0, 0.05)
    assert "motion" in budget(CAMERA, trajectory=short, **LIT).without
    assert "motion" not in budget(CAMERA, trajectory=short, displacement_px=(5.0, 0.0), **LIT).without


def test_boxes_stay_and_sweep_what_the_path_covers():
    box = torch.tensor([[10.0, 12.0, 20.0, 25.0]])
    taken = Exposure(CAMERA, 0.01, 100.0, trajectory=VIBRATION)
    assert torch.equal(taken.move_boxes(box), box)
    left, top, right, bottom = VIBRATION.seen(0.01).box
    torch.testing.assert_close(taken.sweep_boxes(box), box + torch.tensor([left, top, right, bottom]))
    assert right - left > 6
    still = Exposure(CAMERA, 0.01, 100.0, velocity_px_s=(800.0, 0.0))
    torch.testing.assert_close(still.sweep_boxes(box), box + torch.tensor([-4.0, 0.0, 4.0, 0.0]))
