"""Capacity, quanta and the ideal observer: published anchors, closed forms, limits; of edges: bias and intervals."""

import math

import numpy as np
import pytest
import torch
from closed_edges import closed_edge, closed_mtf
from scipy.ndimage import gaussian_filter

from blurnoise.camera import transfer
from blurnoise.metrics import SlantedEdge, information, slanted_edge
from blurnoise.metrics.information import (
    _at,
    _separable,
    ideal_observer_snr,
    neq,
    shannon_capacity_radial,
    shannon_capacity_square,
    square_integral,
)

DOUBLE = torch.float64
SNR_300 = {"signal_pp": 60.0, "noise_variance": 1.0}  # 60² / 12


def band(count, stop=0.5):
    return torch.linspace(0, stop, count, dtype=DOUBLE)


def test_perfect_camera_is_the_area_times_the_logarithm():
    radial = shannon_capacity_radial(band(7), power=torch.ones(7), **SNR_300)
    square = shannon_capacity_square(band(7), band(7), power=torch.ones(7, 7), **SNR_300)
    assert float(radial) == pytest.approx(math.pi / 4 * math.log2(301), rel=1e-13)
    assert float(square) == pytest.approx(math.log2(301), rel=1e-13)


@pytest.mark.parametrize(
    ("length_px", "radial", "square"),
    [(0, 5.974, 7.403), (3, 2.599, 4.317), (6, 1.489, 2.877), (10, 0.889, 2.007), (30, 0.222, 0.812)],
)
def test_motion_before_the_pixel(length_px, radial, square):
    f = band(201)
    across = (transfer.sinc(f) * transfer.sinc(length_px * f)) ** 2
    along = transfer.sinc(f) ** 2
    assert float(shannon_capacity_radial(f, power=across, **SNR_300)) == pytest.approx(radial, abs=2e-3)
    both = along[:, None] * across
    assert float(shannon_capacity_square(f, f, power=both, **SNR_300)) == pytest.approx(square, abs=2e-3)


def test_coloured_noise_is_weighed_per_frequency_and_grids_are_cut_at_one_half():
    f, beyond = band(801), torch.arange(0, 0.73, 0.0049, dtype=DOUBLE)
    got = shannon_capacity_radial(f, power=(1 + f) / 100, signal_pp=60.0, noise_variance=1 + f)
    assert float(got) == pytest.approx(math.pi / 4 * 2, rel=1e-12)  # S/N = 3 everywhere
    power = [transfer.gaussian(each, 0.5) ** 2 for each in (f, beyond)]
    inside, again = (
        shannon_capacity_radial(each, power=own, **SNR_300)
        for each, own in zip((f, beyond), power, strict=True)
    )
    assert float(again) == pytest.approx(float(inside), rel=1e-4)
    fx, fy = torch.arange(0, 0.73, 0.049, dtype=DOUBLE), torch.arange(0, 0.7, 0.037, dtype=DOUBLE)
    density = 3 + 4 * fx + 8 * fy[:, None]  # the mean of |f| is 1/4
    assert float(square_integral(fx, fy, density)) == pytest.approx(6, rel=1e-13)


def test_noise_around_no_power_makes_up_for_itself():
    """S/N = 0 +- 0.03: cut at 0 it would give 0.6 x 0.03 bits per area; what stays is -0.03^2 / 2 / ln 2.

    4000 x 51 samples, the middle ones counting most: the mean of 0.03 / ln 2 is known to 1e-4.
    """
    noise = torch.randn(4000, 51, generator=torch.Generator().manual_seed(5), dtype=DOUBLE) * 1e-4
    got = shannon_capacity_radial(band(51), power=noise, **SNR_300).mean() / (math.pi / 4)
    assert float(got) == pytest.approx(-(0.03**2) / 2 / math.log(2), abs=5e-4)


def test_leading_axes_are_apart_and_differentiable():
    f = band(31)
    power = torch.stack([transfer.gaussian(f, s) ** 2 for s in (0.5, 1.0, 2.0)]).requires_grad_()
    signal = torch.tensor([[30.0], [60.0], [90.0]])
    together = shannon_capacity_radial(f, power=power, signal_pp=signal, noise_variance=2.0)
    for i in range(3):
        alone = shannon_capacity_radial(f, power=power[i], signal_pp=float(signal[i]), noise_variance=2.0)
        assert float(together[i].detach()) == float(alone.detach())
    together.sum().backward()
    assert bool((power.grad[:, 1:] > 0).all())
    assert torch.autograd.gradcheck(
        lambda p: shannon_capacity_radial(f, power=p, **SNR_300), (power[0].detach().requires_grad_(),)
    )


