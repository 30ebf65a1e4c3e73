"""Trajectories: closed forms, windows, and transfer functions of paths."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from brute_force import accelerated_path
from path_oracle import accelerated, polyline_grid, straight_path, vibration

from blurnoise import Trajectory
from blurnoise.blur import fourier, path_otf
from blurnoise.motion.trajectory import shake, simplified
from blurnoise.optics import transfer

FX, FY = np.fft.rfftfreq(16), np.fft.fftfreq(14)
EXACT = 5e-8  # the points of a path err by 4e-8 at most, the window by 5e-10


def of(trajectory: Trajectory, exposure_s: float, f: tuple[float, float] = (0.1, 0.0)) -> complex:
    """The transfer function at one frequency, a multiple of 0.05, of the path as it was."""
    knots, durations = trajectory.window(-exposure_s / 2, exposure_s / 2)
    return complex(on_grid((20, 20), np.array(f[:1]), np.array(f[1:]), knots, durations)[0, 0])


def grid(knots: np.ndarray, durations: np.ndarray) -> np.ndarray:
    return on_grid((14, 16), FX, FY, knots, durations)


def on_grid(
    sides: tuple[int, int], fx: np.ndarray, fy: np.ndarray, knots: np.ndarray, durations: np.ndarray
) -> np.ndarray:
    knots, shares = torch.from_numpy(knots.copy()), torch.from_numpy(durations / durations.sum())
    return path_otf.transfer_on(sides, knots, shares)(torch.from_numpy(fx), torch.from_numpy(fy)).numpy()


def random_path(count: int = 12) -> tuple[np.ndarray, np.ndarray]:
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
def test_vibration(exposure_s: float, phase: float, expected: complex) -> None:
    """By the series, and by a polyline within 1e-3 px, hence within 2 pi f 1e-3 = 6e-4."""
    assert complex(vibration(0.3, 80.0, exposure_s, phase_rad=phase)) == pytest.approx(expected, abs=1e-6)
    path = Trajectory.sinusoid(3.0, 80.0, 0.02, phase_rad=phase)
    assert of(path, exposure_s) == pytest.approx(expected, abs=6e-4)


@pytest.mark.parametrize(
    ("along", "value"), [(0.242098, 0.5), (0.324920, 0.2), (0.353114, 0.1), (0.382740, 0.0)]
)
def test_vibration_of_whole_periods(along: float, value: float) -> None:
    assert complex(vibration(along, 80.0, 0.025)) == pytest.approx(value, abs=4e-6)


def test_vibration_of_a_moment_is_a_line_of_any_length() -> None:
    """2 pi nu a T |cos(phase)| where nu T is small: the curvature left out moves places by a (pi nu T)^2 / 2."""
    for phase in (0.0, 0.9, 1.4):
        length = 2 * math.pi * 5.0 * 30.0 * 0.002 * abs(math.cos(phase))
        got = abs(complex(vibration(0.2 * 30.0, 5.0, 0.002, phase_rad=phase)))
        assert got == pytest.approx(float(np.sinc(0.2 * length)), abs=2e-3)


@pytest.mark.parametrize(
    ("f", "v", "g", "expected"),
    [(0.1, 6.0, 4.0, 0.504581 - 0.014697j), (0.25, 6.0, 12.0, 0.035304 + 0.327814j)],
)
def test_acceleration(f: float, v: float, g: float, expected: complex) -> None:
    assert complex(accelerated(f * v, f * g, 1.0)) == pytest.approx(expected, abs=1e-6)
    path = accelerated_path((v, 0.0), (g, 0.0), 1.0)
    assert of(path, 1.0, (f, 0.0)) == pytest.approx(expected, abs=2 * math.pi * f * 1e-3)


def test_from_rest_has_no_zeros() -> None:
    """Over 10 px, where uniform motion has its first zero at 0.1 cycles/px and MTF50 at 0.06034.

    MTF50 at 0.060546 by the mean of 200 000 moments.
    """
    f = np.linspace(0.001, 0.25, 2000)
    response = np.abs(accelerated(f * 10.0, f * 20.0, 1.0))
    assert float(np.interp(-0.5, -response[f < 0.1], f[f < 0.1])) == pytest.approx(0.060546, abs=2e-6)
    assert response.min() > 0.215
    uniform = accelerated(f * 10.0, 0 * f, 1.0)
    np.testing.assert_allclose(uniform, np.sinc(10 * f), atol=1e-12)


def test_two_knots_are_straight_motion() -> None:
    knots = np.array([[-4.45, 4.45], [2.5, -2.5]])
    fx, fy = torch.from_numpy(FX), torch.from_numpy(FY)
    exact = transfer.motion(fx, fy[:, None], torch.tensor([8.9, -5.0], dtype=torch.float64)).numpy()
    np.testing.assert_allclose(grid(knots, np.ones(1)), exact, atol=EXACT)


@pytest.mark.parametrize(("reach_px", "count"), [(2.0, 5), (20.0, 200), (300.0, 40)])
@pytest.mark.parametrize("sides", [(64, 96), (90, 128)])
def test_paths_are_sums_over_segments(sides: tuple[int, int], reach_px: float, count: int) -> None:
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


def test_paths_too_long_to_sum() -> None:
    knots = torch.tensor([[0.0, 3e6], [0.0, 0.0]], dtype=torch.float64)
    with pytest.raises(
        ValueError, match=r"trajectory: what an exposure sees of it is 3e\+06 px long in 1 segments"
    ):
        path_otf.transfer_on((64, 64), knots, torch.ones(1, dtype=torch.float64))


def test_polyline_is_the_mean_over_time() -> None:
    """Against 20 000 moments, whose midpoint rule errs by (2 pi f step)^2 / 24, below 1e-5 here."""
    knots, durations = random_path()
    time = np.concatenate([[0.0], np.cumsum(durations)])
    at = (np.arange(20_000) + 0.5) / 20_000 * time[-1]
    x, y = (np.interp(at, time, along) for along in knots)
    for i, j in ((1, 1), (8, 5), (3, 12)):
        brute = np.exp(-2j * np.pi * (FX[i] * x + FY[j] * y)).mean()
        assert abs(grid(knots, durations)[j, i] - brute) < 1e-5


@pytest.mark.parametrize("off_px", [0.02, 0.2, 1.0])
def test_a_path_that_is_near_errs_by_what_is_known(off_px: float) -> None:
    """At most 2 pi |f| s, whatever the places within s px; a tenth of it RMS, where they are off at random."""
    drawn = np.random.default_rng(4)
    f = np.linspace(0.01, 0.5, 50)
    knots, shares = drawn.uniform(-10, 10, (2, 65)), np.full(64, 1 / 64)
    away = drawn.normal(size=(2, 65))
    near = knots + off_px * away / np.hypot(*away)
    error = np.abs(
        polyline_grid(f, np.zeros(1), near, shares) - polyline_grid(f, np.zeros(1), knots, shares)
    )[0]
    assert (error <= 2 * np.pi * f * off_px).all()
    assert float(np.sqrt((error / (2 * np.pi * f * off_px)) ** 2).mean()) < 0.2
    assert float(error.max()) > 1e-3 * off_px


def test_equal_weights_per_knot_are_wrong() -> None:
    """Time counts, not knots: the same places at another pace are another blur."""
    knots, durations = random_path()
    assert np.abs(grid(knots, durations) - grid(knots, np.ones_like(durations))).max() > 0.05


def test_reversed_in_time_about_the_origin() -> None:
    """The reverse of a path has its transfer function; the path turned by 180 degrees the conjugate."""
    knots, durations = random_path()
    np.testing.assert_allclose(grid(knots[:, ::-1], durations[::-1]), grid(knots, durations), atol=EXACT)
    np.testing.assert_allclose(grid(-knots, durations), grid(knots, durations).conj(), atol=EXACT)


def test_knots_on_a_segment_change_nothing() -> None:
    knots, durations = random_path()
    time = np.concatenate([[0.0], np.cumsum(durations)])
    fine = np.sort(np.concatenate([time, np.linspace(0.01, time[-1] - 0.01, 37)]))
    more = np.stack([np.interp(fine, time, along) for along in knots])
    np.testing.assert_allclose(grid(more, np.diff(fine)), grid(knots, durations), atol=EXACT)
    assert len(simplified(fine, more, 1e-9)) == len(time)


def test_simplified_is_within_its_tolerance_at_every_time() -> None:
    path = Trajectory.sinusoid(6.0, 80.0, 0.02, direction_deg=30.0)
    time, knots = np.array(path.time_s), np.array([path.x_px, path.y_px])
    kept = simplified(time, knots, 0.05)
    again = np.stack([np.interp(time, time[kept], along[kept]) for along in knots])
    off = np.hypot(*(again - knots)).max()
    assert 0.005 < off <= 0.05
    assert len(kept) < len(time) / 4
    slowed = np.array([[0.0, 1.0, 10.0], [0.0, 0.0, 0.0]])  # one line of which the pace changes
    assert simplified(np.array([0.0, 1.0, 2.0]), slowed, 0.05) == [0, 1, 2]


@pytest.mark.parametrize("seed", range(4))
def test_few_segments_serve(seed: int) -> None:
    """Shakes of 20 px, 255 segments: to 0.05 px a quarter of them at most, half the RMS of the change below 3e-3."""
    path = shake(seed, 20.0, 0.01)
    some = np.linspace(0, 2000, 256).astype(int)
    time, knots = np.array(path.time_s)[some], np.array([path.x_px, path.y_px])[:, some]
    kept, fy, fx = simplified(time, knots, 0.05), *fourier.frequencies((64, 64))
    whole, few = (
        polyline_grid(fx, fy, knots[:, at], np.diff(time[at]) / np.ptp(time)) for at in (np.arange(256), kept)
    )
    assert len(kept) - 1 <= 63
    assert 1e-3 < np.sqrt((np.abs(few - whole) ** 2).mean()) / 2 < 3e-3


def test_many_periods_are_simplified_a_part_at_a_time() -> None:
    """Every period ends where it began: cut off one by one, their work would go with the square of their number."""
    path = Trajectory.sinusoid(100.0, 2e4, 0.01)
    time, knots = np.array(path.time_s), np.array([path.x_px, path.y_px])
    kept = simplified(time, knots, 0.02)
    again = np.stack([np.interp(time, time[kept], along[kept]) for along in knots])
    assert np.hypot(*(again - knots)).max() <= 0.02
    assert len(kept) < len(time) / 3
    walk = np.cumsum(np.random.default_rng(1).normal(size=(2, 9000)), 1)
    even = np.arange(9000.0)
    again = np.stack(
        [np.interp(even, even[at], along[at]) for at in [simplified(even, walk, 2.0)] for along in walk]
    )
    assert 1.0 < np.hypot(*(again - walk)).max() <= 2.0


def test_independent_places_become_gaussian() -> None:
    """Steps of a jitter, each a knot held: 20 000 places, sampling error 1/sqrt(20 000) = 0.007."""
    sigma = 1.5
    places = np.random.default_rng(7).normal(scale=sigma, size=(2, 20_000)).repeat(2, axis=1)
    durations = np.where(np.arange(places.shape[1] - 1) % 2 == 0, 1.0, 1e-9)
    got = grid(places, durations)
    f = np.hypot(*np.meshgrid(FX, FY))
    np.testing.assert_allclose(np.abs(got), np.exp(-2 * (np.pi * sigma * f) ** 2), atol=5 * 0.007)


@pytest.mark.parametrize("exposure_s", [0.02, 0.011, 0.004])
def test_centroid_stays(exposure_s: float) -> None:
    """Without a first moment the phase of H starts level: Im H falls as f^3."""
    seen = accelerated_path((700.0, 200.0), (5e4, -3e4), 0.02).seen(exposure_s)
    middles = (seen.knots[:, 1:] + seen.knots[:, :-1]) / 2
    assert np.abs(middles @ seen.shares).max() < 1e-12
    small = polyline_grid(np.array([1e-4]), np.array([1e-4]), seen.knots, np.array(seen.shares))
    assert abs(small.imag[0, 0]) < 1e-7


def test_a_shorter_exposure_sees_a_part_of_a_longer_one() -> None:
    path = Trajectory.sinusoid(6.0, 80.0, 0.02, direction_deg=30.0, phase_rad=0.4)
    long, long_s = path.window(-0.01, 0.01)
    short, short_s = path.window(-0.003, 0.003)
    time = np.concatenate([[0.0], np.cumsum(long_s)]) - 0.01
    at = np.concatenate([[0.0], np.cumsum(short_s)]) - 0.003
    np.testing.assert_allclose(short, np.stack([np.interp(at, time, along) for along in long]), atol=1e-12)


def test_velocity_adds() -> None:
    """To a path the uniform motion that runs beside it; a straight one is what a straight trajectory is."""
    still = Trajectory((-0.1, 0.1), (0.0, 0.0), (0.0, 0.0))
    seen = still.seen(0.01, (900.0, -500.0))
    np.testing.assert_allclose(seen.knots, [[-4.5, 4.5], [2.5, -2.5]], atol=1e-12)
    assert seen.knots == pytest.approx(straight_path((900.0, -500.0), 0.1).seen(0.01).knots)


def test_error_bounds_what_it_changes() -> None:
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


def test_no_time_sees_one_place() -> None:
    seen = straight_path((900.0, 0.0), 0.1).seen(0.0)
    assert (seen.x_px, seen.shares, seen.error) == ((0.0,), (), 0.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Trajectory((0.0, 0.0), (0.0, 1.0), (0.0, 1.0)), "time_s: 0.0 follows 0.0; must increase"),
        (lambda: Trajectory((0.0, 1.0), (0.0, 1.0), (0.0,)), "must be as many of each, at least 2"),
        (lambda: Trajectory((0.0, 1.0), (0.0, math.nan), (0.0, 0.0)), "x_px = nan: must be finite"),
        (lambda: Trajectory((0.0, 1.0), (0.0, 2e5), (0.0, 0.0)), "x_px: spans 200000 px"),
        (lambda: straight_path((1.0, 0.0), 0.01).seen(0.02), "must hold the exposure, -0.01 to 0.01 s"),
        (lambda: Trajectory.sinusoid(1e3, 1e6, 100.0), "knots; at most"),
        (lambda: Trajectory.sinusoid(1.0, 1.0, 1.0, phase_rad=math.inf), "phase_rad = inf: must be finite"),
        (lambda: Trajectory((0.0, 1.0), (0.0, 10**400), (0.0, 0.0)), "x_px = .*: must be finite"),
        (lambda: Trajectory.of([0.0, 1.0], np.zeros((3, 2))), r"must be \(K,\), \(2, K\)"),
        (lambda: straight_path((1.0, 0.0), 1.0).seen(math.nan), "exposure_s = nan"),
    ],
)
def test_what_is_no_trajectory(make: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()  # type: ignore[operator]


def test_a_path_holds_an_exposure_that_is_rounded_to_single_precision() -> None:
    """0.1 s is longer in single precision; a thousandth more is not held."""
    path = straight_path((100.0, 0.0), 0.1)
    rounded = float(np.float32(0.1))
    assert rounded > 0.1
    assert path.seen(rounded).box[2] == pytest.approx(5.0, rel=1e-6)
    with pytest.raises(ValueError, match="must hold the exposure"):
        path.seen(0.1001)
