"""Objects, shakes and a camera that drives in the augmentation: what moves, beside whom, and where boxes go."""

import math
from dataclasses import replace
from typing import Any

import exposures
import pytest
import torch
from batches import one_of, pictures
from kornia.augmentation import (
    AugmentationSequential,
    RandomHorizontalFlip,
    VideoSequential,
)
from kornia.geometry.boxes import Boxes
from torch.nn.functional import avg_pool2d

from blurnoise import Camera, develop, simulate
from blurnoise.camera.colour import linear_from_srgb
from blurnoise.motion.ego import Vehicle
from blurnoise.scene import cutting
from blurnoise.training.augmentation import RandomExposure
from blurnoise.training.ranges import ExposureRanges
from blurnoise.training.source import velocity_px_s

SIZE = (46, 63)
CAMERA = Camera.preset("imx250")
AT: dict[str, Any] = {"exposure_s": 0.02, "illuminance_lux": 80.0}
STRAIGHT: dict[str, Any] = {"speed_px_s": 600.0, "direction_deg": 20.0}
WALL_M, KMH = 20.0, 36.0
SIDEWAYS = Vehicle(heading_deg=90.0, height_m=1e5, plane_m=WALL_M, hfov_deg=60.0, lens="rectilinear")
"""Along a wall that is all of the picture, at one distance: f v / Z px/s to the right, everywhere."""
ROAD = Vehicle(height_m=1.5, hfov_deg=60.0, lens="rectilinear")
FOCAL_PX = SIZE[1] / 2 / math.tan(math.radians(30))
RESET = Camera.preset("ar0237").with_figures(shutter="global-reset")


def batch(count=3):
    """Smooth pictures, and a mask of a square for each but the last, which has none."""
    image = avg_pool2d(pictures(count, 3, *SIZE), 5, 1, 2)
    masks = torch.zeros(count, 2, *SIZE)
    for item in range(count - 1):
        masks[item, item % 2, 12 + item : 30 + item, 20:38] = 1.0
    return image, masks


def exposed(image, camera=CAMERA, **given):
    return exposures.exposed(image, camera, **{**AT, **given})


def simulated(light, mask, own, rest, camera, **at):
    """The parts of a mask by simulate's layers, developed."""
    matte = mask.amax(0).numpy()
    cut = cutting.cut_out(light, [matte], [own], cutting.filled(light, cutting.hole_of(matte > 0)))
    at |= {"velocity_px_s": rest, "encoding": "linear", "layers": cut.layers}
    return develop(simulate(cut.background, camera, **at), camera)


@pytest.mark.parametrize("moves", ["targets", "background"])
@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_parts_move_as_simulates_layers_do(moves, fidelity):
    image, masks = batch(2)
    found = exposed(image, **STRAIGHT, masks=masks, moves=moves, fidelity=fidelity)
    angle, still = math.radians(20.0), torch.zeros(2)
    along = torch.tensor([600.0 * math.cos(angle), -600.0 * math.sin(angle)])
    own, rest = (along, still) if moves == "targets" else (still, along)
    light = linear_from_srgb(image[:1])
    expected = simulated(light, masks[0], own, rest, CAMERA, **AT, generator=[0], fidelity=fidelity)
    alike = (found[:1] - expected).abs() < 1.5 / 255  # the angle's rounding moves few values by one number
    assert float(alike.float().mean()) > 0.999
    whole = (exposed(image, **STRAIGHT, masks=masks)[:1] - expected).abs() < 1.5 / 255
    assert float(whole.float().mean()) < 0.97  # all is told from it


