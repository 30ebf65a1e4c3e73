"""Made-up runs of any size, and what their page costs: ``python tests/helpers/made_up_run.py FOLDER CELLS``.

Answers come from a formula where a model's would take days.

Domain: 640 x 480 px pictures of one to three stop signs, 400 conditions (10 exposures, 8 lights, 5 speeds) and the
untouched picture, ten detections in each cell. Confidence falls with blur and with the noise of little light. Up to
250 pictures differ: what is more are these again under other names. What is measured is the store and the report,
which ask nothing of where the answers are from.
"""

from __future__ import annotations

import json
import math
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from blurnoise_eval.datasets.records import Picture, PictureSet, Target, UnreadablePicture, size_group
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.grid.axes import NAMES
from blurnoise_eval.grid.conditions import Cell, SweepPlan, cell_seed
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.store.store import CellResult, PictureFacts, Store
from blurnoise_eval.sweep.run_folder import open_run
from blurnoise_eval.system.files import RUN_FILE

from blurnoise.optics.camera import Camera

_SIZE_PX = (640, 480)
_DETECTIONS = 10  # in each cell
_BLOCK = 8  # cells that are stored at a time
_DIFFERENT = 250  # pictures; more are copies
GRID = {
    "exposure_s": (0.001, 0.002, 0.003, 0.005, 0.008, 0.013, 0.02, 0.03, 0.05, 0.09),
    "illuminance_lux": (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0),
    "velocity_x_px_s": (0.0, 100.0, 200.0, 500.0, 1000.0),
}
CELLS_PER_PICTURE = 1 + math.prod(map(len, GRID.values()))


