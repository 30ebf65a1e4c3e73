"""Detection before recognition: maps with known regions, and a graph that takes brightness for text."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from band_readers import COLOURS, band_reader, saved
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.ocr import Reading, Recogniser, TextSpotter
from blurnoise_eval.detectors.ocr.recogniser import RegionContract
from blurnoise_eval.detectors.ocr.spotter import find_regions, straighten
from constant_graphs import answering_graph
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

# Pictures enter at their own size, and crops hold little beside the bands, whose mean the recogniser reads.
NATIVE = {"min_side_px": 1, "unclip": 0.3}


def turned_rectangle(
    shape: tuple[int, int], centre: tuple[float, float], size: tuple[float, float], angle_deg: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates (u, v) of every pixel's centre, from -1 to 1 inside the rectangle; clockwise as displayed."""
    y, x = np.indices(shape) + 0.5
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    dx, dy = x - centre[0], y - centre[1]
    return (dx * cos + dy * sin) * 2 / size[0], (dy * cos - dx * sin) * 2 / size[1]


def corners_of(
    centre: tuple[float, float], size: tuple[float, float], angle_deg: float
) -> NDArray[np.float64]:
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    right, down = np.array([cos, sin]) * size[0] / 2, np.array([-sin, cos]) * size[1] / 2
    middle = np.array(centre)
    return np.stack(
        [middle - right - down, middle + right - down, middle + right + down, middle - right + down]
    )


def brightness_detector(
    path: Path, *, shape: tuple[int | str, int | str] = ("H", "W"), dtype: int = TensorProto.FLOAT
) -> Path:
    """Write a text detector whose map is the brightest channel, 0 to 1; the input is -1 to 1."""
    kind = helper.tensor_dtype_to_np_dtype(dtype)
    graph = helper.make_graph(
        [
            helper.make_node("ReduceMax", ["x"], ["most"], axes=[1], keepdims=1),
            helper.make_node("Clip", ["most", "zero", "one"], ["map"]),
        ],
        "bright",
        [helper.make_tensor_value_info("x", dtype, ["N", 3, *shape])],
        [helper.make_tensor_value_info("map", dtype, ["N", 1, *shape])],
        [numpy_helper.from_array(np.array(value, kind), name) for name, value in (("zero", 0), ("one", 1))],
    )
    return saved(graph, path, {})


def spotter(folder: Path, **contract: object) -> TextSpotter:
    recogniser = Recogniser(band_reader(folder / "rec.onnx"))
    return TextSpotter(brightness_detector(folder / "det.onnx"), recogniser, contract={**NATIVE, **contract})


def picture(*words: tuple[str, int, int]) -> NDArray[np.uint8]:
    """Black, 160 px high and 320 wide, with words of bands 16 px wide and 16 high at (left, top)."""
    image = np.zeros((160, 320, 3), np.uint8)
    for letters, left, top in words:
        for place, letter in enumerate(letters):
            image[top : top + 16, left + 16 * place : left + 16 * (place + 1)] = COLOURS[letter]
    return image


# --- regions ---


@pytest.mark.parametrize("angle_deg", [-40, 0, 30])
def test_regions_are_rectangles_moved_outwards(angle_deg: float) -> None:
    centre, size = (151.3, 108.2), (120.0, 24.0)
    u, v = turned_rectangle((210, 310), centre, size, angle_deg)
    inside = (abs(u) < 1) & (abs(v) < 1)
    (region,) = find_regions(np.where(inside, np.float32(0.9), np.float32(0)), RegionContract())
    grown = 1.6 * size[0] * size[1] / sum(size)
    expected = corners_of(centre, (size[0] + grown, size[1] + grown), angle_deg)
    # The outline runs through the outermost pixels' centres: up to 1 px inside on each side, with the offset
    # that much smaller: 1.6 · d(wh/(w + h)) < 1.6 px for 1 px of either.
    assert np.abs(region - expected).max() < 2.7
    np.testing.assert_allclose(region.mean(0), centre, atol=0.5)


def test_thresholds() -> None:
    probabilities = np.zeros((64, 96), np.float32)
    probabilities[10:20, 10:50] = 0.45
    assert find_regions(probabilities, RegionContract()) == []  # text, but not sure enough
    assert len(find_regions(probabilities, RegionContract(box_threshold=0.4))) == 1
    assert find_regions(probabilities, RegionContract(threshold=0.5, box_threshold=0.4)) == []
    probabilities[30:32, 10:50] = 1  # 2 px high: its outline is 1 px high
    assert find_regions(probabilities, RegionContract()) == []
    assert find_regions(np.full((64, 96), np.nan, np.float32), RegionContract()) == []


