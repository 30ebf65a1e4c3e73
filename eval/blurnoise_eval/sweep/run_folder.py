"""A run folder: what makes two runs the same run, and what is noted of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise_eval.datasets import Picture, PictureSet, UnreadablePicture, source_content, source_identity
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.nodes import Plan
from blurnoise_eval.grid.objects import Objects
from blurnoise_eval.grid.parts import Part
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.coco_export import write_truth
from blurnoise_eval.system.machine import hardware, versions

HARMLESS = ("id",)
"""Fields of annotations that reach neither a pixel nor a box."""
_LONGEST_SHOWN = 24  # letters of a value in an error
_MOST_SHOWN = 5  # differences


def open_run(
    store: Store,
    models: Sequence[Model],
    camera: Camera,
    pictures: PictureSet,
    plan: Plan,
    facts: dict[str, Any],
    *,
    whole: PictureSet | None = None,
    part: Part | None = None,
) -> None:
    """Note in the store what the run is; a store that holds another run's answers is refused.

    One without any answer, of a first attempt with the wrong model or pictures, is taken over.
    ``facts``: what else the report shows (command, threads). part: which of the pictures of ``whole`` these are.
    Raises :class:`StoreError` that lists what differs, ``ValueError`` for two models of one name.
    """
    names = [model.name for model in models]
    if len(set(names)) < len(names):
        raise ValueError(f"model = {names}: names must differ, since results are told apart by them")
    every = whole or pictures
    identity = {
        "model": [
            {"name": model.name, "sha256": model.sha256, "contract": _unsourced(model.contract.to_dict())}
            for model in models
        ],
        "camera": _unsourced(camera.to_dict()),
        "plan": plan.to_dict(),
        "pictures": _digest(repr([picture.name for picture in every])),
        "choice of targets": _digest(repr([picture.targets for picture in every])),
    }
    if plan.cuts:
        identity["annotations"] = _digest(repr([_annotations(picture) for picture in every]))
    if part is not None and part.count > 1:
        identity["part"] = str(part)
    identity = json.loads(json.dumps(identity))  # lists for tuples, as the store has them
    held = store.about("identity")
    if held is not None and held != identity and not queries.has_answers(store):
        store.clear()
        held = None
    differing = [] if held is None else differences(held, identity)
    if queries.has_answers(store):
        differing += other_software(computed_by(store), [versions()])
    differing += [
        f"picture {picture.name!r}{' or its plate' * (plan.objects.plates is not None)}"
        for picture in _replaced(pictures, plan.objects, store)
    ]
    if differing:
        raise StoreError(
            f"run = {str(store.folder)!r}: holds a run with another {listed(differing)}; "
            "choose another folder, or repeat that run's command to resume it"
        )
    write_truth(pictures, store.folder, whole)
    store.computes_with(versions())
    store.set_about("identity", identity)
    before = {model["name"]: model for model in (store.about("manifest") or {"models": []})["models"]}
    store.set_about(
        "manifest",
        {
            "title": f"{', '.join(names)} seen through {camera.name}",
            "models": [{**before.get(model.name, {}), **_about(model, pictures)} for model in models],
            "camera": camera.to_dict(),
            "images": {
                "kind": pictures.kind,
                "source": pictures.source,
                "count": len(pictures),
                "labelled": pictures.labelled,
                "notes": list(pictures.notes),
                "chosen": pictures.chosen,
            },
            "seed": plan.seed,
            "grey_anchor": plan.grey_anchor,
            "trajectory": None if plan.path is None else {**asdict(plan.path[0]), "longest_s": plan.path[1]},
            "versions": versions(),
            "hardware": hardware(),
            **facts,
        },
    )


def differences(held: Any, here: Any, at: str = "") -> list[str]:
    """What differs between two documents: 'camera.f_number (2.0 there, 2.8 here)'; of another name only that."""
    if held == here:
        return []
    pairs: list[tuple[Any, Any, Any]]
    if isinstance(held, Mapping) and isinstance(here, Mapping):
        keys = [*{**held, **here}] if held.get("name") == here.get("name") else ["name"]
        pairs = [(key, held.get(key), here.get(key)) for key in keys]
    elif isinstance(held, list) and isinstance(here, list) and len(held) == len(here):
        pairs = [(key, *both) for key, both in enumerate(zip(held, here, strict=True))]
    else:
        values = f" ({held} there, {here} here)"
        return [f"{at}{values if len(values) <= 2 * _LONGEST_SHOWN else ''}"]
    return [each for key, a, b in pairs for each in differences(a, b, f"{at}.{key}".lstrip("."))]


def listed(differing: Sequence[str]) -> str:
    """Differences in a line."""
    more = len(differing) - _MOST_SHOWN
    return " and ".join([*differing[:_MOST_SHOWN], *([f"{more} more"] if more > 0 else [])])


def computed_by(store: Store) -> list[Mapping[str, str]]:
    """Versions of the software that computed the run's cells; where these state none, the run's own."""
    return [*store.software().values()] or [(store.about("manifest") or {}).get("versions", {})]


def other_software(held: Sequence[Mapping[str, str]], here: Sequence[Mapping[str, str]]) -> list[str]:
    """The versions that differ. What an old run does not say is not compared."""
    found = [
        differences(one, {name: other.get(name) for name in one}, "software")
        for one in held
        for other in here
    ]
    return list(dict.fromkeys(each for some in found for each in some))


def _replaced(pictures: PictureSet, objects: Objects, store: Store) -> Iterator[Picture]:
    """Those that, or whose plates, are not what their cells were computed from; only where a file has changed it is
    read."""
    held = store.pictures()
    for picture in pictures:
        before = held.get(picture.name)
        if before is None or before[0] == (identity := source_identity(picture, objects)):
            continue
        try:
            now = source_content(picture, picture.load(), objects)
        except UnreadablePicture:
            now = ""
        if now != before[1]:
            yield picture
        else:
            store.note_picture(picture.name, identity, now)


def _about(model: Model, pictures: PictureSet) -> dict[str, Any]:
    contract = model.contract.to_dict()
    unknown: list[str] = []
    if isinstance(model, Detector):
        contract["input_size_px"] = list(model.input_size_px)
        unknown = sorted(set(pictures.categories) - set(model.contract.classes))
    return {
        "name": model.name,
        "kind": "detector" if isinstance(model, Detector) else "reader",
        "unknown_labels": unknown,
        "file": str(getattr(model, "source", model.path)),
        "sha256": model.sha256,
        "contract": contract,
    }


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "backslashreplace"), digest_size=16).hexdigest()


def _annotations(picture: Picture) -> list[Any]:
    """What a data set says of targets beside their boxes, such as polygons that they are cut out by."""
    every = [target.annotation.items() for target in picture.targets or ()]
    return [sorted((name, repr(value)) for name, value in each if name not in HARMLESS) for each in every]


def _unsourced(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != "sources"}
