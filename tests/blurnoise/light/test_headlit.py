"""Targets in headlamps: where their boxes place them, and the light that they add to a picture."""

import math

import numpy as np
import pytest
import torch
from headlit_oracle import StatedScene

from blurnoise.camera import Camera
from blurnoise.light.headlamps import Headlamps
from blurnoise.light.headlit import NEAREST_M, Outline, RoadView, headlit
from blurnoise.light.road_objects import RoadObject, road_object
from blurnoise.motion.ego import Vehicle

SIZE = (720, 1280)
CAMERA = Camera.preset("imx250").with_figures(width_px=1280, height_px=720, hfov_deg=60.0)
FOCAL_PX = 640 / math.tan(math.radians(30))
LIGHT = torch.full((1, 3, *SIZE), 0.341)
LOW, HIGH = Headlamps("low"), Headlamps("high")


def sign(ahead_m=50.0, right_m=3.0, **other):
    stated = {"base_m": 1.8, "width_m": 0.762, "height_m": 0.762, "focal_px": FOCAL_PX, "size": SIZE}
    return StatedScene(right_m, ahead_m, **{**stated, **other})


def of_sign(scene, lamps=LOW, **view):
    (found,) = headlit(LIGHT, [Outline("stop sign", scene.box)], RoadView(CAMERA, **view), lamps).targets
    return found


# The held-out scenes: stated in metres, reckoned by the oracle alone.
@pytest.mark.parametrize(
    ("label", "scene", "lamps", "up_m"),
    [
        ("stop sign", sign(34.0, 4.2), LOW, 2.181),
        ("stop sign", sign(80.0, -3.5), HIGH, 2.181),
        ("person", sign(27.0, -1.5, base_m=0.0, width_m=0.5, height_m=1.7), LOW, 0.2),
    ],
)
def test_held_out_scenes(label, scene, lamps, up_m):
    light = torch.full((1, 3, *SIZE), 0.5)
    picture = headlit(light, [Outline(label, scene.box)], RoadView(CAMERA), lamps)
    lux, returned = scene.lit(up_m, lamps.beam == "high")
    returned = returned if label == "stop sign" else 0.0
    ambient_lux = 1.0
    row = round(SIZE[0] / 2 + (1.5 - up_m) * FOCAL_PX / scene.ahead_m - 0.5)
    column = int((scene.box[0] + scene.box[2]) / 2)
    luminance = 0.5 * (ambient_lux + float(picture.plane()[0, 0, row, column])) / math.pi
    assert luminance == pytest.approx(0.5 * (ambient_lux + lux) / math.pi + returned, rel=0.02)


@pytest.mark.parametrize("ahead_m", [13.2, 25.0, 50.0, 100.0])
def test_distance_by_size(ahead_m):
    at = of_sign(sign(ahead_m)).standing
    assert (at.ahead_m, at.right_m) == pytest.approx((ahead_m, 3.0), rel=1e-9)
    assert at.up_m(np.array([sign(ahead_m).box[1]])) == pytest.approx(1.8 + 0.762)


def test_stop_sign_at_50_m_in_low_beam():
    found = of_sign(sign(base_m=1.819), own={"stop sign": RoadObject(0.762, 0.762, 1.819, "III")})
    numbers = found.observation_deg, found.illuminance_lux, found.luminance_cd_m2
    assert numbers == pytest.approx((1.189, 0.1443, 2.1779), rel=0.005)
    lux = found.lux(int(found.outline.box_xyxy[1]) + 8, 1)[0]
    assert lux == pytest.approx(20.21, rel=0.01)


def test_legs_are_lit_more_than_the_chest():
    scene = sign(40.0, 1.0, base_m=0.0, width_m=0.5, height_m=1.7)
    (person,) = headlit(LIGHT, [Outline("person", scene.box)], RoadView(CAMERA), LOW).targets
    rows = [scene.box[3] - up * FOCAL_PX / 40 for up in (0.25, 0.9, 1.4)]
    assert person._at(np.array(rows))[0].tolist() == pytest.approx([21.44, 1.366, 0.3085], rel=0.005)
    assert person.luminance_cd_m2 == 0


def test_nearer_than_8_m_counts_as_8_m():
    found = of_sign(sign(3.0, right_m=0.5))
    assert found.nearer
    assert found.standing.ahead_m == pytest.approx(NEAREST_M)
    assert found.standing.measured_m == pytest.approx(3.0)
    assert found.standing.up_m(np.array([sign(3.0).box[1]])) == pytest.approx(1.8 + 0.762)  # its size is kept
    assert not of_sign(sign(8.1)).nearer


def test_stated_distance_replaces_that_by_size():
    assert of_sign(sign(50.0), distance_m=20.0).distance_m == pytest.approx(20.0)


def test_a_sign_seen_from_the_side_is_as_far_as_its_height_says():
    box = sign(50.0).box
    half = (box[2] - box[0]) / 4
    turned = (box[0] + half, box[1], box[2] - half, box[3])
    at = RoadView(CAMERA).standing(turned, road_object("stop sign"), SIZE)
    assert at.ahead_m == pytest.approx(50.0)


