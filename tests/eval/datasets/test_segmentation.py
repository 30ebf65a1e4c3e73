"""Mattes of annotations: polygons by area, run lengths against COCO's own tools, objects found in boxes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from blurnoise_eval.datasets import segmentation
from pycocotools import mask as coco_masks

SIZE = (61, 84)


def disc(*, hidden: bool) -> tuple[np.ndarray, np.ndarray, tuple[float, ...]]:
    """A picture (120, 161, 3) with a disc of 21 px radius, its matte and its box; hidden: its upper third has the
    colours of what is around it."""
    rng = np.random.default_rng(4)
    y, x = np.mgrid[:120, :161] + 0.5
    inside = np.hypot(x - 90, y - 62) <= 21
    shown = inside & (y > 55) if hidden else inside
    colours = np.where(shown[..., None], (200, 60, 40), (70, 90, 110)) + rng.normal(0, 6, (120, 161, 3))
    return colours.clip(0, 255).astype(np.uint8), inside.astype(np.float32), (69.0, 41.0, 111.0, 83.0)


def test_an_object_is_found_in_its_box_by_its_colours() -> None:
    picture, inside, box = disc(hidden=False)
    found = segmentation.of_object_in(picture, box)
    assert np.minimum(found, inside).sum() / np.maximum(found, inside).sum() > 0.93
    cv2.setRNGSeed(99)  # whatever was drawn before
    assert np.array_equal(segmentation.of_object_in(picture, box), found)
    drawn = cv2.randu(np.zeros(8, np.float32), 0, 1)
    cv2.setRNGSeed(99)
    assert np.array_equal(cv2.randu(np.zeros(8, np.float32), 0, 1), drawn)  # and whatever is drawn after


def test_what_does_not_reach_all_sides_of_its_box_is_the_box() -> None:
    """So that no part of an object is left behind, sharp."""
    picture, _, (x0, y0, x1, y1) = disc(hidden=True)
    boxed = segmentation.of_box(x0, y0, x1 - x0, y1 - y0, (120, 161))
    assert np.array_equal(segmentation.of_object_in(picture, (x0, y0, x1, y1)), boxed)


@pytest.mark.parametrize(
    "box", [(0.0, 0.0, 161.0, 120.0), (3.0, 3.0, 6.0, 5.0), (150.5, 100.0, 170.0, 140.0)]
)
def test_a_box_with_nothing_to_compare_with_is_taken_whole(box: tuple[float, ...]) -> None:
    picture = disc(hidden=False)[0]
    x0, y0, x1, y1 = box
    found = segmentation.of_object_in(picture, box)
    assert np.array_equal(found, segmentation.of_box(x0, y0, x1 - x0, y1 - y0, (120, 161)))
    outside = segmentation.of_object_in(picture, (200.0, 10.0, 220.0, 20.0))
    assert not outside.any()


def test_run_lengths_are_those_of_cocos_tools() -> None:
    drawn = np.random.default_rng(0)
    for _ in range(20):
        size = tuple(int(side) for side in drawn.integers(2, 50, 2))
        mask = (drawn.random(size) > drawn.random()).astype(np.uint8)
        packed = coco_masks.encode(np.asfortranarray(mask))
        assert (segmentation.of_rle(packed["counts"], size) == mask).all()
        assert (segmentation.of_rle(packed["counts"].decode(), size) == mask).all()
    large = np.zeros((480, 640), np.uint8)
    large[100:300, 50:600] = 1  # numbers of several characters, either sign of their differences
    packed = coco_masks.encode(np.asfortranarray(large))
    assert (segmentation.of_rle(packed["counts"], (480, 640)) == large).all()


@pytest.mark.parametrize("counts", [[2, 3], [7, -1], "", "~~~~", b"\x00", "01", "n", "\u4f60\u597d"])
def test_run_lengths_that_are_none(counts: object) -> None:
    with pytest.raises((ValueError, TypeError), match=r"segmentation|counts"):
        segmentation.of_rle(counts, (2, 3))  # type: ignore[arg-type]


def test_polygons_take_their_area() -> None:
    """Whole eighths of a pixel exactly; else to an eighth at an edge; random shapes to 1 %, their mean to 0.1 %."""
    rectangle = [10.25, 5.5, 30.75, 5.5, 30.75, 17.25, 10.25, 17.25]
    found, exact = (
        segmentation.of_polygons([rectangle], SIZE),
        segmentation.of_box(10.25, 5.5, 20.5, 11.75, SIZE),
    )
    assert float(exact.sum()) == pytest.approx(20.5 * 11.75)
    assert (found == exact).all()
    triangle = segmentation.of_polygons([[3, 3, 40, 7, 20, 33]], SIZE)
    assert float(triangle.sum()) == pytest.approx(521, abs=0.5)
    drawn, off = np.random.default_rng(0), []
    for _ in range(40):
        angle, radius = 2 * np.pi * (np.arange(7) + drawn.uniform(0, 0.8, 7)) / 7, drawn.uniform(4, 14, 7)
        x, y = 30 + radius * np.cos(angle), 25 + radius * np.sin(angle)
        area = abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) / 2
        own = segmentation.of_polygons([np.stack([x, y], 1).ravel().tolist()], SIZE)
        off.append(float(own.sum()) / area - 1)
    assert np.abs(off).max() < 0.01
    assert abs(np.mean(off)) < 1e-3


def test_polygons_are_joined_and_end_with_the_picture() -> None:
    one, other = [5, 5, 15, 5, 15, 15, 5, 15], [10, 10, 20, 10, 20, 20, 10, 20]
    both = segmentation.of_polygons([one, other], SIZE)
    assert float(both[12, 12]) == 1.0  # where they overlap, too
    assert float(both.sum()) == pytest.approx(175, abs=5)
    assert float(segmentation.of_polygons([[-10, -10, 4, -10, 4, 4, -10, 4]], SIZE).sum()) == pytest.approx(
        16, abs=1
    )
    assert float(segmentation.of_polygons([[-10, -10, -4, -10, -4, -4]], SIZE).sum()) == 0


def test_polygons_mean_what_cocos_tools_mean() -> None:
    polygon = [12.0, 8.0, 60.0, 15.0, 48.0, 50.0, 20.0, 41.0]
    theirs = coco_masks.decode(coco_masks.frPyObjects([polygon], *SIZE))[..., 0]
    ours = segmentation.of_polygons([polygon], SIZE)
    assert float(np.abs(ours - theirs).sum()) < 75  # half a pixel of their outline of 150 px
    assert float(ours.sum()) == pytest.approx(float(theirs.sum()), rel=0.03)


def test_annotations() -> None:
    square = [5, 5, 15, 5, 15, 15, 5, 15]
    assert (
        segmentation.of_annotation({"segmentation": [square]}, SIZE)
        == segmentation.of_polygons([square], SIZE)
    ).all()
    runs = {"segmentation": {"size": [2, 3], "counts": [2, 3, 1]}, "iscrowd": 0}
    assert segmentation.of_annotation(runs, (2, 3)).sum() == 3
    for wrong, message in (
        ({**runs, "iscrowd": 1}, "a crowd's"),
        ({"segmentation": []}, "there is none"),
        ({"segmentation": [[1, 2, 3, 4]]}, "3 corners"),
        ({"segmentation": {"size": [3, 2], "counts": [6]}}, "must be the picture's"),
    ):
        with pytest.raises(ValueError, match=message):
            segmentation.of_annotation(wrong, (2, 3))
