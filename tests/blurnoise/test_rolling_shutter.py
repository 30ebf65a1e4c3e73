"""Rolling shutter: against rows exposed one by one, closed forms, and one way against the other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from blurs import warped
from brute_force import photograph, rms_dn, rolled
from path_oracle import straight_path, vibration

from blurnoise import Trajectory
from blurnoise._core.borders import extended
from blurnoise.blur import convolution, rows
from blurnoise.blur.displacement import Displacement, Readout, stretch
from blurnoise.blur.layers import moved
from blurnoise.blur.rows import shifted_rows

ROW_S, EXPOSURE_S = 3e-4, 0.01
SIZE = (41, 67)
READOUT = Readout(SIZE[0], ROW_S, EXPOSURE_S)


def picture() -> torch.Tensor:
    return torch.from_numpy(photograph(*SIZE))


def of_rows(light: torch.Tensor, path: Trajectory, readout: Readout, border: Any) -> torch.Tensor:
    """Each row exposed in its own window of a path, as bright as that is long."""
    still, exposure = light.new_zeros(2), light.new_tensor(readout.exposure_s)
    seen = moved(light, Displacement(still, exposure, readout, path), border)
    return seen * torch.from_numpy(readout.light).to(light)[:, None]


def rolled_at_once(
    light: torch.Tensor, moved: torch.Tensor, exposure: torch.Tensor, row_s: float, border: Any
) -> torch.Tensor:
    readout = Readout(light.shape[-2], row_s, float(exposure.detach()))
    return rows.rolled(light, Displacement(moved, exposure, readout), border)


def in_uniform_motion(
    velocity: tuple[float, float], row_s: float = ROW_S, light: torch.Tensor | None = None
) -> torch.Tensor:
    x, y = velocity
    light = picture() if light is None else light
    blurred = convolution.motion_blur(
        light, (x * EXPOSURE_S, y * EXPOSURE_S), method="transfer", border="circular"
    )
    return warped(blurred, velocity, row_s, "circular")


@pytest.mark.parametrize("velocity_x", [600.0, -90.0])
@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_motion_along_rows_at_once(velocity_x: float, kind: torch.dtype) -> None:
    """Blurred and displaced in one transform of rows, or one after the other: as with gradients."""
    light, moved = picture().to(kind), torch.tensor([velocity_x * EXPOSURE_S, 0.0], dtype=kind)
    exposure = torch.tensor(EXPOSURE_S, dtype=kind)
    for border in ("reflect", "circular"):  # black beyond the border, the blur alone would be cut off at it
        seen = rolled_at_once(light, moved, exposure, ROW_S, border)
        asked = moved.clone().requires_grad_()
        follows = rolled_at_once(light, asked, exposure, ROW_S, border)
        assert float((seen - follows.detach()).abs().max()) < 2e-4
        follows.square().mean().backward()
        assert asked.grad is not None
        assert float(asked.grad.abs().max()) > 0
    most = 0.1 if velocity_x > 500 else 0.2  # what Lanczos-6 displaces wrongly, less than a px does not blur
    brute = rolled(picture().numpy(), lambda s: (velocity_x * s, 0 * s), *READOUT.windows_s)
    assert rms_dn(rolled_at_once(light, moved, exposure, ROW_S, "circular").double().numpy(), brute) < most


@pytest.mark.parametrize("velocity", [(600, 0), (0, 300), (500, -400), (300, 500)])
@pytest.mark.parametrize("scan", [1, -1])
def test_uniform_motion_by_brute_force(velocity: tuple[float, float], scan: int) -> None:
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
def test_the_whole_picture_up_to_its_border(velocity: tuple[float, float], border: Any) -> None:
    """As of a scene that is continued far beyond what comes in: one continued once blurred errs by 9 DN.

    Down the rows by brute force: what is blurred first and then resampled is farther from that than what is not.
    """
    size, row_s, far = (120, 160 if velocity[0] else 8), 96e-6, 64
    light = torch.from_numpy(photograph(*size))
    moved, exposure = torch.tensor(velocity, dtype=torch.float64) * EXPOSURE_S, torch.tensor(EXPOSURE_S)
    scene = extended(light, (far, far), (size[0] + 2 * far, size[1] + 2 * far), border)
    blurred = convolution.motion_blur(scene, moved.tolist(), method="transfer", border="replicate")
    truth = warped(blurred, velocity, row_s, "replicate")[..., far:-far, far:-far].numpy()
    if not velocity[0]:
        windows = Readout(size[0] + 2 * far, row_s, EXPOSURE_S).windows_s
        truth = rolled(scene[..., far:-far].numpy(), lambda s: (0 * s, velocity[1] * s), *windows, moments=64)
        truth = truth[..., far:-far, :]
    seen = rolled_at_once(light, moved, exposure, row_s, border).numpy()
    assert 255 * np.abs(seen - truth).max() < 0.1
    after = warped(
        convolution.motion_blur(light, moved.tolist(), method="transfer", border=border),
        velocity,
        row_s,
        border,
    )
    if all(velocity) and border != "circular":
        assert rms_dn(after.numpy(), truth) > 1.0


@pytest.mark.parametrize("velocity", [(900.0, -500.0), (0.0, 500.0)])
@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_at_once_is_one_after_the_other(velocity: tuple[float, float], kind: torch.dtype) -> None:
    """Between two transforms of rows, or by taps, as with gradients; these reach the motion and the exposure."""
    light = torch.from_numpy(photograph(45, 67, channels=2)).to(kind)
    moved, exposure = torch.tensor(velocity, dtype=kind) * EXPOSURE_S, torch.tensor(EXPOSURE_S, dtype=kind)
    asked = moved.clone().requires_grad_(), exposure.clone().requires_grad_()
    for border in ("reflect", "replicate", "circular"):
        seen = rolled_at_once(light, moved, exposure, ROW_S, border)
        follows = rolled_at_once(light, *asked, ROW_S, border)
        assert 255 * float((seen - follows.detach()).abs().max()) < (0.25 if velocity[0] == 0 else 0.02)
        follows.square().mean().backward()
    for each in asked:
        assert each.grad is not None
        assert float(each.grad.abs().max()) > 0
    with pytest.raises(ValueError, match="at most 268435456 are allowed"):
        rolled_at_once(light, torch.tensor([4e4, 4e4], dtype=kind), exposure, 1e-9, "reflect")


def test_shear_before_blur_is_wrong() -> None:
    """Warped first, the blur must be longer by the stretch."""
    velocity = (300.0, 500.0)
    brute = rolled(picture().numpy(), lambda s: (300 * s, 500 * s), *READOUT.windows_s)
    sheared = warped(picture(), velocity, ROW_S, "circular")
    blurred = [
        convolution.motion_blur(sheared, (3.0 * by, 5.0 * by), method="transfer", border="circular").numpy()[
            ..., 8:-8, :
        ]
        for by in (1.0, stretch(500.0, ROW_S))
    ]  # the border is continued before the warp or after it
    short, right = (rms_dn(each, brute[..., 8:-8, :]) for each in blurred)
    assert right < 0.5 * short


@pytest.mark.parametrize("direction_deg", [0.0, 90.0, 30.0])
@pytest.mark.parametrize("reset", [False, True])
def test_vibration_by_brute_force(direction_deg: float, reset: bool) -> None:
    """Along rows and across them to 0.1 DN, both, by sub-exposures a pixel apart, to 0.3; one window for all: 2."""
    readout = Readout(SIZE[0], ROW_S, EXPOSURE_S, reset)
    path = Trajectory.sinusoid(3.0, 80.0, 0.1, direction_deg=direction_deg, phase_rad=0.3)
    origin = path.origin_px(EXPOSURE_S)

    def places(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (
            np.interp(times, path.time_s, path.x_px) - origin[0],
            np.interp(times, path.time_s, path.y_px) - origin[1],
        )

    brute = rolled(picture().numpy(), places, *readout.windows_s)
    seen = of_rows(picture(), path, readout, "circular").numpy() / readout.light[:, None]
    assert rms_dn(seen, brute) < (0.3 if direction_deg == 30.0 else 0.1)
    together = Readout(SIZE[0], 0.0, EXPOSURE_S)
    assert rms_dn(of_rows(picture(), path, together, "circular").numpy(), brute) > 2.0


@pytest.mark.parametrize(
    ("path", "exposure_s", "reset"),
    [
        (Trajectory.sinusoid(1.0, 80.0, 0.1, direction_deg=30.0, phase_rad=0.7), 0.01, False),
        (straight_path((900.0, -600.0), 0.1), 0.001, True),
        (straight_path((300.0, -200.0), 0.1), 0.01, True),
    ],
)
def test_rows_that_see_little_of_a_path(path: Trajectory, exposure_s: float, reset: bool) -> None:
    """By sub-exposures, whose linear interpolation costs 0.14 DN uncompensated, and 0.1 where as of other taps."""
    readout = Readout(81, ROW_S / 3, exposure_s, reset)
    light, origin = photograph(81, 113), path.origin_px(exposure_s)

    def places(times: np.ndarray) -> tuple[np.ndarray, ...]:
        knots = zip((path.x_px, path.y_px), origin, strict=True)
        return tuple(np.interp(times, path.time_s, along) - middle for along, middle in knots)

    brute = rolled(light, places, *readout.windows_s, moments=96)  # type: ignore[arg-type]
    seen = of_rows(torch.from_numpy(light), path, readout, "circular").numpy() / readout.light[:, None]
    assert rms_dn(seen, brute) < 0.06


@pytest.mark.parametrize(
    ("amplitude_px", "frequency_hz", "exposure_s"),
    [(3.0, 2400.0, 0.01), (0.5, 1600.0, 0.01), (1.0, 480.0, 1 / 30)],
)
def test_fast_vibration_down_the_rows(amplitude_px: float, frequency_hz: float, exposure_s: float) -> None:
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


@pytest.mark.parametrize("reset", [False, True])
@pytest.mark.parametrize("exposure_s", [0.0, 1e-12, 1e-6])
def test_short_exposures_along_and_across_rows(exposure_s: float, reset: bool) -> None:
    """Rows in an instant, each where the path is then: nothing divides by its length, nor are cells as short as it.

    Nothing is blurred, so that Lanczos's taps and the phase along rows differ most: by 0.22 DN, as the warp does.
    """
    readout = Readout(SIZE[0], ROW_S, exposure_s)
    path = Trajectory((-1.0, 1.0), (-600.0, 600.0), (-300.0, 300.0))
    brute = rolled(picture().numpy(), lambda s: (600 * s, 300 * s), *readout.windows_s, moments=1)
    seen = of_rows(picture(), path, readout, "circular").numpy()
    assert rms_dn(seen, brute) < 0.25
    assert rms_dn(seen, picture().numpy()) > 2.0
    whole = of_rows(picture(), path, Readout(SIZE[0], ROW_S, exposure_s, reset), "circular")
    assert bool(whole.isfinite().all())


def test_wobble() -> None:
    """Centroids of rows go as a sinc(nu T), over 1 / (nu t_row) rows."""
    readout = Readout(500, 5e-5, 0.004)
    path = Trajectory.sinusoid(3.0, 80.0, 0.1)
    x = torch.arange(48, dtype=torch.float64)
    line = torch.exp(-((x - 24) ** 2) / 18).expand(1, 1, 500, 48)
    seen = of_rows(line, path, readout, "constant")[0, 0]
    centroids = ((seen * x).sum(1) / seen.sum(1) - 24).numpy()
    assert centroids.max() == pytest.approx(3.0 * np.sinc(0.32), rel=2e-3)
    assert centroids[250] - centroids[0] == pytest.approx(centroids[499] - centroids[249], abs=0.02)
    np.testing.assert_allclose(centroids[:250], centroids[250:], atol=0.02)  # 1 / (80 Hz 5e-5 s) = 250 rows


def test_plane_wave() -> None:
    """f=(.07,-.05), v=(900,-500) px/s, T=10 ms, AR0233's 24.098 us: amplitude sinc(f.vT), f_y less f.v t_row."""
    row_s, velocity, f = 24.098e-6, (900.0, -500.0), (0.07, -0.05)
    x, y = np.meshgrid(np.arange(300.0), np.arange(420.0))
    light = torch.from_numpy(np.cos(2 * np.pi * (f[0] * x + f[1] * y)))[None, None]
    blurred = convolution.motion_blur(light, (9.0, -5.0), method="transfer")
    seen = warped(blurred, velocity, row_s, "reflect").numpy()[0, 0]
    amplitude, seen_y = np.sinc(0.07 * 9 + 0.05 * 5), f[1] - (f[0] * 900 + f[1] * -500) * row_s
    assert amplitude == pytest.approx(0.133156, abs=1e-6)
    assert seen_y == pytest.approx(-0.0521206, abs=1e-7)
    middle = (420 - 1) / 2
    expected = amplitude * np.cos(2 * np.pi * (f[0] * x + f[1] * middle + seen_y * (y - middle)))
    inside = np.s_[80:-80, 80:-80]  # the wave ends at the border
    np.testing.assert_allclose(seen[inside], expected[inside], atol=2e-3)
    assert np.abs(seen[inside] - amplitude * light.numpy()[0, 0][inside]).max() > 0.1


