"""Labels under an exposure: masks and keypoints stand where the exposed object is, and in every door alike."""

from typing import Any

import numpy as np
import pytest
import torch
from exposures import exposed, exposures
from kornia.augmentation import (
    AugmentationSequential,
    CenterCrop,
    RandomHorizontalFlip,
    Resize,
    VideoSequential,
)

from blurnoise import Camera, Exposure, RandomExposure, labels_numpy
from blurnoise.camera.distortion import Distortion
from blurnoise.motion.trajectory import shake
from blurnoise.training.labels import keypoints_after, masks_after, of_targets

SIZE = H, W = (121, 163)
GLOBAL = Camera.preset("imx250").with_figures(read_noise_e=0.1, dark_current_e_s=0.0)
ROLLING = GLOBAL.with_figures(shutter="rolling", row_time_s=8e-6)
READOUT_S = 8e-6 * GLOBAL.sensor.height_px  # 16 ms
BARREL = Distortion("opencv", (-0.2, 0.02, 0.001, 0.002))
CAMERAS = {
    "rolling": ROLLING,
    "upwards": ROLLING.with_figures(scan="up"),
    "reset": ROLLING.with_figures(shutter="global-reset"),
    "barrel": GLOBAL.with_figures(distortion=BARREL),
    "pincushion": GLOBAL.with_figures(distortion=Distortion("opencv", (0.2, 0.0, 0.0, 0.0))),
    "rolling barrel": ROLLING.with_figures(distortion=BARREL),
}
LIT: dict[str, Any] = {"exposure_s": 0.004, "illuminance_lux": 80.0, "encoding": "linear"}
MOTIONS: dict[str, dict[str, Any]] = {
    "right": {"speed_px_s": 1000.0},
    "up": {"speed_px_s": 900.0, "direction_deg": 100.0},
    "down": {"speed_px_s": 1000.0, "direction_deg": 250.0},
    "drive": {"ego_kmh": 60.0},
    "shake": {"speed_px_s": 500.0, "trajectory": shake(3, 12.0, 0.004, duration_s=0.06)},
}
SQUARES = ((12, 12, 42, 46), (84, 20, 112, 52), (46, 66, 78, 98), (14, 116, 44, 150))
AT: dict[str, Any] = {"exposure_s": 0.004, "speed_px_s": 900.0, "direction_deg": 30.0}


def squares():
    """Pictures of one white square each, (N, 3, H, W), and its centre, px from that of the first pixel."""
    image = torch.zeros(len(SQUARES), 3, H, W, dtype=torch.float64)
    for picture, (top, left, bottom, right) in zip(image, SQUARES, strict=True):
        picture[:, top:bottom, left:right] = 1.0
    centres = [[(left + right - 1) / 2, (top + bottom - 1) / 2] for top, left, bottom, right in SQUARES]
    return image, torch.tensor(centres, dtype=torch.float64)


def centroid(plane):
    y, x = torch.meshgrid(torch.arange(H), torch.arange(W), indexing="ij")
    return torch.stack([(plane * x).sum(), (plane * y).sum()]) / plane.sum()


def iou(one, other):
    return float((one & other).sum() / (one | other).sum())


