"""Ways into a network that finds squares of one red, behind nodes that turn each way into its own: rgb, 0-1."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import onnx
import pytest
from blurnoise_eval import STOP_SIGN
from blurnoise_eval.contracts.comparison import compared, contracts_chosen, output_problems
from blurnoise_eval.contracts.reduced_noise import resize_doubt
from blurnoise_eval.contracts.variants import Variant
from blurnoise_eval.datasets import image_folder, sample, write_picture
from blurnoise_eval.detectors.contract import INPUT_VALUES, Contract
from blurnoise_eval.detectors.contract_files import contract_document, contract_option, preset
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Detections
from constant_graphs import constant_graph
from onnx import helper, numpy_helper

ASSUMED = "assumed: preset x, which the graph suggests"


def fields(colour, values):
    span, mean, std = INPUT_VALUES[values]
    mean, std = (each and (each[::-1] if colour == "bgr" else each) for each in (mean, std))
    return {"colour": colour, "value_range": span, "mean": mean, "std": std}


def behind(source, taken, path):
    """The network of ``source``, which takes rgb in 0-1, behind nodes that let it take pictures ``taken``."""
    model = onnx.load(source)
    graph = model.graph
    image = graph.input[0].name
    for node in graph.node:
        node.input[:] = ["as_its_own" if name == image else name for name in node.input]
    at = fields(*taken)
    scale = 1.0 if at["value_range"] == "0-1" else 1 / 255.0
    shape = (1, 3, 1, 1)
    gain = np.array(at["std"] or (1, 1, 1), np.float32).reshape(shape) * np.float32(scale)
    shift = np.array(at["mean"] or (0, 0, 0), np.float32).reshape(shape) * np.float32(scale)
    order = [2, 1, 0] if taken[0] == "bgr" else [0, 1, 2]
    for name, values in (("gain", gain), ("shift", shift), ("order", np.array(order, np.int64))):
        graph.initializer.append(numpy_helper.from_array(values, f"{name}_before"))
    before = [
        helper.make_node("Mul", [image, "gain_before"], ["scaled"]),
        helper.make_node("Add", ["scaled", "shift_before"], ["shifted"]),
        helper.make_node("Gather", ["shifted", "order_before"], ["as_its_own"], axis=1),
    ]
    nodes = [*before, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.save(model, path)
    return path


def assumed(path, contract):
    guessed = {"colour", "value_range", "mean", "std", "resize"}
    sources = {name: ASSUMED if name in guessed else "given" for name in Contract.names()}
    return Detector(path, contract=replace(contract, sources=sources))


RED, BLUE = (204, 51, 51), (51, 51, 204)


def squares(count=4, colours=(RED,)):
    """Pictures of three squares of 32 px each, of these colours by chance, on grey noise."""
    random = np.random.default_rng(1)
    made = []
    for _ in range(count):
        image = random.integers(40, 200, (128, 128, 1)).repeat(3, axis=2).astype(np.uint8)
        for left, top in ((10, 10), (80, 20), (45, 80)):
            x, y = np.add((left, top), random.integers(-6, 7, 2))
            image[y : y + 32, x : x + 32] = colours[int(random.integers(len(colours)))]
        made.append((image, None))
    return made


@pytest.fixture(scope="module")
def reds(tmp_path_factory):
    """A YOLOX of one class on 128 x 128 px, whose boxes are of 32 px, at stride 8. Their score is the share of pixels
    that are of that red: 1 in the very colour, 0 from 0.2 off in all channels together."""
    weight = np.zeros((6, 1, 32, 32), np.float32)
    weight[5] = 0.98 / 32**2
    constants = {
        "weight": weight, "offsets": np.array([0.5, 0.5, np.log(4), np.log(4), 1, 0.01], np.float32),
        "colour": np.array([0.8, 0.2, 0.2], np.float32).reshape(1, 3, 1, 1), "slope": np.float32(5),
        "none": np.float32(0), "one": np.float32(1), "channels": np.array([1], np.int64),
        "flat": np.array([1, 6, -1], np.int64), "rest": np.zeros((1, 80, 6), np.float32),
    }  # fmt: skip
    steps = (
        ("Sub", "images colour", "off"), ("Abs", "off", "far"), ("ReduceSum", "far channels", "in_all"),
        ("Mul", "in_all slope", "falls"), ("Sub", "one falls", "peak"), ("Clip", "peak none one", "red"),
        ("Conv", "red weight offsets", "found"), ("Reshape", "found flat", "columns"),
        ("Transpose", "columns", "rows"), ("Concat", "rows rest", "out"),
    )  # fmt: skip
    options = {
        "Conv": {"strides": [8, 8], "pads": [12, 12, 12, 12]},
        "Transpose": {"perm": [0, 2, 1]},
        "Concat": {"axis": 1},
    }
    graph = helper.make_graph(
        [
            helper.make_node(kind, given.split(), [output], **options.get(kind, {}))
            for kind, given, output in steps
        ],
        "reds",
        [helper.make_tensor_value_info("images", onnx.TensorProto.FLOAT, [1, 3, 128, 128])],
        [helper.make_tensor_value_info("out", onnx.TensorProto.FLOAT, [1, 336, 6])],
        [numpy_helper.from_array(np.asarray(values), name) for name, values in constants.items()],
    )
    path = tmp_path_factory.mktemp("network") / "reds.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


OWN = Contract("yolox", ("red",), input_size_px=(128, 128))
PICTURES = squares()


@pytest.mark.parametrize("taken", list(product(("rgb", "bgr"), INPUT_VALUES)))
def test_what_nothing_states_is_chosen_and_its_source_says_so(taken, tmp_path, reds):
    detector = assumed(behind(reds, taken, tmp_path / "m.onnx"), OWN)
    found = compared(detector, PICTURES)
    assert {name: getattr(found.contract, name) for name in fields(*taken)} == fields(*taken)
    assert found.contract.sources["colour"].startswith("chosen by comparing 11 variants on 4 pictures")
    assert "do not decide, as others find much the same" in found.contract.sources["resize"]
    assert found.doubts == ()
    assert found.inferences <= 120
    assert found == compared(detector, PICTURES)


def test_what_is_stated_is_only_doubted(tmp_path, reds):
    path = behind(reds, ("rgb", "0-255"), tmp_path / "m.onnx")
    stated = Detector(path, contract=OWN)
    found = compared(stated, PICTURES)
    assert found.contract == OWN
    (doubt,) = found.doubts
    assert "values may be wrong (given). " in doubt
    assert " with rgb, 0-255, " in doubt
    right = Detector(path, contract=replace(OWN, value_range="0-255"))
    assert compared(right, PICTURES).doubts == ()


def test_what_the_pictures_leave_open_is_doubted(reds):
    """Of red and blue squares the network finds the red ones, and about as many blue ones where it is fed with
    bgr."""
    found = compared(assumed(reds, OWN), squares(12, (RED, BLUE)))
    (doubt,) = found.doubts
    assert f"colour may be wrong ({ASSUMED}). " in doubt
    assert "If the former is right, use --contract yolox,classes=red," in doubt
    assert found.contract.sources["colour"].startswith("assumed, doubtful: ")
    assert found.contract.sources["value_range"].startswith("chosen")


@pytest.mark.parametrize(
    ("value", "top", "words"),
    [
        (0.5, 0.0, "every score is exactly 0"),
        (0.5, 1.5, "score = 2.25: must be <= 1"),
        (np.nan, 0.5, "336 NaN or"),
    ],
)
def test_outputs_that_no_picture_explains(value, top, words, tmp_path):
    """An int8 export whose scores are all 0 is doubted, and nothing is said to be chosen for it."""
    rows = np.full((1, 84, 6), value, np.float32)
    rows[..., 4:] = top
    constant_graph(tmp_path / "m.onnx", [rows], (64, 64))
    detector = Detector(tmp_path / "m.onnx", contract=replace(preset("yolox"), classes=("red",)))
    image = np.zeros((40, 60, 3), np.uint8)
    (problem,) = output_problems(detector, image)
    assert words in problem
    assert detector.non_finite_values_here == 0  # the caller's pictures are counted, not these
    found = compared(assumed(detector.path, detector.contract), [(image, None)] * 3)
    assert words in found.doubts[0]
    assert found.doubts[0].startswith("3 of 3 pictures: ")
    assert not any(source.startswith("chosen") for source in found.contract.sources.values())


def variant(resize, merits):
    """A variant with these merits, picture by picture; what it finds differs from resize to resize."""
    place = len(resize)
    found = Detections(np.array([[place * 9, 0, place * 9 + 5, 5]]), np.ones(1), np.zeros(1))
    agreed = [merit**2 / 0.9 for merit in merits]
    return Variant(replace(OWN, resize=resize), agreed, list(agreed), [found] * len(merits))


def test_another_resize_is_doubted_only_where_it_is_significantly_better():
    """Differences of 8 % on average: their t is 1.5 or 15 with 7 degrees of freedom, and 2.36 is 97.5 %."""
    final = variant("stretch", [1.0] * 8)
    noisy = variant("letterbox", [1.22, 0.94] * 4)
    steady = variant("letterbox", [1.094, 1.066] * 4)
    for stated in (True, False):
        assert noisy.standing(final, stated=stated) == "open"
        assert steady.standing(final, stated=stated) == "rival"


@pytest.mark.parametrize(
    ("pictures", "less", "apart", "expected"),
    [(8, 0.05, 0.3, "rival"), (8, 0.15, 0.3, "less likely"), (8, 0.6, 0.3, "worse"), (2, 0.3, 0.1, "rival")],
)
def test_another_colour_is_doubted_where_the_chosen_one_is_not_probably_better(
    pictures, less, apart, expected
):
    """Differences of ``less`` +- ``apart``. Their t is .4, 1.3 and 5.3 of eight, where 84 % is 1.1 and 97.5 % 2.4; 3
    of two, which are too few for 84 % (1.8) to count."""
    final = variant("stretch", [1.0] * pictures)
    other = variant("stretch", [1 - less + apart, 1 - less - apart] * (pictures // 2))
    other.contract = replace(OWN, colour="bgr")
    other.seen = [Detections(np.array([[90.0, 0, 95, 5]]), np.ones(1), np.zeros(1))] * pictures
    assert other.standing(final, stated=False) == expected


def test_one_line_a_sweep_for_models_with_the_same_doubt(tmp_path, reds, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number, (image, _) in enumerate(PICTURES):
        write_picture(folder / f"{number}.png", image)
    path = behind(reds, ("rgb", "0-255"), tmp_path / "m.onnx")
    models = []
    for name in ("first", "second"):
        models.append(Detector(path, contract=OWN))
        models[-1].name = name
    contracts_chosen(models, image_folder(folder), say=True)
    lines = capsys.readouterr().err.splitlines()
    text = " ".join(line.strip() for line in lines)
    assert text.count("may be wrong") == 1
    assert text.startswith("first: doubtful contract: values may be wrong")
    assert text.endswith("The same fields of second")
    assert max(map(len, lines)) <= 80


PHOTOS = Path(__file__).parents[4] / "shared/real/photos"


@pytest.mark.slow
@pytest.mark.skipif(not PHOTOS.is_dir(), reason="no photographs here")
def test_a_network_that_fires_everywhere_is_no_rival_of_one_that_finds_hardly_anything():
    """Signs in photographs without any: fed with values to 255 the network finds 250 in each, and many again."""
    photographs = [(image, None) for _, image in sample(image_folder(PHOTOS), 8)]
    assert compared(Detector(STOP_SIGN), photographs).doubts == ()


# --- the filter of pictures that become smaller ---


@pytest.mark.parametrize(("side_px", "stops"), [(96, "1.6"), (64, None)], ids=["thirds", "halves"])
def test_a_filter_that_nobody_stated_is_doubted_where_it_keeps_noise(side_px, stops, tmp_path):
    """Of three pixels bilinear takes the middle one, of two it is the mean, as the others."""
    constant_graph(tmp_path / "m.onnx", [np.zeros((1, 84, 21), np.float32)], (32, 32))
    detector = Detector(tmp_path / "m.onnx", contract="yolov8,size=32")
    doubt = resize_doubt(detector, [np.zeros((side_px, side_px, 3), np.uint8)])
    assert ("resize_filter = bilinear" in doubt and f"about {stops} stops" in doubt) if stops else doubt == ""


def test_a_filter_that_somebody_stated_is_not_doubted(tmp_path):
    constant_graph(tmp_path / "m.onnx", [np.zeros((1, 84, 21), np.float32)], (32, 32))
    detector = Detector(tmp_path / "m.onnx", contract="yolov8,size=32,filter=bilinear")
    assert resize_doubt(detector, [np.zeros((96, 96, 3), np.uint8)]) == ""


def test_a_filter_that_nobody_stated_is_not_written_and_stays_doubted(tmp_path):
    constant_graph(tmp_path / "m.onnx", [np.zeros((1, 84, 21), np.float32)], (32, 32))
    unstated = Detector(tmp_path / "m.onnx", contract="yolov8,size=32").contract
    document = contract_document(unstated)
    assert "resize_filter" not in document
    again = Detector(tmp_path / "m.onnx", contract=document)
    assert "resize_filter" in resize_doubt(again, [np.zeros((96, 96, 3), np.uint8)])
    stated = Detector(tmp_path / "m.onnx", contract="yolov8,size=32,filter=bilinear").contract
    assert contract_document(stated)["resize_filter"] == "bilinear"
    assert "resize_filter=bilinear" in contract_option(stated)
    assert "resize_filter" not in contract_option(unstated)


def test_a_run_s_comparison_names_the_filter(tmp_path):
    constant_graph(tmp_path / "m.onnx", [np.zeros((1, 84, 21), np.float32)], (32, 32))
    detector = Detector(tmp_path / "m.onnx", contract="yolov8,size=32")
    doubts = compared(detector, [(np.zeros((96, 96, 3), np.uint8), None)]).doubts
    assert any(doubt.startswith("resize_filter = bilinear") for doubt in doubts)