def test_a_person_who_lies_is_no_tenth_as_tall():
    flat = RoadView(CAMERA).standing((600, 400, 700, 405), road_object("person"), SIZE)
    assert flat.ahead_m == pytest.approx(FOCAL_PX * 1.7 / 25, rel=1e-3)


@pytest.mark.parametrize(
    "box", [(-50, 10, -1, 40), (10, 800, 40, 850), (10, 10, 10, 40), (1300, 0, 1400, 50)], ids=str
)
def test_boxes_outside_receive_no_light(box):
    picture = headlit(LIGHT, [Outline("stop sign", box)], RoadView(CAMERA), LOW)
    assert picture.targets == (None,)
    assert not picture.plane().any()


@pytest.mark.parametrize(
    "box",
    [(-20, -30, 1400, 900), (0.2, 0.2, 0.4, 0.3), (1279.9, 719.9, 1290, 730), (5, 5, 1200, 5.5)],
    ids=str,
)
def test_strange_boxes_give_finite_light_within_the_picture(box):
    picture = headlit(LIGHT, [Outline("person", box), Outline("stop sign", box)], RoadView(CAMERA), HIGH)
    plane = picture.plane()
    assert plane.shape == (1, 1, *SIZE)
    assert bool(torch.isfinite(plane).all())
    assert plane.min() >= 0
    assert all(target.distance_m + 1e-9 >= NEAREST_M for target in picture.targets if target)


def test_a_box_that_reaches_the_picture_s_side_is_cut_off():
    x0, y0, x1, y1 = sign(10.0).box
    shifted = Outline("stop sign", (0.0, y0, x1 - x0, y1))
    (found,) = headlit(LIGHT, [shifted], RoadView(CAMERA), LOW).targets
    assert found.cut_off
    assert not of_sign(sign(10.0)).cut_off


def test_classes_outside_the_table_receive_no_light():
    picture = headlit(LIGHT, [Outline("pizza", (600, 300, 650, 350))], RoadView(CAMERA), LOW)
    assert picture.targets == (None,)
    assert not picture.plane().any()


def test_white_gets_its_luminance_however_the_photograph_was_exposed():
    scene = sign(50.0)
    for exposed in (0.1, 0.8):
        light = torch.full((1, 3, *SIZE), exposed)
        (found,) = headlit(light, [Outline("stop sign", scene.box)], RoadView(CAMERA), LOW).targets
        middle = int((scene.box[1] + scene.box[3]) / 2)
        returned = found.white * (found.lux(middle, 1)[0] - found.illuminance_lux) / math.pi
        assert returned == pytest.approx(found.luminance_cd_m2, rel=0.02)


def test_white_of_a_box_without_outline_is_not_its_corner():
    box = (600.0, 300.0, 640.0, 340.0)
    light = torch.full((1, 3, *SIZE), 1.0)  # the sky
    yy, xx = np.mgrid[0:40, 0:40] - 19.5
    octagon = torch.from_numpy((np.abs(xx) + np.abs(yy) < 28) & (np.maximum(abs(xx), abs(yy)) < 20))
    light[0, :, 300:340, 600:640][:, octagon] = 0.3
    (found,) = headlit(light, [Outline("stop sign", box)], RoadView(CAMERA), LOW).targets
    assert found.white == pytest.approx(0.3)


def test_a_silhouette_has_a_least_white():
    (found,) = headlit(LIGHT * 0, [Outline("stop sign", sign().box)], RoadView(CAMERA), LOW).targets
    assert found.white == 0.02


def test_only_the_matte_shines():
    alpha = np.zeros((10, 12), np.float32)
    alpha[2:8, 3:9] = 1.0
    alpha[8, 3:9] = 0.5
    outline = Outline("stop sign", (600.0, 300.0, 612.0, 310.0), alpha, (600, 300), outlined=True)
    plane = headlit(LIGHT, [outline], RoadView(CAMERA), LOW).plane()[0, 0]
    assert set(map(tuple, torch.nonzero(plane).tolist())) == {
        (y, x) for y in range(302, 309) for x in range(603, 609)
    }
    assert float(plane[308, 605]) == pytest.approx(float(plane[307, 605]) / 2, rel=0.05)


def test_the_target_further_down_is_in_front():
    behind = Outline("stop sign", (600.0, 300.0, 640.0, 340.0))
    front = Outline("person", (610.0, 310.0, 630.0, 420.0))
    picture = headlit(LIGHT, [front, behind], RoadView(CAMERA), LOW)
    person, plane = picture.targets[0], picture.plane()[0, 0]
    assert float(plane[325, 620]) == pytest.approx(person.lux(325, 1)[0])
    assert torch.equal(picture.plane(but=[0])[0, 0, 325, 605], plane[325, 605])


