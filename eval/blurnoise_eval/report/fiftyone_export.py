"""A run as a FiftyOne data set, in the format that FiftyOne exports and imports itself (FiftyOneDataset).

A sample is one picture under one condition, with the simulated picture as its file: boxes lie on what the model saw,
conditions are sliders, and ``group_by("picture", order_by="exposure_s")`` puts the exposures of a picture in a row.
Domain: boxes relative to the picture, (left, top, width, height), as FiftyOne has them.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from blurnoise_eval.datasets import encode
from blurnoise_eval.plan.axes import CHOICES, EXPOSURE, VELOCITY, setting_of
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report.failures import Pictures
from blurnoise_eval.report.run import RunData
from blurnoise_eval.store import queries
from blurnoise_eval.store.columns import AxisValues
from blurnoise_eval.store.rows import CellRow, TargetAnswer
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import check_own_folder, path_within, write_whole

MOST_SAMPLES, MOST_PX = 2000, 1_000_000_000
"""Samples of a data set, and pixels of all its pictures, which are PNG files of about 2 GB then."""
LEAST_SCORE = 0.05
"""Of predictions."""
_VERSION = "1.0.0"  # of FiftyOne; later releases migrate the format
_FIELDS = "fiftyone.core.fields."
_MEASURES = ("blur_px", "applied_gain_db", "snr_db")
Row = dict[str, Any]


def write_fiftyone(
    store: Store,
    data: RunData,
    run: Pictures,
    folder: Path,
    progress: Callable[[int], None] = lambda pictures: None,
) -> str:
    """Write metadata.json, samples.json and data/ into ``folder``; returns what they hold, in words.

    Samples are of the first repeat. Of a run beyond the limits above every light and speed keeps the recommended
    exposure and others, evenly spread; then pictures are left out. progress: is called for each picture. Raises
    ``ValueError`` where no picture of the run can be opened, and ``OSError``.
    """
    names, slugs, (n_pictures, n_exposures) = sorted(store.pictures()), _slugs(data), _limits(store, data)
    check_own_folder(folder)
    path_within(folder, "data").mkdir(parents=True, exist_ok=True)
    wrong, counts = list[str](), dict[str, int]()

    def parts() -> Iterator[bytes]:
        yield b'{"samples": ['
        for name in spread(names, n_pictures):
            try:
                for sample in _samples(store, data, run, name, slugs, n_exposures):
                    encoded = encode(sample.pop("image"))
                    sample["metadata"]["size_bytes"] = len(encoded)
                    write_whole(folder / sample["filepath"], encoded)
                    yield f"{',' if counts else ''}\n{json.dumps(sample, allow_nan=False)}".encode()
                    counts[name] = counts.get(name, 0) + 1
            except ValueError as error:
                wrong.append(str(error))
            progress(1)
        if wrong and not counts:
            raise ValueError(wrong[0])
        yield b"\n]}\n"

    try:
        write_whole(folder / "samples.json", parts())
    except ValueError:
        with suppress(OSError):  # not empty
            (folder / "data").rmdir()
            folder.rmdir()
        raise
    document = {"version": _VERSION, "media_type": "image", "sample_fields": _fields(data, slugs)}
    write_whole(folder / "metadata.json", json.dumps(document, indent=1).encode())
    text = f"{sum(counts.values())} samples of {len(counts)} of {len(names)} pictures"
    cells = queries.counts(store)["n_cells"]
    text += f" ({cells} cells in the run)" if sum(counts.values()) < cells else ""
    return f"{text}; {len(wrong)} pictures failed (first: {wrong[0]})" if wrong else text


def _limits(store: Store, data: RunData) -> tuple[int, int]:
    """How many pictures, and exposures of each under each light and speed."""
    sizes = [each.width_px * each.height_px for each in store.pictures().values()]
    samples = min(MOST_SAMPLES, MOST_PX * len(sizes) // max(1, sum(sizes)))
    lines: dict[Any, int] = defaultdict(int)
    for at, _ in queries.exposed_conditions(store):
        lines[_line(at)] += 1
    fit = (samples // max(1, len(sizes)) - 1) // max(1, len(lines))
    exposures = min(max(2, fit), max(lines.values(), default=1))
    return max(1, samples // (1 + exposures * len(lines))), exposures


def _line(at: AxisValues) -> Any:
    return setting_of(at), at.velocity_px_s


def _slugs(data: RunData) -> dict[str, str]:
    """A name for each model that a field may have."""
    plain = [re.sub(r"\W", "_", name, flags=re.ASCII) for name in data.model_names]
    names = [slug if plain.count(slug) == 1 else f"{slug}_{place}" for place, slug in enumerate(plain)]
    return dict(zip(data.model_names, names, strict=True))


def _truth_field(data: RunData, slug: str) -> str:
    """Without labels each model has targets of its own."""
    return "ground_truth" if data.manifest["images"]["labelled"] else f"ground_truth_{slug}"


def _columns(data: RunData) -> list[str]:
    return [EXPOSURE.name, *VELOCITY, *(axis.name for axis in data.settings.axes)]


def _samples(
    store: Store, data: RunData, run: Pictures, name: str, slugs: Mapping[str, str], n_exposures: int
) -> Iterator[Row]:
    """A picture's samples, the original first, with its pixels as ``image``."""
    cells: dict[str, list[CellRow]] = defaultdict(list)  # of each model
    targets: dict[tuple[str, str], list[TargetAnswer]] = {}
    for row in queries.cells_with(store, image=name, repeat=0):
        of = row.cell_id, row.model
        targets[of] = [each.target for each in queries.targets_of(store, *of)]
        cells[row.cell_id].append(row)
    found_at: dict[Any, list[float]] = defaultdict(list)
    for row in (row for rows in cells.values() for row in rows if not row.conditions.original):
        for target in targets[row.cell_id, row.model]:
            if target.confidence >= data.found_from:
                key = row.model, _line(row.conditions), target.target_id
                found_at[key].append(row.applied_exposure_s or 0.0)
    for cell_id, tag in _chosen(data, [rows[0] for rows in cells.values()], n_exposures):
        first = cells[cell_id][0]
        image = run.simulate(cell_id)
        height, width = image.shape[:2]
        number = _number(cell_id)
        sample: Row = {
            "_id": {"$oid": number},
            "filepath": f"data/{cell_id}.png",
            "tags": [tag],
            "image": image,
        }
        sample |= {"_media_type": "image", "_rand": int(number[:13], 16) / 16**13}
        size = {"width": width, "height": height, "num_channels": 3}
        sample["metadata"] = {"_cls": "ImageMetadata", "mime_type": "image/png", **size}
        values = {**first.columns(), EXPOSURE.name: first.applied_exposure_s}
        sample |= {"picture": name, "cell_id": cell_id}
        sample |= {column: _finite(values[column]) for column in (*_columns(data), *_MEASURES)}
        truth: dict[str, dict[int, Row]] = defaultdict(dict)
        for row in cells[cell_id]:
            slug, found = slugs[row.model], truth[_truth_field(data, slugs[row.model])]
            line = None if row.conditions.original else _line(row.conditions)
            for target in targets[cell_id, row.model]:
                at = sorted(found_at[row.model, line, target.target_id])
                new = found.setdefault(target.target_id, _truth(cell_id, target, slug, (width, height)))
                new[f"confidence_{slug}"] = target.confidence
                new[f"found_{slug}"] = target.confidence >= data.found_from
                new[f"found_from_s_{slug}"], new[f"found_to_s_{slug}"] = (
                    (at[0], at[-1]) if at else (None, None)
                )
            sample[f"predictions_{slug}"] = _detections(_predictions(store, row, data, (width, height)))
        yield sample | {name: _detections(found.values()) for name, found in truth.items()}


