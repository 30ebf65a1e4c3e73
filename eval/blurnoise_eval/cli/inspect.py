"""``blurnoise inspect``: the inputs, outputs and contract of a model, and its detections in a picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli._options import Contract, Json, Location, ModelTimeout, new_file, place
from blurnoise_eval.cli.console import print_facts
from blurnoise_eval.plan.files import MODEL_TIMEOUT_S
from blurnoise_eval.system.terminal import say, say_json, shortened, table_lines, width

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.model import OnnxModel
    from blurnoise_eval.detectors.ocr import Recogniser

    Pictures = list[tuple[Location, NDArray[np.uint8]]]

DRAWN_SCORE = 0.3  # detections from here on are drawn and listed
_LONGEST = 60  # characters of a name or a value of the metadata


def inspect(
    model: Annotated[Location, Argument(parser=place, metavar="M.onnx", help="detector or text recogniser")],
    *,
    contract: Contract = None,
    probe: Annotated[
        Location | None,
        Option(
            parser=place,
            metavar="IMAGE|DIR|LABELS",
            help="picture, or folder or labels of which up to 32 are used; list the detections in the first, draw "
            "them as MODEL-IMAGE-probe.png, and compare contracts",
        ),
    ] = None,
    save_contract: Annotated[
        bool,
        Option(
            "--save-contract",
            help="write the contract beside the model as MODEL.contract.json; all commands read this file",
        ),
    ] = False,
    model_timeout_s: ModelTimeout = MODEL_TIMEOUT_S,
    as_json: Json = False,
) -> None:
    """Show the inputs, outputs and metadata of a model, and its contract: how pictures enter the model and how its
    outputs are read.

      blurnoise inspect M.onnx
      blurnoise inspect M.onnx --probe photo.jpg
      blurnoise inspect M.onnx --probe photos/ --save-contract
      blurnoise inspect M.onnx --contract yolox,colour=rgb,range=0-1

    For each field of the contract, the table names its source: the graph, the metadata, a file, or an assumption.

    A detector with a wrong contract often still finds something, for example with red and blue swapped, or with
    values 0-1 instead of 0-255. --probe therefore compares contracts with other colour orders, values and resizing.
    It prefers the contract with which the same objects are found in the mirrored and cropped picture. This takes 100
    to 600 inferences. If the pictures do not decide, a warning says so; use more pictures.

    FIELD is one of: family (or base), classes (coco80, coco91 or a/b/c), colour (rgb, bgr, grey), value_range (or
    range: 0-1, 0-255), mean and std (1/2/3, in that range and colour order), resize (letterbox, letterbox-top-left,
    stretch, none), resize_filter (or filter: bilinear, area, antialiased), pad_value (or pad), input_size_px (or
    size: 416x640, height first), nms_iou (or iou), outputs (their columns: picture/xyxy/score/class). A contract file
    may consist of "base: yolox" and the fields that differ.

    PRESET is the name of a family, such as yolox, yolov8, rtdetr or tfod, or ppocr for text recognisers. The error
    for an unknown name lists all presets.
    """
    from blurnoise_eval.detectors.contract_files import contract_document
    from blurnoise_eval.detectors.model import OnnxModel
    from blurnoise_eval.detectors.ocr import Recogniser, is_recogniser
    from blurnoise_eval.measure.photographs import photographs
    from blurnoise_eval.system.files import write_whole

    probed, remarks = _pictures(probe) if probe else ([], ())
    opened = OnnxModel(model, timeout_s=model_timeout_s)
    reads = (contract or "").split(",")[0] == "ppocr" or is_recogniser(opened)
    if reads and save_contract:
        raise ValueError("save-contract: a text recogniser has no contract file")
    output = new_file(f"{model.stem}-{probed[0][0].stem}-probe.png") if probed else Path()
    kept = None
    if save_contract:
        kept = (model.parent if isinstance(model, Path) else Path()) / f"{model.stem}.contract.json"
        new_file(str(kept))
    network: Any
    if reads:
        network, why = (
            Recogniser(opened, contract=contract),
            "input: one picture; output: class probabilities for each step",
        )
        facts: dict[str, Any] = {"recognised": f"graph: {why}", "unknown": [], "warnings": []}
    else:
        network, facts = _detector(opened, contract, probed)
    what_runs, doubts = _what_runs(opened, network, probed)
    facts["warnings"] = [*facts["warnings"], *doubts, *remarks]
    if brought := photographs(probed):
        facts["pictures"] = "; ".join(brought.texts)
    if kept is not None:
        write_whole(kept, (json.dumps(contract_document(network.contract), indent=1) + "\n").encode())
        facts["saved"] = str(kept)
    session = opened.session
    facts = {
        "model": str(model),
        "sha256": network.sha256,
        "inputs": [f"{value.name} {value.shape} {value.type}" for value in session.get_inputs()],
        "outputs": [f"{value.name} {value.shape} {value.type}" for value in session.get_outputs()],
        "metadata": dict(sorted(opened.metadata.items())),
        **what_runs,
        "family": network.contract.family,
        **facts,
    }
    found = _found(network, *probed[0], output) if probed else {}
    if as_json:
        read_by = {"contract": network.contract.to_dict(), "sources": dict(network.contract.sources)}
        seen = {"probe": found} if found else {}
        say_json({**facts, **read_by, "assumed": network.contract.assumptions, **seen})
        return
    _print(facts, network.contract, found)


def _pictures(probe: Location) -> tuple[Pictures, tuple[str, ...]]:
    """The picture, or up to 32 pictures of a folder or of labels; and notes about them. Raises ``ValueError`` where
    none can be read."""
    from blurnoise_eval.contracts.comparison import MOST_PICTURES
    from blurnoise_eval.datasets import eight_bit, image_folder, picture_doubts, read_picture, sample
    from blurnoise_eval.label_formats import format_of, is_label_file

    labelled = is_label_file(probe)
    if not labelled and not (isinstance(probe, Path) and probe.is_dir()):
        return [(probe, eight_bit(read_picture(probe)))], tuple(picture_doubts(probe.parent, [probe.name]))
    pictures = format_of(probe).open(probe) if labelled else image_folder(probe)
    found = sample(pictures, MOST_PICTURES)
    if not found:
        of = "these labels" if labelled else "this folder"
        raise ValueError(f"probe = {str(probe)!r}: no picture of {of} can be read")
    return [((pictures.folder or probe) / picture.name, image) for picture, image in found], pictures.notes


def _detector(model: OnnxModel, contract: str | None, probed: Pictures) -> tuple[Detector, dict[str, Any]]:
    """The detector, and facts about its contract."""
    from blurnoise_eval.contracts.comparison import compared, output_problems
    from blurnoise_eval.detectors.contract_files import contract_option
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.recognition import drawn_picture

    detector = Detector(model, contract=contract)
    source = detector.contract.sources["family"]
    if not source.startswith(("graph: ", "assumed: ")):
        source = f"{source}; the graph agrees: {detector.why}"
    facts: dict[str, Any] = {"recognised": source}
    facts["unknown"] = [detector.family.unknown] if detector.family.unknown else []
    if probed:
        comparison = compared(detector, [(picture, None) for _, picture in probed])
        detector = detector.with_contract(comparison.contract)
        facts |= {"compared": comparison.text} if comparison.text else {}
        facts["warnings"] = list(comparison.doubts)
    else:
        facts["warnings"] = output_problems(detector, drawn_picture())
    if typed := contract_option(detector.contract):
        facts["--contract"] = typed
    return detector, facts


def _what_runs(
    model: OnnxModel, network: Detector | Recogniser, probed: Pictures
) -> tuple[dict[str, Any], list[str]]:
    """What onnxruntime executes, and warnings about it."""
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.executed_graph import executed_graph, hot_pixel_text
    from blurnoise_eval.detectors.recognition import drawn_picture

    runs = executed_graph(model)
    if runs is None:
        return {}, []
    facts: dict[str, Any] = {"runs": runs.text}
    if runs.elsewhere:
        facts["other runtimes"] = list(runs.elsewhere)
    warnings = list(runs.warnings)
    if "dynamic" in runs.quantization and isinstance(network, Detector):
        warnings += filter(None, [hot_pixel_text(network, probed[0][1] if probed else drawn_picture())])
    return facts, warnings


def _found(
    network: Detector | Recogniser, path: Location, picture: NDArray[np.uint8], output: Path
) -> dict[str, Any]:
    """The detections in a picture, drawn to ``output``; of a text recogniser, the text of the whole picture."""
    from blurnoise_eval.datasets import write_picture
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.plots.annotate import drawn_example
    from blurnoise_eval.store.rows import LabelledBox

    if not isinstance(network, Detector):
        reading = network.read(picture, [(0, 0, picture.shape[1], picture.shape[0])])[0]
        return {"image": str(path), "text": reading.text, "score": reading.confidence}
    answers = network.detect(picture).leading
    found = zip(answers.boxes_xyxy.tolist(), answers.scores.tolist(), answers.class_ids.tolist(), strict=True)
    boxes = [LabelledBox(tuple(box), score, network.contract.classes[number]) for box, score, number in found]
    shown = [box for box in boxes if box.score >= DRAWN_SCORE]
    drawn = drawn_example(Path(str(path)), shown, [], max(picture.shape[:2]), DRAWN_SCORE)
    write_picture(output, picture if drawn is None else drawn)
    detections = [{"class": box.label, "score": box.score, "box_xyxy": [*box.box_xyxy]} for box in shown]
    return {
        "image": str(path), "output": str(output), "detections": detections, "weaker": len(boxes) - len(shown),
    }  # fmt: skip


def _print(facts: dict[str, Any], contract: Any, found: dict[str, Any]) -> None:
    """Print the facts, the contract with the source of each field, and the detections."""
    shown = {
        **facts,
        "metadata": {_short(key): _short(value) for key, value in facts["metadata"].items()} or "none",
        "unknown": facts["unknown"] or "none beyond the assumed fields",
        "warnings": facts["warnings"] or f"none with {found.get('image', 'a test picture')}",
    }
    print_facts(shown, False)
    values = contract.to_dict()
    if "classes" in values:
        values["classes"] = f"{len(values['classes'])}: {_short(', '.join(values['classes']))}"
    rows = [
        (name, values[name] if isinstance(values[name], str) else json.dumps(values[name]), source)
        for name, source in contract.sources.items()
        if name != "family"  # above
    ]
    say(*table_lines(("contract", "value", "source"), rows, (False,) * 3, width()))
    if "text" in found:
        say(f"text in {found['image']}", f"  {found['text']!r} {found['score']:.3f}")
    elif found:
        say(f"detections in {found['image']}; {found['weaker']} more with scores below {DRAWN_SCORE}")
        for row in found["detections"]:
            box = ", ".join(f"{side:.1f}" for side in row["box_xyxy"])
            say(f"  {row['score']:.3f} at {box} px: {_short(row['class'])}")
        say(found["output"])


def _short(text: str) -> str:
    return shortened(" ".join(text.split()), _LONGEST)
