"""Blur whose reach is known: shapes alone decide all work, so that no value is pulled from the pictures' device."""

import pytest
import torch

from blurnoise.blur import fourier
from blurnoise.camera.transfer import Optics


class Bounded(fourier.Straight):
    """Motion of at most 9 px across and 3 px down, which a caller knows without looking at the device."""

    most_px = (9.0, 3.0)


@pytest.mark.parametrize("border", ["reflect", "replicate", "circular", "constant"])
def test_no_value_is_pulled(border):
    """PyTorch's meta device has no values, and mixes with no constant of the CPU's."""
    picture, moved = torch.empty(2, 3, 21, 34, device="meta"), torch.empty(2, 2, device="meta")
    seen = fourier.apply(picture, Bounded(moved, Optics(gaussian_sigma_px=1.0)), border)
    assert (seen.device.type, seen.shape) == ("meta", picture.shape)
    with pytest.raises(NotImplementedError, match="Cannot copy out of meta tensor"):
        _ = fourier.Straight(moved).most_px  # the one that is


class _Blur(torch.nn.Module):
    def forward(self, picture, moved):
        return fourier.apply(picture, Bounded(moved), "reflect")


@pytest.mark.slow
def test_it_is_exported_and_compiled_whole():
    """With gradients; without them the CPU's route is OpenCV's."""
    drawn = torch.Generator().manual_seed(1)
    first, other = (torch.rand(2, 3, 21, 34, generator=drawn).requires_grad_() for _ in range(2))
    exported = torch.export.export(_Blur(), (first, torch.tensor([[9.0, 3.0]] * 2)), strict=False).module()
    moved = torch.tensor([[-5.0, 3.0], [2.0, 0.5]])
    expected = _Blur()(other, moved)
    torch.testing.assert_close(exported(other, moved), expected, rtol=0, atol=0)
    weights = torch.rand(expected.shape, generator=drawn)
    gradients = [
        torch.autograd.grad((seen * weights).sum(), other)[0] for seen in (exported(other, moved), expected)
    ]
    torch.testing.assert_close(*gradients)
    compiled = torch.compile(exported, fullgraph=True, backend="aot_eager")
    torch.testing.assert_close(compiled(other, moved), expected)