@pytest.mark.parametrize("dtype", [torch.float16, torch.float32, torch.float64])
def test_pictures_one_by_one_are_the_batch(dtype):
    """Bit for bit, whatever moves in the others; a picture without masks is the one without any."""
    image, masks = (each.to(dtype) for each in batch(4))
    moves = ["targets", "background", "all", "targets"]
    found = exposed(image, **STRAIGHT, masks=masks, moves=moves)
    assert found.dtype == dtype
    for item in range(4):
        one = {**STRAIGHT, "seeds": [item]}
        alone = exposed(image[[item]], **one, masks=masks[[item]], moves=moves[item])
        assert torch.equal(alone, found[[item]])
        plain = moves[item] == "all" or not masks[item].any()
        assert torch.equal(exposed(image[[item]], **one), found[[item]]) == plain
    if dtype == torch.float16:
        single = exposed(image.float(), **STRAIGHT, masks=masks.float(), moves=moves)
        assert torch.equal(single.to(dtype), found)


def test_containers_pass_masks_by_and_boxes_of_what_is_followed_stay():
    image, masks = batch(3)
    boxes = torch.tensor([[[20.0, 12.0, 37.0, 29.0]]]).repeat(3, 1, 1)
    aug = RandomExposure(moves="background", speed_px_s=600.0, exposure_s=0.02, grow_boxes=True, p=1.0)
    flip = RandomHorizontalFlip(p=1.0)
    _, grown, kept = AugmentationSequential(flip, aug, data_keys=["input", "bbox_xyxy", "mask"])(
        image, boxes, masks
    )
    assert torch.equal(kept, masks.flip(-1))
    assert bool((grown[:, 0, 2] - grown[:, 0, 0] > 17).all())  # the container gives it no masks: all moves
    aug(image, masks=masks)
    after = aug.transform_boxes(Boxes.from_tensor(boxes, mode="xyxy"), aug._params, aug.flags)
    after = after.to_tensor("xyxy")
    torch.testing.assert_close(after[:2], boxes[:2])
    assert bool((after[2] - boxes[2]).abs().sum() > 5)  # without masks all moves


def test_boxes_cover_shakes():
    aug = RandomExposure(**AT, speed_px_s=0.0, shake_px=(9.0, 9.0), grow_boxes=True, p=1.0)
    torch.manual_seed(4)
    boxes = torch.tensor([[[25.0, 20.0, 34.0, 24.0]]]).repeat(4, 1, 1)
    out = aug(batch(1)[0].expand(4, -1, -1, -1))
    assert len({round(float(each.std()), 6) for each in out}) == 4  # each its own
    grown = aug.transform_boxes(Boxes.from_tensor(boxes, mode="xyxy"), aug._params, aug.flags)
    grown = grown.to_tensor("xyxy")
    added = (grown[:, 0, 2:] - grown[:, 0, :2]) - (boxes[:, 0, 2:] - boxes[:, 0, :2])
    assert added.amax(1).tolist() == pytest.approx([9.0] * 4, abs=0.1)  # the extent is its longer side


@pytest.mark.parametrize(("camera", "shake_px"), [("imx250", 5.0), ("ar0237", 5.0), (RESET, 0.0)])
def test_parts_move_before_cameras_that_shake_and_read_row_by_row(camera, shake_px):
    image, masks = batch(2)
    moves = ("targets", "background")
    aug = RandomExposure(camera, exposure_s=(0.01, 0.03), moves=moves, shake_px=shake_px, p=1.0)
    torch.manual_seed(6)
    out, drawn = aug(image, masks=masks), aug._params
    one = one_of(drawn, 0)
    assert torch.equal(aug(image[:1], params=one)[0], out[0])
    taker = aug.ranges.cameras[0]
    velocity = velocity_px_s(one["speed_px_s"], one["direction_deg"])[0]
    (exposure,) = aug.ranges.exposures(one)
    followed = exposure.moves != "targets"
    own, rest = (velocity, 0 * velocity)[:: -1 if followed else 1]
    at = {name: float(one[name]) for name in ("exposure_s", "illuminance_lux")}
    at |= {"generator": one["noise_seed"].tolist(), "trajectory": exposure.trajectory}
    off = (simulated(linear_from_srgb(image[:1]), masks[0], own, rest, taker, **at)[0] - out[0]).abs()
    assert float((off < 1.5 / 255).float().mean()) > 0.995


