"""Noise and fixed patterns of rows, columns and frames, and the bend: samples against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from blurnoise import Camera, Exposure, plan, simulate
from blurnoise._core import rng
from blurnoise._core.threads import WORTH_IT
from blurnoise.scene.scene import ExposedScene
from blurnoise.sensor import readout as sensor

BASE = Camera(
    name="test", pixel_pitch_um=3.0, f_number=2.0, transmission=0.9, quantum_efficiency=0.6, full_well_e=9000.0,
    system_gain_dn_per_e=0.8, read_noise_e=3.0, black_level_dn=200.0, bit_depth=14,
)  # fmt: skip
LINES = replace(BASE, row_noise_e=4.0, column_noise_e=2.0, black_level_drift_dn=1.5)
FIXED = replace(
    BASE, prnu=0.01, prnu_row=0.03, prnu_column=0.02, dsnu_e=3.0, dsnu_row_e=5.0, dsnu_column_e=8.0
)
BENT = replace(BASE, photon_transfer=((0.2, 1.1), (0.5, 0.9), (0.9, 0.4)))
COUNT, HEIGHT, WIDTH, MEAN_E = 1500, 24, 31, 100.0
ROUTES: dict[str, tuple[float, dict[str, Any]]] = {
    "one draw": (3.0, {}),
    "counts": (0.5, {}),
    "exact": (3.0, {"fidelity": "full"}),
    "with derivatives": (3.0, {}),
}
by_route = pytest.mark.parametrize("route", ROUTES)


def frames(
    camera: Camera, mean_e: float, shape: tuple[int, ...], route: str = "one draw", **more: Any
) -> Tensor:
    """Frames (B, C, H, W), float64, the seeds 0 to B - 1."""
    read_noise_e, options = ROUTES[route]
    light = torch.full(shape, mean_e, dtype=torch.float64, requires_grad=route == "with derivatives")
    given = {"exposure_s": 0.01, "temperature_c": 20.0, "generator": list(range(shape[0]))}
    return sensor.read_out(
        light, replace(camera, read_noise_e=read_noise_e), **given, **options, **more
    ).detach()


@by_route
def test_variances_of_row_means_column_means_frame_means_and_pixels(route: str) -> None:
    """K = 0.8 DN/e-. A mean of n pixels holds 1/n of their white variance, and all of what its row shares.

    The means of rows, their frame's mean taken off, are COUNT (HEIGHT - 1) samples: variance to 5 sqrt(2 / n).
    """
    dn = frames(LINES, MEAN_E, (COUNT, 1, HEIGHT, WIDTH), route)[:, 0].numpy()
    white = 0.64 * (MEAN_E + ROUTES[route][0] ** 2) + 1 / 12
    rows, columns, drift = 0.64 * 4.0**2, 0.64 * 2.0**2, 1.5**2
    of_rows, of_columns, of_frames = dn.mean(2), dn.mean(1), dn.mean((1, 2))
    found = {
        "rows": ((of_rows.var(1, ddof=1)).mean(), rows + white / WIDTH, COUNT * (HEIGHT - 1)),
        "columns": ((of_columns.var(1, ddof=1)).mean(), columns + white / HEIGHT, COUNT * (WIDTH - 1)),
        "frames": (
            of_frames.var(ddof=1),
            drift + rows / HEIGHT + columns / WIDTH + white / HEIGHT / WIDTH,
            COUNT,
        ),
        # pixels of a row share its noise: as many samples as rows
        "pixels": (dn.var(0, ddof=1).mean(), white + rows + columns + drift, COUNT),
    }
    for name, (variance, expected, samples) in found.items():
        assert variance == pytest.approx(expected, rel=5 * math.sqrt(2 / samples)), name
    spread = math.sqrt(found["frames"][1] / COUNT)
    assert dn.mean() == pytest.approx(200 + 0.8 * MEAN_E, abs=5 * spread)


@pytest.mark.parametrize(
    "missing",
    [{"row_noise_e": 0.0}, {"column_noise_e": 0.0}, {"black_level_drift_dn": 0.0}, {"row_noise_e": 4.4}],
)
def test_a_noise_too_few_or_a_tenth_more_would_be_noticed(
    missing: dict[str, float], monkeypatch: Any
) -> None:
    monkeypatch.setitem(globals(), "LINES", replace(LINES, **missing))
    with pytest.raises(AssertionError):
        test_variances_of_row_means_column_means_frame_means_and_pixels("one draw")


@pytest.mark.parametrize(
    ("figure", "alike"),
    [("row_noise_e", (3,)), ("column_noise_e", (2,)), ("black_level_drift_dn", (1, 2, 3))],
)
def test_each_is_added_to_the_frame_as_it_is_and_shared_by_what_it_belongs_to(
    figure: str, alike: tuple[int, ...]
) -> None:
    """Before rounding: the rest of the frame keeps its bits; the colours of three sensors have their own lines."""
    still = frames(BASE, 3000.0, (3, 3, 15, 21), quantised=False)
    added = frames(replace(BASE, **{figure: 2.0}), 3000.0, (3, 3, 15, 21), quantised=False) - still
    first = added
    for dimension in alike:
        first = first.narrow(dimension, 0, 1)
    torch.testing.assert_close(added, first.expand_as(added), rtol=0, atol=1e-9)
    assert first.unique().numel() == first.numel()


def test_a_row_of_a_mosaic_has_one_value() -> None:
    camera = replace(Camera.preset("imx250c"), dark_current_e_s=0.0)
    given: dict[str, Any] = {
        "exposure_s": 0.01,
        "illuminance_lux": 50.0,
        "quantised": False,
        "fidelity": "full",
    }
    light = torch.rand(1, 3, 14, 18, generator=torch.Generator().manual_seed(3))
    plain, noisy = (
        simulate(light, each, generator=[5], **given) for each in (camera, replace(camera, row_noise_e=9.0))
    )
    added = noisy - plain
    assert added.shape == (1, 1, 14, 18)
    torch.testing.assert_close(
        added, added[..., :1].expand_as(added), rtol=0, atol=2e-3
    )  # of 2000 DN, single
    assert added[..., 0].unique().numel() == 14


EVERY = replace(
    FIXED, row_noise_e=4.0, column_noise_e=2.0, black_level_drift_dn=1.5, dark_current_e_s=900.0,
    photon_transfer=BENT.photon_transfer,
)  # fmt: skip


@pytest.mark.parametrize("fidelity", ["auto", "full"])
@pytest.mark.parametrize("camera", [EVERY, replace(EVERY, photon_transfer=())], ids=["bent", "straight"])
def test_bits_depend_on_neither_batch_nor_threads_nor_pieces(
    camera: Camera, fidelity: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    light = torch.rand(2, 1, 401, 353, generator=torch.Generator().manual_seed(1)) * 6000
    pattern = camera.fixed_pattern((1, 401, 353), 3)
    given: dict[str, Any] = {"exposure_s": 0.02, "fixed_pattern": pattern, "fidelity": fidelity}
    together = sensor.read_out(light, camera, generator=[7, 8], **given)
    assert together.numel() > WORTH_IT
    threads = torch.get_num_threads()
    try:
        for count, piece in ((1, 1 << 15), (3, 10_001)):
            torch.set_num_threads(count)
            monkeypatch.setattr(sensor, "_PIECE", piece)
            monkeypatch.setattr(sensor, "_FAST_PIECE", piece)
            alone = [
                sensor.read_out(light[each : each + 1], camera, generator=[7 + each], **given)
                for each in (0, 1)
            ]
            assert torch.equal(torch.cat(alone), together)
    finally:
        torch.set_num_threads(threads)


@pytest.mark.parametrize("white_e", [300.0, 9500.0])
def test_the_fast_route_gives_the_references_frame(white_e: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for rounding of single precision, and several lights of one frame share its rows."""
    camera = replace(EVERY, photon_transfer=())
    light = torch.rand(1, 3, 53, 71, generator=torch.Generator().manual_seed(1))
    given: dict[str, Any] = {"exposure_s": 0.02, "fixed_pattern": camera.fixed_pattern((3, 53, 71), 3)}
    fast = sensor.read_out(light, camera, white_e=white_e, generator=[5], **given)
    both = sensor.read_out(
        light.expand(2, -1, -1, -1), camera, white_e=[white_e, 100.0], generator=[5, 5], **given
    )
    monkeypatch.setattr(sensor, "supports", lambda active: False)
    reference = sensor.read_out(light, camera, white_e=white_e, generator=[5], **given)
    assert torch.equal(both[:1], fast)
    assert float((fast - reference).abs().max()) <= 1
    assert float((fast != reference).double().mean()) < 1e-3


