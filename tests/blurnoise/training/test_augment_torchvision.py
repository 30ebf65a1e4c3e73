"""The torchvision transform: the same pictures as the Kornia class, every type back as it came."""

import importlib.util
from typing import Any

import numpy as np
import pytest
import torch
import torchvision_ops
from exposures import exposed
from torch import Tensor

from blurnoise._core import rng
from blurnoise.motion.ego import Vehicle
from blurnoise.training.source import DRAWN
from blurnoise.training.table import ExposureTable

pytest.importorskip("PIL")
if importlib.util.find_spec("torchvision") is None:
    pytest.skip("torchvision is not installed", allow_module_level=True)

torchvision_ops.detectors()  # so that its Python loads beside another build of torch

import PIL.Image  # noqa: E402
from torchvision import tv_tensors  # noqa: E402

from blurnoise.training.torchvision import RandomExposureV2  # noqa: E402

LIT: dict[str, Any] = {"exposure_s": 0.02, "illuminance_lux": 50.0}
STRAIGHT: dict[str, Any] = {**LIT, "speed_px_s": 500.0, "direction_deg": 0.0, "p": 1.0}
"""10 px, so 5 px to each side."""
SIZE = (48, 80)
ROAD = Vehicle(hfov_deg=60.0, lens="rectilinear")
TABLE = ExposureTable.of_grid(
    "imx250", exposure_s=(0.001, 0.01), illuminance_lux=(5.0, 50.0), speed_px_s=(0.0, 300.0)
)


def picture(*shape):
    return torch.rand(*(shape or (3, *SIZE)), generator=torch.Generator().manual_seed(2))


def boxes(values, form="XYXY", dtype=torch.float32):
    return tv_tensors.BoundingBoxes(torch.tensor([values], dtype=dtype), format=form, canvas_size=SIZE)


@pytest.mark.parametrize("of", ["ranges", "road", "table"])
def test_exposes_as_the_functional_twin_does(of):
    ways = {
        "ranges": (
            RandomExposureV2("imx250", encoding="linear", gain_db=0.0, p=1.0),
            DRAWN,
            {"encoding": "linear"},
        ),
        "road": (
            RandomExposureV2("imx250", **LIT, gain_db=0.0, p=1.0, ego_kmh=90.0, vehicle=ROAD),
            (*DRAWN, "ego_kmh"),
            {"vehicle": ROAD},
        ),
        "table": (RandomExposureV2(table=TABLE, p=1.0), DRAWN, {}),
    }
    transform, drawn, fixed = ways[of]
    params = transform.make_params([])
    given = {name: params[name] for name in drawn if name in params} | fixed
    seed = rng.item_seeds(torch.Generator().manual_seed(int(params["noise_seed"])), 1)
    expected = exposed(picture()[None], "imx250", **given, seeds=seed)
    assert torch.equal(transform.transform(picture(), params), expected[0])


def test_parameters_follow_torchs_seed():
    transform = RandomExposureV2(("imx250", "ar0237"), p=1.0)
    outs = []
    for seed in (1, 1, 2):
        torch.manual_seed(seed)
        outs.append(transform(picture()))
    assert torch.equal(outs[0], outs[1])
    assert not torch.equal(outs[0], outs[2])


def test_all_types_come_back_as_they_came():
    """8 bits are float's values, rounded: no scale and no bias between them."""
    transform = RandomExposureV2(**STRAIGHT)
    params = transform.make_params([])
    eight = picture().mul(255).round().to(torch.uint8)
    expected = transform.transform(eight.float() / 255, params)
    out = transform.transform(eight, params)
    assert out.dtype == torch.uint8
    assert torch.equal(out, (expected * 255).round().byte())
    image = transform.transform(tv_tensors.Image(eight), params)
    assert isinstance(image, tv_tensors.Image)
    assert torch.equal(image, out)
    pil = transform.transform(PIL.Image.fromarray(eight.permute(1, 2, 0).numpy()), params)
    assert isinstance(pil, PIL.Image.Image)
    assert np.array_equal(np.asarray(pil), out.permute(1, 2, 0).numpy())
    grey = transform.transform(PIL.Image.fromarray(eight[0].numpy()), params)
    assert (grey.mode, grey.size) == ("L", (80, 48))
    half = transform.transform(picture().half(), params)
    assert half.dtype == torch.float16