def test_streaks_stretch_and_skew() -> None:
    assert 9 * stretch(-500.0, 24.098e-6) == pytest.approx(8.89285, abs=1e-5)
    assert -5 * stretch(-500.0, 24.098e-6) == pytest.approx(-4.94047, abs=1e-5)
    shear = 1000 * 24.10e-6
    assert shear == pytest.approx(0.0241, abs=1e-6)
    assert math.degrees(math.atan(shear)) == pytest.approx(1.38, abs=0.005)
    assert 1000 * Readout(1280, 24.10e-6, 0.0).span_s[1] == pytest.approx(15.4, abs=0.05)


def test_global_reset() -> None:
    """The last of 1280 rows is 4.08 times as bright as the first; a flash within all windows freezes all rows."""
    readout = Readout(1280, 24.098e-6, 0.01, reset=True)
    assert readout.light[-1] / readout.light[0] == pytest.approx(4.08, abs=0.005)
    starts, stops = readout.windows_s
    assert starts.min() == starts.max()
    assert stops.min() - starts.max() == pytest.approx(0.01)
    assert (starts + stops)[639:641].mean() == pytest.approx(0.0, abs=1e-12)
    rolling = Readout(100, 24.098e-6, 0.01)
    starts, stops = rolling.windows_s
    assert stops.min() - starts.max() == pytest.approx(0.01 - 99 * 24.098e-6)
    assert (rolling.light == 1).all()
    still = straight_path((0.0, 0.0), 1.0)
    seen = of_rows(torch.ones(1, 1, 1280, 2), still, readout, "reflect")
    np.testing.assert_allclose(seen[0, 0, :, 0].numpy(), readout.light, rtol=1e-6)


