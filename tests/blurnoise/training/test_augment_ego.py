"""A camera that drives in the augmentation: what its pictures see, draws and replay, boxes, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from batches import pictures
from kornia.geometry.boxes import Boxes
from torch import Tensor

from blurnoise import Camera, develop, simulate
from blurnoise.motion.ego import Vehicle
from blurnoise.training.augmentation import RandomExposure, expose_pictures
from blurnoise.training.ranges import ExposureRanges

SIZE = (46, 63)
CAMERA = Camera.preset("imx250")
WALL_M, KMH, EXPOSURE_S = 20.0, 36.0, 0.02
SIDEWAYS = Vehicle(heading_deg=90.0, height_m=1e5, plane_m=WALL_M, hfov_deg=60.0, lens="rectilinear")
"""Along a wall that is all of the picture, at one distance: f v / Z px/s to the right, everywhere."""
ROAD = Vehicle(height_m=1.5, hfov_deg=60.0, lens="rectilinear")
PINHOLE = Vehicle(lens="rectilinear")
FOCAL_PX = SIZE[1] / 2 / math.tan(math.radians(30))
WALL_PX_S = FOCAL_PX * KMH / 3.6 / WALL_M
AT: dict[str, Any] = {"exposure_s": EXPOSURE_S, "illuminance_lux": 80.0}


def batch(count: int = 3) -> Tensor:
    return torch.nn.functional.avg_pool2d(pictures(count, 3, *SIZE), 3, 1, 1)


def exposed(image: Tensor, camera: Any = CAMERA, **given: Any) -> Tensor:
    return expose_pictures(image, camera, **{**AT, "generator": list(range(len(image))), **given})


@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_at_rest_pictures_are_untouched(fidelity: Any) -> None:
    """Bit for bit, beside others that are not."""
    image = batch()
    still = exposed(image, fidelity=fidelity)
    found = exposed(image, ego_kmh=[0.0, 50.0, 0.0], vehicle=ROAD, fidelity=fidelity)
    assert torch.equal(found[::2], still[::2])
    assert not torch.equal(found[1], still[1])


def test_along_a_wall_all_moves_by_f_v_over_z() -> None:
    """As the plan says that one blur does there, bit for bit."""
    image, slowly = batch(), {"exposure_s": 0.2, "illuminance_lux": 8.0}
    found = exposed(image, **slowly, ego_kmh=KMH, vehicle=SIDEWAYS)
    known, *wrong = (
        exposed(image, **slowly, speed_px_s=share * WALL_PX_S, direction_deg=0.0) for share in (1.0, 0.9, 1.1)
    )
    assert torch.equal(found, known)
    assert min(float((found - other).abs().mean()) for other in wrong) > 1 / 255


def test_every_picture_is_simulated_with_the_flow_of_its_own_camera_and_speed() -> None:
    """Whose focal length is that of its field of view, whatever is beside it in the batch."""
    image, speeds = batch(4), [30.0, 90.0, 0.0, 60.0]
    cameras = [CAMERA, replace(CAMERA, hfov_deg=30.0), CAMERA, replace(CAMERA, hfov_deg=30.0)]
    vehicle = replace(ROAD, hfov_deg=None, pitch_deg=5.0)
    found = exposed(image, cameras, ego_kmh=speeds, vehicle=vehicle)
    for item, (camera, kmh) in enumerate(zip(cameras, speeds, strict=True)):
        one = slice(item, item + 1)
        alone = exposed(image[one], camera, ego_kmh=kmh, vehicle=vehicle, generator=[item])
        assert torch.equal(alone, found[one])
        flow = vehicle.flow_px_s(camera, SIZE, kmh / 3.6)
        dn = simulate(image[one], camera, **AT, velocity_px_s=flow, generator=[item])
        assert float((develop(dn, camera) - alone).abs().max()) < 1.5 / 255
    swapped = exposed(image, cameras[1:] + cameras[:1], ego_kmh=speeds, vehicle=vehicle)
    assert not torch.equal(swapped[1], found[1])


def test_gradients_reach_pictures_and_speed() -> None:
    scene = (batch(2) * 0.6 + 0.2).requires_grad_()
    speed = torch.tensor([50.0, 80.0], requires_grad=True)
    weights = torch.linspace(0, 1, SIZE[0])[:, None]
    (exposed(scene, ego_kmh=speed, vehicle=ROAD) * weights).square().sum().backward()
    assert scene.grad is not None
    assert speed.grad is not None
    assert bool(torch.isfinite(scene.grad).all())
    assert float(speed.grad.abs().min()) > 0


def test_targets_that_drive_along_stay_sharp() -> None:
    image, masks = batch(2), torch.zeros(2, 1, *SIZE)
    masks[:, :, 28:44, 20:40] = 1.0
    drives = {"ego_kmh": 100.0, "vehicle": ROAD, "exposure_s": 0.05}
    still, whole = exposed(image, exposure_s=0.05), exposed(image, **drives)
    followed = exposed(image, **drives, masks=masks, moves="background")
    inside, outside = (..., slice(31, 41), slice(23, 37)), (..., slice(28, 44), slice(0, 12))
    assert float((followed[inside] - still[inside]).abs().max()) < 2 / 255
    assert float((whole[inside] - still[inside]).abs().mean()) > 4 / 255
    assert float((followed[outside] - whole[outside]).abs().mean()) < 2 / 255


# The class


def test_speeds_are_drawn_evenly_and_replayed() -> None:
    aug = RandomExposure(ego_kmh=(10.0, 90.0), vehicle=ROAD, exposure_s=(0.005, 0.05), p=1.0)
    torch.manual_seed(1)
    drawn = aug.generate_parameters((4000, 3, *SIZE))
    speeds = drawn["ego_kmh"].double()
    assert 10.0 <= float(speeds.min()) < float(speeds.max()) <= 90.0
    assert float(speeds.mean()) == pytest.approx(50, abs=5 * 80 / math.sqrt(12 * 4000))
    assert float(speeds.std()) == pytest.approx(80 / math.sqrt(12), rel=5 / math.sqrt(4000))
    assert not drawn["speed_px_s"].any()
    assert "ego_kmh=(10.0, 90.0)" in str(aug.ranges)
    assert "vehicle=Vehicle(" in str(aug.ranges)
    assert "speed_px_s" not in str(aug.ranges)

    image = batch(4)
    out, params = aug(image), aug._params
    assert torch.equal(aug(image, params=params), out)
    for item in range(4):
        one = {k: v if k == "forward_input_shape" else v[item : item + 1] for k, v in params.items()}
        assert torch.equal(aug(image[item : item + 1], params=one), out[item : item + 1])
    other = {**params, "ego_kmh": params["ego_kmh"].flip(0)}
    assert not torch.equal(aug(image, params=other), out)


def grown(vehicle: Vehicle, box: list[float], **given: Any) -> list[float]:
    """By what a box (left, top, right, bottom) grows to each side, px."""
    aug = RandomExposure(**AT, ego_kmh=KMH, vehicle=vehicle, grow_boxes=True, p=1.0, **given)
    aug(batch(1))
    after = aug.transform_boxes(Boxes.from_tensor(torch.tensor([[box]]), mode="xyxy"), aug._params, aug.flags)
    left, top, right, bottom = (after.to_tensor("xyxy")[0, 0] - torch.tensor(box)).tolist()
    return [-left, -top, right, bottom]


def test_boxes_grow_by_what_their_own_place_does() -> None:
    half = WALL_PX_S * EXPOSURE_S / 2
    assert grown(SIDEWAYS, [20.0, 12.0, 37.0, 29.0]) == pytest.approx([half, 0, half, 0], abs=1e-4)
    # y below the axis: down y² V / (h f), across x y V / (h f), from the middle of the picture
    left, top, right, bottom = box = [20.0, 26.0, 50.0, 38.0]
    middle_x, middle_y = SIZE[1] / 2, SIZE[0] / 2
    share = KMH / 3.6 / (ROAD.height_m * FOCAL_PX) * EXPOSURE_S / 2
    across = [(bottom - middle_y) * abs(side - middle_x) * share for side in (left, right)]
    down = [(side - middle_y) ** 2 * share for side in (top, bottom)]
    assert grown(ROAD, box) == pytest.approx([across[0], down[0], across[1], down[1]], rel=1e-3)
    assert grown(ROAD, [20.0, 3.0, 50.0, 15.0]) == [0, 0, 0, 0]  # of the sky


def test_boxes_of_targets_that_drive_along_stay() -> None:
    aug = RandomExposure(**AT, ego_kmh=90.0, vehicle=ROAD, moves="background", grow_boxes=True, p=1.0)
    masks = torch.zeros(2, 1, *SIZE)
    masks[0, :, 28:44, 20:40] = 1.0
    boxes = torch.tensor([[[20.0, 28.0, 40.0, 44.0]]]).repeat(2, 1, 1)
    aug(batch(2), masks=masks)
    after = aug.transform_boxes(Boxes.from_tensor(boxes, mode="xyxy"), aug._params, aug.flags)
    widths = (after.to_tensor("xyxy")[:, 0, 2:] - boxes[:, 0, 2:]).amax(1)
    assert widths[0] == 0
    assert widths[1] > 0.1


def test_boxes_follow_rows_of_a_rolling_shutter() -> None:
    """Beside a wall at f v / Z the box is where that speed has it, its skewed corners included."""
    rolls = replace(CAMERA, row_time_s=2e-5, shutter="rolling")
    box = torch.tensor([[[20.0, 2.0, 37.0, 9.0]]])
    moved = []
    for motion in (
        {"ego_kmh": KMH, "vehicle": SIDEWAYS},
        {"speed_px_s": WALL_PX_S, "direction_deg": 0.0},
        {"speed_px_s": 0.0},
    ):
        aug = RandomExposure(rolls, **AT, **motion, grow_boxes=True, p=1.0)
        aug(batch(1))
        after = aug.transform_boxes(Boxes.from_tensor(box, mode="xyxy"), aug._params, aug.flags)
        moved.append(after.to_tensor("xyxy"))
    row_s = 2e-5 * CAMERA.width_px / SIZE[1]
    skew = 3.5 * WALL_PX_S * row_s  # from the middle row of the box to its edges
    assert moved[0].tolist()[0][0] == pytest.approx(moved[1].tolist()[0][0], abs=1e-3)
    assert float((moved[0] - moved[2]).abs().max()) > 4 * skew


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"ego_kmh": (50.0, 20.0)}, "ego_kmh"),
        ({"ego_kmh": 500.0}, "ego_kmh = 500.0: must be finite and >= 0 and <= 360"),
        ({"vehicle": ROAD}, "vehicle: goes with ego_kmh"),
        ({"ego_kmh": 50.0, "blur_px": 3.0}, "blur_px"),
        ({"ego_kmh": 50.0, "moves": ("all", "targets")}, "moves"),
        ({"ego_kmh": 300.0, "vehicle": Vehicle(height_m=1e-3), "exposure_s": 3.0}, "= 300, 3 at most"),
        ({"ego_kmh": 50.0, "camera": replace(CAMERA, hfov_deg=190.0), "vehicle": PINHOLE}, "hfov_deg"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_named(given: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        ExposureRanges(**given)


@pytest.mark.parametrize(
    "given", [{"speed_px_s": 5.0}, {"moves": "targets"}, {"ego_kmh": -1.0}, {"ego_kmh": [1.0] * 3}]
)
def test_functional_twin_refuses_them_too(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="ego_kmh"):
        exposed(batch(2), **{"ego_kmh": 50.0, **given})
    with pytest.raises(TypeError, match="vehicle"):
        ExposureRanges(ego_kmh=50.0, vehicle=1.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("ego", [{}, {"ego_kmh": 50.0}])
@pytest.mark.parametrize("vehicle", [None, "x"])
def test_pictures_refuse_what_is_no_vehicle(vehicle: Any, ego: Any) -> None:
    with pytest.raises(TypeError, match="vehicle: must be"):
        exposed(torch.rand(1, 3, 8, 8), vehicle=vehicle, **ego)


def test_pictures_refuse_a_vehicle_that_does_not_drive() -> None:
    with pytest.raises(ValueError, match="vehicle: goes with ego_kmh"):
        exposed(torch.rand(1, 3, 8, 8), vehicle=Vehicle(height_m=2.0))
