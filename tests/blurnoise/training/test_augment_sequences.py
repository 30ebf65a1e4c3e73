"""RandomExposure in Kornia's sequences: boxes, masks and keypoints beside the picture, replay, video."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from kornia.augmentation import (
    AugmentationSequential,
    RandomHorizontalFlip,
    RandomVerticalFlip,
    VideoSequential,
)
from torch import Tensor

from blurnoise.training.augmentation import RandomExposure, expose_pictures

TWO = ("imx250", "ar0237")
STRAIGHT = {"exposure_s": 0.02, "illuminance_lux": 50.0, "speed_px_s": 500.0, "direction_deg": 30.0}  # 10 px
HALF_X, HALF_Y = 5 * math.cos(math.radians(30)), 5 * math.sin(math.radians(30))
LAST_X, LAST_Y = 79.0, 47.0  # boxes end in pixels, not at their edges: Kornia's xyxy_plus
BOX = torch.tensor([[[20.0, 12.0, 40.0, 30.0]]])
GROWN = torch.tensor([[[20 - HALF_X, 12 - HALF_Y, 40 + HALF_X, 30 + HALF_Y]]])


def in_sequence(
    box: Tensor, *others: Any, key: str = "bbox_xyxy", grow: bool = True, p: float = 1.0
) -> Tensor:
    aug = RandomExposure(**STRAIGHT, grow_boxes=grow, p=p)
    sequence = AugmentationSequential(aug, *others, data_keys=["input", key])
    image = torch.rand(len(box), 3, 48, 80)
    return sequence(image, box)[1]


def test_boxes_grow_to_what_is_swept() -> None:
    torch.testing.assert_close(in_sequence(BOX), GROWN)
    assert torch.equal(in_sequence(BOX, grow=False), BOX)


def test_what_is_swept_lies_within_the_grown_box_and_fills_it() -> None:
    """A bright square, blurred by 10 px: light of half a pixel's worth or more ends where the box ends."""
    image = torch.zeros(1, 1, 48, 80)
    image[..., 12:30, 20:40] = 1.0
    seen = expose_pictures(image, "imx250", **{**STRAIGHT, "direction_deg": 0.0}, encoding="linear")
    lit = (seen[0, 0] > 0.02 * seen.max()).nonzero()
    (top, left), (bottom, right) = lit.amin(0).tolist(), lit.amax(0).tolist()
    assert (left, right + 1) == (15, 45)
    assert (top, bottom + 1) == (12, 30)


@pytest.mark.parametrize("key", ["bbox", "bbox_xyxy", "bbox_xywh"])
def test_boxes_grow_in_every_format(key: str) -> None:
    def coded(box: Tensor) -> Tensor:
        if key == "bbox_xyxy":
            return box
        if key == "bbox_xywh":
            return torch.cat([box[..., :2], box[..., 2:] - box[..., :2]], -1)
        x0, y0, x1, y1 = box.unbind(-1)
        return torch.stack([x0, y0, x1, y0, x1, y1, x0, y1], -1).unflatten(-1, (4, 2))

    torch.testing.assert_close(in_sequence(coded(BOX), key=key), coded(GROWN))


def test_boxes_grow_along_with_flips() -> None:
    """Growth and a flip commute up to the direction's mirror image, which has the same extent."""
    left, top, right, bottom = GROWN.unbind(-1)
    mirrored = torch.stack([LAST_X - right, top, LAST_X - left, bottom], -1)
    torch.testing.assert_close(in_sequence(BOX, RandomHorizontalFlip(p=1.0)), mirrored)
    aug = RandomExposure(**STRAIGHT, grow_boxes=True, p=1.0)
    before = AugmentationSequential(
        RandomHorizontalFlip(p=1.0), RandomVerticalFlip(p=1.0), aug, data_keys=["input", "bbox_xyxy"]
    )(torch.rand(1, 3, 48, 80), BOX)[1]
    turned = torch.stack([LAST_X - right, LAST_Y - bottom, LAST_X - left, LAST_Y - top], -1)
    torch.testing.assert_close(before, turned)


def test_boxes_of_one_pixel_grow() -> None:
    point = torch.tensor([[[30.0, 20.0, 30.0, 20.0], [30.0, 20.0, 30.0, 33.0]]])
    by = torch.tensor([-HALF_X, -HALF_Y, HALF_X, HALF_Y])
    torch.testing.assert_close(in_sequence(point), point + by)