def test_every_picture_is_simulated_with_the_flow_of_its_own_camera_and_speed():
    """Whose focal length is that of its field of view, whatever is beside it; one at rest is as still."""
    image, speeds = batch(4)[0], [30.0, 90.0, 0.0, 60.0]
    cameras = [CAMERA, CAMERA.with_figures(hfov_deg=30.0), CAMERA, CAMERA.with_figures(hfov_deg=30.0)]
    vehicle = replace(ROAD, hfov_deg=None, pitch_deg=5.0)
    found = exposed(image, cameras, ego_kmh=speeds, vehicle=vehicle)
    assert torch.equal(found[2], exposed(image)[2])
    for item, (camera, kmh) in enumerate(zip(cameras, speeds, strict=True)):
        alone = exposed(image[[item]], camera, ego_kmh=kmh, vehicle=vehicle, seeds=[item])
        assert torch.equal(alone, found[[item]])
        flow = vehicle.flow_px_s(camera, SIZE, kmh / 3.6)
        dn = simulate(image[[item]], camera, **AT, velocity_px_s=flow, generator=[item])
        assert float((develop(dn, camera) - alone).abs().max()) < 1.5 / 255


def test_targets_that_drive_along_stay_sharp():
    image, masks = batch(2)[0], torch.zeros(2, 1, *SIZE)
    masks[:, :, 28:44, 20:40] = 1.0
    drives = {"ego_kmh": 100.0, "vehicle": ROAD, "exposure_s": 0.05}
    still, whole = exposed(image, exposure_s=0.05), exposed(image, **drives)
    followed = exposed(image, **drives, masks=masks, moves="background")
    inside, outside = (..., slice(31, 41), slice(23, 37)), (..., slice(28, 44), slice(0, 12))
    assert float((followed[inside] - still[inside]).abs().max()) < 2 / 255
    assert float((whole[inside] - still[inside]).abs().mean()) > 4 / 255
    assert float((followed[outside] - whole[outside]).abs().mean()) < 2 / 255


def grown(vehicle, box):
    """By what a box (left, top, right, bottom) grows to each side, px."""
    aug = RandomExposure(**AT, ego_kmh=KMH, vehicle=vehicle, grow_boxes=True, p=1.0)
    aug(batch(1)[0])
    after = aug.transform_boxes(Boxes.from_tensor(torch.tensor([[box]]), mode="xyxy"), aug._params, aug.flags)
    left, top, right, bottom = (after.to_tensor("xyxy")[0, 0] - torch.tensor(box)).tolist()
    return [-left, -top, right, bottom]


def test_boxes_grow_by_what_their_own_place_does():
    half = FOCAL_PX * KMH / 3.6 / WALL_M * AT["exposure_s"] / 2
    assert grown(SIDEWAYS, [20.0, 12.0, 37.0, 29.0]) == pytest.approx([half, 0, half, 0], abs=1e-4)
    # y below the axis: down y² V / (h f), across x y V / (h f), from the middle of the picture
    left, top, right, bottom = box = [20.0, 26.0, 50.0, 38.0]
    middle_x, middle_y = SIZE[1] / 2, SIZE[0] / 2
    share = KMH / 3.6 / (ROAD.height_m * FOCAL_PX) * AT["exposure_s"] / 2
    across = [(bottom - middle_y) * abs(side - middle_x) * share for side in (left, right)]
    down = [(side - middle_y) ** 2 * share for side in (top, bottom)]
    assert grown(ROAD, box) == pytest.approx([across[0], down[0], across[1], down[1]], rel=1e-3)
    assert grown(ROAD, [20.0, 3.0, 50.0, 15.0]) == [0, 0, 0, 0]  # of the sky


