"""``blurnoise inspect``: what a model takes and gives, how it would be read and why, and a look at its answers."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from blurnoise_eval.cli.console import print_assumptions, print_facts

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.ocr import Recogniser

DRAWN_SCORE = 0.3  # detections from here on are drawn and listed
_VALUE_LENGTH = 60  # of metadata, in characters


def inspect(options: argparse.Namespace) -> int:
    """Inputs, outputs, metadata, family, contract, doubts; with ``--probe`` a picture's answers."""
    if options.output and not options.probe:
        raise ValueError("output: goes with --probe, whose picture it shows")
    from blurnoise_eval.datasets import eight_bit, read_picture
    from blurnoise_eval.detectors.detector import open_session
    from blurnoise_eval.detectors.ocr import is_recogniser

    picture = eight_bit(read_picture(options.probe)) if options.probe else None
    session = open_session(options.model)
    reads = options.contract == "ppocr" or is_recogniser(options.model)
    about = _inspect_reader if reads else _inspect_detector
    model, facts, found = about(options, picture)
    contract = model.contract
    metadata = dict(sorted(session.get_modelmeta().custom_metadata_map.items()))
    facts = {
        "model": str(options.model),
        "sha256": model.sha256,
        "inputs": [f"{value.name} {value.shape} {value.type}" for value in session.get_inputs()],
        "outputs": [f"{value.name} {value.shape} {value.type}" for value in session.get_outputs()],
        "metadata": metadata,
        "family": contract.family,
        **facts,
    }
    if options.json:
        stated = {"contract": contract.to_dict(), "sources": dict(contract.sources)}
        probed = {"probe": found} if found else {}
        print(json.dumps({**facts, **stated, "assumed": contract.assumptions, **probed}))
        return 0
    _print_all(facts, contract, options.probe or "a drawn picture")
    if found:
        _print_probe(found)
    if not reads:
        print_assumptions(contract, options.model)
    return 0


def _inspect_detector(
    options: argparse.Namespace, picture: NDArray[np.uint8] | None
) -> tuple[Detector, dict[str, Any], dict[str, Any] | None]:
    """The detector, what is known of it, and what it finds in the picture."""
    from blurnoise_eval.detectors.contract_checks import suspicions
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.formats import probe

    detector = Detector(options.model, contract=options.contract)
    facts = {
        "recognised": _recognised(detector),
        "unknown": [detector.family.UNKNOWN] if detector.family.UNKNOWN else [],
        "warnings": suspicions(detector, probe.picture() if picture is None else picture),
    }
    if picture is None:
        return detector, facts, None
    output = options.output or Path(f"{detector.name}-{options.probe.stem}-probe.png")
    return detector, facts, _probed(detector, options.probe, picture, output)


def _inspect_reader(
    options: argparse.Namespace, picture: NDArray[np.uint8] | None
) -> tuple[Recogniser, dict[str, Any], dict[str, Any] | None]:
    """The text recogniser, what is known of it, and what it reads in the picture, taken as one line of text."""
    if options.output:
        raise ValueError("output: nothing is drawn for a text recogniser")
    from blurnoise_eval.detectors.ocr import Recogniser

    recogniser = Recogniser(options.model, contract=options.contract)
    why = "graph: one picture in, a row of class probabilities per step out"
    facts: dict[str, Any] = {"recognised": why, "unknown": [], "warnings": []}
    if picture is None:
        return recogniser, facts, None
    reading = recogniser.read(picture, [(0, 0, picture.shape[1], picture.shape[0])])[0]
    return recogniser, facts, {"image": str(options.probe), "text": reading.text, "score": reading.confidence}


def _recognised(detector: Detector) -> str:
    source = detector.contract.sources["family"]
    own = source.startswith(("graph: ", "assumed: "))
    return source if own else f"stated ({source}); the graph agrees: {detector.why}"


def _probed(detector: Detector, path: Path, picture: NDArray[np.uint8], output: Path) -> dict[str, Any]:
    """Write the picture with its detections to ``output``; return both, and what was below notice."""
    from blurnoise_eval.datasets import write_picture
    from blurnoise_eval.drawing.annotate import drawn_example

    answers = detector.detect(picture)
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
    texts = {name: [_plain(line) for line in facts[name]] for name in ("inputs", "outputs", "warnings")}
    metadata = {_short(key): _short(value) for key, value in facts["metadata"].items()}
    shown = {
        **facts,
        **texts,
        "metadata": metadata or "none",
        "recognised": _plain(facts["recognised"]),
        "unknown": facts["unknown"] or "nothing beyond what is assumed",
        "warnings": texts["warnings"] or f"none on {looked_at}",
    }
    print_facts(shown, False)
    print("contract")
    for name, source in contract.sources.items():
        value = getattr(contract, name)
        if name == "classes":
            names = ", ".join(map(_short, value[:4]))
            value = f"{len(value)}: {names}{', ...' if len(value) > 4 else ''}"
        if name != "family":  # told above
            print(f"  {name:15s} {value!s:28s} {source}")


def _print_probe(found: dict[str, Any]) -> None:
    if "text" in found:
        print(f"read in {found['image']}\n  {found['text']!r} {found['score']:.3f}")
        return
    print(f"detections in {found['image']}")
    for row in found["detections"]:
        print(f"  {_detection(row)}")
    best = f", the best: {_detection(found['best_weaker'])}" if found["best_weaker"] else ""
    print(f"  {found['weaker']} below {DRAWN_SCORE}{best}")
    print(found["output"])


def _detection(row: dict[str, Any]) -> str:
    left, top, right, bottom = row["box_xyxy"]
    return f"{_short(row['class']):20s} {row['score']:.3f}  ({left:.1f}, {top:.1f}, {right:.1f}, {bottom:.1f}) px"


def _short(text: str) -> str:
    line = _plain(text)
    return line if len(line) <= _VALUE_LENGTH else f"{line[: _VALUE_LENGTH - 3]}..."


def _plain(text: str) -> str:
    """The text in one line, without what would steer a terminal: names in files are anybody's."""
    return "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))
