"""Detection before recognition: maps with known regions, and a graph that takes brightness for text."""

import math

import numpy as np
import onnx
import pytest
from band_readers import COLOURS, band_reader
from blurnoise_eval.detectors.ocr import (
    Reading,
    Recogniser,
    TextSpotter,
    character_error_rate,
    rapidocr_models,
)
from blurnoise_eval.detectors.ocr.recogniser import RegionContract
from blurnoise_eval.detectors.ocr.spotter import find_regions, straighten
from onnx import parser

from blurnoise import motion_blur
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.charts import stop_sign, stop_sign_text_box

# Pictures enter at their own size, and crops hold little beside the bands, whose mean the recogniser reads.
NATIVE = {"min_side_px": 1, "unclip": 0.3}


def turned_rectangle(shape, centre, size, angle_deg):
    """Coordinates (u, v) of every pixel's centre, from -1 to 1 inside the rectangle; clockwise as displayed."""
    y, x = np.indices(shape) + 0.5
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    dx, dy = x - centre[0], y - centre[1]
    return (dx * cos + dy * sin) * 2 / size[0], (dy * cos - dx * sin) * 2 / size[1]


def corners_of(centre, size, angle_deg):
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    right, down = np.array([cos, sin]) * size[0] / 2, np.array([-sin, cos]) * size[1] / 2
    middle = np.array(centre)
    return np.stack(
        [middle - right - down, middle + right - down, middle + right + down, middle - right + down]
    )


BRIGHT = """<ir_version: 8, opset_import: ["": 17]> bright (float[N,3,H,W] x) => (float[N,1,H,W] map)
<float zero = {0}, float one = {1}> {
  most = ReduceMax<axes = [1], keepdims = 1>(x)
  map = Clip(most, zero, one)
}"""
"""A text detector whose map is the brightest channel, 0 to 1; the input is -1 to 1."""


def spotter(folder, **contract):
    onnx.save(parser.parse_model(BRIGHT), folder / "det.onnx")
    recogniser = Recogniser(band_reader(folder / "rec.onnx"))
    return TextSpotter(folder / "det.onnx", recogniser, contract={**NATIVE, **contract})


def picture(*words):
    """Black, 160 px high and 320 wide, with words of bands 16 px wide and 16 high at (left, top)."""
    image = np.zeros((160, 320, 3), np.uint8)
    for letters, left, top in words:
        for place, letter in enumerate(letters):
            image[top : top + 16, left + 16 * place : left + 16 * (place + 1)] = COLOURS[letter]
    return image


# --- regions ---


def test_an_upright_region_is_exact():
    """The outline runs through the outermost pixels' centres; it moves outwards by 1.6 area / perimeter."""
    probabilities = np.zeros((64, 96), np.float32)
    probabilities[10:26, 20:60] = 0.8
    grown = 1.6 * 39 * 15 / (39 + 15)
    for unclip, more in ((1.6, grown), (0.0, 0.0)):
        (region,) = find_regions(probabilities, RegionContract(unclip=unclip))
        np.testing.assert_allclose(region, corners_of((40, 18), (39 + more, 15 + more), 0), atol=1e-3)
    assert find_regions(probabilities * 0.55, RegionContract()) == []  # text, but not sure enough


@pytest.mark.parametrize("angle_deg", [-44, 5, 30])
def test_straightened_text_runs_to_the_right(angle_deg):
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
def test_a_high_region_is_laid_on_its_side(size, shape):
    image = np.zeros((100, 100, 3), np.uint8)
    image[:50] = (255, 0, 0)
    crop = straighten(image, corners_of((50, 50), size, 0).astype(np.float32))
    assert crop.shape == shape
    assert (crop[0 if shape[0] < shape[1] else 5, 5] == (255, 0, 0)).all()  # what was above is on the left


# --- spotting ---


def whole(made, image):
    return made.read(image, [(0, 0, image.shape[1], image.shape[0])])[0].text


@pytest.mark.parametrize("contract", [{}, {"min_side_px": 480}, {"max_side_px": 160}])
def test_lines_are_found_and_read(tmp_path, contract):
    """Row by row, from the left."""
    image = picture(("rgb", 40, 30), ("br", 200, 34), ("gr", 100, 110))
    assert whole(spotter(tmp_path, **contract), image) == "rgb br gr"
    assert whole(spotter(tmp_path, **contract), picture()) == ""


# --- known boxes ---


def test_known_boxes_take_the_lines_whose_centres_they_hold(tmp_path):
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


def test_contract_and_identity_are_those_of_both(tmp_path):
    made = spotter(tmp_path)
    other = TextSpotter(
        made.path, Recogniser(band_reader(tmp_path / "o.onnx", softmax=False)), contract=NATIVE
    )
    assert (made.name, made.sha256 == other.sha256) == ("det+rec", False)
    stated = made.contract.to_dict()
    assert (stated["regions.unclip"], stated["text.height_px"]) == (0.3, 48)
    assert set(stated["sources"]) == set(stated) - {"sources"}
    assert "family = 'ppocr' is assumed" in " ".join(made.contract.assumptions)
    (tmp_path / "det.contract.json").write_text('{"threshold": 0.2}')
    beside = TextSpotter(made.path, other.recogniser).contract.to_dict()
    assert (beside["regions.threshold"], beside["sources"]["regions.threshold"]) == (
        0.2,
        "file det.contract.json",
    )


# --- the networks of the rapidocr package ---


@pytest.mark.slow
def test_real_networks_read_a_stop_sign_and_no_smeared_one():
    """On 18 % grey, moved to the right during the exposure; by its known box, and found."""
    models = rapidocr_models()
    if models is None:
        pytest.skip("could not import 'rapidocr'")
    recogniser = Recogniser(models[1])
    readers = recogniser, TextSpotter(models[0], recogniser)
    for size_px, blur_px in ((100, 0.0), (50, 0.0), (32, 0.0), (100, 60.0)):
        linear = motion_blur(stop_sign(size_px, height_px=320, width_px=320), [[blur_px, 0.0]])
        coded = srgb_from_linear(linear)[0].clamp(0, 1).mul(255).round().byte()
        box = stop_sign_text_box(size_px, height_px=320, width_px=320)
        for reader in readers:
            (reading,) = reader.read(coded.permute(1, 2, 0).contiguous().numpy(), [box])
            assert (reading.text == "STOP") == (blur_px == 0)
            assert reading.confidence > 0.97 or blur_px
            assert character_error_rate(reading.text, "STOP") >= (0.75 if blur_px else 0)
