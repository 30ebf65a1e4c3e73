"""What the options of a command name: a camera, a detector, pictures, threads."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from blurnoise.camera import Camera
    from blurnoise_eval.datasets import PictureSet
    from blurnoise_eval.scoring.on_picture import Model


def camera(options: argparse.Namespace) -> Camera:
    """The camera, with the lens's f-number if that is given."""
    from dataclasses import replace

    from blurnoise_eval.drawing.photon_transfer import find

    camera = find(options.camera)
    if options.f_number is None:
        return camera
    sources = {**camera.sources, "f_number": "given on the command line"}
    return replace(camera, f_number=options.f_number, sources=sources)


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

    from blurnoise_eval.detectors.opening import open_models

    if options.ocr:
        _choose_packaged(options)
    return list(
        open_models(
            options.model or [STOP_SIGN],
            options.contract or [None],
            dictionary=options.dictionary,
            text_detector=options.text_detector,
        )
    )


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
    from blurnoise_eval.system.machine import usable_cores

    threads = options.threads if options.threads is not None else usable_cores()
    if threads < 1:
        raise ValueError(f"threads = {threads}: must be >= 1")
    return int(threads)
