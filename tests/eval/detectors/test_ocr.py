"""Recognisers on known boxes: graphs that read the colours of bands, so that every answer is known."""

import cv2
import numpy as np
import pytest
from band_readers import COLOURS, band_reader
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.ocr import (
    Recogniser,
    character_error_rate,
    characters,
    decode,
    rapidocr_recogniser,
)
from hypothesis import given
from hypothesis import strategies as st

from blurnoise import motion_blur
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.charts import stop_sign, stop_sign_text_box


def bands(letters, *, height=48, width=48):
    """A band of ``width`` px for each letter, black for "-"."""
    return np.concatenate([np.full((height, width, 3), COLOURS[x], np.uint8) for x in letters], axis=1)


def whole(image):
    return [(0, 0, image.shape[1], image.shape[0])]


def one_text(recogniser, image):
    return recogniser.read(image, whole(image))[0].text


# --- the picture's way into the network ---


def test_bands_are_read_in_order(tmp_path):
    recogniser = Recogniser(band_reader(tmp_path / "m.onnx"))
    reading = recogniser.read(bands("rgb-b-bbr"), whole(bands("rgb-b-bbr")))[0]
    assert reading.text == "rgbbbr"
    assert reading.confidence == pytest.approx(1, abs=1e-3)  # 1 / (1 + e^-10 ...) at the surest


@pytest.mark.parametrize(
    ("size", "colour"),
    [((48, 200), "rgb"), ((31, 117), "bgr"), ((90, 1000), "rgb"), ((200, 30), "bgr"), ((1, 1), "rgb")],
)
def test_input_is_the_crop_normalised_beside_zeros(tmp_path, size, colour):
    mean, std = (0.5, 0.25, 0.125), (0.5, 0.2, 1.0)
    contract = {"colour": colour, "mean": mean, "std": std}
    recogniser = Recogniser(band_reader(tmp_path / "m.onnx"), contract=contract)
    crop = np.random.default_rng(1).integers(0, 256, (*size, 3), np.uint8)
    blob = recogniser.prepare(crop)
    filled = -(-48 * size[1] // size[0])
    assert blob.shape == (1, 3, 48, max(320, filled))
    resized = cv2.resize(crop, (filled, 48)) / 255
    expected = ((resized if colour == "rgb" else resized[..., ::-1]) - mean) / std
    np.testing.assert_allclose(blob[0, :, :, :filled], expected.transpose(2, 0, 1), atol=1e-5)
    assert not blob[..., filled:].any()


# --- answers ---


def test_logits_are_noticed(tmp_path):
    sure = Recogniser(band_reader(tmp_path / "p.onnx"))
    logits = Recogniser(band_reader(tmp_path / "l.onnx", softmax=False))
    image = bands("r-gb") // 255 * 198  # 0.55: a logit of 11 beside the blank's 10
    assert logits.contract.output == "logits"
    assert "softmax is applied" in logits.contract.sources["output"]
    assert sure.contract.output == "probabilities"
    got, expected = logits.read(image, whole(image))[0], sure.read(image, whole(image))[0]
    assert got.text == expected.text == "rgb"
    assert 0.7 < expected.confidence < 0.8
    assert got.confidence == pytest.approx(expected.confidence, abs=1e-6)
    with pytest.raises(
        ModelError, match=r"output = 'probabilities' \(given\): must be 'logits', because the rows"
    ):
        Recogniser(tmp_path / "l.onnx", contract={"output": "probabilities"})


# --- dictionary ---


def test_a_dictionary_file_wins_and_is_part_of_the_identity(tmp_path):
    path = band_reader(tmp_path / "m.onnx")
    plain = Recogniser(path)
    assert plain.contract.sources["dictionary"] == "metadata character"
    dictionary = tmp_path / "greek.txt"
    dictionary.write_bytes("\ufeffβ\r\nγ\r\nρ\r\n".encode())
    greek = Recogniser(path, dictionary=dictionary)
    assert one_text(greek, bands("r-g-b")) == "ργβ"
    assert greek.contract.to_dict()["dictionary"] == "greek.txt"
    assert greek.contract.sources["dictionary"] == "given"
    assert greek.sha256 != plain.sha256
    (tmp_path / "m.contract.json").write_text('{"family": "ppocr", "dictionary": "greek.txt"}')
    beside = Recogniser(path)
    assert one_text(beside, bands("r-g-b")) == "ργβ"
    assert beside.sha256 == greek.sha256


# --- from rows of classes to texts, and texts compared ---

CLASSES = characters("a\nb\nc")  # blank, a, b, c, space
labels = st.lists(st.integers(0, 4), min_size=1, max_size=30)


def sure(path, probability=0.9):
    rows = np.full((len(path), 5), (1 - probability) / 4, np.float32)
    rows[np.arange(len(path)), path] = probability
    return rows


# --- decoding ---


@given(labels)
def test_decoding_drops_repeats_then_blanks(path):
    """Against the definition, letter by letter."""
    expected, previous = "", 0
    for label in path:
        if label != previous and label != 0:
            expected += " abc "[label]
        previous = label
    reading = decode(sure(path), CLASSES)
    assert reading.text == expected
    assert reading.confidence == pytest.approx(0.9 if expected else 0)


# --- character error rate ---


def test_known_rates():
    """Of insertions, deletions and substitutions; a swap is two errors."""
    known = {("STOP", "STOP"): 0, ("SOP", "STOP"): 1 / 4, ("stop", "STOP"): 1, ("STOPSTOP!", "STOP"): 5 / 4}
    known |= {("kitten", "sitting"): 3 / 7, ("TSOP", "STOP"): 2 / 4, ("", ""): 0, ("x", ""): 1}
    for (read, truth), rate in known.items():
        assert character_error_rate(read, truth) == pytest.approx(rate)


# --- the network of the rapidocr package ---


@pytest.mark.slow
def test_the_packaged_network_reads_a_stop_sign_and_no_smeared_one():
    """On 18 % grey, moved to the right during the exposure."""
    if (model := rapidocr_recogniser()) is None:
        pytest.skip("could not import 'rapidocr'")
    recogniser = Recogniser(model)
    for size_px, blur_px in ((100, 0.0), (50, 0.0), (32, 0.0), (100, 60.0)):
        linear = motion_blur(stop_sign(size_px, height_px=320, width_px=320), [[blur_px, 0.0]])
        coded = srgb_from_linear(linear)[0].clamp(0, 1).mul(255).round().byte()
        box = stop_sign_text_box(size_px, height_px=320, width_px=320)
        (reading,) = recogniser.read(coded.permute(1, 2, 0).contiguous().numpy(), [box])
        assert (reading.text == "STOP") == (blur_px == 0)
        assert reading.confidence > 0.97 or blur_px
        assert character_error_rate(reading.text, "STOP") >= (0.75 if blur_px else 0)
