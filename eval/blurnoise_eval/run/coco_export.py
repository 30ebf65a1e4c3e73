"""A run's truth and detections as COCO's files, for pycocotools and anything else that reads them."""

from __future__ import annotations

import glob
import json
from collections.abc import Callable, Mapping
from itertools import chain, count
from pathlib import Path
from typing import Any

from blurnoise._core.checks import shown
from blurnoise._core.files import json_of, read_bytes
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.run.documents import validated
from blurnoise_eval.run.setup import Setup
from blurnoise_eval.scoring.evaluated import Truth, coco_results
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.system.files import path_within, write_whole

INSTANCES = Path("coco") / "instances.json"


def write_truth(pictures: PictureSet, run: Path) -> None:
    """Write the labels to ``run``/coco/instances.json; without labels it lists the pictures only.

    Ids, areas, segmentations and crowds are those of the data set where it has them. A part has the ids of the whole,
    so that parts can be joined. Raises ``OSError``.
    """
    names = {picture.name for picture in pictures}
    every = [(picture, target) for picture in pictures.every for target in picture.targets or ()]
    used = {target.annotation.get("id") for _, target in every}
    fresh = (number for number in count(1) if number not in used)
    annotations: list[dict[str, Any]] = []
    for picture, target in every:
        x0, y0, x1, y1 = target.box_xyxy
        area = (x1 - x0) * (y1 - y0) if target.area_px2 is None else target.area_px2
        new = {"id": next(fresh)} if "id" not in target.annotation else {}
        where = {"image_id": picture.image_id, "category_id": pictures.categories[target.label]}
        box = {"bbox": [x0, y0, x1 - x0, y1 - y0], "area": area, "iscrowd": int(target.crowd)}
        if picture.name in names:
            annotations.append({**target.annotation, **new, **where, **box})
    images = [{"id": picture.image_id, "file_name": picture.name} for picture in pictures]
    categories = [{"id": number, "name": name} for name, number in pictures.categories.items()]
    write_instances(run, {"images": images, "annotations": annotations, "categories": categories})


def write_instances(run: Path, truth: Mapping[str, Any]) -> None:
    """Write ``run``/coco/instances.json. Raises ``OSError``."""
    file = path_within(run, INSTANCES)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, json.dumps(truth).encode("utf-8", "backslashreplace"))


def read_truth(store: Store) -> dict[str, Any]:
    """The labels of a run, see :func:`write_truth`. Raises :class:`StoreError` where they are missing or broken."""
    try:
        truth: dict[str, Any] = validated(
            "truth", json_of(read_bytes(path_within(store.folder, INSTANCES)).decode())
        )
        names = {image["file_name"] for image in truth["images"]}
        categories = {category["id"] for category in truth["categories"]}
        if missing := sorted(store.pictures().keys() - names):
            raise ValueError(f"images: {missing[0]!r}, a picture of the run, is missing")
        if unknown := [box for box in truth["annotations"] if box["category_id"] not in categories]:
            raise ValueError(f"category_id = {shown(unknown[0]['category_id'])}: must be in categories")
        return truth
    except (OSError, ValueError) as error:
        raise StoreError(
            f"{store.folder / INSTANCES}: cannot be read ({error}); repeat the sweep's command to restore it"
        ) from None


def truths(store: Store, setup: Setup) -> Callable[[str], Truth | None]:
    """The truth of a model, by its name: the labels, or else its own detections in the original pictures.

    None for a reader of text. Raises :class:`StoreError` where the run's instances.json is missing or broken.
    """
    coco = read_truth(store)
    image_ids = {entry["file_name"]: entry["id"] for entry in coco["images"]}
    sizes_px = {image_ids[name]: (each.width_px, each.height_px) for name, each in store.pictures().items()}

    def truth_of(name: str) -> Truth | None:
        if setup.models[name]["kind"] != "detector":
            return None
        classes = setup.classes(name)
        if setup.labelled:
            categories = {category["name"]: category["id"] for category in coco["categories"]}
            known = {index: categories[label] for index, label in enumerate(classes) if label in categories}
            return Truth(coco, image_ids, known, sizes_px)
        ids = {label: number for number, label in enumerate(classes, start=1)}
        annotations = []
        for number, row in enumerate(queries.targets_when_clean(store, name), start=1):
            target = row.target
            box = [target.x0, target.y0, target.width_px, target.height_px]
            if target.label not in ids:
                raise store.damaged("targets.label", f"{target.label!r} is no class of {name!r}")
            facts = {"id": number, "image_id": image_ids[row.image], "category_id": ids[target.label]}
            annotations.append({**facts, "bbox": box, "area": box[2] * box[3], "iscrowd": 0})
        names = [{"id": number, "name": label} for label, number in ids.items()]
        detections = {"annotations": annotations, "categories": names}
        return Truth(detections, image_ids, {index: index + 1 for index in range(len(classes))}, sizes_px)

    return truth_of


def detection_files(setup: Setup) -> list[str]:
    """The names of the files that :func:`write_detections` may write, as patterns."""
    return [glob.escape(f"{name}{end}.json") for name in setup.models for end in ("", "-instances")]


def write_detections(store: Store, setup: Setup, folder: Path) -> list[Path]:
    """Write MODEL.json for each detector into ``folder``; returns the paths.

    MODEL.json has the detections as COCO has results, each with the ``cell_id`` by which results.csv has its
    condition. MODEL-instances.json has the truth at rest; targets.csv has the boxes where motion takes them. Raises
    ``OSError``.
    """
    written, truth_of, labels = [], truths(store, setup), read_truth(store)
    folder.mkdir(parents=True, exist_ok=True)
    for model in setup.models:
        if (truth := truth_of(model)) is None:
            continue
        rows = (
            json.dumps({**row, "cell_id": cell_id})
            for cell_id, image, detections in queries.detections_of(store, model)
            for row in coco_results(detections, truth.image_ids[image], truth.category_of)
        )
        lines = (f"{',' if number else '['}\n{row}" for number, row in enumerate(rows))
        written.append(path_within(folder, f"{model}.json"))
        write_whole(written[-1], (text.encode() for text in chain(lines, ["\n]"])))
        whole = {**labels, **truth.coco, "images": labels["images"]}
        write_whole(path_within(folder, f"{model}-{INSTANCES.name}"), json.dumps(whole).encode("utf-8"))
    return written
