"""Matching under blur: the box at mid-exposure and all that it covers during the exposure, told apart by detectors
that box the one or the other."""

from collections.abc import Callable

import numpy as np
import pytest
from blurnoise_eval.datasets import Picture, Target
from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.plan.conditions import Cell, Conditions
from blurnoise_eval.run.exposing import PictureScene, frames
from blurnoise_eval.scoring.boxes import swept_within
from blurnoise_eval.scoring.evaluated import Evaluated, Truth
from blurnoise_eval.scoring.movers import box_mover, box_sweeper
from blurnoise_eval.scoring.on_picture import ModelOnPicture
from numpy.typing import NDArray

from blurnoise import Camera
from blurnoise.scene.exposure import Exposure

CAMERA = Camera.preset("imx250")
SIDE_PX, BOX = 20, (130.0, 60.0, 150.0, 80.0)
EXPOSURE_S, LUX = 0.01, 100.0
Found = Callable[[NDArray[np.uint8]], tuple[float, float, float, float]]


def square():
    """White on black, (150, 280, 3)."""
    image = np.zeros((150, 280, 3), np.uint8)
    image[60:80, 130:150] = 255
    return image


def smear(image):
    """The box of all that is clearly brighter than black."""
    rows, columns = np.nonzero(image.min(axis=2) > 40)
    return columns.min(), rows.min(), columns.max() + 1, rows.max() + 1


class Fake:
    """A detector without a network: one box, sure of itself."""

    name, non_finite_values_here = "fake", 0

    def __init__(self, found):
        self._found = found
        self.contract = type("Contract", (), {"classes": ("square",)})()

    def detect_all(self, image):
        found = Detections(np.array([self._found(image)]), np.array([1.0]), np.array([0]))
        return found, None


def answers(found, velocity_px_s):
    scene, picture = PictureScene(square()), Picture("p", (Target("square", "squares", BOX),), square, "p")
    x, y = velocity_px_s
    at = Conditions(exposure_s=EXPOSURE_S, illuminance_lux=LUX, velocity_x_px_s=x, velocity_y_px_s=y)
    (frame,) = frames(scene, [Cell("p", 0, at, 7)], CAMERA)
    seen = ModelOnPicture(Fake(found), picture, square())  # type: ignore[arg-type]
    (row,) = seen.evaluate(frame.image, frame.move_boxes, frame.sweep_boxes).targets
    return row


@pytest.mark.parametrize("direction", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
@pytest.mark.parametrize("blur_px", [0.0, 6.0, 16.0, 26.0, 45.0])
def test_who_boxes_the_smear_is_right_by_the_swept_box(blur_px, direction):
    """At any blur; held to the place at mid-exposure only while the smear is less than twice the square's size."""
    x, y = (blur_px * along / EXPOSURE_S for along in direction)
    row = answers(smear, (x, y))
    assert row.confidence_swept == 1
    area = (SIDE_PX + blur_px * abs(direction[0])) * (SIDE_PX + blur_px * abs(direction[1]))
    assert row.confidence == float(SIDE_PX**2 / area > 0.5)


def judged(box, speed_px_s):
    exposure = Exposure(CAMERA, EXPOSURE_S, LUX, (speed_px_s, 0.0))
    sides = [BOX[0], BOX[1], SIDE_PX, SIDE_PX]
    annotations = [
        {"id": number, "image_id": number, "category_id": 3, "bbox": sides, "area": 400.0, "iscrowd": 0}
        for number in (1, 2)
    ]
    truth = Truth(
        {"annotations": annotations, "categories": [{"id": 3, "name": "square"}]},
        {"p": 1, "q": 2},
        {0: 3},
        {1: (280, 150), 2: (155, 150)},
    )
    clipped = np.minimum(box, [155, 150, 155, 150])  # the second picture ends 5 px right of the square
    found = [
        (name, 0, Detections(each[None], np.array([0.9]), np.array([0])))
        for name, each in (("p", box), ("q", clipped))
    ]
    return Evaluated({}, truth, Answers.of(found), box_mover(exposure), box_sweeper(exposure))


@pytest.mark.parametrize(("blur_px", "other"), [(6.0, 1.0), (26.0, 0.5 * 51 / 101), (100.0, 0.0)])
def test_average_precision_by_the_swept_box(blur_px, other):
    """Boxes of the one kind are right by it, by the other as far as they overlap.

    At 26 px the square is 20/46 of its smear, but 20/38 where the picture's border cuts this: of two detections the
    second is right, a precision of 1/2 at 51 of 101 recalls.
    """
    grown = np.array(BOX) + np.array([-blur_px / 2, 0, blur_px / 2, 0])
    of_smear, of_middle = (judged(box, blur_px / EXPOSURE_S) for box in (grown, np.array(BOX)))
    assert of_smear.swept_ap50.value == pytest.approx(1)
    assert of_middle.average(ious=slice(1)).value == pytest.approx(1)
    assert of_middle.swept_ap50.value == pytest.approx(other)
    assert of_smear.average(ious=slice(1)).value == pytest.approx(other)


def test_sweeping_ends_at_the_border_of_the_picture():
    moved = [[2.0, 10.0, 12.0, 20.0], [90.0, 30.0, 99.0, 48.0], [-5.0, 10.0, 30.0, 55.0]]
    sweep = box_sweeper(Exposure(CAMERA, 0.02, 50.0, (1000.0, -200.0)))
    swept = sweep(np.array(moved), np.full((3, 2), (100.0, 50.0)), ["square"] * 3)
    inside = [[0, 8, 22, 22], [80, 28, 100, 50], [-5, 8, 40, 55]]
    np.testing.assert_allclose(swept_within(swept, moved, (100, 50)), inside)