def test_limits() -> None:
    light = picture()
    assert warped(light, (0.0, 0.0), ROW_S, "reflect") is light
    assert warped(light, (500.0, 300.0), 0.0, "reflect") is light
    flipped = warped(light.flip(-2), (500.0, -300.0), ROW_S, "circular").flip(-2)
    torch.testing.assert_close(warped(light, (500.0, 300.0), -ROW_S, "circular"), flipped, rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match=r"velocity_px_s = 4000 down: must be below 3333\.33"):
        warped(light, (0.0, 4000.0), ROW_S, "reflect")
    constant = torch.full((1, 1, 41, 67), 0.37, dtype=torch.float64)
    torch.testing.assert_close(warped(constant, (500.0, 300.0), ROW_S, "reflect"), constant)


def test_columns_shift_most_at_the_ends_and_not_in_the_middle() -> None:
    """A ramp moves by its slope times v_x tau."""
    ramp = torch.arange(400.0, dtype=torch.float64).expand(1, 1, 41, 400) / 400
    moved = (ramp - warped(ramp, (500.0, 0.0), ROW_S, "replicate"))[0, 0, :, 200] * 400
    np.testing.assert_allclose(moved.numpy(), 500 * ROW_S * (np.arange(41) - 20), atol=5e-3)


@pytest.mark.parametrize("velocity", [(500.0, 0.0), (0.0, 300.0), (300.0, -200.0)])
def test_routes_agree(velocity: tuple[float, float]) -> None:
    """OpenCV's and torch's, in either precision; gradients reach the picture and the velocity."""
    light = picture()
    fast = warped(light, velocity, ROW_S, "reflect")
    plain = warped(light.clone().requires_grad_(), velocity, ROW_S, "reflect").detach()
    torch.testing.assert_close(fast, plain, rtol=0, atol=1e-12)
    torch.testing.assert_close(
        warped(light.float(), velocity, ROW_S, "reflect").double(), fast, rtol=0, atol=2e-6
    )
    path = Trajectory.sinusoid(
        3.0, 80.0, 0.1, direction_deg=math.degrees(math.atan2(-velocity[1], velocity[0]))
    )
    rows = of_rows(light, path, READOUT, "reflect")
    slow = of_rows(light.clone().requires_grad_(), path, READOUT, "reflect").detach()
    torch.testing.assert_close(rows, slow, rtol=0, atol=1e-12)


