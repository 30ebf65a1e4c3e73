"""Development: digital numbers of every type, and none that is none; what is kept, and compiled code."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from blurnoise import Camera, develop, simulate
from blurnoise._core import rng
from blurnoise._core.lookup import look_up
from blurnoise.picture.develop import develop_8bit
from blurnoise.training.augmentation import RandomExposure, expose_pictures

CAMERA = replace(Camera.preset("ar0237"), black_level_dn=64.0)
NUMBERS = torch.arange(0, CAMERA.full_scale_dn + 1, 7)[None, None]
LIT = {"exposure_s": 0.01, "illuminance_lux": 50.0}


def test_frames_that_were_not_rounded_keep_their_fractions() -> None:
    camera = Camera.preset("imx250")
    dn = torch.tensor([[[[52.7, 52.0, 53.0]]]], dtype=torch.float64)
    span = camera.full_scale_dn - camera.black_level_dn
    told = (develop(dn, camera, encoding="linear") * span + camera.black_level_dn).flatten().tolist()
    assert told == pytest.approx([52.7, 52.0, 53.0], abs=1e-9)


@pytest.mark.parametrize(
    "kind", [torch.int16, torch.int32, torch.int64, torch.uint16, torch.uint32, torch.float64]
)
@pytest.mark.parametrize("encoding", ["srgb", "linear"])
def test_integers_are_digital_numbers(kind: torch.dtype, encoding: str) -> None:
    expected = develop(NUMBERS.float(), CAMERA, encoding=encoding)  # type: ignore[arg-type]
    assert float(expected.max()) > 0.99
    found = develop(NUMBERS.to(kind), CAMERA, encoding=encoding)  # type: ignore[arg-type]
    assert found.dtype == (kind if kind.is_floating_point else torch.float32)
    assert torch.equal(found.float(), expected)
    assert torch.equal(develop_8bit(NUMBERS.to(kind), CAMERA), develop_8bit(NUMBERS.float(), CAMERA))


def test_bytes_are_digital_numbers() -> None:
    eight = replace(CAMERA, bit_depth=8, black_level_dn=4.0)
    dn = torch.arange(256, dtype=torch.uint8)
    assert torch.equal(develop(dn, eight), develop(dn.float(), eight))
    assert int(develop_8bit(dn, eight).max()) == 255


@pytest.mark.parametrize("kind", [torch.float32, torch.float64, torch.int64])
def test_numbers_beyond_the_converter_are_its_ends(kind: torch.dtype) -> None:
    """A float beyond 2**31, as an integer of 32 bits, would be a negative number: black instead of white."""
    dn = torch.tensor([-5, 1 << 40, 1 << 20], dtype=torch.int64).to(kind)
    assert develop(dn, CAMERA).tolist() == pytest.approx([0.0, 1.0, 1.0])
    assert look_up(torch.tensor([3.0, 4.0]), dn).tolist() == [3.0, 4.0, 4.0]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("by", [develop, develop_8bit])
def test_what_is_no_number_is_not_black(bad: float, by: Callable[..., Tensor]) -> None:
    dn = NUMBERS.float()
    dn[0, 0, 3] = bad
    with pytest.raises(ValueError, match="dn: contains NaN or Inf"):
        by(dn, CAMERA)


@pytest.mark.parametrize("kind", [torch.bool, torch.float16, torch.bfloat16, torch.complex64])
def test_other_types_are_refused(kind: torch.dtype) -> None:
    with pytest.raises(TypeError, match="dn: must be integers, float32 or float64, got torch"):
        develop(torch.zeros(1, 2, dtype=kind), CAMERA)


def test_what_inference_kept_serves_gradients() -> None:
    camera = replace(CAMERA, prnu=0.0123, dsnu_e=1.5, read_noise_e=0.5, name="kept")
    picture = torch.full((1, 3, 21, 17), 0.5)
    with torch.inference_mode():
        first = develop(simulate(picture, camera, **LIT, generator=[1]), camera)
        assert all(not kept.is_inference() for kept in camera.fixed_pattern((3, 21, 17), 0))
    lux = torch.tensor(50.0, requires_grad=True)
    dn = simulate(picture, camera, exposure_s=0.01, illuminance_lux=lux, generator=[1])
    develop(dn, camera).mean().backward()
    assert lux.grad is not None
    assert float(lux.grad) > 0
    assert float((develop(dn, camera).detach() - first).abs().mean()) < 0.1


@pytest.mark.parametrize("seed", [np.int64(7), np.uint8(7)])
def test_numpys_integers_are_seeds(seed: np.integer) -> None:
    assert rng.item_seeds([seed], 1) == [7]
    assert rng.item_seeds(seed, 1) == [7]  # type: ignore[arg-type]
    assert rng.item_seeds(torch.tensor([7, 8]), 2) == [7, 8]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "bad", ["ab", 1.5, [1.5], [None], [True], [2**63], [-1], pytest.param(10**5000, id="long"), {}]
)
def test_other_seeds_are_named(bad: object) -> None:
    with pytest.raises((TypeError, ValueError), match="generator") as error:
        rng.item_seeds(bad, 1)  # type: ignore[arg-type]
    assert len(str(error.value)) < 250


@pytest.mark.parametrize("chain", [simulate, expose_pictures])
def test_compiled_code_breaks_its_graph_at_the_simulator(chain: Callable[..., Tensor]) -> None:
    picture = torch.rand(2, 3, 23, 31, generator=torch.Generator().manual_seed(3))

    def model(image: Tensor) -> Tensor:
        return 2 * chain(image / 2, CAMERA, **LIT, generator=[1, 2])

    try:
        assert torch.equal(torch.compile(model, backend="eager")(picture), model(picture))
    finally:
        torch._dynamo.reset()


@pytest.mark.slow
def test_the_augmentations_parameters_say_all_in_compiled_code() -> None:
    picture = torch.rand(2, 3, 23, 31, generator=torch.Generator().manual_seed(3))
    augmentation = RandomExposure(CAMERA, p=1.0)
    try:
        compiled = torch.compile(augmentation, backend="eager")(picture)
        assert torch.equal(augmentation(picture, params=augmentation._params), compiled)
    finally:
        torch._dynamo.reset()


@pytest.mark.parametrize("kind", [torch.uint8, torch.int8, torch.int16, torch.int64])
@pytest.mark.parametrize("bit_depth", [6, 12, 16])
def test_integers_narrower_and_wider_than_the_converter(kind: torch.dtype, bit_depth: int) -> None:
    camera = replace(Camera.preset("imx250"), bit_depth=bit_depth, black_level_dn=0.0)
    dn = torch.tensor([-3, 0, 5, 63, 100, 127]).clamp_min(torch.iinfo(kind).min)
    expected = develop(dn.double().clamp(0, camera.full_scale_dn), camera)
    torch.testing.assert_close(develop(dn.to(kind), camera).double(), expected, rtol=0, atol=1e-7)
