"""The identity of a run: what a run is noted as when it begins, and what must be the same where it goes on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any

from blurnoise._core.writing import remove_made
from blurnoise.camera import Camera
from blurnoise_eval.datasets import Picture, PictureSet, UnreadablePicture, content
from blurnoise_eval.datasets.taken import exif_text
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.coco_export import write_truth
from blurnoise_eval.run.setup import Setup
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.system.files import RUN_FILE, RUN_FILES, RUN_PICTURES, check_outputs, writing
from blurnoise_eval.system.machine import hardware, versions
from blurnoise_eval.system.urls import is_url

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
) -> None:
    """Note in the store what the run is made of. A run there that has no answer yet, of a first attempt, is replaced.

    facts: what else the report shows (command, threads). Raises :class:`StoreError` that lists the differences to
    the run in the store, and ``ValueError`` for two models of one name.
    """
    names = [model.name for model in models]
    if len(set(names)) < len(names):
        raise ValueError(f"model = {names}: must have different names; rename one, as in model.name = 'b'")
    if plan.picture_tone not in (None, "srgb") and pictures.kind == "rendered":
        raise ValueError("picture_tone: needs pictures of your own; rendered pictures are sRGB-coded")
    every, part = pictures.every, pictures.of_part
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
    if plan.cuts or plan.beams:
        identity["annotations"] = _digest(repr([_annotations(picture) for picture in every]))
    if part is not None and part.count > 1:
        identity["part"] = str(part)
    identity = json.loads(json.dumps(identity))  # lists for tuples, as the store has them
    noted, answered = store.about("identity"), queries.has_answers(store)
    if noted is not None and noted != identity and not answered:
        store.clear()
        noted = None
    earlier = None if store.about("manifest") is None else Setup.read(store)
    differing = [] if noted is None else differences(noted, identity)
    if answered and earlier is not None:
        differing += differences(earlier.manifest["versions"], versions(), "software")
    differing += [f"picture {picture.name!r}" for picture in _replaced(pictures, store)]
    if differing:
        raise StoreError(
            f"run = {str(store.folder)!r}: holds a run with another {listed(differing)}; "
            "choose another folder; a run is resumed with the same command and the same version of blurnoise"
        )
    write_truth(pictures, store.folder)
    store.set_about("identity", identity)
    before = {} if earlier is None else earlier.models
    images = {name: getattr(pictures, name) for name in ("kind", "source", "labelled", "notes", "chosen")}
    if isinstance(pictures.folder, Path) and pictures.kind != "rendered":  # not at a URL, a request for each
        files = [pictures.folder / picture.name for picture in pictures.pictures]
        images["exif"] = exif_text(files, plan.picture_tone or "srgb")
    if pictures.folder:
        images["at"] = {name: _absolute(str(getattr(pictures, name))) for name in ("source", "folder")}
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


def _absolute(path: str) -> str:
    return path if is_url(path) else str(Path(path).absolute())


def differences(there: Any, here: Any, at: str = "") -> list[str]:
    """The differences between two documents, each with its path and, where these are short, both values.

    >>> differences({"seed": 1, "camera": {"f_number": 2.0}}, {"seed": 1, "camera": {"f_number": 2.8}})
    ['camera.f_number (2.0 there, 2.8 here)']
    """
    one, other = _flat(there, at), _flat(here, at)
    both = {path: (one.get(path), other.get(path)) for path in {**one, **other}}
    texts = {path: f" ({a} there, {b} here)" for path, (a, b) in both.items() if a != b}
    return [path + text * (len(text) <= 2 * _LONGEST_SHOWN) for path, text in texts.items()]


def _flat(document: Any, at: str) -> dict[str, Any]:
    """The values of a document by their paths."""
    if not isinstance(document, Mapping | list) or not document:
        return {at: document}
    pairs = document.items() if isinstance(document, Mapping) else enumerate(document)
    parts = (_flat(value, f"{at}.{key}".lstrip(".")) for key, value in pairs)
    return {path: value for part in parts for path, value in part.items()}


def listed(differing: Sequence[str]) -> str:
    """Differences in a line.

    >>> listed(["camera", "plan.seed"])
    'camera and plan.seed'
    """
    more = len(differing) - _MOST_SHOWN
    return " and ".join([*differing[:_MOST_SHOWN], *([f"{more} more"] if more > 0 else [])])


def _replaced(pictures: PictureSet, store: Store) -> Iterator[Picture]:
    """Pictures that have changed since their cells were computed; a picture is read only if its file has changed."""
    noted = store.pictures()
    for picture in pictures:
        before = noted.get(picture.name)
        if before is None or before.identity == picture.identity:
            continue
        try:
            now = content(picture.load())
        except UnreadablePicture:
            now = ""
        if now != before.content:
            yield picture
        else:
            store.note_picture(picture.name, before._replace(identity=picture.identity))


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
    """What a data set says of targets in addition to their boxes, such as polygons that they are cut out by."""
    annotations = [target.annotation.items() for target in picture.targets or ()]
    return [sorted((name, repr(value)) for name, value in of if name not in HARMLESS) for of in annotations]


def _unsourced(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != "sources"}


@contextmanager
def begun_or_gone(
    folder: Path, models: Sequence[Model], pictures: PictureSet, *, overwrite: bool = False
) -> Iterator[None]:
    """Begin a run in the folder, or go on there.

    Where the body fails before a cell is finished or a picture is skipped, the files and folders that it has made are
    deleted: a typing error leaves no empty run behind.

    overwrite: as of :func:`~blurnoise_eval.run.evaluation.evaluate`. Raises ``OSError`` where the run or its report
    could not be written.
    """
    files = chain(
        [Path(pictures.source)], (Path(str(pictures.folder or ""), picture.name) for picture in pictures)
    )
    weights = (getattr(model, "path", None) for model in models)  # at a URL nothing of this machine
    inputs = chain((path for path in weights if isinstance(path, Path)), files)
    with writing(overwrite=overwrite, inputs=inputs) as written:
        below = [folder / name for name in (*RUN_PICTURES, "coco")]
        check_outputs(folder, *RUN_FILES, *(f"{name}/" for name in RUN_PICTURES))
        stores = [folder / f"{RUN_FILE}{suffix}" for suffix in ("", "-wal", "-shm")]
        new = [path for path in (*stores, *below, folder, *folder.parents) if not path.exists()]
        since = len(written.made)
        try:
            yield
        except BaseException:
            if stores[0] in new and not _has_begun(folder):
                remove_made(written, since)
                for path in new:
                    with suppress(OSError):  # missing, or not empty
                        path.unlink() if path in stores else path.rmdir()
            raise


def _has_begun(folder: Path) -> bool:
    try:
        with Store(folder) as store:
            return queries.has_begun(store)
    except StoreError:  # no file, or another process has it
        return (folder / RUN_FILE).is_file()