def test_background_is_dark_or_a_wall_at_the_median_distance():
    boxes = [Outline("stop sign", sign(ahead, right).box) for ahead, right in ((20, -4), (40, 2), (90, 3))]
    dark = headlit(LIGHT, boxes, RoadView(CAMERA), LOW)
    lit = headlit(LIGHT, boxes, RoadView(CAMERA, background="lit"), LOW)
    assert dark.wall is None
    assert dark.plane()[0, 0, 300, 100] == 0
    # in the column of the sign at 40 m, in its middle row, as much as on the sign itself
    x0, y0, x1, y1 = boxes[1].box_xyxy
    row, column = round((y0 + y1) / 2 - 0.5), round((x0 + x1) / 2 - 0.5)
    assert lit.wall[row, column] == pytest.approx(lit.targets[1].illuminance_lux, rel=0.02)
    assert headlit(LIGHT, [], RoadView(CAMERA, background="lit"), LOW).wall is None


def test_wall_of_a_target_that_counts_as_8_m_has_the_scale_of_8_m():
    lit = headlit(LIGHT, [Outline("stop sign", sign(2.0, 0.3).box)], RoadView(CAMERA, background="lit"), LOW)
    foot = sign(2.0, 0.3).box[3]
    above = int(foot - 0.3 * FOCAL_PX / 8)  # .3 m above the sign's foot at 8 m
    expected = LOW.onto((0.5 - 640) * 8 / FOCAL_PX, 1.8 + (foot - above - 0.5) * 8 / FOCAL_PX, 8.0)
    assert lit.wall[above, 0] == pytest.approx(float(expected.illuminance_lux), rel=0.01)


def test_wall_at_a_stated_distance_has_the_scale_of_that_distance():
    view = RoadView(CAMERA, background="lit", distance_m=50.0)
    box = sign(10.0, 0.3).box
    lit = headlit(LIGHT, [Outline("stop sign", box)], view, LOW)
    below = int(box[3] + 1.0 * FOCAL_PX / 50)  # 1 m below the sign's foot at 50 m
    expected = LOW.onto((0.5 - 640) * 50 / FOCAL_PX, 1.8 + (box[3] - below - 0.5) * 50 / FOCAL_PX, 50.0)
    assert lit.wall[below, 0] == pytest.approx(float(expected.illuminance_lux), rel=0.01)
    assert lit.targets[0].standing.up_m(np.array([box[1]])) == pytest.approx(
        1.8 + 0.762
    )  # its own size is kept


def test_sheeting_replaces_that_of_classes_that_have_one():
    person = Outline("person", sign(27.0, -1.5, base_m=0.0, width_m=0.5, height_m=1.7).box)
    outlines = [Outline("stop sign", sign().box), person]
    found = headlit(LIGHT, outlines, RoadView(CAMERA, sheeting="XI"), LOW).targets
    assert found[0].luminance_cd_m2 > 2 * of_sign(sign()).luminance_cd_m2
    assert found[1].luminance_cd_m2 == 0
    assert headlit(LIGHT, outlines, RoadView(CAMERA, sheeting="none"), LOW).targets[0].luminance_cd_m2 == 0


def test_the_vehicle_says_how_high_the_camera_is():
    low, high = (of_sign(sign(), vehicle=Vehicle(height_m=height)) for height in (1.2, 1.5))
    # the share that section 7 of the design has for a camera at 1.2 m
    assert low.luminance_cd_m2 / high.luminance_cd_m2 == pytest.approx(1.69, abs=0.03)


def test_a_vehicle_with_a_field_of_view_sees_by_it():
    wide = RoadView(CAMERA, Vehicle(hfov_deg=90.0, lens="rectilinear"))
    at = wide.standing(sign().box, road_object("stop sign"), SIZE)
    assert at.ahead_m == pytest.approx(50 * 640 / FOCAL_PX)


def test_heading_turns_the_road():
    view = RoadView(CAMERA, Vehicle(heading_deg=10.0))
    at = view.standing((635.0, 355.0, 645.0, 365.0), road_object("stop sign"), SIZE)
    assert math.degrees(math.atan2(at.right_m, at.ahead_m)) == pytest.approx(10.0, abs=0.05)


def test_without_a_base_the_picture_says_how_high_a_target_is():
    of = RoadObject(width_m=0.762, base_m=None)
    at = RoadView(CAMERA, Vehicle(pitch_deg=0.0)).standing(sign(50.0).box, of, SIZE)
    assert at.up_m(np.array([sign(50.0).box[1]])) == pytest.approx(1.8 + 0.762)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"background": "grey"}, "background = 'grey': must be one of 'dark', 'lit'"),
        ({"sheeting": "IX"}, "sheeting = 'IX'"),
        ({"distance_m": 0.0}, "distance_m = 0.0: must be finite and >= 1"),
        ({"distance_m": math.nan}, "distance_m = nan"),
    ],
)
def test_faults_are_one_line(fields, message):
    with pytest.raises(ValueError, match=message):
        RoadView(CAMERA, **fields)