def test_gradients() -> None:
    light = torch.from_numpy(photograph(9, 11)).requires_grad_()
    velocity = torch.tensor([500.0, 300.0], dtype=torch.float64, requires_grad=True)
    weights = torch.rand(1, 1, 9, 11, dtype=torch.float64, generator=torch.Generator().manual_seed(2))

    def seen(light: torch.Tensor, velocity: torch.Tensor) -> torch.Tensor:
        return (warped(light, velocity, ROW_S, "reflect") * weights).sum()

    (of_velocity,) = torch.autograd.grad(seen(light, velocity), velocity)
    for axis in range(2):
        step = torch.zeros(2, dtype=torch.float64)
        step[axis] = 0.01
        numeric = (seen(light, velocity + step) - seen(light, velocity - step)) / 0.02
        assert float(of_velocity[axis]) == pytest.approx(float(numeric.detach()), rel=1e-4)
    assert torch.autograd.gradcheck(lambda light: seen(light, velocity.detach()), (light,), fast_mode=True)


@pytest.mark.parametrize("direction_deg", [0.0, 90.0])
def test_gradient_of_light_along_a_path(direction_deg: float) -> None:
    """The way is linear in the light: its gradient times the light is the frame's sum of weights."""
    light, path = picture(), Trajectory.sinusoid(2.0, 80.0, 0.1, direction_deg=direction_deg)
    weights = torch.rand(light.shape, dtype=light.dtype, generator=torch.Generator().manual_seed(2))
    expected = of_rows(light, path, READOUT, "reflect")
    seen = of_rows(light.requires_grad_(), path, READOUT, "reflect")
    torch.testing.assert_close(seen, expected, rtol=0, atol=1e-9)
    (gradient,) = torch.autograd.grad((seen * weights).sum(), light)
    total = float((expected * weights).sum())
    assert float((gradient * light).detach().sum()) == pytest.approx(total, rel=1e-9)