def test_frames_of_a_scene_are_those_of_simulate() -> None:
    """Exposures of one picture share what they can; rows and columns are of the seed all the same."""
    picture = np.random.default_rng(2).integers(0, 256, (40, 50, 3), dtype=np.uint8)
    camera = replace(Camera.preset("imx250"), row_noise_e=20.0, column_noise_e=5.0, black_level_drift_dn=2.0)
    lights = [Exposure(camera, 0.01, lux, seed=seed) for lux, seed in ((5.0, 1), (6.0, 1), (6.0, 2))]
    scene = ExposedScene.of_picture(picture)
    together = [each.picture for each in scene.frames(lights)]
    for exposure, seen in zip(lights, together, strict=True):
        (alone,) = ExposedScene.of_picture(picture).frames([exposure])
        assert np.array_equal(alone.picture, seen)
    assert not np.array_equal(together[1], together[2])


@pytest.mark.parametrize(("place", "pixel", "row", "column"), [(0, 0.01, 0.03, 0.02), (1, 3.0, 5.0, 8.0)])
def test_fixed_patterns_of_rows_and_columns(place: int, pixel: float, row: float, column: float) -> None:
    """Variances of the means of 400 rows and 500 columns, to 5 sqrt(2 / n) each, and what is left of the pixels."""
    field = FIXED.fixed_pattern((1, 400, 500), 3)[place][0].double().numpy()
    of_rows, of_columns = field.mean(1), field.mean(0)
    assert of_rows.var(ddof=1) == pytest.approx(row**2 + pixel**2 / 500, rel=5 * math.sqrt(2 / 399))
    assert of_columns.var(ddof=1) == pytest.approx(column**2 + pixel**2 / 400, rel=5 * math.sqrt(2 / 499))
    left = field - of_rows[:, None] - of_columns + field.mean()
    assert left.var() == pytest.approx(pixel**2 * 399 / 400 * 499 / 500, rel=5 * math.sqrt(2 / 200_000))
    plain = replace(FIXED, prnu_row=0.0, prnu_column=0.0, dsnu_row_e=0.0, dsnu_column_e=0.0)
    own = (
        plain.fixed_pattern((1, 400, 500), 3)[place][0].double().numpy()
    )  # of the pixels: as without the others
    np.testing.assert_allclose(left, own - own.mean(1)[:, None] - own.mean(0) + own.mean(), atol=1e-3 * pixel)