def made_up_run(folder: Path, cells: int, detector: Detector, seed: int = 0) -> float:
    """Write a run of at least so many cells, whole pictures, into ``folder``; returns the store's seconds a cell."""
    camera = Camera.preset("imx250")
    pictures = made_up_pictures(-(-cells // CELLS_PER_PICTURE), detector.contract.classes[0], seed)
    different = pictures.pictures[:_DIFFERENT]
    plan = SweepPlan(GRID, seed=seed, examples=False)
    seconds = 0.0
    with Store(folder, create=True) as store:
        open_run(store, [detector], camera, pictures, plan, {"command": "made up", "threads": 1})
        for place, picture in enumerate(different):
            store.note_picture(picture.name, PictureFacts(picture.identity, picture.name, *_SIZE_PX, ""))
            results = list(_results(picture, plan, detector.name, camera, (seed, place)))
            begun = time.process_time()
            for first in range(0, len(results), _BLOCK):
                store.add(results[first : first + _BLOCK])
            seconds += time.process_time() - begun
    for copy in range(1, -(-len(pictures) // _DIFFERENT)):
        last = pictures.pictures[: len(pictures) - copy * _DIFFERENT][-1].name
        copy_pictures(folder, _other(copy * _DIFFERENT, copy), last, _name(_DIFFERENT))
    return seconds / len(different) / CELLS_PER_PICTURE


def copy_pictures(run: Path, other: Mapping[str, str], last: str, before: str) -> None:
    """Add the rows of a run's pictures up to ``last``, and before ``before``, again.

    other: by column the expression, of a row's columns, that stands in the copy.
    """
    with closing(sqlite3.connect(run / RUN_FILE)) as db, db:
        for table in ("cells", "targets", "pictures"):
            names = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
            columns = ", ".join(f'"{name}"' for name in names)
            values = ", ".join(other.get(name, f'"{name}"') for name in names)
            db.execute(
                f"INSERT INTO {table} ({columns}) SELECT {values} FROM {table} WHERE image <= ? AND image < ?",
                (last, before),
            )


def _other(further: int, copy: int) -> dict[str, str]:
    """What a copy's columns hold instead: the names that are so many further, ids of their own."""
    return {
        "image": f"printf('%07d.png', CAST(substr(image, 1, 7) AS INTEGER) + {further})",
        "cell_id": f"cell_id || '-{copy}'",
    }


def made_up_pictures(count: int, label: str, seed: int = 0) -> PictureSet:
    """So many pictures that cannot be read, of one to three targets of ``label``."""
    generator = np.random.default_rng(seed)

    def target() -> Target:
        side = float(np.exp(generator.uniform(math.log(16), math.log(160))))
        x, y = (float(generator.uniform(0, length - side)) for length in _SIZE_PX)
        return Target(label, size_group(side, side, "objects"), (x, y, x + side, y + side))

    different = [
        tuple(target() for _ in range(generator.integers(1, 4))) for _ in range(min(count, _DIFFERENT))
    ]
    every = [
        Picture(_name(place), different[place % _DIFFERENT], _unreadable, "made up", place + 1)
        for place in range(count)
    ]
    return PictureSet("coco", "made up", tuple(every))


def _name(place: int) -> str:
    return f"{place:07}.png"


def _unreadable() -> Any:
    raise UnreadablePicture("made up: has no pixels")


def _results(
    picture: Picture, plan: SweepPlan, model: str, camera: Camera, seed: tuple[int, int]
) -> Iterator[CellResult]:
    """A picture's cells before one model."""
    generator = np.random.default_rng(seed)
    targets = picture.targets or ()
    boxes = np.array([target.box_xyxy for target in targets], np.float32)
    sides = (boxes[:, 2] - boxes[:, 0]).astype(float)
    ease = generator.normal(1.0, 0.5, len(targets))
    for at in [None, *plan.conditions()]:
        light = 1e3 if at is None else at.exposure_s * at.illuminance_lux
        blur = 0.0 if at is None else at.blur_px
        logit = ease + 2.5 - 2.0 / (0.1 + light) ** 0.5 - 3.0 * blur / sides
        confidence = 1 / (1 + np.exp(-logit - generator.normal(0, 0.3, len(targets))))
        found = np.zeros((_DETECTIONS, 6))
        found[: len(targets), :4] = boxes + generator.normal(0, 0.03, boxes.shape) * sides[:, None]
        found[: len(targets), 4] = confidence
        rest = _DETECTIONS - len(targets)
        corners = generator.uniform(0, 400, (rest, 2))
        found[len(targets) :, :4] = np.concatenate(
            [corners, corners + generator.uniform(16, 80, (rest, 2))], 1
        )
        found[len(targets) :, 4] = 0.001 + 0.5 * generator.random(rest) ** 4
        found = found[np.argsort(-found[:, 4], kind="stable")]
        boxes32, scores = found[:, :4].astype(np.float32), found[:, 4].astype(np.float32)
        detections = Detections(boxes32, scores, found[:, 5].astype(np.int64))
        cell = Cell(picture.name, 0, at, cell_seed(plan.seed, picture.name, 0))
        shared: dict[str, Any] = {
            "cell_id": cell.cell_id,
            "model": model,
            "camera": camera.name,
            "image": picture.name,
            "repeat": 0,
            "clean": at is None,
            **(dict.fromkeys(NAMES) if at is None else at.on(camera)),
            "blur_px": None if at is None else blur,
        }
        untouched = None if at is None else 0.0
        own = {
            "seed": cell.seed,
            "n_targets": len(targets),
            "target_confidence": float(confidence.mean()),
            "detection_rate": float((confidence >= FOUND_SCORE).mean()),
            "n_detections": len(detections),
            "saturated": 0.01 * light / (1 + light),
            "applied_exposure_s": None if at is None else at.exposure_s,
            "applied_gain_db": untouched,
            "snr_db": None if at is None else 10 * math.log10(1 + 100 * light),
            "brightness": light / (1 + light),
            "invented_share": untouched,
            "simulate_ms": 4.0 + float(generator.random()),
            "infer_ms": 10.0 + float(generator.random()),
            "error": None,
            "example": None,
        }
        rows = tuple(
            {
                **shared,
                "target_id": number,
                "group": target.group,
                "label": target.label,
                **dict(zip(("x0", "y0", "x1", "y1"), target.box_xyxy, strict=True)),
                "width_px": target.box_xyxy[2] - target.box_xyxy[0],
                "height_px": target.box_xyxy[3] - target.box_xyxy[1],
                "confidence": value,
                "confidence_swept": value,
                "invented_share": untouched,
            }
            for number, (target, value) in enumerate(zip(targets, confidence.tolist(), strict=True))
        )
        yield CellResult({**shared, **own}, rows, detections)


_REPORT = """
import json, resource, sys, time
begun = time.perf_counter()
from blurnoise_eval.evaluation import Evaluation
Evaluation(sys.argv[1]).report()
wall_s = time.perf_counter() - begun
used = [resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print(json.dumps({"wall_s": wall_s, "cpu_s": sum(each.ru_utime + each.ru_stime for each in used)}))
"""


def main(folder: Path, cells: int) -> dict[str, float]:
    """Make a run, then its page and tables in a process of their own: seconds by the clock and of a core."""
    from blurnoise_models.detector import STOP_SIGN

    store_s = made_up_run(folder, cells, Detector(STOP_SIGN))
    report = subprocess.run(
        [sys.executable, "-c", _REPORT, str(folder)], check=True, stdout=subprocess.PIPE, text=True
    )
    size = (folder / RUN_FILE).stat().st_size
    return {
        "store_ms": 1e3 * store_s,
        "store_bytes": size / cells,
        **json.loads(report.stdout.splitlines()[-1]),
    }


if __name__ == "__main__":
    print(main(Path(sys.argv[1]), int(sys.argv[2])))
