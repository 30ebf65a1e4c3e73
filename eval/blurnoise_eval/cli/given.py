"""What the options of a command name: a camera, a detector, pictures, threads."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from blurnoise.camera import Camera
    from blurnoise_eval.datasets import PictureSet
    from blurnoise_eval.scoring.on_picture import Model


def camera(options: argparse.Namespace) -> Camera:
    """The camera, with the lens's f-number if that is given: its light, and its diffraction."""
    from dataclasses import replace

    from blurnoise_eval.drawing.photon_transfer import find
    from blurnoise_eval.grid.conditions import with_lens

    camera = find(options.camera)
    if options.f_number is None:
        return camera
    sources = {**camera.sources, "f_number": "given on the command line"}
    return replace(with_lens(camera, f_number=options.f_number), sources=sources)


def detector(options: argparse.Namespace) -> Any:
    """The user's model, or the built-in detector."""
    from blurnoise_models.detector import STOP_SIGN

    from blurnoise_eval.detectors.detector import Detector

    return Detector(options.model or STOP_SIGN, contract=options.contract)


def models(options: argparse.Namespace) -> list[Model]:
    """The user's detectors and text recognisers, or the built-in detector. Equal names get a number.

    Raises ``ValueError`` where detectors and recognisers are named together: their targets differ.
    """
    from blurnoise_models.detector import STOP_SIGN

    from blurnoise_eval.detectors.ocr import is_recogniser

    if options.ocr:
        _choose_packaged(options)
    paths = options.model or [STOP_SIGN]
    contracts = options.contract or [None]
    if len(contracts) not in (1, len(paths)):
        raise ValueError(
            f"contract: {len(contracts)} are given; must be one, or one for each of {len(paths)} models"
        )
    contracts = contracts * len(paths) if len(contracts) == 1 else contracts
    told = "ppocr" in contracts or options.dictionary is not None  # the graph alone may not show it
    kinds = [told or is_recogniser(path) for path in paths]
    if len(set(kinds)) > 1:
        raise ValueError(
            "model: a sweep runs detectors or text recognisers, not both; give each a run of its own"
        )
    if (options.dictionary or options.text_detector) and not kinds[0]:
        raise ValueError("dictionary, text-detector: go with text recognisers, as --model")
    load = partial(_reader, options) if kinds[0] else _detector
    found = [load(path, contract) for path, contract in zip(paths, contracts, strict=True)]
    names: dict[str, int] = {}
    for model in found:
        names[model.name] = names.get(model.name, 0) + 1
        if names[model.name] > 1:
            model.name = f"{model.name}-{names[model.name]}"
    return found


def _choose_packaged(options: argparse.Namespace) -> None:
    """Put the files of the package rapidocr in the place of --model and --text-detector."""
    from blurnoise_eval.detectors.ocr import rapidocr_models

    if options.model or options.text_detector or options.dictionary:
        raise ValueError("ocr: brings its own models; leave out --model, --text-detector and --dictionary")
    found = rapidocr_models()
    if found is None:
        raise ValueError("ocr: needs the package rapidocr: pip install --no-deps rapidocr")
    options.model = [found[1]]
    options.text_detector = found[0] if options.ocr == "find" else None


def read(models: Sequence[Model]) -> bool:
    """Whether these read text."""
    from blurnoise_eval.detectors.detector import Detector

    return not isinstance(models[0], Detector)


def _detector(path: Path, contract: str | None) -> Model:
    from blurnoise_eval.detectors.detector import Detector

    return Detector(path, contract=contract)


def _reader(options: argparse.Namespace, path: Path, contract: str | None) -> Model:
    from blurnoise_eval.detectors.ocr import Recogniser, TextSpotter

    recogniser = Recogniser(path, contract=contract, dictionary=options.dictionary)
    return TextSpotter(options.text_detector, recogniser) if options.text_detector else recogniser


def pictures(options: argparse.Namespace, *, reads: bool) -> PictureSet:
    """A labelled set's, a folder's, or rendered signs; the first ``--limit`` of them. reads: text."""
    from dataclasses import replace

    if options.limit is not None and options.limit < 1:
        raise ValueError(f"limit = {options.limit}: must be >= 1")
    found = _pictures(options, reads)
    return replace(found, pictures=found.pictures[: options.limit])


def _pictures(options: argparse.Namespace, reads: bool) -> PictureSet:
    from blurnoise_eval import datasets

    sources = [name for name in ("coco", "yolo", "bdd", "text") if getattr(options, name)]
    if len(sources) > 1:
        raise ValueError(f"--{' and --'.join(sources)}: must be one of them")
    if options.target and (not sources or options.text):
        raise ValueError("target: goes with --coco, --yolo or --bdd, whose classes it names")
    if options.keep_empty and not options.target:
        raise ValueError("keep-empty: goes with --target; without it, pictures of nothing count anyway")
    if options.split and not options.yolo:
        raise ValueError("split: goes with --yolo, whose data.yaml names it")
    if reads and sources and not options.text:
        raise ValueError(
            f"{sources[0]}: text recognisers take --text, which says what is to be read, or --images"
        )
    chosen = {"images": options.images, "labels": options.target, "keep_empty": options.keep_empty}
    if options.coco:
        return datasets.coco(options.coco, **chosen)
    if options.yolo:
        return datasets.yolo(options.yolo, split=options.split, **chosen)
    if options.bdd:
        return datasets.bdd(options.bdd, **chosen)
    if options.text:
        return datasets.texts(options.text, images=options.images)
    if options.images:
        return datasets.image_folder(options.images)
    return datasets.rendered_texts() if reads else datasets.rendered_signs()


def threads(options: argparse.Namespace) -> int:
    """As many as asked for, else one per usable core. Raises ``ValueError`` below 1."""
    from blurnoise_eval.sweep.run_folder import usable_cores

    threads = options.threads if options.threads is not None else usable_cores()
    if threads < 1:
        raise ValueError(f"threads = {threads}: must be >= 1")
    return int(threads)