@by_route
@pytest.mark.parametrize(("share", "factor"), [(0.1, 1.1), (0.35, 1.0), (0.7, 0.65), (0.92, 0.4)])
def test_the_bend_is_in_the_variance_and_not_in_the_mean(share: float, factor: float, route: str) -> None:
    """n = 120 000 pixels: mean to 5 sigma / sqrt(n), variance to 5 sqrt(2 / n); factors by hand, at the points'
    ends held."""
    mean_e = share * BENT.saturation_e
    dn = frames(BENT, mean_e, (1, 1, 300, 400), route)
    variance = 0.64 * (factor * mean_e + ROUTES[route][0] ** 2) + 1 / 12
    assert float(dn.mean()) == pytest.approx(200 + 0.8 * mean_e, abs=5 * math.sqrt(variance / dn.numel()))
    assert float(dn.var()) == pytest.approx(variance, rel=5 * math.sqrt(2 / dn.numel()))
    assert BENT.variance_factor(mean_e) == pytest.approx(factor)


def test_gradients_pass_the_bend_rows_and_columns() -> None:
    """Central differences before rounding, of every pixel by its own light."""
    light = (
        torch.rand(1, 1, 5, 7, dtype=torch.float64, generator=torch.Generator().manual_seed(2)) * 5000 + 500
    )
    given: dict[str, Any] = {"exposure_s": 0.02, "generator": [4], "quantised": False}
    given["fixed_pattern"] = EVERY.fixed_pattern((1, 5, 7), 1)
    asked = light.clone().requires_grad_()
    sensor.read_out(asked, EVERY, **given).sum().backward()
    ends = [sensor.read_out(light + step, EVERY, **given) for step in (0.01, -0.01)]
    torch.testing.assert_close(asked.grad, (ends[0] - ends[1]) / 0.02, rtol=1e-6, atol=1e-6)


def test_plans_leave_out_what_does_not_matter() -> None:
    """A bend of bright light where there is none, rows below the tolerance; and say what they keep."""
    bent = replace(BENT, photon_transfer=((0.5, 1.0), (0.9, 0.4)), row_noise_e=1e-3, column_noise_e=2.0)
    dim, bright = (plan(bent, exposure_s=0.01, illuminance_lux=lux) for lux in (1.0, 500.0))
    assert (dim.camera.photon_transfer, dim.camera.row_noise_e, dim.camera.column_noise_e) == ((), 0.0, 2.0)
    assert bright.camera.photon_transfer == bent.photon_transfer
    said = {each.name: each for each in bright.stages}
    assert said["column noise"].contribution_dn == pytest.approx(0.8 * 2.0)
    assert said["column noise"].how == "a normal value per column and frame"
    assert said["photon transfer"].how == "in the draw of shot noise"
    assert said["row noise"].how == "left out: within the tolerance"
    total = plan(FIXED, exposure_s=0.01, illuminance_lux=1.0).stages
    assert {each.name: each.contribution_dn for each in total}["DSNU"] == pytest.approx(0.8 * math.sqrt(98))


def test_a_pixels_noise_in_the_dark_holds_that_of_its_row_and_column() -> None:
    """sqrt(9 + 16 + 4) e-: threshold and range rest on it; a well counts as full three deviations below its end."""
    assert LINES.dark_noise_e == pytest.approx(math.sqrt(29))
    assert LINES.dark_variance_dn2(5.0) == pytest.approx(0.64 * 34 + 1 / 12)
    assert LINES.threshold_e == pytest.approx(0.5 + math.sqrt(0.25 + 29 + 1 / 12 / 0.64))
    wide = replace(LINES, dsnu_row_e=5.0, dsnu_column_e=8.0)
    assert wide.saturated_dn == math.floor(0.8 * (9000 - 3 * math.sqrt(29 + 89)) + 200)


def test_what_is_off_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Streams of their own, of which those of figures that are 0 are not opened."""
    drawn, real = [], rng.standard_normal
    monkeypatch.setattr(rng, "standard_normal", lambda *given: drawn.append(given[2]) or real(*given))
    frames(BASE, 50.0, (1, 1, 9, 9))
    assert drawn == []
    frames(LINES, 50.0, (1, 1, 9, 9))
    assert drawn == ["row noise", "column noise", "black level drift"]
