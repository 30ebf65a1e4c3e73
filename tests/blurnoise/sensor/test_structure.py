"""Noise and fixed patterns of rows, columns and frames, and the bend: samples against closed forms."""

import math

import pytest
import torch
from exposed_frames import budget

from blurnoise import Camera
from blurnoise._core.threads import WORTH_IT
from blurnoise.sensor import fused
from blurnoise.sensor import readout as sensor

BASE = Camera.preset("imx250").with_figures(
    name="test", quantum_efficiency=0.6, full_well_e=9000.0, system_gain_dn_per_e=0.8,
    read_noise_e=3.0, black_level_dn=200.0, bit_depth=14,
)  # fmt: skip
LINES = BASE.with_figures(row_noise_e=4.0, column_noise_e=2.0, black_level_drift_dn=1.5)
FIXED = BASE.with_figures(
    prnu=0.01, prnu_row=0.03, prnu_column=0.02, dsnu_e=3.0, dsnu_row_e=5.0, dsnu_column_e=8.0
)
BENT = BASE.with_figures(photon_transfer=((0.2, 1.1), (0.5, 0.9), (0.9, 0.4)))
STRAIGHT = FIXED.with_figures(
    row_noise_e=4.0, column_noise_e=2.0, parity_noise_e=1.0, black_level_drift_dn=1.5, dark_current_e_s=900.0
)
EVERY = STRAIGHT.with_figures(
    photon_transfer=BENT.sensor.photon_transfer, row_gain_noise=0.01, row_gain_rows=30.0
)
COUNT, HEIGHT, WIDTH, MEAN_E = 1500, 24, 31, 100.0
ROUTES = {
    "one draw": (3.0, "auto"), "counts": (0.5, "auto"), "exact": (3.0, "full"), "with derivatives": (3.0, "auto"),
}  # fmt: skip
by_route = pytest.mark.parametrize("route", ROUTES)


def frames(camera, mean_e, shape, route="one draw", **more):
    """Frames (B, C, H, W), float64, the seeds 0 to B - 1."""
    read_noise_e, fidelity = ROUTES[route]
    light = torch.full(shape, mean_e, dtype=torch.float64, requires_grad=route == "with derivatives")
    given = {"exposure_s": 0.01, "temperature_c": 20.0, "generator": list(range(shape[0]))}
    camera = camera.with_figures(read_noise_e=read_noise_e)
    return sensor.read_out(light, camera, **given, fidelity=fidelity, **more).detach()


@by_route
def test_variances_of_row_means_column_means_frame_means_and_pixels(route):
    """K = 0.8 DN/e-. A mean of n pixels holds 1/n of their white variance, and all of what its row shares.

    The means of rows, their frame's mean taken off, are COUNT (HEIGHT - 1) samples: variance to 5 sqrt(2 / n).
    """
    dn = frames(LINES, MEAN_E, (COUNT, 1, HEIGHT, WIDTH), route)[:, 0].numpy()
    white = 0.64 * (MEAN_E + ROUTES[route][0] ** 2) + 1 / 12
    rows, columns, drift = 0.64 * 4.0**2, 0.64 * 2.0**2, 1.5**2
    of_frames = drift + rows / HEIGHT + columns / WIDTH + white / HEIGHT / WIDTH
    for found, expected, samples in (
        (dn.mean(2).var(1, ddof=1).mean(), rows + white / WIDTH, COUNT * (HEIGHT - 1)),
        (dn.mean(1).var(1, ddof=1).mean(), columns + white / HEIGHT, COUNT * (WIDTH - 1)),
        (dn.mean((1, 2)).var(ddof=1), of_frames, COUNT),
        # pixels of a row share its noise: as many samples as rows
        (dn.var(0, ddof=1).mean(), white + rows + columns + drift, COUNT),
    ):
        assert found == pytest.approx(expected, rel=5 * math.sqrt(2 / samples))
    assert dn.mean() == pytest.approx(200 + 0.8 * MEAN_E, abs=5 * math.sqrt(of_frames / COUNT))


@by_route
def test_even_and_odd_columns_have_opposite_offsets_in_each_row(route):
    """Half the difference of the means of even and odd columns: 16 and 15 of the 31, besides their white noise."""
    dn = frames(BASE.with_figures(parity_noise_e=4.0), MEAN_E, (COUNT, 1, HEIGHT, WIDTH), route)[:, 0].numpy()
    white = 0.64 * (MEAN_E + ROUTES[route][0] ** 2) + 1 / 12
    apart = (dn[:, :, ::2].mean(2) - dn[:, :, 1::2].mean(2)) / 2
    expected = 0.64 * 4.0**2 + white * (1 / 16 + 1 / 15) / 4
    assert apart.var() == pytest.approx(expected, rel=5 * math.sqrt(2 / (COUNT * HEIGHT)))


