"""Objects and shakes in the augmentation: what moves, in which precision, beside whom, and where boxes go."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from batches import pictures
from blurnoise_eval.datasets import segmentation
from kornia.augmentation import AugmentationSequential, RandomHorizontalFlip
from kornia.geometry.boxes import Boxes
from torch import Tensor

from blurnoise import Camera, develop, simulate
from blurnoise.optics.colour import linear_from_srgb
from blurnoise.scene import cutting
from blurnoise.training.augmentation import RandomExposure, expose_pictures, velocity_px_s
from blurnoise.training.ranges import ExposureRanges, shakes

SIZE = (46, 63)
CONDITIONS: dict[str, Any] = {"exposure_s": 0.02, "illuminance_lux": 80.0, "speed_px_s": 600.0}


def batch(count: int = 3) -> tuple[Tensor, Tensor]:
    """Smooth pictures, and a mask of a square for each but the last, which has none."""
    image = torch.nn.functional.avg_pool2d(pictures(count, 3, *SIZE), 5, 1, 2)
    masks = torch.zeros(count, 2, *SIZE)
    for item in range(count - 1):
        masks[item, item % 2, 12 + item : 30 + item, 20:38] = 1.0
    return image, masks


def exposed(image: Tensor, masks: Tensor | None, **given: Any) -> Tensor:
    seeds = list(range(len(image)))
    return expose_pictures(
        image, "imx250", **{**CONDITIONS, "masks": masks, "generator": seeds, "direction_deg": 20.0, **given}
    )


@pytest.mark.parametrize("moves", ["targets", "background"])
@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_parts_move_as_simulates_layers_do(moves: str, fidelity: Any) -> None:
    image, masks = batch(2)
    found = exposed(image, masks, moves=moves, fidelity=fidelity)
    angle, velocity = math.radians(20.0), 600.0
    along = torch.tensor([velocity * math.cos(angle), -velocity * math.sin(angle)])
    still = torch.zeros(2)
    own, rest = (along, still) if moves == "targets" else (still, along)
    light = linear_from_srgb(image[:1])
    matte = masks[0].amax(0).numpy()
    cut = cutting.cut_out(light, [matte], [own], cutting.filled(light, cutting.hole_of(matte > 0)))
    dn = simulate(
        cut.background, Camera.preset("imx250"), exposure_s=0.02, illuminance_lux=80.0, velocity_px_s=rest,
        encoding="linear", layers=cut.layers, generator=[0], fidelity=fidelity,
    )  # fmt: skip
    expected = develop(dn, Camera.preset("imx250"))
    alike = (found[:1] - expected).abs() < 1.5 / 255  # the angle's rounding moves few values by one number
    assert float(alike.float().mean()) > 0.999
    whole = (exposed(image, masks)[:1] - expected).abs() < 1.5 / 255
    assert float(whole.float().mean()) < 0.97  # all is told from it


def test_what_stands_still_stays_sharp() -> None:
    """Far from what moves, and in its middle where it is followed, a picture is that of no motion."""
    image, masks = batch(2)
    still = exposed(image, None, speed_px_s=0.0)[0]
    targets = exposed(image, masks, moves="targets")[0]
    followed = exposed(image, masks, moves="background")[0]
    moved = exposed(image, None)[0]
    corner, middle = (..., slice(38, 46), slice(0, 63)), (..., slice(15, 27), slice(23, 35))
    assert float((targets[corner] - still[corner]).abs().max()) < 2 / 255
    assert float((followed[middle] - still[middle]).abs().max()) < 2 / 255
    assert float((followed[corner] - moved[corner]).abs().mean()) < 2 / 255
    assert float((still[corner] - moved[corner]).abs().mean()) > 4 / 255


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
def test_pictures_one_by_one_are_the_batch(dtype: torch.dtype) -> None:
    """Bit for bit, whatever moves in the others; a picture without masks is the one without any."""
    image, masks = batch(4)
    image, masks = image.to(dtype), masks.to(dtype)
    moves = ["targets", "background", "all", "targets"]
    found = exposed(image, masks, moves=moves)
    assert found.dtype == dtype
    for item in range(4):
        one = slice(item, item + 1)
        alone = exposed(image[one], masks[one], moves=moves[one], generator=[item])
        assert torch.equal(alone, found[one])
        if moves[item] == "all" or not masks[item].any():
            assert torch.equal(exposed(image[one], None, generator=[item]), found[one])
        else:
            assert not torch.equal(exposed(image[one], None, generator=[item]), found[one])
    if dtype in (torch.float16, torch.bfloat16):
        assert torch.equal(exposed(image.float(), masks.float(), moves=moves).to(dtype), found)
    if dtype == torch.float64:  # another stream of noise, so that their means agree
        assert float((found - exposed(image.float(), masks, moves=moves)).mean().abs()) < 2e-3


def test_what_is_behind_is_taken_from_around() -> None:
    """A constant stays, a slope is continued, nothing is beyond what is around, and what is seen is as it was."""
    matte = segmentation.of_box(20, 12, 18, 18, SIZE)
    hidden = torch.from_numpy(matte > 0)
    slope = torch.linspace(0.1, 0.7, SIZE[1]).expand(1, 1, *SIZE).contiguous()
    noise = pictures(1, 3, *SIZE).double()
    for light, off in ((torch.full((1, 3, *SIZE), 0.3), 1e-6), (slope, 0.03), (noise, 1.0)):
        spoilt = light.clone()
        spoilt[..., hidden] = 1.0
        plate = cutting.filled(spoilt, cutting.hole_of(matte > 0))
        assert plate.dtype == light.dtype
        assert float((plate - light)[..., hidden].abs().max()) <= off
        away = torch.from_numpy(~cutting.hole_of(matte > 0))
        assert torch.equal(plate[..., away], light[..., away])
        assert float(plate[..., hidden].max()) < 1.0
        assert torch.equal(cutting.filled(light, cutting.hole_of(matte > 0)), plate)  # whatever was there
    assert abs(float(plate[..., hidden].mean()) - 0.5) < 0.1


def test_near_parts_are_one_layer_and_far_ones_two(monkeypatch: pytest.MonkeyPatch) -> None:
    """What meets on its way would else be cut into parts of the exposure; the picture is the same."""
    image = torch.nn.functional.avg_pool2d(pictures(1, 3, 40, 160), 5, 1, 2)
    counts: list[int] = []
    kept = cutting.cut_out

    def counted(light: Tensor, own: Any, *rest: Any) -> Any:
        counts.append(len(own))
        return kept(light, own, *rest)

    monkeypatch.setattr("blurnoise.scene.cutting.cut_out", counted)
    for left, expected in ((35, 1), (90, 2)):
        masks = torch.zeros(1, 1, 40, 160)
        masks[..., 10:25, 10:25] = masks[..., 10:25, left : left + 15] = 1.0
        exposed(image, masks, moves="targets", direction_deg=0.0)
        assert counts[-1] == expected


def test_masks_of_any_type_say_the_same() -> None:
    image, masks = batch(2)
    expected = exposed(image, masks, moves="targets")
    for other in (masks.bool(), masks.byte(), masks.double(), masks.amax(1, keepdim=True), masks.flip(1)):
        assert torch.equal(exposed(image, other, moves="targets"), expected)


def test_a_mask_of_everything_leaves_no_background() -> None:
    image, _ = batch(1)
    masks = torch.ones(1, 1, *SIZE)
    assert torch.equal(exposed(image, masks, moves="targets"), exposed(image, None))
    assert torch.equal(exposed(image, masks[:, :0], moves="targets"), exposed(image, None))


@pytest.mark.parametrize("moves", ["targets", "background"])
def test_gradients_reach_pictures_and_speed(moves: str) -> None:
    image, masks = batch(2)
    scene = (image * 0.6 + 0.2).double().requires_grad_()
    speed = torch.tensor([600.0, 600.0], dtype=torch.float64, requires_grad=True)
    weights = torch.linspace(0, 1, SIZE[1], dtype=torch.float64)

    def centre(pace: Tensor) -> Tensor:
        seen = exposed(scene, masks, moves=moves, speed_px_s=pace, illuminance_lux=60.0)
        return (seen * weights).square().sum()

    centre(speed).backward()
    assert scene.grad is not None
    assert speed.grad is not None
    assert bool(torch.isfinite(scene.grad).all())
    assert float(scene.grad[0, :, 12:30, 20:38].abs().sum()) > 0  # the object's own
    assert float(speed.grad[0].abs()) > 0


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"masks": torch.zeros(2, 1, 9, 9)}, "masks: shape"),
        ({"masks": torch.zeros(3, 1, *SIZE)}, "masks: shape"),
        ({"masks": torch.full((2, 1, *SIZE), 255, dtype=torch.uint8)}, "masks: values"),
        ({"masks": torch.full((2, 1, *SIZE), torch.nan)}, "masks: values"),
        ({"moves": "target"}, "moves"),
        ({"moves": ["all"] * 3}, "moves"),
    ],
)
def test_what_is_wrong_is_named(given: dict[str, Any], named: str) -> None:
    image, masks = batch(2)
    with pytest.raises(ValueError, match=named):
        exposed(image, given.get("masks", masks), moves=given.get("moves", "targets"))
    with pytest.raises(TypeError, match="masks"):
        exposed(image, masks.numpy(), moves="targets")  # type: ignore[arg-type]


# The class


def test_draws_replay_with_their_masks() -> None:
    image, masks = batch(6)
    aug = RandomExposure(moves=("all", "targets", "background"), shake_px=0.0, p=1.0)
    torch.manual_seed(1)
    out = aug(image, masks=masks)
    params = aug._params
    assert {"moves_index", "masks"} <= set(params)
    assert torch.equal(aug(image, params=params), out)
    for item in range(6):
        one = {k: v if k == "forward_input_shape" else v[item : item + 1] for k, v in params.items()}
        assert torch.equal(aug(image[item : item + 1], params=one), out[item : item + 1])
    assert not torch.equal(aug(image, params={k: v for k, v in params.items() if k != "masks"}), out)


def test_one_picture_has_masks_of_three_dimensions() -> None:
    image, masks = batch(2)
    aug = RandomExposure(moves="targets", p=1.0, keepdim=True)
    out = aug(image[0], masks=masks[0])
    assert out.shape == image[0].shape
    assert torch.equal(aug(image[0], params=aug._params), out)


def test_what_moves_is_drawn_evenly_and_named() -> None:
    aug = RandomExposure(moves=("targets", "background"), shake_px=(2.0, 6.0), p=1.0)
    torch.manual_seed(3)
    params = aug.generate_parameters((2000, 3, 8, 8))
    assert abs(float(params["moves_index"].double().mean()) - 0.5) < 5 * 0.5 / math.sqrt(2000)
    assert 2.0 <= float(params["shake_px"].min()) < float(params["shake_px"].max()) <= 6.0
    assert "moves=('targets', 'background')" in str(aug.ranges)
    plain = RandomExposure(p=1.0)
    assert not {"moves_index", "shake_px"} & set(plain.generate_parameters((2, 3, 8, 8)))
    with pytest.raises(ValueError, match="moves"):
        ExposureRanges(moves=())
    with pytest.raises(ValueError, match="shake_px"):
        ExposureRanges(shake_px=(-1.0, 2.0))
    with pytest.raises(ValueError, match="ar0237"):
        ExposureRanges("ar0237", exposure_s=1e-6, shake_px=3.0)


def test_containers_pass_masks_by_and_move_everything() -> None:
    image, masks = batch(3)
    boxes = torch.tensor([[[20.0, 12.0, 37.0, 29.0]]]).repeat(3, 1, 1)
    aug = RandomExposure(moves="background", speed_px_s=600.0, exposure_s=0.02, grow_boxes=True, p=1.0)
    whole = AugmentationSequential(RandomHorizontalFlip(p=1.0), aug, data_keys=["input", "bbox_xyxy", "mask"])
    _, grown, kept = whole(image, boxes, masks)
    assert torch.equal(kept, masks.flip(-1))
    assert bool((grown[:, 0, 2] - grown[:, 0, 0] > 17).all())  # nobody is followed

    geometry = AugmentationSequential(RandomHorizontalFlip(p=1.0), data_keys=["input", "bbox_xyxy", "mask"])
    flipped, flipped_boxes, flipped_masks = geometry(image, boxes, masks)
    out = aug(flipped, masks=flipped_masks)
    assert out.shape == image.shape
    after = aug.transform_boxes(
        Boxes.from_tensor(flipped_boxes, mode="xyxy"), aug._params, aug.flags
    ).to_tensor("xyxy")
    torch.testing.assert_close(after[:2], flipped_boxes[:2])  # followed: they stay
    assert bool((after[2] - flipped_boxes[2]).abs().sum() > 5)  # without masks all moves


def test_shakes_are_each_pictures_own_and_boxes_cover_them() -> None:
    image, _ = batch(4)
    ranges: dict[str, Any] = {"exposure_s": 0.02, "illuminance_lux": 200.0, "speed_px_s": 0.0}
    aug = RandomExposure(**ranges, shake_px=(9.0, 9.0), grow_boxes=True, p=1.0)
    torch.manual_seed(4)
    same = image[:1].expand(4, -1, -1, -1)
    out, drawn = aug(same), aug._params
    assert len({round(float(each.std()), 6) for each in out}) == 4
    for item in range(4):
        one = {k: v if k == "forward_input_shape" else v[item : item + 1] for k, v in drawn.items()}
        assert torch.equal(aug(same[:1], params=one)[0], out[item])
    boxes = torch.tensor([[[25.0, 20.0, 34.0, 24.0]]]).repeat(4, 1, 1)
    params = aug.generate_parameters(same.shape) | {"batch_prob": torch.ones(4)}
    params["forward_input_shape"] = torch.tensor(same.shape)
    grown = aug.transform_boxes(Boxes.from_tensor(boxes, mode="xyxy"), params, aug.flags).to_tensor("xyxy")
    added = (grown[:, 0, 2:] - grown[:, 0, :2]) - (boxes[:, 0, 2:] - boxes[:, 0, :2])
    assert added.amax(1).tolist() == pytest.approx([9.0] * 4, abs=0.1)  # the extent is its longer side


RESET = replace(Camera.preset("ar0237"), shutter="global-reset")


@pytest.mark.parametrize(
    ("camera", "shake_px"), [("imx250", 5.0), ("ar0237", 0.0), ("ar0237", 5.0), (RESET, 0.0), (RESET, 5.0)]
)
def test_parts_move_before_cameras_that_shake_and_read_row_by_row(camera: Any, shake_px: float) -> None:
    image, masks = batch(2)
    aug = RandomExposure(
        camera, exposure_s=(0.01, 0.03), moves=("targets", "background"), shake_px=shake_px, p=1.0
    )
    torch.manual_seed(6)
    out, drawn = aug(image, masks=masks), aug._params
    for item in range(2):
        one = {k: v if k == "forward_input_shape" else v[item : item + 1] for k, v in drawn.items()}
        assert torch.equal(aug(image[item : item + 1], params=one)[0], out[item])
        matte = masks[item].amax(0).numpy()
        if not matte.any():
            continue
        taker, exposure_s = aug.ranges.cameras[0], float(one["exposure_s"])
        velocity = velocity_px_s(one["speed_px_s"], one["direction_deg"])[0]
        own, rest = (velocity, 0 * velocity)[
            :: 1 if aug.ranges.arguments(one)["moves"] == ["targets"] else -1
        ]
        light = linear_from_srgb(image[item : item + 1])
        cut = cutting.cut_out(light, [matte], [own], cutting.filled(light, cutting.hole_of(matte > 0)))
        dn = simulate(
            cut.background, taker, exposure_s=exposure_s, illuminance_lux=float(one["illuminance_lux"]),
            velocity_px_s=rest, encoding="linear", layers=cut.layers, generator=one["noise_seed"].tolist(),
            trajectory=shakes(one, [taker], slice(None))[0],
        )  # fmt: skip
        off = (develop(dn, taker)[0] - out[item]).abs()
        assert float((off < 1.5 / 255).float().mean()) > 0.995


def test_shaken_pictures_do_not_depend_on_their_batch_before_a_rolling_shutter() -> None:
    image, _ = batch(3)
    aug = RandomExposure("ar0237", exposure_s=(0.01, 0.03), shake_px=(0.0, 5.0), speed_px_s=0.0, p=1.0)
    torch.manual_seed(6)
    out = aug(image)
    one = {k: v if k == "forward_input_shape" else v[1:2] for k, v in aug._params.items()}
    assert torch.equal(aug(image[1:2], params=one), out[1:2])
