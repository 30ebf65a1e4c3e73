"""Mattes of annotations: polygons by area, run lengths against COCO's own tools."""

import numpy as np
import pytest
from blurnoise_eval.datasets import segmentation
from blurnoise_eval.datasets.segmentation import of_annotation
from pycocotools import mask as coco_masks

SIZE = (61, 84)


def test_run_lengths_are_those_of_cocos_tools():
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


def test_polygons_take_their_area():
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


def test_annotations():
    square = [5, 5, 15, 5, 15, 15, 5, 15]
    assert (of_annotation({"segmentation": [square]}, SIZE) == segmentation.of_polygons([square], SIZE)).all()
    runs = {"segmentation": {"size": [2, 3], "counts": [2, 3, 1]}, "iscrowd": 0}
    assert of_annotation(runs, (2, 3)).sum() == 3


BAD = [
    (None, "of one object"),
    ([[1, 2, 3, 4]], "3 corners"),
    ([[1, 2, 3, 4, 5, "six"]], "segmentation = "),
    ({"size": [3, 2], "counts": [6]}, r"of one object in \(2, 3\)"),
    ({"size": [2, 3]}, "counts"),
    *(
        ({"size": [2, 3], "counts": counts}, "segmentation = ")
        for counts in ([2, 3], [7, -1], "", "01", [[1]])
    ),
]


@pytest.mark.parametrize(("segmentation", "fault"), BAD)
def test_what_is_no_segmentation_is_named(segmentation, fault):
    with pytest.raises(ValueError, match=fault):
        of_annotation({"segmentation": segmentation}, (2, 3))
    with pytest.raises(ValueError, match="of one object"):
        of_annotation({"segmentation": {"size": [2, 3], "counts": [6]}, "iscrowd": 1}, (2, 3))