@by_route
@pytest.mark.parametrize(("rows", "shares"), [(0.0, (0.0, 0.0)), (8.0, (math.exp(-1 / 8), math.exp(-3 / 8)))])
def test_row_gain_noise_is_a_correlated_share_of_the_signal(route, rows, shares):
    """Covariances of row means at a distance of 1 and 3 rows; those of 48 rows are about a mean that varies itself.

    The mean of n rows has the variance v = sum of all n^2 covariances over n^2, by which each covariance is smaller.
    """
    height, signal = 48, 1000.0
    camera = BASE.with_figures(row_gain_noise=0.02, row_gain_rows=rows)
    dn = frames(camera, signal, (COUNT, 1, height, WIDTH), route)[:, 0].numpy()
    means = dn.mean(2) - 200.0
    of_rows = means - means.mean(1, keepdims=True)
    law = [math.exp(-h / rows) if rows else float(h == 0) for h in range(height)]
    of_mean = (height + 2 * sum((height - h) * law[h] for h in range(1, height))) / height**2
    square = (0.8 * 0.02 * signal) ** 2
    white = (0.64 * (signal + ROUTES[route][0] ** 2) + 1 / 12) / WIDTH
    # correlated rows are as many samples as correlation lengths
    within = 5 * square * math.sqrt(2 * max(1.0, 2 * rows) / (COUNT * height))
    assert of_rows.var() == pytest.approx(square * (1 - of_mean) + white * (1 - 1 / height), abs=within)
    for distance, share in zip((1, 3), shares, strict=True):
        middle = slice(8, -8)
        found = (of_rows[:, :-distance] * of_rows[:, distance:])[:, middle].mean()
        assert found == pytest.approx(square * (share - of_mean), abs=within + white / height)
    assert means.mean() == pytest.approx(0.8 * signal, rel=1e-3)


@pytest.mark.parametrize(
    ("figure", "alike"),
    [("row_noise_e", (3,)), ("column_noise_e", (2,)), ("black_level_drift_dn", (1, 2, 3))],
)
def test_each_is_added_to_the_frame_as_it_is_and_shared_by_what_it_belongs_to(figure, alike):
    """Before rounding: the rest of the frame keeps its bits; the colours of three sensors have their own lines."""
    still = frames(BASE, 3000.0, (3, 3, 15, 21), quantised=False)
    added = frames(BASE.with_figures(**{figure: 2.0}), 3000.0, (3, 3, 15, 21), quantised=False) - still
    first = added
    for dimension in alike:
        first = first.narrow(dimension, 0, 1)
    torch.testing.assert_close(added, first.expand_as(added), rtol=0, atol=1e-9)
    assert first.unique().numel() == first.numel()


@pytest.mark.parametrize("fidelity", ["auto", "full"])
@pytest.mark.parametrize(
    "camera", [EVERY, STRAIGHT, BASE.with_figures(read_noise_e=0.4)], ids=["bent", "straight", "quiet"]
)
def test_bits_depend_on_neither_batch_nor_threads_nor_pieces(camera, fidelity, monkeypatch):
    light = torch.rand(2, 1, 401, 353, generator=torch.Generator().manual_seed(1)) * 6000
    pattern = camera.sensor.fixed_pattern((1, 401, 353), 3)
    given = {"exposure_s": 0.02, "fixed_pattern": pattern, "fidelity": fidelity}
    together = sensor.read_out(light, camera, generator=[7, 8], **given)
    assert together.numel() > WORTH_IT
    threads = torch.get_num_threads()
    try:
        for count, piece in ((1, 1 << 15), (3, 10_001)):
            torch.set_num_threads(count)
            monkeypatch.setattr(sensor, "_PIECE", piece)
            monkeypatch.setattr(fused, "_PIECE", piece)
            for each, dn in enumerate(together):
                alone = sensor.read_out(light[each : each + 1], camera, generator=[7 + each], **given)
                assert torch.equal(alone[0], dn)
    finally:
        torch.set_num_threads(threads)


