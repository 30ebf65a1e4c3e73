"""Objects before a camera that shakes or reads row by row, and before a flow: against a truth of many moments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import brute_force
import numpy as np
import pytest
import sub_exposures
import torch

from blurnoise import Camera, Layer, Trajectory, simulate
from blurnoise.blur.displacement import Displacement, Readout
from blurnoise.blur.layers import exposed

HEIGHT, WIDTH, EXPOSURE_S = 65, 96, 0.01
STREET = torch.from_numpy(brute_force.photograph(HEIGHT, WIDTH, 5, 3))
T = torch.tensor(EXPOSURE_S, dtype=torch.float64)
PAIRS = [((0.0, 0.0), (1500.0, 0.0)), ((600.0, -300.0), (-800.0, 500.0)), ((1000.0, 200.0), (0.0, 0.0))]
Place = Callable[[int, float], tuple[float, float]]
"""Of the street (0) or the object (1) at a time."""


def thing(velocity: tuple[float, float]) -> Layer:
    """A textured disc whose edge is 4 px wide, at rest in the middle."""
    y, x = torch.meshgrid(torch.arange(20) - 9.5, torch.arange(24) - 11.5, indexing="ij")
    alpha = ((1 - torch.sqrt((y / 9.5) ** 2 + (x / 11.5) ** 2)) * 3).clamp(0, 1).double()
    light = torch.from_numpy(brute_force.photograph(20, 24, 9, 3))[0]
    return Layer(light, alpha, velocity, (36, 22))


def moment(layer: Layer, place: Place, time: float) -> torch.Tensor:
    light, alpha = torch.zeros(3, HEIGHT, WIDTH).double(), torch.zeros(1, HEIGHT, WIDTH).double()
    light[:, 22:42, 36:60], alpha[:, 22:42, 36:60] = layer.light, layer.alpha
    street = sub_exposures.moved(STREET[0], *place(0, time))
    covered = sub_exposures.moved(alpha, *place(1, time)).clamp(0, 1)
    return sub_exposures.moved(light * alpha, *place(1, time)) + (1 - covered) * street


def straight(street: tuple[float, float], own: tuple[float, float]) -> Place:
    return lambda k, time: ((street, own)[k][0] * time, (street, own)[k][1] * time)


def truth(layer: Layer, place: Place, row_s: float = 0.0, *, reset: bool = False) -> torch.Tensor:
    """The mean of 128 moments; with a readout, of all those of half a row's time that a row's window holds; with a
    reset windows begin together, and each ends a row's time after the last."""
    if not row_s:
        times = ((np.arange(128) + 0.5) / 128 - 0.5) * EXPOSURE_S
        return sum(moment(layer, place, float(time)) for time in times) / 128  # type: ignore[return-value]
    cell, tau = row_s / 2, (np.arange(HEIGHT) - (HEIGHT - 1) / 2) * row_s
    begin, end = tau - EXPOSURE_S / 2, tau + EXPOSURE_S / 2
    if reset:
        begin = np.full(HEIGHT, -(EXPOSURE_S + row_s * (HEIGHT - 1) / 2) / 2)
        end = begin + EXPOSURE_S + row_s * np.arange(HEIGHT)
    half = int(max(-begin.min(), end.max()) / cell) + 1
    total, spent = torch.zeros(3, HEIGHT, WIDTH).double(), torch.zeros(HEIGHT).double()
    for time in np.arange(-half, half + 1) * cell:
        ends = np.minimum(end, time + cell / 2), np.maximum(begin, time - cell / 2)
        share = torch.from_numpy(np.clip(ends[0] - ends[1], 0, None))
        if bool(share.any()):
            total, spent = total + moment(layer, place, float(time)) * share[:, None], spent + share
    return total / spent[:, None]


def found(
    layer: Layer,
    velocity: tuple[float, float] | torch.Tensor,
    path: Trajectory | None = None,
    row_s: float = 0.0,
    *,
    reset: bool = False,
) -> torch.Tensor:
    even = velocity if isinstance(velocity, torch.Tensor) else torch.tensor(velocity).double() * T
    moves = Displacement(even, T, Readout(HEIGHT, row_s, EXPOSURE_S, reset), path)
    return exposed(STREET, [layer], moves, "circular")[0]