def test_no_noise_is_infinite_and_nan_stays_in_its_curve():
    f, power = torch.arange(0, 0.6, 0.05, dtype=DOUBLE), torch.ones(2, 12)
    assert float(shannon_capacity_radial(f, power=power[0], signal_pp=1.0, noise_variance=0.0)) == math.inf
    assert float(shannon_capacity_radial(f, power=0 * power[0], signal_pp=1.0, noise_variance=0.0)) == 0
    assert float(neq(torch.tensor(1.0), mean_signal=2.0, noise_power_spectrum=0.0)) == math.inf
    power[1, 3] = math.nan
    got = shannon_capacity_radial(f, power=power, **SNR_300)
    assert math.isfinite(float(got[0]))
    assert math.isnan(float(got[1]))


def test_neq_is_the_photons_that_an_ideal_sensor_would_need():
    electrons, read_e, gain = 1000.0, 3.0, 0.25
    nps = gain**2 * (electrons + read_e**2) + 1 / 12
    f = band(65)
    flat = torch.ones(65, 65)
    curve = neq(flat, mean_signal=gain * electrons, noise_power_spectrum=nps)
    assert round(nps, 2) == 63.15
    assert round(float(curve[0, 0]), 1) == 989.8
    assert float(square_integral(f, f, curve)) == pytest.approx(float(curve[0, 0]), rel=1e-13)
    ideal = neq(torch.ones(1), mean_signal=gain * electrons, noise_power_spectrum=gain**2 * electrons)
    assert float(ideal) == pytest.approx(electrons, rel=1e-13)  # not 1/K, as eq. 8 as printed gives


def test_ideal_observer_agrees_with_blur_in_space():
    """|G|² MTF² summed over frequencies is the energy of the blurred target summed over pixels."""
    target, sigma = torch.zeros(96, 101, dtype=DOUBLE), 2.0
    target[7:19, 20:32] = 8.0
    fx, fy = (torch.fft.fftfreq(n, dtype=DOUBLE) for n in (101, 96))
    exact = (transfer.gaussian(fx, sigma) * transfer.gaussian(fy, sigma)[:, None]) ** 2
    curve = transfer.gaussian(band(501, 0.6), sigma)[None] ** 2
    measured = _separable(*(_at(band(501, 0.6), curve, f) for f in (fx, fy)))
    blurred = gaussian_filter(target.numpy(), sigma, mode="wrap", truncate=8)
    for power, tolerance in ((exact, 1e-6), (measured, 1e-4)):
        got = ideal_observer_snr(target, power=power, noise_power_spectrum=9.0)
        assert float(got) == pytest.approx(math.sqrt((blurred**2).sum() / 9), rel=tolerance)
    assert float(ideal_observer_snr(target, power=1.0, noise_power_spectrum=0.0)) == math.inf
    assert float(ideal_observer_snr(0 * target, power=1.0, noise_power_spectrum=0.0)) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frequency": band(11, 0.4)}, "must be 11 frequencies that rise from 0 to 1/2"),
        ({"frequency": band(11).flip(0)}, "that rise from 0"),
        ({"power": torch.tensor(1.0)}, "at least 1 dimensions"),
        ({"noise_variance": torch.tensor([[1.0], [-1.0]])}, "noise_variance: must be >= 0"),
    ],
)
def test_wrong_arguments_are_named(change, message):
    right = {"frequency": band(11), "power": torch.ones(11), **SNR_300}
    shannon_capacity_radial(**right)
    with pytest.raises(ValueError, match=message):
        shannon_capacity_radial(**{**right, **change})


STEP = 0.7


BLUR = {"sigma_px": 0.3, "motion_px": (6.0, 0.0)}


FREQUENCY = torch.arange(257, dtype=torch.float64) / 512


def edges(count, cnr, seed=0, **blur):
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn(count, 1, 100, 100, generator=generator, dtype=torch.float64) * STEP / cnr
    found = slanted_edge(
        closed_edge(100, 100, offset_px=(0.3, 0.1), **blur) + noise, full_scale=9.0, seed=seed
    )
    assert isinstance(found, list)
    return found


