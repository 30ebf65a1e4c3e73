"""Gradients of the mean frame and of a noisy one, against finite differences."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from blurnoise import Camera, simulate

CAMERA = Camera(
    name="smooth",
    pixel_pitch_um=4.0,
    f_number=2.8,
    transmission=0.9,
    quantum_efficiency=0.5,
    full_well_e=9000.0,
    system_gain_dn_per_e=0.4,
    read_noise_e=2.5,
    dark_current_e_s=200.0,
    prnu=0.01,
    dsnu_e=3.0,
    black_level_dn=60.0,
    defocus_radius_px=1.2,
)
INPUTS = {"image": 0, "exposure_s": 1, "illuminance_lux": 2, "velocity_px_s": 3, "temperature_c": 4}


def scene() -> list[Tensor]:
    image = 0.1 + 0.8 * torch.rand(
        1, 1, 9, 11, generator=torch.Generator().manual_seed(1), dtype=torch.float64
    )
    scalars = (torch.tensor(value, dtype=torch.float64) for value in (0.01, 40.0))
    velocity = torch.tensor([230.0, -110.0], dtype=torch.float64)
    return [image, *scalars, velocity, torch.tensor(35.0, dtype=torch.float64)]


def frame(
    image: Tensor, exposure: Tensor, lux: Tensor, velocity: Tensor, temperature: Tensor, **options: object
) -> Tensor:
    return simulate(
        image,
        options.pop("camera", CAMERA),  # type: ignore[arg-type]
        exposure_s=exposure,
        illuminance_lux=lux,
        velocity_px_s=velocity,
        temperature_c=temperature,
        encoding="linear",
        generator=[7],
        **options,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("name", INPUTS)
def test_gradients_are_those_of_finite_differences(name: str, noise: bool) -> None:
    inputs = scene()
    varied = inputs[INPUTS[name]].requires_grad_()

    def of(value: Tensor) -> Tensor:
        given = [*inputs]
        given[INPUTS[name]] = value
        return frame(*given, noise=noise, quantised=False)

    assert torch.autograd.gradcheck(of, (varied,), eps=1e-6, atol=1e-3, rtol=1e-3)


def test_the_reparameterised_frame_has_the_laws_moments() -> None:
    """What the gradient flows through is the noisy frame itself, not another."""
    inputs = scene()
    inputs[0].requires_grad_()
    through = frame(*inputs, fidelity="full").detach()
    with torch.no_grad():
        without = frame(*inputs)
    assert torch.equal(through, through.round())
    assert float((through - without).abs().max()) <= 1.0  # a rounding step at most: auto left little out


def test_rounding_lets_gradients_through_and_clipping_does_not() -> None:
    inputs = scene()
    image = inputs[0].requires_grad_()
    frame(*inputs).sum().backward()
    assert image.grad is not None
    assert float(image.grad.abs().min()) > 0
    image.grad = None
    inputs[2] = torch.tensor(1e6, dtype=torch.float64)
    frame(*inputs).sum().backward()
    assert float(image.grad.abs().max()) == 0


@pytest.mark.parametrize("read_noise_e", [0.0, 0.1, 0.24])
def test_gradients_stay_finite_without_light_or_read_noise(read_noise_e: float) -> None:
    inputs = scene()
    inputs[0] = torch.zeros_like(inputs[0])
    for value in inputs:
        value.requires_grad_()
    camera = replace(CAMERA, read_noise_e=read_noise_e, dark_current_e_s=0.0)
    frame(*inputs, camera=camera).sum().backward()
    for value in inputs[:4]:
        assert value.grad is not None
        assert torch.isfinite(value.grad).all()
