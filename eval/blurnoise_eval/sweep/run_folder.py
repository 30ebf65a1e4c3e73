"""A run folder: what makes two runs the same run, and what is noted of it."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise_eval.datasets import Picture, PictureSet, UnreadablePicture, content
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import Part, SweepPlan
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.coco_export import write_truth
from blurnoise_eval.system.files import RUN_FILE, RUN_PICTURES
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
    plan: SweepPlan,
    facts: dict[str, Any],
    *,
    whole: PictureSet | None = None,
    part: Part | None = None,
) -> None:
    """Note in the store what the run is; one without any answer, of a first attempt, is taken over.

    ``facts``: what else the report shows (command, threads). part: which of the pictures of ``whole`` these are.
    Raises :class:`StoreError` that lists what differs from the run in the store, ``ValueError`` for two models of one
    name.
    """
    names = [model.name for model in models]
    if len(set(names)) < len(names):
        raise ValueError(f"model = {names}: names must differ, since results are told apart by them")
    every = whole or pictures
    identity = {
        "model": [
            {"name": each.name, "sha256": each.sha256, "contract": _unsourced(each.contract.to_dict())}
            for each in models
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
    held, answered = store.about("identity"), queries.has_answers(store)
    if held is not None and held != identity and not answered:
        store.clear()
        held = None
    differing = [] if held is None else differences(held, identity)
    differing += other_software(computed_by(store), [versions()]) if answered else []
    differing += [f"picture {picture.name!r}" for picture in _replaced(pictures, store)]
    if differing:
        raise StoreError(
            f"run = {str(store.folder)!r}: holds a run with another {listed(differing)}; "
            "choose another folder, or repeat that run's command to resume it"
        )
    write_truth(pictures, store.folder, whole)
    store.computes_with(versions())
    store.set_about("identity", identity)
    before = {model["name"]: model for model in (store.about("manifest") or {"models": []})["models"]}
    images = {name: getattr(pictures, name) for name in ("kind", "source", "labelled", "notes", "chosen")}
    manifest = {
        "title": f"{', '.join(names)} seen through {camera.name}",
        "models": [{**before.get(model.name, {}), **_about(model, pictures)} for model in models],
        "camera": camera.to_dict(),
        "images": {**images, "count": len(pictures)},
        "seed": plan.seed,
        "grey_anchor": plan.grey_anchor,
        "trajectory": None if plan.path is None else {**asdict(plan.path[0]), "longest_s": plan.path[1]},
        "versions": versions(),
        "hardware": hardware(),
    }
    store.set_about("manifest", {**manifest, **facts})


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
    found = dict[str, None]()
    for one, other in product(held, here):
        found |= dict.fromkeys(differences(one, {name: other.get(name) for name in one}, "software"))
    return list(found)


def _replaced(pictures: PictureSet, store: Store) -> Iterator[Picture]:
    """Those that are not what their cells were computed from; only where a file has changed it is read."""
    held = store.pictures()
    for picture in (each for each in pictures if each.name in held):
        before = held[picture.name]
        if before[0] == picture.identity:
            continue
        try:
            now = content(picture.load())
        except UnreadablePicture:
            now = ""
        if now != before[1]:
            yield picture
        else:
            store.note_picture(picture.name, picture.identity, now)


def _about(model: Model, pictures: PictureSet) -> dict[str, Any]:
    file, contract = str(getattr(model, "source", model.path)), model.contract.to_dict()
    about = {"name": model.name, "kind": "reader", "unknown_labels": [], "file": file, "sha256": model.sha256}
    if isinstance(model, Detector):
        unknown = sorted(set(pictures.categories) - set(model.contract.classes))
        about |= {"kind": "detector", "unknown_labels": unknown}
        contract["input_size_px"] = list(model.input_size_px)
    return {**about, "contract": contract}


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "backslashreplace"), digest_size=16).hexdigest()


def _annotations(picture: Picture) -> list[Any]:
    """What a data set says of targets beside their boxes, such as polygons that they are cut out by."""
    every = [target.annotation.items() for target in picture.targets or ()]
    return [sorted((name, repr(value)) for name, value in each if name not in HARMLESS) for each in every]


def _unsourced(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != "sources"}


@contextmanager
def begun_or_gone(folder: Path) -> Iterator[None]:
    """Where the body fails before a cell is finished or a picture is skipped, the folder is left as it was.

    Only files of runs are removed: others may have come to the folder meanwhile.
    """
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    files = [RUN_FILE + ending for ending in ("", "-wal", "-shm", "-journal")]
    new = [folder / name for name in (*files, *RUN_PICTURES, "coco") if not (folder / name).exists()]
    try:
        yield
    except BaseException:
        if folder / RUN_FILE in new and not _has_begun(folder):
            for each in new:
                shutil.rmtree(each, ignore_errors=True)  # leaves a file and a link
                with suppress(OSError):
                    each.unlink()
            with suppress(OSError):  # missing, or not empty
                for each in made:
                    each.rmdir()
        raise


def _has_begun(folder: Path) -> bool:
    try:
        with Store(folder) as store:
            return queries.has_begun(store)
    except StoreError:  # no file, or another process has it
        return (folder / RUN_FILE).is_file()
