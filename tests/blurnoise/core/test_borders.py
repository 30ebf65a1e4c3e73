"""Continued pictures: OpenCV's route and the differentiable one agree, at any length."""

from __future__ import annotations

import pytest
import torch

from blurnoise._core.borders import BORDERS, Border, extended


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 2), (5, 7)])
def test_both_routes_agree(border: Border, size: tuple[int, int]) -> None:
    image = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(0))
    spans = (size[0] + 43, size[1] + 37)
    fast = extended(image, (20, 11), spans, border)
    slow = extended(image.clone().requires_grad_(), (20, 11), spans, border).detach()
    assert torch.equal(fast, slow)
    assert torch.equal(fast[..., 20 : 20 + size[0], 11 : 11 + size[1]], image)


def test_reflection_leaves_the_outermost_pixel_single() -> None:
    row = torch.tensor([[[[1.0, 2.0, 3.0]]]])
    assert extended(row, (0, 3), (1, 9), "reflect").flatten().tolist() == [2, 3, 2, 1, 2, 3, 2, 1, 2]
    assert extended(row, (0, 1), (1, 5), "constant").flatten().tolist() == [0, 1, 2, 3, 0]
    assert extended(row, (0, 4), (1, 8), "circular").flatten().tolist() == [3, 1, 2, 3, 1, 2, 3, 1]