def _chosen(data: RunData, rows: Sequence[CellRow], n_exposures: int) -> Iterator[tuple[str, str]]:
    """The ids of a picture's cells that become samples, each with its tag, the original first."""
    lines: dict[Any, list[CellRow]] = defaultdict(list)
    for row in sorted(rows, key=_exposure_s):
        if row.conditions.original:
            yield row.cell_id, "original"
        else:
            lines[_line(row.conditions)].append(row)
    wanted = [row.exposure_s for row in data.recommendations if row.scope == "all" and row.exposure_s]
    for same in lines.values():
        nearest = {
            min(same, key=lambda row: abs(math.log(_exposure_s(row) / exposure_s))).cell_id
            for exposure_s in wanted
        }
        others = [row.cell_id for row in same if row.cell_id not in nearest]
        kept = nearest.union(spread(others, n_exposures - len(nearest)) if n_exposures > len(nearest) else ())
        for row in same:
            if row.cell_id in kept:
                yield row.cell_id, "recommended" if row.cell_id in nearest else "simulated"


def _exposure_s(row: CellRow) -> float:
    return row.applied_exposure_s or 0.0


def _truth(cell_id: str, target: TargetAnswer, slug: str, size: tuple[int, int]) -> Row:
    made = _detection(f"{cell_id} {slug} {target.target_id}", target.label, target.box_xyxy, size)
    return made | {"target_id": target.target_id, "group": target.group}