def test_uneven_displacements_have_phases_of_their_own() -> None:
    light = picture()
    shifts = torch.linspace(-3.0, 4.0, 41, dtype=torch.float64) ** 2
    fast = shifted_rows(light, shifts, "reflect")
    plain = shifted_rows(light.clone().requires_grad_(), shifts, "reflect").detach()
    torch.testing.assert_close(fast, plain, rtol=0, atol=1e-12)
    far = shifted_rows(light, torch.full((41,), 2.0, dtype=torch.float64), "circular")
    torch.testing.assert_close(far, light.roll(2, -1), rtol=0, atol=1e-9)


def test_far_shifts_in_single_precision() -> None:
    """Phases of 1e4 px are products in double precision: in single they would be off by 1e-3 of a turn and more."""
    light = picture()
    shifts = torch.linspace(-1e4, 1e4, SIZE[0], dtype=torch.float64)
    far = shifted_rows(light, shifts, "circular")
    torch.testing.assert_close(
        shifted_rows(light.float(), shifts, "circular").double(), far, rtol=0, atol=1e-5
    )
    whole = shifted_rows(light, torch.full((SIZE[0],), 67.0 * 149, dtype=torch.float64), "circular")
    torch.testing.assert_close(whole, light, rtol=0, atol=1e-8)
