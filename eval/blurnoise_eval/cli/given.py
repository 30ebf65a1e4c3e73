"""What the options of a command name: a camera, a detector, pictures, threads."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from blurnoise.camera import Camera
    from blurnoise_eval.datasets import PictureSet


def camera(options: argparse.Namespace) -> Camera:
    """The camera, with the lens's f-number if that is given."""
    from dataclasses import replace

    from blurnoise_eval.cameras import find

    camera = find(options.camera)
    if options.f_number is None:
        return camera
    sources = {**camera.sources, "f_number": "given on the command line"}
    return replace(camera, f_number=options.f_number, sources=sources)


def detector(options: argparse.Namespace) -> Any:
    """The user's model, or the built-in detector."""
    from blurnoise_models.detector import STOP_SIGN

    from blurnoise_eval.onnx_model import Detector

    return Detector(options.model or STOP_SIGN, contract=options.contract)


def pictures(options: argparse.Namespace) -> PictureSet:
    """COCO's, a folder's, or rendered signs; the first ``--limit`` of them."""
    from blurnoise_eval import datasets

    if options.target and not options.coco:
        raise ValueError("target: goes with --coco, whose categories it names")
    if options.coco:
        pictures = datasets.coco(options.coco, images=options.images, labels=options.target)
    elif options.images:
        pictures = datasets.image_folder(options.images)
    else:
        pictures = datasets.rendered_signs()
    if options.limit is None:
        return pictures
    if options.limit < 1:
        raise ValueError(f"limit = {options.limit}: must be >= 1")
    return datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[: options.limit])


def threads(options: argparse.Namespace) -> int:
    """As many as asked for, else one per usable core. Raises ``ValueError`` below 1."""
    from blurnoise_eval.results import usable_cores

    threads = options.threads if options.threads is not None else usable_cores()
    if threads < 1:
        raise ValueError(f"threads = {threads}: must be >= 1")
    return int(threads)
