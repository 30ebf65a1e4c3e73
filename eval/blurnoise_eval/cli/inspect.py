"""``blurnoise inspect``: what a model takes and gives, how it would be read and why, and a look at its answers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli._options import Contract, Json, Location, ModelTimeout, new_file, place
from blurnoise_eval.cli.console import print_assumptions, print_facts
from blurnoise_eval.grid.plan_file import MODEL_TIMEOUT_S
from blurnoise_eval.system.terminal import say, say_json, say_wrapped, table_lines, width

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.model import OnnxModel
    from blurnoise_eval.detectors.ocr import Recogniser

DRAWN_SCORE = 0.3  # detections from here on are drawn and listed
_VALUE_LENGTH = 60  # of metadata, in characters


def inspect(
    model: Annotated[
        Location, Argument(parser=place, metavar="M.onnx", help="a detector or a text recogniser")
    ],
    *,
    contract: Contract = None,
    probe: Annotated[
        Location | None,
        Option(
            parser=place,
            metavar="IMAGE|DIR",
            help="list and draw what it finds in this picture, or in the first of a folder; compare how pictures "
            "may enter the model, on up to 32",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        Option(
            "-o",
            "--output",
            parser=new_file,
            metavar="OUT.png",
            help="of --probe (default: MODEL-IMAGE-probe.png)",
        ),
    ] = None,
    save_contract: Annotated[
        bool,
        Option(
            "--save-contract",
            help="write the contract as MODEL.contract.json beside the model, where every command finds it",
        ),
    ] = False,
    model_timeout_s: ModelTimeout = MODEL_TIMEOUT_S,
    as_json: Json = False,
) -> None:
    """Show a model's inputs, outputs and metadata, the family it belongs to and why, every
    field of its contract and where that came from, and what nothing in the file tells.

      blurnoise inspect M.onnx                                     from the file alone
      blurnoise inspect M.onnx --probe photo.jpg                   its detections drawn on a photograph of yours
      blurnoise inspect M.onnx --probe photos/ --save-contract     the contract chosen by 32 of them, kept
      blurnoise inspect M.onnx --contract yolox,colour=rgb,range=0-1 --probe photos/

    Red and blue swapped, or values 0-1 instead of 0-255, often still find something. With --probe
    colours, values and resize are varied: what is found again in the mirrored, cropped picture
    decides what nothing states, and doubts what is stated. It takes 100 to 600 inferences; what the
    pictures leave open is a warning, which more pictures settle.

    FIELD: family (or base), classes (coco80, coco91 or a/b/c), colour (rgb, bgr), value_range (or
    range: 0-1, 0-255), mean and std (1/2/3, in that range and the colours' order), resize
    (letterbox, letterbox-top-left, stretch, none), pad_value (or pad), input_size_px (or size:
    416x640, height first), nms_iou (or iou). A file may hold "base: yolox" and what differs.

    PRESET: a family's name, such as yolox, yolov8, rtdetr or tfod, for text recognisers ppocr;
    completion lists all of them, and so does the error of any other word.
    """
    if output and not probe:
        raise ValueError("output: goes with --probe, whose picture it shows")
    from blurnoise_eval.detectors.contract_files import contract_document
    from blurnoise_eval.detectors.model import OnnxModel
    from blurnoise_eval.detectors.ocr import is_recogniser
    from blurnoise_eval.system.files import write_whole

    probed = _pictures(probe) if probe else []
    opened = OnnxModel(model, timeout_s=model_timeout_s)
    reads = (contract or "").split(",")[0] == "ppocr" or is_recogniser(opened)
    if reads and (output or save_contract):
        name = "output: nothing is drawn" if output else "save-contract: none is written"
        raise ValueError(f"{name} for a text recogniser")
    if probe and not output and not reads:
        output = new_file(f"{model.stem}-{probed[0][0].stem}-probe.png")
    kept = _contract_file(model) if save_contract else None
    look = _look_at_reader if reads else _look_at_detector
    network, facts, found = look(opened, contract, probed, output)
    read_by: Any = network.contract
    if kept is not None:
        write_whole(kept, (json.dumps(contract_document(read_by), indent=1) + "\n").encode())
        facts["saved"] = str(kept)
    session = opened.session
    facts = {
        "model": str(model),
        "sha256": network.sha256,
        "inputs": [f"{value.name} {value.shape} {value.type}" for value in session.get_inputs()],
        "outputs": [f"{value.name} {value.shape} {value.type}" for value in session.get_outputs()],
        "metadata": dict(sorted(opened.metadata.items())),
        "family": read_by.family,
        **facts,
    }
    if as_json:
        stated = {"contract": read_by.to_dict(), "sources": dict(read_by.sources)}
        seen = {"probe": found} if found else {}
        say_json({**facts, **stated, "assumed": read_by.assumptions, **seen})
        return
    _print_all(facts, read_by, probe or "a drawn picture")
    if found:
        _print_probe(found)
    if not reads:
        print_assumptions(read_by, opened.path)


def _pictures(probe: Location) -> list[tuple[Location, NDArray[np.uint8]]]:
    """The picture, or up to 32 of a folder. Raises ``ValueError`` for a folder without any."""
    from blurnoise_eval.datasets import eight_bit, image_folder, read_picture, sample
    from blurnoise_eval.sweep.contract_checks import MOST_PICTURES

    if not (isinstance(probe, Path) and probe.is_dir()):
        return [(probe, eight_bit(read_picture(probe)))]
    found = sample(image_folder(probe), MOST_PICTURES)
    if not found:
        raise ValueError(f"probe = {str(probe)!r}: none of its pictures can be read")
    return [(probe / picture.name, image) for picture, image in found]


def _contract_file(model: Location) -> Path:
    """Where the contract is written. Raises ``ValueError`` where something stands already."""
    beside = model.parent if isinstance(model, Path) else Path()
    path = beside / f"{model.stem}.contract.json"
    if path.exists():
        raise ValueError(f"save-contract = {str(path)!r}: exists; must be a new file")
    return new_file(str(path))


def _look_at_detector(
    model: OnnxModel,
    contract: str | None,
    probed: list[tuple[Location, NDArray[np.uint8]]],
    output: Path | None,
) -> tuple[Detector, dict[str, Any], dict[str, Any] | None]:
    """The detector, what is known of it, and what it finds in the first picture."""
    from blurnoise_eval.detectors.baked import baked, baked_text
    from blurnoise_eval.detectors.contract_files import contract_option
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.formats import probe as drawn
    from blurnoise_eval.sweep.contract_checks import compared, output_problems

    detector = Detector(model, contract=contract)
    facts: dict[str, Any] = {
        "recognised": _recognised(detector),
        "unknown": [detector.family.unknown] if detector.family.unknown else [],
    }
    if probed:
        comparison = compared(detector, [(picture, None) for _, picture in probed])
        detector = detector.with_contract(comparison.contract)
        facts |= {"compared": comparison.text} if comparison.text else {}
        facts["warnings"] = list(comparison.doubts)
    else:
        facts["warnings"] = output_problems(detector, drawn.picture())
    limits = baked(detector, [picture for _, picture in probed] or [drawn.picture()])
    if limits is not None:
        facts |= {"baked": limits, "limits": baked_text(limits)}
    if typed := contract_option(detector.contract):
        facts["--contract"] = typed
    if not probed or output is None:
        return detector, facts, None
    return detector, facts, _probed(detector, *probed[0], output)


def _look_at_reader(
    model: OnnxModel,
    contract: str | None,
    probed: list[tuple[Location, NDArray[np.uint8]]],
    _output: Path | None,
) -> tuple[Recogniser, dict[str, Any], dict[str, Any] | None]:
    """The text recogniser, what is known of it, and what it reads in the first picture, taken as one line of text."""
    from blurnoise_eval.detectors.ocr import Recogniser

    recogniser = Recogniser(model, contract=contract)
    why = "graph: one picture in, a row of class probabilities per step out"
    facts: dict[str, Any] = {"recognised": why, "unknown": [], "warnings": []}
    if not probed:
        return recogniser, facts, None
    probe, picture = probed[0]
    reading = recogniser.read(picture, [(0, 0, picture.shape[1], picture.shape[0])])[0]
    return recogniser, facts, {"image": str(probe), "text": reading.text, "score": reading.confidence}


def _recognised(detector: Detector) -> str:
    source = detector.contract.sources["family"]
    own = source.startswith(("graph: ", "assumed: "))
    return source if own else f"stated ({source}); the graph agrees: {detector.why}"


def _probed(detector: Detector, path: Location, picture: NDArray[np.uint8], output: Path) -> dict[str, Any]:
    """Write the picture with its detections to ``output``; return both, and what was below notice."""
    from blurnoise_eval.datasets import write_picture
    from blurnoise_eval.plots.annotate import drawn_example

    answers = detector.detect(picture).leading
    rows = [
        {"class": detector.contract.classes[number], "score": float(score), "box_xyxy": box.tolist()}
        for box, score, number in zip(answers.boxes_xyxy, answers.scores, answers.class_ids, strict=True)
    ]
    shown = [row for row in rows if row["score"] >= DRAWN_SCORE]
    boxes = [{"label": row["class"], "score": row["score"], "box_xyxy": row["box_xyxy"]} for row in shown]
    drawn = drawn_example(
        {"path": path, "detections": boxes, "targets": []}, max(picture.shape[:2]), DRAWN_SCORE
    )
    write_picture(output, picture if drawn is None else drawn)
    return {
        "image": str(path),
        "output": str(output),
        "detections": shown,
        "weaker": len(rows) - len(shown),
        "best_weaker": rows[len(shown)] if len(rows) > len(shown) else None,
    }


def _print_all(facts: dict[str, Any], contract: Any, looked_at: object) -> None:
    """Every fact, then every field of the contract with its source."""
    metadata = {_short(key): _short(value) for key, value in facts["metadata"].items()}
    shown = {
        **facts,
        "metadata": metadata or "none",
        "unknown": facts["unknown"] or "nothing beyond what is assumed",
        "warnings": facts["warnings"] or f"none on {looked_at}",
    }
    print_facts(shown, False)
    rows = []
    for name, source in contract.sources.items():
        value = contract.to_dict()[name]
        if name == "classes":
            names = ", ".join(map(_short, value[:4]))
            value = f"{len(value)}: {names}{', ...' if len(value) > 4 else ''}"
        if name != "family":  # told above
            rows.append((name, value if isinstance(value, str) else json.dumps(value), source))
    say(*table_lines(("contract", "value", "from"), rows, (False,) * 3, width()))


def _print_probe(found: dict[str, Any]) -> None:
    if "text" in found:
        say(f"read in {found['image']}", f"  {found['text']!r} {found['score']:.3f}")
        return
    say(f"detections in {found['image']}")
    if found["detections"]:
        heads, right = ("class", "score", "x0", "y0", "x1", "y1 / px"), (False, *(True,) * 5)
        say(*table_lines(heads, list(map(_detection, found["detections"])), right, width()))
    best = found["best_weaker"]
    told = f", the best: {_short(best['class'])}, {best['score']:.3f}" if best else ""
    say_wrapped(f"{found['weaker']} below {DRAWN_SCORE}{told}", hanging=2)
    say(found["output"])


def _detection(row: dict[str, Any]) -> list[str]:
    return [_short(row["class"]), f"{row['score']:.3f}", *(f"{side:.1f}" for side in row["box_xyxy"])]


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _VALUE_LENGTH else f"{line[: _VALUE_LENGTH - 3]}..."