@pytest.mark.parametrize("angle_deg", [-44, 5, 30])
def test_straightened_text_runs_to_the_right(angle_deg: float) -> None:
    centre, size = (150.0, 110.0), (100.0, 30.0)
    u, v = turned_rectangle((220, 300), centre, size, angle_deg)
    image = np.zeros((220, 300, 3), np.uint8)
    image[..., 0] = np.clip(127.5 + 100 * u, 0, 255).round()  # red grows along the line, green downwards
    image[..., 1] = np.clip(127.5 + 100 * v, 0, 255).round()
    crop = straighten(image, corners_of(centre, size, angle_deg).astype(np.float32))
    assert crop.shape == (30, 100, 3)
    along = 127.5 + 100 * (np.arange(100) + 0.5 - 50) / 50
    down = 127.5 + 100 * (np.arange(30) + 0.5 - 15) / 15
    # Rounded twice, and 1/32 px of the warp's own table in x and y: at most 0.5 + 0.5 + 2 · 100/15/32.
    np.testing.assert_allclose(crop[..., 0], np.broadcast_to(along, (30, 100)), atol=1.5)
    np.testing.assert_allclose(crop[..., 1], np.broadcast_to(down[:, None], (30, 100)), atol=1.5)


@pytest.mark.parametrize(
    ("size", "shape"), [((20, 80), (20, 80, 3)), ((40, 61), (40, 61, 3)), ((60, 80), (80, 60, 3))]
)
def test_a_high_region_is_laid_on_its_side(size: tuple[int, int], shape: tuple[int, ...]) -> None:
    image = np.zeros((100, 100, 3), np.uint8)
    image[:50] = (255, 0, 0)
    crop = straighten(image, corners_of((50, 50), size, 0).astype(np.float32))
    assert crop.shape == shape
    assert (crop[0 if shape[0] < shape[1] else 5, 5] == (255, 0, 0)).all()  # what was above is on the left


# --- spotting ---


def whole(made: TextSpotter, image: NDArray[np.uint8]) -> str:
    return made.read(image, [(0, 0, image.shape[1], image.shape[0])])[0].text


@pytest.mark.parametrize("contract", [{}, {"min_side_px": 480}, {"max_side_px": 160}])
def test_lines_are_found_and_read(tmp_path: Path, contract: dict[str, object]) -> None:
    """Row by row, from the left."""
    image = picture(("rgb", 40, 30), ("br", 200, 34), ("gr", 100, 110))
    assert whole(spotter(tmp_path, **contract), image) == "rgb br gr"
    assert whole(spotter(tmp_path, **contract), picture()) == ""


# --- known boxes ---


def test_known_boxes_take_the_lines_whose_centres_they_hold(tmp_path: Path) -> None:
    made = spotter(tmp_path)
    image = picture(("rgb", 40, 30), ("br", 200, 34), ("gr", 100, 110))
    readings = made.read(
        image,
        [
            (40, 30, 88, 46),  # the word
            (60, 36, 68, 40),  # its middle: a box drawn too small
            (0, 0, 320, 80),  # a row
            (0, 0, 320, 160),  # the whole sign
            (40, 30, 60, 46),  # less than half of a word
            (200, 100, 320, 160),  # nothing
            (50, 50, 50, 50),  # empty
        ],
    )
    assert [reading.text for reading in readings] == ["rgb", "rgb", "rgb br", "rgb br gr", "", "", ""]
    assert readings[4] == Reading("", 0.0)
    second = made.read(image, [(200, 34, 232, 50)])[0]
    mean = (3 * readings[0].confidence + 2 * second.confidence) / 5
    assert readings[2].confidence == pytest.approx(mean)
    assert made.read(image, []) == []


# --- contract, identity, failures ---


def test_contract_and_identity_are_those_of_both(tmp_path: Path) -> None:
    recogniser = Recogniser(band_reader(tmp_path / "rec.onnx"))
    path = brightness_detector(tmp_path / "det.onnx")
    made, other = (
        TextSpotter(path, each)
        for each in (recogniser, Recogniser(band_reader(tmp_path / "o.onnx", softmax=False)))
    )
    assert (made.name, made.sha256 == other.sha256) == ("det+rec", False)
    stated = made.contract.to_dict()
    assert (stated["regions.unclip"], stated["text.height_px"]) == (1.6, 48)
    assert set(stated["sources"]) == set(stated) - {"sources"}
    assert "threshold = 0.3 is assumed" in " ".join(made.contract.assumptions)
    (tmp_path / "det.contract.json").write_text('{"threshold": 0.2}')
    beside = TextSpotter(path, recogniser).contract
    assert beside.regions.threshold == 0.2
    assert beside.to_dict()["sources"]["regions.threshold"] == "file det.contract.json"


def constant_map(path: Path, value: NDArray[np.float32]) -> Path:
    return answering_graph(path, {"map": (value, None)}, [1, 3, "H", "W"])


@pytest.mark.parametrize(
    ("value", "fault"),
    [
        (np.full((1, 4, 5), 0.2), r"answers \[4, 5\], 0 to 0.2"),
        (np.full((1, 1, 8, 8), -4.5), r"\[1, 8, 8\], -4.5 to 0"),
    ],
)
def test_answers_that_are_no_map(tmp_path: Path, value: NDArray[np.float64], fault: str) -> None:
    recogniser = Recogniser(band_reader(tmp_path / "rec.onnx"))
    path = constant_map(tmp_path / "no.onnx", value.astype(np.float32))
    with pytest.raises(ModelError, match=f"no.onnx: .*{fault}, to a picture; a text detector answers"):
        TextSpotter(path, recogniser)
