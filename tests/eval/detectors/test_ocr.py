"""Recognisers on known boxes: graphs that read the colours of bands, so that every answer is known."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from band_readers import COLOURS, band_reader, constant_reader
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.ocr import Reading, Recogniser
from constant_graphs import answering_graph
from numpy.typing import NDArray


def bands(letters: str, *, height: int = 48, width: int = 48) -> NDArray[np.uint8]:
    """A band of ``width`` px for each letter, black for "-"."""
    return np.concatenate([np.full((height, width, 3), COLOURS[x], np.uint8) for x in letters], axis=1)


def whole(image: NDArray[np.uint8]) -> list[tuple[float, float, float, float]]:
    return [(0, 0, image.shape[1], image.shape[0])]


def one_text(recogniser: Recogniser, image: NDArray[np.uint8]) -> str:
    return recogniser.read(image, whole(image))[0].text


# --- the picture's way into the network ---


def test_bands_are_read_in_order(tmp_path: Path) -> None:
    recogniser = Recogniser(band_reader(tmp_path / "m.onnx"))
    reading = recogniser.read(bands("rgb-b-bbr"), whole(bands("rgb-b-bbr")))[0]
    assert reading.text == "rgbbbr"
    assert reading.confidence == pytest.approx(1, abs=1e-3)  # 1 / (1 + e^-10 ...) at the surest


@pytest.mark.parametrize(
    ("size", "colour"),
    [((48, 200), "rgb"), ((31, 117), "bgr"), ((90, 1000), "rgb"), ((200, 30), "bgr"), ((1, 1), "rgb")],
)
def test_input_is_the_crop_normalised_beside_zeros(
    tmp_path: Path, size: tuple[int, int], colour: str
) -> None:
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


def test_height_is_the_graphs(tmp_path: Path) -> None:
    path = band_reader(tmp_path / "m.onnx", shape=("N", 32, "W"), height=32)
    recogniser = Recogniser(path)
    assert recogniser.contract.height_px == 32
    assert recogniser.contract.sources["height_px"] == "graph"
    assert recogniser.prepare(bands("r")).shape == (1, 3, 32, 320)
    assert one_text(recogniser, bands("r-g")) == "rg"
    with pytest.raises(
        ModelError, match=r"height_px = 48 \(given\): must be 32, as the graph takes this height"
    ):
        Recogniser(path, contract={"height_px": 48})


# --- boxes ---


def test_each_box_is_read_on_its_own(tmp_path: Path) -> None:
    recogniser = Recogniser(band_reader(tmp_path / "m.onnx"), contract={"margin": 0.0})
    image = bands("rgb")
    boxes = [(0, 0, 48, 48), (96, 0, 144, 48), (48, 0, 144, 48), (50, 3, 90.5, 40.2)]
    alone = [recogniser.read(image, [box])[0] for box in boxes]
    assert recogniser.read(image, boxes) == alone
    assert [reading.text for reading in alone] == ["r", "b", "gb", "g"]
    assert recogniser.read(image, np.array(boxes)) == alone
    assert recogniser.read(image, []) == []


def test_boxes_are_clipped_and_empty_ones_read_as_nothing(tmp_path: Path) -> None:
    recogniser = Recogniser(band_reader(tmp_path / "m.onnx"))
    image = bands("rr")
    outside = [(-50, 0, -1, 48), (0, 48, 96, 90), (500, 0, 600, 48)]
    empty = [(10, 10, 10, 40), (30, 20, 20, 40), (5, 8, 25, 8)]
    assert recogniser.read(image, outside + empty) == [Reading("", 0.0)] * 6
    assert [r.text for r in recogniser.read(image, [(-30, -30, 300, 300), (-1e9, 0, 1e9, 48)])] == ["r", "r"]
    assert recogniser.read(image, [(0.2, 0.2, 0.3, 0.3)])[0].text == "r"


# --- answers ---


def test_logits_are_noticed(tmp_path: Path) -> None:
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
        ModelError, match=r"output = 'probabilities' \(given\): must be 'logits', as the rows"
    ):
        Recogniser(tmp_path / "l.onnx", contract={"output": "probabilities"})


def test_nan_is_no_text_and_counted(tmp_path: Path) -> None:
    answer = np.array([[(0, 1, 0, 0, 0), (0, np.nan, 0, 0, 1), (np.inf, 0, 0, 0, 0)]], np.float32)
    with pytest.warns(RuntimeWarning, match="outputs contain NaN or Inf"):
        recogniser = Recogniser(constant_reader(tmp_path / "m.onnx", answer))
    seen = recogniser.non_finite_values_here
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # one warning is enough
        assert recogniser.read(bands("r"), whole(bands("r"))) == [Reading("", 0.0)]
    assert recogniser.non_finite_values_here == seen + 2
    assert recogniser.contract.sources["output"].startswith("assumed")


# --- dictionary ---


@pytest.mark.parametrize("lines", ["b\ng", "", "b\n\ng\nr"])
def test_a_dictionary_of_another_length_names_both_numbers(tmp_path: Path, lines: str) -> None:
    path = band_reader(tmp_path / "m.onnx", metadata={"character": lines})
    count = len(lines.split("\n")) + 2
    with pytest.raises(ModelError, match=rf"answers \[40, 5\].*makes {count} classes.*{count - 2} lines"):
        Recogniser(path)


def test_a_dictionary_file_wins_and_is_part_of_the_identity(tmp_path: Path) -> None:
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


def test_no_dictionary_and_one_that_cannot_be_read(tmp_path: Path) -> None:
    path = band_reader(tmp_path / "m.onnx", metadata={})
    with pytest.raises(ModelError, match="nothing says which characters its classes are"):
        Recogniser(path)
    with pytest.raises(ModelError, match=r"dictionary none.txt: cannot be read"):
        Recogniser(path, dictionary=tmp_path / "none.txt")
    (tmp_path / "bad.txt").write_bytes(b"b\n\xff\nr")
    with pytest.raises(ModelError, match=r"dictionary bad.txt: cannot be read"):
        Recogniser(path, dictionary=tmp_path / "bad.txt")


# --- contract ---


def test_what_nobody_stated_is_marked_as_assumed(tmp_path: Path) -> None:
    recogniser = Recogniser(band_reader(tmp_path / "m.onnx"))
    assumed = {name for name, source in recogniser.contract.sources.items() if source.startswith("assumed")}
    assert assumed == {"family", "colour", "mean", "std", "min_width_px", "max_width_px", "margin"}
    assert len(recogniser.contract.assumptions) == len(assumed)
    assert "colour = 'bgr' is assumed" in " ".join(recogniser.contract.assumptions)
    stated = recogniser.contract.to_dict()
    assert json.loads(json.dumps(stated)) == stated
    again = Recogniser(recogniser.path, contract=stated)
    assert again.contract == recogniser.contract
    assert again.contract.assumptions == []


# --- graphs of another form ---


def test_graphs_of_another_form(tmp_path: Path) -> None:
    grey = answering_graph(tmp_path / "grey.onnx", {"y": (np.ones((1, 1, 5)), None)}, [1, 1, 32, "W"])
    with pytest.raises(ModelError, match=r"must take one picture \[N, 3, height, width\].*\[1, 1, 32, 'W'\]"):
        Recogniser(grey)
    flat = constant_reader(tmp_path / "flat.onnx", np.ones((1, 5), np.float32) / 5)
    with pytest.raises(ModelError, match=r"answers \[5\], steps and classes"):
        Recogniser(flat)
    steps_first = constant_reader(tmp_path / "steps.onnx", np.ones((7, 1, 5), np.float32) / 5)
    with pytest.raises(
        ModelError, match=r"answers \[7, 1, 5\] to 1 picture\(s\): the first axis must be the batch"
    ):
        Recogniser(steps_first)
