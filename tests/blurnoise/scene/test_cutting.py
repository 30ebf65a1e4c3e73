"""Mattes: objects cut out of pictures, and what is behind them."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import segmentation

from blurnoise import expose_layers
from blurnoise.scene import cutting

SIZE = (61, 84)


def box_of_light(*, soft: bool) -> tuple[torch.Tensor, np.ndarray]:
    """A red square before a grey slope, and its matte; soft: its edges half a pixel."""
    matte = (
        segmentation.of_box(30.5, 20.5, 20, 16, SIZE) if soft else segmentation.of_box(30, 20, 20, 16, SIZE)
    )
    behind = torch.linspace(0.2, 0.6, SIZE[1]).expand(1, 3, *SIZE)
    red = torch.tensor([0.8, 0.1, 0.05])[None, :, None, None]
    share = torch.from_numpy(matte)
    return red * share + (1 - share) * behind, matte


# --- cut out ----------------------------------------------------------------


def test_an_object_is_cut_out_with_its_own_colours() -> None:
    """The mixed edge of the picture is no part of the object's colour: a plain blend would keep the grey."""
    light, matte = box_of_light(soft=True)
    cut = cutting.cut_out(light, [matte], [(100.0, 0.0)])
    (layer,) = cut.layers
    assert layer.place_px == (30, 20)
    assert tuple(layer.alpha.shape) == (17, 21)
    for channel, own in enumerate((0.8, 0.1, 0.05)):
        assert float((layer.light[channel][layer.alpha > 0] - own).abs().max()) < 1e-3
    assert float((light[0, 1, 28, 30] - 0.1).abs()) > 0.05


def test_what_is_behind_is_invented_there_alone() -> None:
    light, matte = box_of_light(soft=True)
    cut = cutting.cut_out(light, [matte], [(100.0, 0.0)])
    expected = torch.linspace(0.2, 0.6, SIZE[1]).expand(1, 3, *SIZE)
    assert bool((cut.background == light)[..., torch.from_numpy(~cut.invented)].all())
    assert float((cut.background - expected).abs().max()) < 0.08  # of a slope of 0.1 across the hole
    assert float((cut.background - expected).abs().mean()) < 0.005
    grown = np.zeros(SIZE, bool)
    grown[18:39, 28:53] = True
    assert (cut.invented == grown).all()


def test_together_again_they_are_the_picture() -> None:
    light, matte = box_of_light(soft=False)
    cut = cutting.cut_out(light, [matte], [(0.0, 0.0)])
    seen = expose_layers(cut.background, cut.layers, exposure_s=0.0)
    around = np.zeros(SIZE, bool)
    around[18:38, 28:52] = True
    around[20:36, 30:50] = False
    assert float((seen - light)[..., torch.from_numpy(~around)].abs().max()) < 1e-6
    assert float((seen - light)[..., torch.from_numpy(around)].abs().max()) < 0.08


def test_a_plate_is_not_invented() -> None:
    light, matte = box_of_light(soft=False)
    plate = torch.full_like(light, 0.25)
    cut = cutting.cut_out(light, [matte], [(0.0, 0.0)], plate)
    assert cut.background is plate
    assert not cut.invented.any()


def test_an_object_at_the_border_goes_on() -> None:
    light = torch.full((1, 3, *SIZE), 0.5)
    matte = segmentation.of_box(0, 20, 12, 16, SIZE)
    light[..., 20:36, :12] = 0.9
    light[..., 20:36, 0] = 0.7  # not mixed with anything: the object's own
    (layer,) = cutting.cut_out(light, [matte], [(0.0, 0.0)]).layers
    assert float((layer.light[:, 2:-2, 0] - 0.7).abs().max()) == 0.0


def test_what_cannot_be_cut_out() -> None:
    light, matte = box_of_light(soft=False)
    for wrong, message in (
        (np.zeros(SIZE, np.float32), "is empty"),
        (matte[1:], "must be the picture's"),
        (matte * np.float32(np.nan), "contains NaN or Inf"),
        (np.ones(SIZE, np.float32), "there must be a plate"),
    ):
        with pytest.raises(ValueError, match=message):
            cutting.cut_out(light, [wrong], [(0.0, 0.0)])
    with pytest.raises(ValueError, match="plate: shape"):
        cutting.cut_out(light, [matte], [(0.0, 0.0)], light[..., 1:])


def test_what_is_of_another_kind() -> None:
    light, matte = box_of_light(soft=False)
    with pytest.raises(TypeError, match=r"matte: must be a numpy.ndarray, got Tensor"):
        cutting.cut_out(light, [torch.from_numpy(matte)], [(0.0, 0.0)])  # type: ignore[list-item]


@pytest.mark.parametrize("size", [(0, 5), (5, -1), (5.5, 4), (1 << 20, 1 << 20), (5,), "no"])
def test_sizes_that_are_none(size: object) -> None:
    with pytest.raises((TypeError, ValueError), match="size = ") as error:
        segmentation.of_box(0, 0, 3, 3, size)  # type: ignore[arg-type]
    assert "\n" not in str(error.value)