def test_boxes_grow_no_further_than_the_picture() -> None:
    """An edge within the picture stops at its border; one that lies beyond stays where it is."""
    boxes = torch.tensor([[[1.0, 1.0, 78.0, 46.0], [-3.0, -2.0, 85.0, 50.0]]])
    expected = torch.tensor([[[0.0, 0.0, LAST_X, LAST_Y], [-3.0, -2.0, 85.0, 50.0]]])
    torch.testing.assert_close(in_sequence(boxes), expected)


def test_boxes_grow_only_with_their_picture() -> None:
    torch.manual_seed(4)
    aug = RandomExposure(**STRAIGHT, grow_boxes=True, p=0.5)
    sequence = AugmentationSequential(aug, data_keys=["input", "bbox_xyxy"])
    boxes = BOX.expand(8, 2, 4).clone()
    _, grown = sequence(torch.rand(8, 3, 48, 80), boxes)
    chosen = aug._params["batch_prob"] > 0.5
    assert 0 < int(chosen.sum()) < 8
    torch.testing.assert_close(grown[chosen], GROWN.expand(int(chosen.sum()), 2, 4))
    assert torch.equal(grown[~chosen], boxes[~chosen])


def test_each_picture_of_a_ragged_batch_grows_by_its_own_motion() -> None:
    aug = RandomExposure(direction_deg=0.0, grow_boxes=True, p=1.0)
    sequence = AugmentationSequential(aug, data_keys=["input", "bbox_xyxy"])
    boxes = [BOX[0], BOX[0].repeat(3, 1)]
    _, grown = sequence(torch.rand(2, 3, 48, 400), boxes)
    half = (aug._params["exposure_s"] * aug._params["speed_px_s"] / 2).tolist()
    assert [len(each) for each in grown] == [1, 3]
    for each, by in zip(grown, half, strict=True):
        left = max(20 - by, 0.0)
        expected = torch.tensor([left, 12.0, 40 + by, 30.0]).expand(len(each), 4)
        torch.testing.assert_close(each, expected)


def test_masks_and_keypoints_stay() -> None:
    aug = RandomExposure(TWO, grow_boxes=True, p=0.7)
    sequence = AugmentationSequential(
        RandomHorizontalFlip(p=1.0), aug, data_keys=["input", "bbox_xyxy", "mask", "keypoints"]
    )
    flip = AugmentationSequential(RandomHorizontalFlip(p=1.0), data_keys=["input", "mask", "keypoints"])
    image, mask, points = torch.rand(3, 3, 48, 80), torch.rand(3, 1, 48, 80).round(), torch.rand(3, 5, 2) * 40
    _, _, seen_mask, seen_points = sequence(image, BOX.expand(3, 1, 4), mask, points)
    _, flipped_mask, flipped_points = flip(image, mask, points)
    assert torch.equal(seen_mask, flipped_mask)
    assert torch.equal(seen_points, flipped_points)


def test_sequences_replay() -> None:
    aug = RandomExposure(TWO, grow_boxes=True, p=0.5)
    sequence = AugmentationSequential(RandomHorizontalFlip(p=0.5), aug, data_keys=["input", "bbox_xyxy"])
    image, boxes = torch.rand(6, 3, 48, 80), BOX.expand(6, 1, 4)
    first, params = sequence(image, boxes), sequence._params
    sequence(image, boxes)
    for one, other in zip(first, sequence(image, boxes, params=params), strict=True):
        assert torch.equal(one, other)


def test_frames_of_a_video_share_their_conditions_and_noise() -> None:
    """Kornia gives all frames of a clip the same parameters, unless it is asked not to."""
    torch.manual_seed(1)
    aug = RandomExposure(TWO, p=0.6)
    clip = torch.rand(4, 1, 3, 12, 14).expand(4, 5, 3, 12, 14)
    out = VideoSequential(aug, data_format="BTCHW", same_on_frame=True)(clip)
    assert torch.equal(out, out[:, :1].expand_as(out))
    changed = (out != clip).flatten(1).any(1)
    assert 0 < int(changed.sum()) < 4
    apart = VideoSequential(RandomExposure(TWO, p=1.0), data_format="BTCHW", same_on_frame=False)(clip)
    assert not torch.equal(apart[0, 0], apart[0, 1])