def error(one: torch.Tensor, other: torch.Tensor) -> float:
    """8-bit numbers, around the object."""
    around = (slice(10, 54), slice(20, 76))
    return sub_exposures.rms_dn(one[..., *around].clamp(0, 1), other[..., *around].clamp(0, 1))


@pytest.mark.parametrize(("street", "own"), PAIRS)
def test_objects_before_a_rolling_shutter(street: tuple[float, float], own: tuple[float, float]) -> None:
    """13 ms from the first row to the last: 20 px at 1500 px/s. Read upwards it is another picture."""
    layer, row_s = thing(own), 2e-4
    expected = truth(layer, straight(street, own), row_s)
    assert error(found(layer, street, row_s=row_s), expected) < 0.25
    for wrong_s in (0.0, -row_s):
        assert error(found(layer, street, row_s=wrong_s), expected) > 1
    back = [(-x, -y) for x, y in (street, own)]  # upwards in time is downwards of what goes back
    upwards = found(replace(layer, velocity_px_s=back[1]), back[0], row_s=-row_s)
    assert error(upwards, expected) < 0.25


@pytest.mark.parametrize(("street", "own"), PAIRS)
@pytest.mark.parametrize("frequency_hz", [40.0, 300.0])
def test_objects_before_a_camera_that_shakes(
    street: tuple[float, float], own: tuple[float, float], frequency_hz: float
) -> None:
    path = Trajectory.sinusoid(5.0, frequency_hz, 0.1, direction_deg=30.0, phase_rad=0.7)
    layer, origin = thing(own), path.origin_px(EXPOSURE_S)

    def place(k: int, time: float) -> tuple[float, float]:
        shaken = (np.interp(time, path.time_s, along) for along in (path.x_px, path.y_px))
        x, y = (float(s) - o + v * time for s, o, v in zip(shaken, origin, (street, own)[k], strict=True))
        return x, y

    expected = truth(layer, place)
    assert error(found(layer, street, path), expected) < 0.5
    assert error(found(layer, street), expected) > 2


@pytest.mark.slow
@pytest.mark.parametrize(("street", "own"), PAIRS)
@pytest.mark.parametrize("shakes", [True, False])
@pytest.mark.parametrize("reset", [True, False])
def test_objects_before_rows_that_see_a_path(
    street: tuple[float, float], own: tuple[float, float], shakes: bool, reset: bool
) -> None:
    """A shake of 5 px before a rolling shutter or a global reset, and the reset alone: to 0.6 DN. Without the readout
    it is another picture."""
    path = Trajectory.sinusoid(5.0, 60.0, 0.1, direction_deg=30.0, phase_rad=0.7) if shakes else None
    layer, row_s = thing(own), 2e-4
    origin = path.origin_px(EXPOSURE_S) if path else (0.0, 0.0)

    def place(k: int, time: float) -> tuple[float, float]:
        shaken = [np.interp(time, path.time_s, along) for along in (path.x_px, path.y_px)] if path else (0, 0)
        x, y = (float(s) - o + v * time for s, o, v in zip(shaken, origin, (street, own)[k], strict=True))
        return x, y

    expected = truth(layer, place, row_s, reset=reset)
    assert error(found(layer, street, path, row_s, reset=reset), expected) < 0.6
    if shakes or reset:
        assert error(found(layer, street, path), expected) > 1.5


@pytest.mark.parametrize("own", [(0.0, 0.0), (900.0, 600.0)])
def test_objects_before_a_flow(own: tuple[float, float]) -> None:
    """A flow that is constant is the uniform motion; one of two halves blurs each half as its own."""
    layer, street = thing(own), (-700.0, 300.0)
    flow = (torch.tensor(street).double() * T)[:, None, None].expand(2, HEIGHT, WIDTH)
    expected = truth(layer, straight(street, own))
    got = found(layer, flow)
    assert error(got, expected) < 1.5
    assert error(found(layer, (0.0, 0.0)), expected) > 5
    halves = flow.clone()
    halves[..., 48:] = 0
    both = found(layer, halves)
    torch.testing.assert_close(both[..., :30], got[..., :30], rtol=0, atol=1e-6)
    still = found(layer, (0.0, 0.0))
    assert (both[..., 75:] - still[..., 75:]).abs().max() < 1e-6


