"""Merging: runs of parts joined to one run, every cell once.

Runs can be joined that differ in pictures, repeats or conditions alone: the same models by content, camera, seed,
and what else their plans say. Cells are told apart by id and model, so that what several runs hold counts once. The
run of all parts of a sweep (``--part``) is that sweep's: the same command goes on with it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from blurnoise_eval.store import queries
from blurnoise_eval.store.checked import check_rows
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.asked import Batch, ask, asked
from blurnoise_eval.sweep.coco_export import INSTANCES
from blurnoise_eval.sweep.run_folder import computed_by, other_software
from blurnoise_eval.system.files import read_within, write_whole, written_whole

_ALIKE = ("model", "camera")
_SETS = ("pictures", "choice of targets", "annotations")  # digests, in parts those of the whole
_NUMBERS = ("id", "image_id", "category_id")  # of an annotation, given anew
_PLAN = ("grid", "repeats")  # what of plans may differ


class Merged(NamedTuple):
    """What a merge has joined: rows of cells, one per cell and model, pictures, and rows that several runs held."""

    cells: int
    pictures: int
    repeated: int


def merge(
    runs: Sequence[Path],
    output: Path,
    command: str | None = None,
    progress: Callable[[int], None] = lambda runs: None,
) -> Merged:
    """Join ``runs`` in ``output``, a new folder, which appears whole or not at all. command: what its
    page gives as its origin; ``progress`` is told of each run.

    Raises :class:`StoreError` that names what differs, for runs of other models, cameras or plans, of pictures or
    targets that are not the same under one name, for a search's run, and where ``output`` holds anything.
    """
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise StoreError(f"output = {str(output)!r}: is not empty; choose another folder")
    with ExitStack() as opened:
        different = {run.resolve(): run for run in runs}  # one that is named twice counts once
        stores = [opened.enter_context(Store(run)) for run in different.values()]
        for store in stores:
            check_rows(store)
        identity = _identity(stores)
        truth = _truth(stores)
        _check_pictures(stores)
        told = command or " ".join(["blurnoise merge", *map(str, runs), "-o", str(output)])
        try:
            with written_whole(output, over=False) as unfinished:
                return _written(stores, identity, truth, unfinished, told, progress)
        except OSError as error:
            raise StoreError(f"output = {str(output)!r}: cannot be written ({error.strerror})") from None


def _written(
    stores: Sequence[Store],
    identity: dict[str, Any],
    truth: dict[str, Any],
    folder: Path,
    command: str,
    progress: Callable[[int], None],
) -> Merged:
    rows = 0
    (folder / INSTANCES).parent.mkdir(parents=True)
    write_whole(folder / INSTANCES, json.dumps(truth).encode("utf-8", "backslashreplace"))
    with Store(folder, create=True) as joined:
        for store in stores:
            joined.take(store)
            progress(1)
            rows += queries.count_rows(store)
            for name in queries.example_files(store):
                file = joined.file(name)
                if store.file(name).is_file() and not file.exists():
                    file.parent.mkdir(parents=True, exist_ok=True)
                    write_whole(file, store.file(name).read_bytes())
        joined.set_about("identity", identity)
        joined.set_about("manifest", _manifest(stores, len(truth["images"]), command))
        joined.set_about("learnt", _learnt(stores))
        if refined := {at: None for store in stores for batch in asked(store) for at in batch.conditions}:
            ask(joined, Batch(len(truth["images"]), (), tuple(refined)))
        cells = queries.count_rows(joined)
        return Merged(cells, len(queries.pictures_seen(joined)), rows - cells)


def _identity(stores: Sequence[Store]) -> dict[str, Any]:
    """What the joined run is. Raises ``StoreError`` where runs differ in what they must share."""
    each = [store.about("identity") for store in stores]
    first, named = stores[0], str(stores[0].folder)
    for store, identity in zip(stores, each, strict=True):
        run = f"run = {str(store.folder)!r}"
        if identity is None:
            raise StoreError(f"{run}: no sweep has begun here")
        if "grid" not in identity["plan"]:
            raise StoreError(
                f"{run}: is a search's, whose conditions are one whole; only sweeps can be merged"
            )
        differing = [name for name in _ALIKE if identity[name] != each[0][name]]
        plans = [{**dict.fromkeys(_PLAN), **held["plan"]} for held in (identity, each[0])]
        keys = {name for plan in plans for name in plan} - set(_PLAN)
        differing += sorted(name for name in keys if plans[0].get(name) != plans[1].get(name))
        one, other = (held.about("manifest")["images"] for held in (first, store))
        differing += ["kind of pictures"] * any(one[name] != other[name] for name in ("kind", "labelled"))
        if (before := one.get("chosen", "")) != (now := other.get("chosen", "")):
            differing.append(f"choice of targets ({before or 'all'} there, {now or 'all'} here)")
        if software := other_software(computed_by(first), computed_by(store)):
            differing.append(software)
        whole = next((of for of in each if _count(of) == _count(identity)), identity)
        if _count(identity) is not None:  # of parts of one whole
            differing += [name for name in _SETS if identity.get(name) != whole.get(name)]
        if differing:
            raise StoreError(
                f"{run}: differs from {named!r} in {' and '.join(differing)}; it cannot be merged"
            )
    plan = {**each[0]["plan"], "repeats": max(identity["plan"]["repeats"] for identity in each)}
    grids = [identity["plan"]["grid"] for identity in each]
    if any(list(grid) != list(grids[0]) for grid in grids):
        axes = sorted({name for grid in grids for name in grid if any(name not in other for other in grids)})
        raise StoreError(
            f"runs: {', '.join(axes) or 'axes'} stated by some of them and not by others; they cannot be merged"
        )
    plan["grid"] = {name: sorted({value for grid in grids for value in grid[name]}) for name in grids[0]}
    joined = {**each[0], "plan": plan}
    joined.pop("part", None)
    for name in _SETS:
        if found := {identity[name] for identity in each if name in identity}:
            joined[name] = "+".join(sorted(found))
    parts = [identity.get("part", "1/1") for identity in each]
    counts = {part.split("/")[1] for part in parts}
    numbers = sorted({int(number) for part in parts for number in part.split("/")[0].split(",")})
    if counts == {counts_of := next(iter(counts))} and len(numbers) < int(counts_of):
        joined["part"] = f"{','.join(map(str, numbers))}/{counts_of}"
    elif len(counts) > 1:
        joined["part"] = " and ".join(sorted(set(parts)))
    return joined


def _count(identity: Mapping[str, Any]) -> str | None:
    """Of how many parts a run is one, or several; None for one that is no part."""
    return identity["part"].rpartition("/")[2] if "part" in identity else None


def _truth(stores: Sequence[Store]) -> dict[str, Any]:
    """What is in the pictures of all runs. A number that two pictures or boxes share is given anew to the later."""
    images: dict[str, dict[str, Any]] = {}
    told: dict[str, list[tuple[Any, ...]]] = {}
    categories: dict[str, int] = {}
    annotations: list[dict[str, Any]] = []
    used = {"image": set[Any](), "annotation": set[Any](), "category": set[Any]()}

    def number(kind: str, wanted: Any) -> Any:
        free = wanted if wanted not in used[kind] else next(n for n in count(1) if n not in used[kind])
        used[kind].add(free)
        return free

    for store in stores:
        path = store.folder / INSTANCES
        try:
            held = json.loads(read_within(store.folder, INSTANCES))
        except (OSError, ValueError) as error:
            raise StoreError(
                f"{path}: cannot be read ({error}); repeat the sweep's command to restore it"
            ) from None
        names = {each["id"]: each["name"] for each in held["categories"]}
        for own, name in names.items():
            if name not in categories:
                categories[name] = number("category", own)
        inside: dict[Any, list[dict[str, Any]]] = {}
        for each in held["annotations"]:
            inside.setdefault(each["image_id"], []).append(each)
        for image in held["images"]:
            name = image["file_name"]
            boxes = inside.get(image["id"], [])
            seen = [
                (names[box["category_id"]], {key: box[key] for key in box if key not in _NUMBERS})
                for box in boxes
            ]
            if name in images:
                if told[name] != seen:
                    raise StoreError(
                        f"run = {str(store.folder)!r}: picture {name!r} has other targets than in a run before; "
                        "they cannot be merged"
                    )
                continue
            told[name] = seen
            images[name] = {**image, "id": number("image", image["id"])}
            for box in boxes:
                stated = {"id": number("annotation", box["id"]), "image_id": images[name]["id"]}
                annotations.append({**box, **stated, "category_id": categories[names[box["category_id"]]]})
    return {
        "images": sorted(images.values(), key=lambda image: image["id"]),
        "annotations": annotations,
        "categories": [{"id": number, "name": name} for name, number in categories.items()],
    }


def _check_pictures(stores: Sequence[Store]) -> None:
    seen: dict[str, tuple[str, Path]] = {}
    for store in stores:
        for name, (_, content) in store.pictures().items():
            before, folder = seen.setdefault(name, (content, store.folder))
            if before != content:
                raise StoreError(
                    f"run = {str(store.folder)!r}: picture {name!r} is not what it is in {str(folder)!r}; "
                    "they cannot be merged"
                )


def _manifest(stores: Sequence[Store], pictures: int, command: str) -> dict[str, Any]:
    each = [store.about("manifest") for store in stores]
    sources = dict.fromkeys(manifest["images"]["source"] for manifest in each)
    notes = dict.fromkeys(note for manifest in each for note in manifest["images"]["notes"])
    images = {"count": pictures, "source": ", ".join(sources), "notes": list(notes)}
    return {**each[0], "images": {**each[0]["images"], **images}, "command": command}


def _learnt(stores: Sequence[Store]) -> dict[str, Any]:
    each: list[Mapping[str, Any]] = [store.learnt() for store in stores]
    values: dict[str, int] = {}
    for learnt in each:
        for model, number in learnt["non_finite_values"].items():
            values[model] = values.get(model, 0) + number
    return {"wall_s": sum(learnt["wall_s"] for learnt in each), "non_finite_values": values}