def power(**blur):
    return torch.from_numpy(closed_mtf(FREQUENCY.numpy(), **blur)) ** 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("length_px", "cnr", "allowed"), [(6.0, 20.0, 0.03), (6.0, 6.0, 0.15), (20.0, 20.0, 0.15)]
)
def test_capacity_has_no_bias_and_its_intervals_hold(length_px, cnr, allowed):
    """The scatter is 13, 40 and 56 %, so the mean of 120 is known to 1.2, 3.7 and 5 %; plain: 1, 23, 53 % off."""
    blur, noise = BLUR | {"motion_px": (length_px, 0.0)}, (STEP / cnr) ** 2
    truth = float(
        shannon_capacity_radial(FREQUENCY, power=power(**blur), signal_pp=STEP, noise_variance=noise)
    )
    readings = [information.capacity_radial(edge) for edge in edges(120, cnr, **blur)]
    assert np.mean([reading.value for reading in readings]) == pytest.approx(truth, rel=allowed)
    assert 0.88 < np.mean([reading.low <= truth <= reading.high for reading in readings]) <= 1


@pytest.mark.slow
def test_two_dimensional_numbers_are_the_closed_forms():
    """Motion across x alone: the y edge sees a pixel. 24 pairs, so means are known to a fifth of the scatter."""
    cnr, still = 30.0, {"sigma_px": 0.3}
    pairs = edges(24, cnr, seed=1, **BLUR, angle_deg=3.0), edges(24, cnr, seed=2, **still, angle_deg=93.0)
    along_x, along_y = power(**BLUR, angle_deg=3.0), power(**still, angle_deg=93.0)
    plane, noise = along_y[:, None] * along_x, (STEP / cnr) ** 2
    target, frequency = torch.zeros(64, 64, dtype=DOUBLE), torch.fft.fftfreq(64, dtype=DOUBLE)
    target[:8, :8] = STEP
    both = _separable(*(_at(FREQUENCY, curve[None], frequency) for curve in (along_x, along_y)))
    square = {"power": plane, "signal_pp": STEP, "noise_variance": noise}
    for number, truth in (
        (information.capacity_square, shannon_capacity_square(FREQUENCY, FREQUENCY, **square)),
        (information.neq_integral, square_integral(FREQUENCY, FREQUENCY, plane) * 0.8**2 / noise),
        (
            lambda x, y: information.square_snr(x, y, side_px=8),
            ideal_observer_snr(target, power=both, noise_power_spectrum=noise),
        ),
    ):
        found = [number(*pair) for pair in zip(*pairs, strict=True)]
        assert np.mean([reading.value for reading in found]) == pytest.approx(float(truth), rel=0.03)
        assert np.mean([reading.low <= float(truth) <= reading.high for reading in found]) > 0.75


def test_edges_give_estimates_with_reasons():
    """Of no edge none, without a bootstrap no interval, and an error where it is needed."""
    lost = slanted_edge(torch.full((50, 50), 0.5))
    (whole,), plain = edges(1, 20.0, sigma_px=0.5), slanted_edge(closed_edge(60, 60), bootstrap=0)
    assert isinstance(lost, SlantedEdge)
    estimates = [information.capacity_square(whole, lost), information.neq_integral(lost, lost)]
    estimates += [information.neq_0(lost), information.capacity_radial(lost), lost.estimate("mtf50")]
    for found in estimates:
        assert (found.available, found.flags) == (False, {"no_edge"})
        assert math.isnan(found.value)
        assert math.isnan(found.low)
    for name in ("cnr", "mtf50"):
        found = whole.estimate(name)
        assert (found.value, (found.low, found.high)) == (getattr(whole, name), whole.intervals[name])
        assert found.low < found.value < found.high
    assert plain.estimate("mtf50").available
    assert math.isnan(plain.estimate("mtf50").low)
    with pytest.raises(ValueError, match="bootstrap > 0"):
        information.capacity_radial(plain)


@pytest.mark.parametrize("bright", [0.8, 0.7991027380144089])
def test_without_noise_numbers_are_infinite_and_flagged(bright):
    """Rounding leaves a variance of 1e-33 of the second level: no noise either."""
    columns = torch.arange(100, dtype=torch.float64)
    edge = slanted_edge(torch.where(columns + columns[:, None] / 12 > 54, bright, 0.09989872824711392))
    assert isinstance(edge, SlantedEdge)
    assert edge.cnr == edge.edge_snr_db == math.inf
    estimates = [edge.estimate("cnr"), edge.estimate("edge_snr_db")]
    estimates += [information.capacity_radial(edge), information.neq_0(edge)]
    for found in estimates:
        assert not found.available
        assert math.isnan(found.low)
        assert "noiseless" in found.flags
    assert edge.estimate("michelson").available
