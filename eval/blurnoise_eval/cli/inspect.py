"""``blurnoise inspect``: what a model takes and gives, how it would be read and why, and a look at its answers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli._options import FAMILIES, Json, one_of
from blurnoise_eval.cli.console import print_assumptions, print_facts
from blurnoise_eval.system.layout import table_lines
from blurnoise_eval.system.storage import Location, location
from blurnoise_eval.system.terminal import say, say_json, say_wrapped, width

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.ocr import Recogniser

DRAWN_SCORE = 0.3  # detections from here on are drawn and listed
_VALUE_LENGTH = 60  # of metadata, in characters


def inspect(
    model: Annotated[
        Location, Argument(parser=location, metavar="M.onnx", help="a detector or a text recogniser")
    ],
    *,
    contract: Annotated[
        str | None,
        Option(
            metavar="FILE|PRESET",
            help="how to read it; see 'blurnoise sweep --help'",
            autocompletion=one_of(FAMILIES),
        ),
    ] = None,
    probe: Annotated[
        Location | None,
        Option(parser=location, metavar="IMAGE", help="list and draw what it finds in this picture"),
    ] = None,
    output: Annotated[
        Path | None,
        Option("-o", "--output", metavar="OUT.png", help="of --probe (default: MODEL-IMAGE-probe.png)"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a model's inputs, outputs and metadata, the family it belongs to and why, every
    field of its contract and where that came from, and what nothing in the file tells.

      blurnoise inspect M.onnx                        warnings come from a picture drawn for it
      blurnoise inspect M.onnx --probe photo.jpg      ... from yours, with its detections drawn on it
      blurnoise inspect M.onnx --contract yolov6 --probe photo.jpg    ... as another family

    Red and blue swapped, or values 0-1 instead of 0-255, often still find something:
    with --probe it says where the opposite would find markedly more.

    Presets: yolov5 yolov6 yolov6e2e yolov7 yolov8 yolov10 yolox rtdetr detr rfdetr ppyoloe
    mmdeploy nanodet nanodetplus fastestdet yolofastestv2 anchors torchvision tfod; of text
    recognisers: ppocr.
    """
    if output and not probe:
        raise ValueError("output: goes with --probe, whose picture it shows")
    from blurnoise_eval.datasets import eight_bit, read_picture
    from blurnoise_eval.detectors.detector import open_session
    from blurnoise_eval.detectors.model_files import fetched
    from blurnoise_eval.detectors.ocr import is_recogniser

    picture = eight_bit(read_picture(probe)) if probe else None
    named, model = model, fetched(model)
    session = open_session(model)
    reads = contract == "ppocr" or is_recogniser(model)
    if reads and output:
        raise ValueError("output: nothing is drawn for a text recogniser")
    look = _look_at_reader if reads else _look_at_detector
    network, facts, found = look(model, contract, probe, picture, output)
    read_by = network.contract
    metadata = dict(sorted(session.get_modelmeta().custom_metadata_map.items()))
    facts = {
        "model": str(named),
        "sha256": network.sha256,
        "inputs": [f"{value.name} {value.shape} {value.type}" for value in session.get_inputs()],
        "outputs": [f"{value.name} {value.shape} {value.type}" for value in session.get_outputs()],
        "metadata": metadata,
        "family": read_by.family,
        **facts,
    }
    if as_json:
        stated = {"contract": read_by.to_dict(), "sources": dict(read_by.sources)}
        probed = {"probe": found} if found else {}
        say_json({**facts, **stated, "assumed": read_by.assumptions, **probed})
        return
    _print_all(facts, read_by, probe or "a drawn picture")
    if found:
        _print_probe(found)
    if not reads:
        print_assumptions(read_by, model)


def _look_at_detector(
    model: Path,
    contract: str | None,
    probe: Location | None,
    picture: NDArray[np.uint8] | None,
    output: Path | None,
) -> tuple[Detector, dict[str, Any], dict[str, Any] | None]:
    """The detector, what is known of it, and what it finds in the picture, which comes from ``probe``."""
    from blurnoise_eval.detectors.baked import baked, baked_text
    from blurnoise_eval.detectors.contract_checks import suspicions
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.formats import probe as drawn

    detector = Detector(model, contract=contract)
    seen = drawn.picture() if picture is None else picture
    limits = baked(detector, [seen])
    facts: dict[str, Any] = {
        "recognised": _recognised(detector),
        "unknown": [detector.family.UNKNOWN] if detector.family.UNKNOWN else [],
        "warnings": suspicions(detector, seen),
    }
    if limits is not None:
        facts |= {"baked": limits, "limits": baked_text(limits)}
    if picture is None or probe is None:
        return detector, facts, None
    return detector, facts, _probed(detector, probe, picture, output)


def _look_at_reader(
    model: Path,
    contract: str | None,
    probe: Location | None,
    picture: NDArray[np.uint8] | None,
    _output: Path | None,
) -> tuple[Recogniser, dict[str, Any], dict[str, Any] | None]:
    """The text recogniser, what is known of it, and what it reads in the picture, taken as one line of text."""
    from blurnoise_eval.detectors.ocr import Recogniser

    recogniser = Recogniser(model, contract=contract)
    why = "graph: one picture in, a row of class probabilities per step out"
    facts: dict[str, Any] = {"recognised": why, "unknown": [], "warnings": []}
    if picture is None:
        return recogniser, facts, None
    reading = recogniser.read(picture, [(0, 0, picture.shape[1], picture.shape[0])])[0]
    return recogniser, facts, {"image": str(probe), "text": reading.text, "score": reading.confidence}


def _recognised(detector: Detector) -> str:
    source = detector.contract.sources["family"]
    own = source.startswith(("graph: ", "assumed: "))
    return source if own else f"stated ({source}); the graph agrees: {detector.why}"


def _probed(
    detector: Detector, path: Location, picture: NDArray[np.uint8], output: Path | None
) -> dict[str, Any]:
    """Write the picture with its detections to ``output``; return both, and what was below notice."""
    from blurnoise_eval.datasets import write_picture
    from blurnoise_eval.drawing.annotate import drawn_example

    output = output or Path(f"{detector.name}-{path.stem}-probe.png")
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
        value = getattr(contract, name)
        if name == "classes":
            names = ", ".join(map(_short, value[:4]))
            value = f"{len(value)}: {names}{', ...' if len(value) > 4 else ''}"
        if name != "family":  # told above
            rows.append((name, str(value), source))
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