@pytest.mark.parametrize(
    "motion", ["right", "up", "down", "drive", pytest.param("shake", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("camera", CAMERAS)
def test_masks_and_keypoints_are_where_the_object_is(camera, motion):
    """Beside half of the light of a white picture, whose rows may be exposed longer than others.

    The edge of a mask is off by up to half a pixel: 2 of 30 px of a square. A blur's centroid weighs the rows that a
    vertical motion spreads over; a lens images the centre of a square .7 px from the centroid of its image.
    """
    image, centres = squares()
    conditions = {**LIT, **MOTIONS[motion]}
    scene = torch.cat([image, torch.ones_like(image[:1])])
    seen = exposed(scene, CAMERAS[camera], seeds=[1] * len(scene), **conditions).mean(1)
    share = (seen[:-1] / seen[-1].clamp_min(0.02)).clamp(0, 1)
    del conditions["encoding"]
    by = exposures(CAMERAS[camera], **conditions)
    masks = masks_after(image[None, :, 0] > 0, by)[0]
    points = keypoints_after(centres[None], by, SIZE)[0]
    for light, mask, point in zip(share, masks, points, strict=True):
        assert iou(light > 0.5, mask) > 0.88
        assert float((centroid(light * (light > 0.1)) - centroid(mask.double())).norm()) < 0.7
        assert float((centroid(mask.double()) - point).norm()) < 1.0
    before = [iou(light > 0.5, plane[0] > 0) for light, plane in zip(share, image, strict=True)]
    assert min(before) < (0.96 if "reset" in camera or motion == "drive" else 0.87)


@pytest.mark.parametrize("dtype", [torch.bool, torch.uint8, torch.int64, torch.float16, torch.float32])
def test_masks_of_any_type_keep_their_labels(dtype):
    ids = torch.randint(0, 2 if dtype == torch.bool else 120, (2, 3, H, W)).to(dtype)
    moved = masks_after(ids, exposures(CAMERAS["rolling barrel"], 2, **AT))
    assert (moved.dtype, moved.shape) == (dtype, ids.shape)
    assert set(moved.unique().tolist()) <= {*ids.unique().tolist(), 0}
    assert bool((moved[..., 0, 0] == 0).all())  # where the lens sees beyond the picture
    assert bool((moved != ids).any())


def test_labels_of_a_global_shutter_stay_and_those_of_what_is_followed():
    masks, points = torch.rand(1, 1, *SIZE), torch.rand(1, 4, 2)
    by = exposures(GLOBAL, **AT)
    assert torch.equal(masks_after(masks, by), masks)
    assert torch.equal(keypoints_after(points, by, SIZE), points)
    target = torch.zeros(1, 1, *SIZE)
    target[..., 10:30, 10:30] = 1.0
    followed = of_targets(exposures(ROLLING, moves="background", **AT), target)
    assert torch.equal(masks_after(target, followed), target)


def test_keypoints_beyond_the_picture_and_unknown_ones():
    far = torch.tensor([[[-1e9, 60.0], [40.0, 1e9], [-3.0, -5.0], [float("nan"), 7.0]]], dtype=torch.float64)
    moved = keypoints_after(far, exposures(ROLLING, exposure_s=0.004, speed_px_s=900.0), SIZE)[0]
    assert moved[0].tolist() == pytest.approx([-1e9, 60.0])
    assert moved[1].tolist() == pytest.approx(
        [40.0 + 900.0 * READOUT_S / 2, 1e9], rel=0.02
    )  # as the last row
    assert moved[2, 0] < -3.0
    assert bool(moved[3].isnan().any())
    driving = exposures(CAMERAS["rolling barrel"], exposure_s=0.004, ego_kmh=60.0)
    assert bool(keypoints_after(far[:, 2:3], driving, SIZE).isfinite().all())


def test_kornia_moves_labels_as_the_numpy_door_does():
    """Through a flip before and after; a clip's frames share their conditions."""
    image, centres = squares()
    aug = RandomExposure(CAMERAS["rolling barrel"], illuminance_lux=80.0, p=1.0, **AT)
    boxes = torch.tensor([[left, top, right - left, bottom - top] for top, left, bottom, right in SQUARES])
    keys = ["input", "mask", "keypoints", "bbox_xywh"]
    given = image[:1], image[None, :, 0] > 0, centres[None], boxes[None].double()
    _, masks, points, found = AugmentationSequential(aug, data_keys=keys)(*given)
    edges = torch.cat([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], 1).numpy()
    arrays = {"label_masks": given[1][0].numpy(), "keypoints": centres.numpy(), "boxes": edges}
    expected = labels_numpy((H, W, 3), exposures(CAMERAS["rolling barrel"], **AT), **arrays)
    assert np.array_equal(masks[0].numpy(), expected.label_masks)
    np.testing.assert_allclose(points[0].numpy(), expected.keypoints, atol=1e-3)
    wanted = np.concatenate([expected.boxes[:, :2], expected.boxes[:, 2:] - expected.boxes[:, :2]], 1)
    np.testing.assert_allclose(found[0].numpy(), wanted, atol=1e-3)
    flips = RandomHorizontalFlip(p=1.0), RandomHorizontalFlip(p=1.0)
    around = AugmentationSequential(flips[0], aug, flips[1], data_keys=keys[:2])
    turned = around(image[:1], given[1].flip(-1))[1]
    assert torch.equal(turned, masks.flip(-1))
    clip = VideoSequential(aug, data_format="BTCHW")
    _, frames = AugmentationSequential(clip, data_keys=keys[:2])(
        image[None, :1].expand(1, 3, 3, H, W), given[1][:, None].expand(1, 3, 4, H, W)
    )
    assert torch.equal(frames[0, 2], masks[0])


def test_kornias_boxes_are_edges_as_bbox_xywh():
    """As bbox_xyxy Kornia 0.9 takes them for places of pixels: a flip displaces them, a crop and a resizing too."""
    boxes = torch.tensor([[[25.0, 25.0, 50.0, 50.0], [0.0, 0.0, 8.0, 8.0], [0.0, 0.0, 100.0, 100.0]]])
    still = RandomExposure(exposure_s=0.02, speed_px_s=500.0, direction_deg=0.0, grow_boxes=True, p=1.0)
    steps = {
        RandomHorizontalFlip(p=1.0): [[20, 25, 60, 50], [87, 0, 13, 8], [0, 0, 100, 100]],
        CenterCrop((60, 60)): [[0, 5, 60, 50], [-20, -20, 13, 8], [-20, -20, 100, 100]],
        Resize((200, 200)): [[40, 50, 120, 100], [0, 0, 26, 16], [0, 0, 200, 200]],
    }
    for step, wanted in steps.items():
        found = AugmentationSequential(still, step, data_keys=["input", "bbox_xywh"])(
            torch.rand(1, 3, 100, 100), boxes
        )
        assert float((found[1][0] - torch.tensor(wanted).float()).abs().max()) < 1.0, step


@pytest.mark.parametrize(
    ("shape", "labels", "words"),
    [
        ((H, W), {"boxes": np.zeros((3, 5))}, r"boxes: shape must be \(N, 4\), got \(3, 5\)"),
        ((H, W), {"label_masks": np.zeros((3, H))}, r"label_masks: shape must be \(\.\.\., 121, 163\)"),
        ((2, H, W, 3), {"keypoints": np.zeros((3, 2))}, r"keypoints: shape must be \(2, N, 2\)"),
        ((H,), {}, "shape"),
    ],
)
def test_labels_of_other_shapes_are_named(shape, labels, words):
    with pytest.raises((TypeError, ValueError), match=words):
        labels_numpy(shape, Exposure(ROLLING, 0.01, 0.0), **labels)
