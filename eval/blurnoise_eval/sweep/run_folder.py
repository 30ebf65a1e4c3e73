"""A run folder: what makes two runs the same run, and what is noted of it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    identity = {
        "model": [
            {"name": model.name, "sha256": model.sha256, "contract": _unsourced(model.contract.to_dict())}
            for model in models
        ],
        "camera": _unsourced(camera.to_dict()),
        "plan": plan.to_dict(),
        "pictures": _digest(repr([picture.name for picture in whole or pictures])),
        "choice of targets": _digest(repr([picture.targets for picture in whole or pictures])),
    }
    if plan.cuts:
        identity["annotations"] = _annotations(whole or pictures)
    if part is not None and part.count > 1:
        identity["part"] = str(part)
    identity = _as_json(identity)
    held = store.about("identity")
    if held is not None and held != identity and not queries.has_answers(store):
        store.clear()
        held = None
    if held is not None and held != identity:
        differing = [key for key in {**identity, **held} if held.get(key) != identity.get(key)]
        told: dict[str, Callable[..., str]] = {"model": _contracts, "camera": _cameras}
        differing = [told[key](held[key], identity[key]) if key in told else key for key in differing]
        raise _another(store, " and ".join(differing))
    if queries.has_answers(store) and (other := other_software(computed_by(store), [versions()])):
        raise _another(store, other)
    for picture in _replaced(pictures, plan.objects, store):
        raise _another(
            store, f"picture {picture.name!r}{' or its plate' * (plan.objects.plates is not None)}"
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


def _contracts(held: list[dict[str, Any]], asked: list[dict[str, Any]]) -> str:
    """'model', or where the files are the same which fields of their contracts differ."""
    if [(one["name"], one["sha256"]) for one in held] != [(one["name"], one["sha256"]) for one in asked]:
        return "model"
    pairs = [(one["contract"], other["contract"]) for one, other in zip(held, asked, strict=True)]
    fields = {
        name: None
        for one, other in pairs
        for name in {**one, **other}
        if name not in one or name not in other or one[name] != other[name]
    }
    return f"contract of the same model ({', '.join(fields)})"


def _cameras(held: dict[str, Any], asked: dict[str, Any]) -> str:
    """'camera' and both names, or where these are the same which fields differ."""
    if held["name"] != asked["name"]:
        return f"camera (it has {held['name']}, this is {asked['name']}; --camera names one)"
    return f"camera ({', '.join(name for name in held if held[name] != asked.get(name))})"


def computed_by(store: Store) -> list[Mapping[str, str]]:
    """Versions of the software that computed the run's cells; where these state none, the run's own."""
    return [*store.software().values()] or [(store.about("manifest") or {}).get("versions", {})]


def other_software(held: Sequence[Mapping[str, str]], asked: Sequence[Mapping[str, str]]) -> str | None:
    """'software' with the versions that differ; None where none do. What an old run does not say is not compared."""
    told = {
        f"{name} {version} there, {other[name]} here": None
        for one in held
        for other in asked
        for name, version in one.items()
        if version != other.get(name, version)
    }
    return f"software ({', '.join(told)})" if told else None


def _another(store: Store, what: str) -> StoreError:
    return StoreError(
        f"run = {str(store.folder)!r}: holds a run with another {what}; "
        "choose another folder, or repeat that run's command to resume it"
    )


def _replaced(pictures: PictureSet, objects: Objects, store: Store) -> Iterator[Picture]:
    """Those that, or whose plates, are not what their cells were computed from; only where a file has changed it is
    read."""
    held = store.pictures()
    for picture in pictures:
        if picture.name not in held:
            continue
        before, identity = held[picture.name][1], source_identity(picture, objects)
        if identity == held[picture.name][0]:
            continue
        try:
            now = source_content(picture, picture.load(), objects)
        except UnreadablePicture:
            now = ""
        if now != before:
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


HARMLESS = ("id",)
"""Fields of annotations that reach neither a pixel nor a box."""


def _annotations(pictures: PictureSet) -> str:
    """What data sets say of targets beside their boxes, such as polygons that they are cut out by."""
    digest = hashlib.blake2b(digest_size=16)
    for picture in pictures:
        for target in picture.targets or ():
            said = sorted(
                (name, repr(value)) for name, value in target.annotation.items() if name not in HARMLESS
            )
            digest.update(repr(said).encode("utf-8", "backslashreplace"))
    return digest.hexdigest()


def _unsourced(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != "sources"}


def _as_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_json(entry) for key, entry in value.items()}
    return [_as_json(entry) for entry in value] if isinstance(value, (list, tuple)) else value
