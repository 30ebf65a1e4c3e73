"""Targets stand where an exposure has moved them, in what is matched, what is read and what is noted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matched_filter
import numpy as np
import pytest
from blurnoise_eval.datasets import Picture, Target
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.ocr import Reading
from blurnoise_eval.scoring.on_picture import View
from numpy.typing import NDArray

from blurnoise import charts
from blurnoise.optics.colour import srgb_from_linear

SIZE_PX, HEIGHT_PX, WIDTH_PX, SHIFT_PX = 24, 54, 64, 15
BOX = tuple(float(e) for e in charts.stop_sign_box(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX))
MOVED = (BOX[0] + SHIFT_PX, BOX[1], BOX[2] + SHIFT_PX, BOX[3])


def sign(shift_px: int = 0) -> NDArray[np.uint8]:
    linear = charts.stop_sign(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX)
    coded: Any = srgb_from_linear(linear)[0].permute(1, 2, 0).mul(255).round().byte().numpy()
    return np.ascontiguousarray(np.roll(coded, shift_px, axis=1))


def to_the_right(
    boxes: NDArray[np.float64], sizes_px: NDArray[np.float64], labels: Sequence[str]
) -> NDArray[np.float64]:
    assert boxes.shape == (1, 4)
    assert len(labels) == 1
    assert sizes_px.shape == (1, 2)
    return boxes + np.array([SHIFT_PX, 0, SHIFT_PX, 0])


def box_of(row: dict[str, Any]) -> tuple[float, ...]:
    return tuple(row[edge] for edge in ("x0", "y0", "x1", "y1"))


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    return Detector(matched_filter.build(path, sizes_px=(24, 16, 10), input_px=64))


@pytest.mark.parametrize("labelled", [True, False], ids=["labelled", "found when clean"])
def test_a_detector_is_held_against_moved_targets(detector: Detector, labelled: bool) -> None:
    targets = (Target("stop sign", "signs", BOX),) if labelled else None
    seen = View(detector, Picture("p", targets, sign, "p"), sign())
    (clean,), (missed,) = seen.clean.targets, seen.evaluate(sign(SHIFT_PX)).targets
    (found,) = seen.evaluate(sign(SHIFT_PX), to_the_right).targets
    assert clean["confidence"] > 0.8
    assert missed["confidence"] < 0.3
    assert found["confidence"] == pytest.approx(clean["confidence"], abs=0.1)
    assert box_of(missed) == box_of(clean)
    assert box_of(found) == pytest.approx(
        [edge + d for edge, d in zip(box_of(clean), (15, 0, 15, 0), strict=True)]
    )
    assert found["width_px"] == pytest.approx(clean["width_px"])
    (again,) = seen.evaluate(
        sign(SHIFT_PX)
    ).targets  # where targets stand is kept for one motion, not for all
    assert {**again, "confidence": 0} == {**missed, "confidence": 0}
    swept = seen.evaluate(sign(), None, to_the_right).targets[0]
    assert (box_of(swept), swept["confidence"]) == (box_of(clean), clean["confidence"])
    assert swept["confidence_swept"] < 0.3


class Asked:
    """A reader that notes where it is asked to read."""

    name, sha256, non_finite_values_here, contract, path = "reader", "0" * 64, 0, None, Path("reader.onnx")

    def __init__(self) -> None:
        self.boxes: list[Any] = []

    def read(self, image: NDArray[np.uint8], boxes_xyxy: Any) -> list[Reading]:
        self.boxes.append([tuple(box) for box in boxes_xyxy])
        return [Reading("STOP", 0.9) for _ in boxes_xyxy]


def test_a_reader_reads_where_the_targets_stand() -> None:
    reader = Asked()
    seen = View(reader, Picture("p", (Target("text", "texts", BOX, text="STOP"),), sign, "p"), sign())
    (row,) = seen.evaluate(sign(SHIFT_PX), to_the_right).targets
    assert reader.boxes == [[BOX], [MOVED]]
    assert (box_of(row), row["confidence"]) == (MOVED, 0.9)


def test_pictures_without_targets_have_nothing_to_move(detector: Detector) -> None:
    seen = View(detector, Picture("p", (), sign, "p"), sign())
    assert seen.evaluate(sign(), to_the_right).targets == ()