@pytest.mark.parametrize(
    ("call", "given", "named"),
    [
        (exposed, {"masks": torch.zeros(2, 1, 9, 9)}, "masks: shape"),
        (exposed, {"masks": torch.full((2, 1, *SIZE), 255, dtype=torch.uint8)}, "masks: values"),
        (exposed, {"ego_kmh": 50.0, "speed_px_s": 5.0}, "ego_speed_m_s"),
        (ExposureRanges, {"moves": ()}, "moves"),
        (ExposureRanges, {"shake_px": (-1.0, 2.0)}, "shake_px"),
        (ExposureRanges, {"ego_kmh": 500.0}, "ego_kmh = 500.0: must be finite and >= 0 and <= 360"),
        (ExposureRanges, {"vehicle": ROAD}, "vehicle: needs ego_kmh"),
        (ExposureRanges, {"ego_kmh": 50.0, "blur_px": 3.0}, "blur_px"),
        (ExposureRanges, {"ego_kmh": 50.0, "moves": ("all", "targets")}, "moves"),
        (ExposureRanges, {"ego_kmh": 300.0, "vehicle": Vehicle(1e-3), "exposure_s": 3.0}, "= 300, 3 at most"),
    ],
)
def test_what_cannot_be_is_named(call, given, named):
    with pytest.raises(ValueError, match=named):
        call(*([batch(2)[0]] if call is exposed else []), **given)


TENS = {"exposure_s": 0.02, "illuminance_lux": 50.0, "speed_px_s": 500.0, "direction_deg": 30.0}  # 10 px
HALF_X, HALF_Y = 5 * math.cos(math.radians(30)), 5 * math.sin(math.radians(30))
LAST_X, LAST_Y = 79.0, 47.0  # boxes end in pixels, not at their edges: Kornia's xyxy_plus
BOX = torch.tensor([[[20.0, 12.0, 40.0, 30.0]]])
GROWN = torch.tensor([[[20 - HALF_X, 12 - HALF_Y, 40 + HALF_X, 30 + HALF_Y]]])


def in_sequence(box, *others, grow=True):
    aug = RandomExposure(**TENS, grow_boxes=grow, p=1.0)
    sequence = AugmentationSequential(aug, *others, data_keys=["input", "bbox_xyxy"])
    return sequence(torch.rand(len(box), 3, 48, 80), box)[1]


def test_boxes_grow_to_what_is_swept():
    torch.testing.assert_close(in_sequence(BOX), GROWN)
    assert torch.equal(in_sequence(BOX, grow=False), BOX)


def test_boxes_grow_no_further_than_the_picture():
    """An edge within the picture stops at its border; one that lies beyond stays where it is."""
    boxes = torch.tensor([[[1.0, 1.0, 78.0, 46.0], [-3.0, -2.0, 85.0, 50.0]]])
    expected = torch.tensor([[[0.0, 0.0, LAST_X, LAST_Y], [-3.0, -2.0, 85.0, 50.0]]])
    torch.testing.assert_close(in_sequence(boxes), expected)


def test_frames_of_a_video_share_their_conditions_and_not_their_noise():
    """Kornia gives all frames of a clip the same parameters, unless it is asked not to."""
    torch.manual_seed(1)
    aug = RandomExposure(p=0.6)
    clip = torch.rand(4, 1, 3, 12, 14).expand(4, 5, 3, 12, 14)
    video = VideoSequential(aug, data_format="BTCHW", same_on_frame=True)
    out = video(clip)
    assert torch.equal(video(clip, params=video._params), out)
    changed_clips = [
        each for each in out if not torch.equal(each, clip[0]) and not torch.equal(each[0], each[1])
    ]
    assert changed_clips
    bright = [{*map(float, each.flatten(1).mean(1))} for each in changed_clips]
    assert all(len(means) == 5 and max(means) - min(means) < 0.05 for means in bright)
    changed = (out != clip).flatten(1).any(1)
    assert 0 < int(changed.sum()) < 4
    apart = VideoSequential(
        RandomExposure(("imx250", "ar0237"), p=1.0), data_format="BTCHW", same_on_frame=False
    )(clip)
    assert not torch.equal(apart[0, 0], apart[0, 1])