@pytest.mark.parametrize("shape", [(5, 3, *SIZE), (2, 3, 1, *SIZE)])
def test_frames_share_conditions_but_not_noise(shape):
    video = RandomExposureV2(**STRAIGHT)(tv_tensors.Video(picture(*shape[-3:]).expand(shape)))
    assert isinstance(video, tv_tensors.Video)
    assert video.shape == shape
    frames = video.reshape(-1, *shape[-3:])
    assert not torch.equal(frames[0], frames[1])
    assert float((frames[0].mean() - frames[1].mean()).abs()) < 0.01


@pytest.mark.parametrize(
    ("form", "before", "after"),
    [
        ("XYXY", [20, 12, 40, 30], [15, 12, 45, 30]),
        ("XYWH", [20, 12, 20, 18], [15, 12, 30, 18]),
        ("CXCYWH", [30, 21, 20, 18], [30, 21, 30, 18]),
        ("XYXY", [2, 12, 78, 30], [0, 12, 80, 30]),
        ("XYXY", [-3, 12, 85, 30], [-3, 12, 85, 30]),
    ],
)
def test_boxes_grow_to_what_is_swept(form, before, after):
    transform = RandomExposureV2(**STRAIGHT, grow_boxes=True)
    _, grown = transform(tv_tensors.Image(picture()), boxes(before, form))
    assert isinstance(grown, tv_tensors.BoundingBoxes)
    assert (grown.format.value, grown.canvas_size) == (form, SIZE)
    torch.testing.assert_close(grown.as_subclass(Tensor), torch.tensor([after]).float())
    _, kept = RandomExposureV2(**STRAIGHT)(tv_tensors.Image(picture()), boxes(before, form))
    assert torch.equal(kept, boxes(before, form))


def test_whole_boxes_grow_by_whole_pixels():
    transform = RandomExposureV2(**{**STRAIGHT, "speed_px_s": 420.0}, grow_boxes=True)
    _, grown = transform(picture(), boxes([20, 12, 40, 30], dtype=torch.int64))
    assert (grown.dtype, grown.tolist()) == (torch.int64, [[15, 12, 45, 30]])  # 4.2 px to each side


@pytest.mark.parametrize("moves", ["targets", "background"])
def test_masks_of_a_sample_say_what_moves(moves):
    """One (N, H, W) of all its objects, or one each; boxes of what the camera follows do not grow."""
    image, box = picture(), boxes([30.0, 20.0, 50.0, 36.0])
    masks = torch.zeros(2, *SIZE, dtype=torch.uint8)
    masks[0, 20:36, 30:40] = masks[1, 20:36, 40:50] = 1
    transform = RandomExposureV2(**STRAIGHT, moves=moves, grow_boxes=True)

    def taken(*sample):
        torch.manual_seed(3)
        return transform(*sample)

    seen, kept, grown = taken(image, tv_tensors.Mask(masks), box)
    assert torch.equal(taken(image, tv_tensors.Mask(masks[0]), tv_tensors.Mask(masks[1]))[0], seen)
    assert torch.equal(kept, masks)
    assert grown.tolist() == ([[25.0, 20.0, 55.0, 36.0]] if moves == "targets" else box.tolist())
    whole, whole_box = taken(image, box)
    assert not torch.equal(whole, seen)
    assert whole_box.tolist() == [[25.0, 20.0, 55.0, 36.0]]


def test_wrong_arguments_and_pictures_are_named():
    with pytest.raises(ValueError, match="p = 2"):
        RandomExposureV2(p=2)
    transform = RandomExposureV2(**STRAIGHT, grow_boxes=True)
    with pytest.raises(TypeError, match=r"image.*uint8 or float.*int32"):
        transform(torch.zeros(3, 4, 5, dtype=torch.int32))
    with pytest.raises(ValueError, match=r"image.*RGBA"):
        transform(PIL.Image.new("RGBA", (5, 4)))
    with pytest.raises(TypeError, match="XYWHR"):
        transform(picture(), boxes([20, 12, 40, 30, 10], "XYWHR"))