@pytest.mark.parametrize(("place", "pixel", "row", "column"), [(0, 0.01, 0.03, 0.02), (1, 3.0, 5.0, 8.0)])
def test_fixed_patterns_of_rows_and_columns(place, pixel, row, column):
    """Variances of the means of 400 rows and 500 columns, to 5 sqrt(2 / n) each, and what is left of the pixels."""

    def split(camera):
        field = camera.sensor.fixed_pattern((1, 400, 500), 3)[place][0].double()
        rows, columns = field.mean(1, keepdim=True), field.mean(0, keepdim=True)
        return rows, columns, field - rows - columns + field.mean()

    rows, columns, left = split(FIXED)
    for found, expected, n in (
        (rows, row**2 + pixel**2 / 500, 399),
        (columns, column**2 + pixel**2 / 400, 499),
        (left, pixel**2 * 399 / 400 * 499 / 500, 200_000),
    ):
        assert float(found.var()) == pytest.approx(expected, rel=5 * math.sqrt(2 / n))
    plain = split(BASE.with_figures(prnu=0.01, dsnu_e=3.0))[2]  # of the pixels: as without the others
    torch.testing.assert_close(left, plain, rtol=0, atol=1e-3 * pixel)


@by_route
@pytest.mark.parametrize(("share", "factor"), [(0.1, 1.1), (0.35, 1.0), (0.7, 0.65), (0.92, 0.4)])
def test_the_bend_is_in_the_variance_and_not_in_the_mean(share, factor, route):
    """n = 120 000 pixels: mean to 5 sigma / sqrt(n), variance to 5 sqrt(2 / n); factors by hand, at the points'
    ends held."""
    mean_e = share * BENT.sensor.saturation_e
    dn = frames(BENT, mean_e, (1, 1, 300, 400), route)
    variance = 0.64 * (factor * mean_e + ROUTES[route][0] ** 2) + 1 / 12
    assert float(dn.mean()) == pytest.approx(200 + 0.8 * mean_e, abs=5 * math.sqrt(variance / dn.numel()))
    assert float(dn.var()) == pytest.approx(variance, rel=5 * math.sqrt(2 / dn.numel()))


def test_gradients_pass_the_bend_rows_and_columns():
    """Central differences before rounding, of every pixel by its own light."""
    light = torch.linspace(500, 5500, 35, dtype=torch.float64).view(1, 1, 5, 7)
    given = {"exposure_s": 0.02, "generator": [4], "quantised": False}
    given["fixed_pattern"] = EVERY.sensor.fixed_pattern((1, 5, 7), 1)
    asked = light.clone().requires_grad_()
    sensor.read_out(asked, EVERY, **given).sum().backward()
    ends = [sensor.read_out(light + step, EVERY, **given) for step in (0.01, -0.01)]
    torch.testing.assert_close(asked.grad, (ends[0] - ends[1]) / 0.02, rtol=1e-6, atol=1e-6)


def test_plans_leave_out_what_does_not_matter():
    """A bend of bright light where there is none, rows below the tolerance; and say what they keep."""
    bent = BENT.with_figures(photon_transfer=((0.5, 1.0), (0.9, 0.4)), row_noise_e=1e-3, column_noise_e=2.0)
    dim, bright = (budget(bent, exposure_s=0.01, illuminance_lux=lux) for lux in (1.0, 500.0))
    assert (
        dim.camera.sensor.photon_transfer,
        dim.camera.sensor.row_noise_e,
        dim.camera.sensor.column_noise_e,
    ) == ((), 0.0, 2.0)
    assert bright.camera.sensor.photon_transfer == bent.sensor.photon_transfer
    said = {each.name: each for each in bright.stages}
    assert said["column noise"].contribution_dn == pytest.approx(0.8 * 2.0)
    assert said["row noise"].how == "left out: within the tolerance"
    stages = budget(FIXED, exposure_s=0.01, illuminance_lux=1.0).stages
    assert {each.name: each.contribution_dn for each in stages}["DSNU"] == pytest.approx(0.8 * math.sqrt(98))


def test_a_pixels_noise_in_the_dark_holds_that_of_its_row_and_column():
    """sqrt(9 + 16 + 4) e-: threshold and range rest on it; a well counts as full three deviations below its end."""
    assert LINES.sensor.dark_noise_e == pytest.approx(math.sqrt(29))
    assert LINES.sensor.dark_variance_dn2(5.0) == pytest.approx(0.64 * 34 + 1 / 12)
    assert LINES.sensor.threshold_e == pytest.approx(0.5 + math.sqrt(0.25 + 29 + 1 / 12 / 0.64))
    wide = LINES.with_figures(dsnu_row_e=5.0, dsnu_column_e=8.0)
    assert wide.sensor.saturated_dn == math.floor(0.8 * (9000 - 3 * math.sqrt(29 + 89)) + 200)
