"""Opens what options and files of settings name: the camera, the models and the pictures."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from blurnoise_eval.system.terminal import say_wrapped

if TYPE_CHECKING:
    from blurnoise.camera import Camera
    from blurnoise.camera.colour import Cfa
    from blurnoise_eval.datasets import PictureSet
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.plan.files import PlanFile
    from blurnoise_eval.scoring.on_picture import Model


def refuse_unused(options: Mapping[str, Any], needs: str) -> None:
    """Raise ``ValueError`` for options that are not None. needs: what they are for, in words."""
    if unused := [name for name, value in options.items() if value is not None]:
        raise ValueError(f"{', '.join(unused)}: needs {needs}")


def camera(name: str | None, cfa: Cfa | None = None, *, colour: bool = True) -> Camera:
    """The camera of a preset or a file, with other colour filters if ``cfa`` is not None.

    Without a name, the default camera for pictures in colour or in grey.
    """
    from blurnoise_eval.cameras import find
    from blurnoise_eval.default_camera import default_camera

    camera = default_camera(colour=colour, cfa=cfa) if name is None else find(name)
    if cfa is None:
        return camera
    return camera.with_figures(cfa=cfa, sources={**camera.sources, "cfa": "from the command line"})


def camera_of_run(plan: PlanFile, pictures: PictureSet) -> tuple[Camera, str | None]:
    """The camera of the plan, or the default for these pictures; and a line about it for the terminal."""
    from blurnoise_eval.default_camera import camera_text, default_for, in_colour

    named = plan.camera is not None
    chosen = camera(plan.camera, cfa=plan.cfa) if named else default_for(pictures, plan.cfa)
    about = camera_text(chosen, colour=chosen.sensor.cfa != "none" or in_colour(pictures))
    return chosen, "; ".join(filter(None, [about, about_lux(plan.camera, chosen)])) or None


def about_lux(named: str | None, camera: Camera) -> str | None:
    """A line on how lux are calibrated, for a camera of the user's own file."""
    from blurnoise.camera import PRESETS

    if named in (None, *PRESETS):
        return None
    from blurnoise_eval.calibration.light import lux_text  # takes 0.6 s

    return lux_text(camera)


def detector(model: Path | None, contract: str | None) -> Detector:
    """The user's model, or the built-in detector."""
    from blurnoise_models.detector import STOP_SIGN

    from blurnoise_eval.detectors.detector import Detector

    return Detector(model or STOP_SIGN, contract=contract)


def models(plan: PlanFile) -> list[Model]:
    """The user's detectors or text recognisers, or the built-in detector. Raises ``ValueError``."""
    from blurnoise_models.detector import STOP_SIGN

    from blurnoise_eval.detectors.ocr import rapidocr_recogniser
    from blurnoise_eval.detectors.opening import open_models

    paths = [_place("model", text) for text in plan.model] or [STOP_SIGN]
    if "ppocr" in map(str, paths):
        if len(paths) > 1:
            raise ValueError("model: ppocr cannot be combined with other models")
        found = rapidocr_recogniser()
        if found is None:
            raise ValueError("model = 'ppocr': needs the package rapidocr: pip install --no-deps rapidocr")
        paths = [found]
    dictionary = _place("dictionary", plan.dictionary)
    contracts = plan.contract or [None]
    return list(open_models(paths, contracts, dictionary=dictionary, timeout_s=plan.model_timeout_s))


def _place(name: str, text: str | None) -> Any:
    """The file, folder or URL of a setting. Raises ``ValueError`` that names the setting."""
    from blurnoise_eval.system.files import note_inputs
    from blurnoise_eval.system.urls import location

    try:
        found = None if text is None else location(text)
        note_inputs([found] if isinstance(found, Path) else [])
        return found
    except ValueError as error:
        raise ValueError(f"{name} = {error}") from None


def pictures(plan: PlanFile, *, reads: bool = False) -> PictureSet:
    """The first ``limit`` pictures of a labelled set, of a folder, or rendered signs. reads: the models read text.

    Notes about the set are written to standard error. Raises ``ValueError`` for settings that exclude each other.
    """
    from blurnoise_eval import datasets
    from blurnoise_eval.label_formats import format_of

    images, labels = _place("images", plan.images), _place("labels", plan.labels)
    of = None if labels is None else format_of(labels)
    if plan.limit is not None and plan.limit < 1:
        raise ValueError(f"limit = {plan.limit}: must be >= 1")
    if plan.target and (of is None or of.texts):
        raise ValueError("target: needs labels of objects, with the class that it names")
    if reads and of and not of.texts:
        raise ValueError(f"labels = {plan.labels!r}: must be PP-OCR labels (.txt) for a text recogniser")
    found: PictureSet
    if of:
        found = of.open(labels, images=images, **({} if of.texts else {"labels": plan.target}))
    elif images:
        found = datasets.image_folder(images)
    else:
        found = datasets.rendered_texts() if reads else datasets.rendered_signs()
    for note in found.notes:
        say_wrapped(f"{found.source}: {note}.", hanging=2, error=True)
    return replace(found, pictures=found.pictures[: plan.limit])


def subject(plan: PlanFile) -> tuple[list[Model], PictureSet]:
    """Models and pictures of a plan."""
    from blurnoise_eval.detectors.detector import Detector

    opened = models(plan)
    return opened, pictures(plan, reads=not isinstance(opened[0], Detector))


def command() -> str:
    """The command line, without the passwords of URLs."""
    from blurnoise_eval.system.urls import without_secrets

    return without_secrets(" ".join(["blurnoise", *sys.argv[1:]]))


def threads(count: int | None) -> int:
    """The number of workers; None: one per usable core. Raises ``ValueError`` below 1."""
    from blurnoise_eval.system.machine import usable_cores

    count = count if count is not None else usable_cores()
    if count < 1:
        raise ValueError(f"threads = {count}: must be >= 1")
    return count