def test_simulate_takes_objects_with_each() -> None:
    """In the chain: a batch is its pictures, gradients reach an object's velocity, rows are the camera's."""
    light, layer = STREET.float(), thing((900.0, 200.0))
    rows = 2e-4 * Camera.preset("imx250").field.per_sensor_px((HEIGHT, WIDTH))
    rolling = replace(Camera.preset("imx250"), row_time_s=rows, shutter="rolling")
    given: dict[str, Any] = {"exposure_s": EXPOSURE_S, "illuminance_lux": 150.0, "encoding": "linear"}
    given |= {"noise": False, "quantised": False}
    path = Trajectory.sinusoid(4.0, 90.0, 0.1)
    flow = torch.tensor([[-300.0], [100.0]])[..., None] * torch.linspace(0.5, 1.5, WIDTH).expand(
        1, HEIGHT, -1
    )
    ways: list[tuple[Camera, dict[str, Any]]] = [
        (rolling, {"velocity_px_s": (-300.0, 100.0)}),
        (Camera.preset("imx250"), {"trajectory": path}),
        (Camera.preset("imx250"), {"velocity_px_s": flow}),
        (rolling, {"trajectory": path}),
    ]
    for camera, moves in ways:
        seen = simulate(light, camera, layers=[layer], **given, **moves)
        asked = replace(layer, velocity_px_s=torch.tensor([900.0, 200.0], requires_grad=True))
        follows = simulate(light, camera, layers=[asked], **given, **moves)
        assert (follows - seen).square().mean().sqrt() < 1.0  # of 4095: auto leaves out 0.1
        two = simulate(light.expand(2, -1, -1, -1), camera, layers=[[layer], []], **given, **moves)
        assert torch.equal(two[:1], seen)
        assert (two[1] - seen[0]).abs().max() > 100
        if "trajectory" not in moves:  # whose path is no tensor
            follows.square().mean().backward()
            assert bool(torch.as_tensor(asked.velocity_px_s).grad.abs().max() > 0)  # type: ignore[union-attr]
    readout = Readout(HEIGHT, 2e-4, EXPOSURE_S)
    expected = exposed(light, [layer], Displacement(torch.tensor([-3.0, 1.0]), T.float(), readout))
    sharp = simulate(expected.clamp(0, 1), Camera.preset("imx250"), **given)
    first = simulate(light, rolling, layers=[layer], **given, **ways[0][1])
    assert (first - sharp).abs().max() < 4  # what rings


def test_rows_of_a_reset_are_as_bright_with_objects() -> None:
    """Far from the object the picture is that without it, the last rows brighter."""
    light, path = STREET.float(), Trajectory.sinusoid(4.0, 90.0, 0.1)
    rows = 2e-4 * Camera.preset("imx250").field.per_sensor_px((HEIGHT, WIDTH))
    given: dict[str, Any] = {"exposure_s": EXPOSURE_S, "illuminance_lux": 50.0, "encoding": "linear"}
    given |= {"noise": False, "quantised": False, "velocity_px_s": (-300.0, 100.0), "fidelity": "full"}
    for shutter in ("global-reset", "rolling"):
        camera = replace(Camera.preset("imx250"), row_time_s=rows, shutter=shutter)
        for moves in ({}, {"trajectory": path}):
            seen = simulate(light, camera, layers=[thing((900.0, 200.0))], **given, **moves)
            alone = simulate(light, camera, **given, **moves)
            off = (seen - alone)[..., 8:-8, :8].square().mean().sqrt()
            assert off < 6, off  # of 4095; with objects shake and readout are before the lens
            assert (seen - alone)[..., 20:45, 36:60].abs().max() > 100
            if shutter == "global-reset":
                assert float(seen[..., 60:, :8].mean() / seen[..., :5, :8].mean()) > 1.3


def test_objects_that_overtake_the_rows() -> None:
    rolling = replace(Camera.preset("imx250"), row_time_s=1e-5, shutter="rolling")
    too_fast: dict[str, Any] = {"illuminance_lux": 10.0, "layers": [thing((0.0, 9e6))], "exposure_s": 0.001}
    with pytest.raises(ValueError, match="overtaken"):
        simulate(STREET.float(), rolling, **too_fast)