def _predictions(store: Store, row: CellRow, data: RunData, size: tuple[int, int]) -> Iterator[Row]:
    contracts = {model["name"]: model["contract"] for model in data.manifest["models"]}
    leading = store.detections(row.cell_id, row.model).leading
    kept = leading[leading.scores >= LEAST_SCORE]
    found = zip(kept.boxes_xyxy.tolist(), kept.scores.tolist(), kept.class_ids.tolist(), strict=True)
    for place, (box, score, kind) in enumerate(found):
        label = contracts[row.model]["classes"][kind]
        yield _detection(f"{row.cell_id} {row.model} prediction {place}", label, box, size) | {
            "confidence": score
        }


def _number(key: str) -> str:
    """An id of MongoDB's kind, the same for the same run."""
    return hashlib.blake2b(key.encode("utf-8", "backslashreplace"), digest_size=12).hexdigest()


def _detection(key: str, label: str, box_xyxy: Sequence[float], size: tuple[int, int]) -> Row:
    (x0, y0, x1, y1), (width, height) = box_xyxy, size
    box = [x0 / width, y0 / height, (x1 - x0) / width, (y1 - y0) / height]
    made: Row = {"_id": {"$oid": _number(key)}, "_cls": "Detection", "attributes": {}, "tags": []}
    return made | {"label": label, "bounding_box": box}


def _detections(rows: Iterable[Row]) -> Row:
    return {"_cls": "Detections", "detections": list(rows)}


def _finite(value: Any) -> Any:
    """What the camera sets itself has no number."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _fields(data: RunData, slugs: Mapping[str, str]) -> list[Row]:
    """The fields of samples, as FiftyOne declares them."""
    size = [_field(name, "Int") for name in ("size_bytes", "width", "height", "num_channels")]
    fields = [_field("id", "ObjectId", db_field="_id"), _field("_dataset_id", "ObjectId")]
    fields += [_field("filepath", "String"), _field("tags", "List", subfield="String")]
    fields += [_document("metadata", "metadata.ImageMetadata", [*size, _field("mime_type", "String")])]
    fields += [_field("_media_type", "String"), _field("_rand", "Float")]
    fields += [_field(name, "DateTime") | {"read_only": True} for name in ("created_at", "last_modified_at")]
    fields += [_field(name, "String") for name in ("picture", "cell_id")]
    fields += [
        _field(name, "String" if name in CHOICES else "Float") for name in (*_columns(data), *_MEASURES)
    ]
    truth = {
        _truth_field(data, slug): [_field("target_id", "Int"), _field("group", "String")]
        for slug in slugs.values()
    }
    for slug in slugs.values():
        own = [_field(f"{name}_{slug}", "Float") for name in ("confidence", "found_from_s", "found_to_s")]
        truth[_truth_field(data, slug)] += [_field(f"found_{slug}", "Boolean"), *own]
    fields += [_labels(name, own) for name, own in truth.items()]
    return fields + [_labels(f"predictions_{slug}", []) for slug in slugs.values()]


def _field(name: str, kind: str, *, db_field: str | None = None, subfield: str | None = None) -> Row:
    made: Row = {"name": name, "ftype": f"{_FIELDS}{kind}Field", "embedded_doc_type": None, "fields": []}
    made |= {"subfield": subfield and f"{_FIELDS}{subfield}Field", "db_field": db_field or name}
    return made | {"description": None, "info": None, "read_only": False}


def _document(
    name: str, of: str, fields: Sequence[Row], kind: str = "EmbeddedDocument", subfield: str | None = None
) -> Row:
    return _field(name, kind, subfield=subfield) | {
        "embedded_doc_type": f"fiftyone.core.{of}",
        "fields": list(fields),
    }


def _labels(name: str, further: Sequence[Row]) -> Row:
    own = [_field("id", "ObjectId", db_field="_id"), _field("tags", "List", subfield="String")]
    own += [
        _field("label", "String"),
        _field("bounding_box", "List", subfield="Float"),
        _field("confidence", "Float"),
    ]
    listed = _document(
        "detections", "labels.Detection", [*own, *further], "List", subfield="EmbeddedDocument"
    )
    return _document(name, "labels.Detections", [listed])
