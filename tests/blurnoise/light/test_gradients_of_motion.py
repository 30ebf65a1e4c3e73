"""Gradients by exposure and velocity where rows or a path are part of the motion, against finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from blurnoise import Camera, Exposure, Layer, Trajectory, simulate

CAMERA = Camera.preset("imx250")
PATH = Trajectory.sinusoid(3.0, 80.0, 0.1, direction_deg=20.0)
MEAN = {"noise": False, "quantised": False, "encoding": "linear", "fidelity": "full", "illuminance_lux": 50.0}


def smooth(seed: int, height: int = 41, width: int = 53) -> Tensor:
    drawn = torch.rand(
        1, 1, height, width, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)
    )
    return avg_pool2d(drawn, 5, 1, 2)


def differences(f: Callable[[Tensor], Tensor], at: Tensor, step: float) -> Tensor:
    """Central ones, by the way that gradients are computed."""
    moves = step * torch.eye(at.numel(), dtype=at.dtype).view(-1, *at.shape)
    return torch.stack([(f(at + by) - f(at - by)).detach() / (2 * step) for by in moves]).view_as(at)


def test_light_that_rows_gain_by_a_global_reset_has_a_gradient() -> None:
    """1080 rows of 20 us at 1 ms: the last gains 21 times the exposure, of which longer exposures have less."""
    camera = replace(CAMERA, row_time_s=2e-5, shutter="global-reset")
    exposure = torch.tensor(1e-3, dtype=torch.float64, requires_grad=True)

    def mean(exposure_s: Tensor) -> Tensor:
        return simulate(smooth(0), camera, exposure_s=exposure_s, **MEAN).mean()

    (found,) = torch.autograd.grad(mean(exposure), exposure)
    assert float(found) == pytest.approx(float(differences(mean, exposure, 1e-6)), rel=1e-6)


@pytest.mark.parametrize("layers", [False, True])
def test_velocity_beside_a_path_has_a_gradient(layers: bool) -> None:
    weight = smooth(1)
    block = Layer(smooth(2, 12, 14)[0], torch.ones(12, 14, dtype=torch.float64), (500.0, 100.0), (20, 14))
    velocity = torch.tensor([300.0, -200.0], dtype=torch.float64, requires_grad=True)

    def mean(velocity_px_s: Tensor) -> Tensor:
        moving = {"velocity_px_s": velocity_px_s, "trajectory": PATH, "layers": [block] if layers else ()}
        return (weight * simulate(smooth(0), CAMERA, exposure_s=0.01, **moving, **MEAN)).mean()

    (found,) = torch.autograd.grad(mean(velocity), velocity)
    torch.testing.assert_close(found, differences(mean, velocity.detach(), 0.5), rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("layers", [False, True])
@pytest.mark.parametrize("shutter", ["global", "rolling", "global-reset"])
@pytest.mark.parametrize("moving", ["straight", "path", "both", "flow"])
def test_exposure_has_the_gradient_of_what_it_sees(moving: str, shutter: str, layers: bool) -> None:
    """Contrast over the exposure falls by 27 000 per second of straight motion; against frames without gradients,
    which other ways may have made."""
    camera = replace(CAMERA, row_time_s=2e-6 * (shutter != "global"), shutter=shutter)
    still = smooth(3)
    block = Layer(smooth(2, 12, 14)[0], torch.ones(12, 14, dtype=torch.float64), (500.0, 100.0), (20, 14))
    velocity = torch.tensor([300.0, -200.0], dtype=torch.float64) * (moving != "path")
    if moving == "flow":
        velocity = velocity[:, None, None] * torch.linspace(0.5, 1.5, 53, dtype=torch.float64).expand(
            2, 41, 53
        )
    given = {"velocity_px_s": velocity, "trajectory": PATH if moving in ("path", "both") else None}
    given |= {"layers": [block] if layers else ()}

    def mean(exposure_s: Tensor) -> Tensor:
        light = simulate(still, camera, exposure_s=exposure_s, **given, **MEAN) - camera.black_level_dn
        return ((still - 0.5) * light / exposure_s).mean()

    exposure = torch.tensor(0.01, dtype=torch.float64, requires_grad=True)
    (found,) = torch.autograd.grad(mean(exposure), exposure)
    expected = float(differences(mean, exposure.detach(), 1e-4))
    assert float(found) == pytest.approx(expected, abs=400.0)


def test_boxes_of_integers_are_not_truncated() -> None:
    camera = replace(CAMERA, row_time_s=1e-5, shutter="rolling")
    of = Exposure(camera, 0.01, 5.0, (100.0, 50.0))
    whole = torch.tensor([[1, 2, 30, 40]])
    assert torch.equal(of.move_boxes(whole), of.move_boxes(whole.float()))
