"""How the store and the report of a run grow with its cells.

Domain: cells of three targets and twelve detections each; bytes on disk, s of CPU, bytes of memory.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
from blurnoise_models.detector import STOP_SIGN
from numpy.typing import NDArray

from blurnoise_eval import datasets
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.python_models import PythonDetector
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.coco_export import INSTANCES, write_instances
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.store.store import CellResult, Store
from blurnoise_eval.system.files import RUN_FILE, write_records
from blurnoise_eval.system.machine import hardware, versions
from blurnoise_eval.system.terminal import table_lines, width

DETECTIONS = 12
_PICTURES = 12
_AXES = {
    "exposure_s": (0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1),
    "illuminance_lux": (1.0, 10.0, 100.0, 1000.0),
    "velocity_x_px_s": (0.0, 200.0, 1000.0),
}
_COPIES, _QUICK_COPIES = (1, 10, 100, 310), (1, 4)
# Prints the CPU time of a report, and the most memory that it had; kB on Linux, bytes on macOS.
_REPORT = """
import resource, sys, warnings
warnings.simplefilter("ignore")
from blurnoise_eval import Run
Run.open(sys.argv[1], progress=False).report(sys.argv[2])
used = resource.getrusage(resource.RUSAGE_SELF)
print(used.ru_utime + used.ru_stime, used.ru_maxrss * (1 if sys.platform == "darwin" else 1024))
"""


@dataclass(frozen=True)
class Size:
    """A run's size: its cells, the store in bytes a cell, the report's CPU time and memory.

    exponent: p where the time grows with cells to the power of p from the size before.
    """

    cells: int
    bytes_per_cell: float
    report_cpu_s: float
    report_mb: float
    exponent: float | None = None


@dataclass(frozen=True)
class SizeTable:
    """A row per size, and the machine."""

    rows: list[Size]
    machine: dict[str, Any]

    def write(self, folder: Path) -> None:
        """Write scale.csv and scale.json; raises ``OSError``."""
        write_records("scale", [asdict(row) for row in self.rows], self.document(), folder)

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {"machine": self.machine, "rows": [asdict(row) for row in self.rows]}

    def table(self) -> list[str]:
        """A line per size."""
        heads = ("cells", "store, GB per million", "report, s of CPU", "MB", "exponent")
        rows = [
            (
                f"{row.cells}",
                f"{row.bytes_per_cell / 1e3:.2f}",
                f"{row.report_cpu_s:.1f}",
                f"{row.report_mb:.0f}",
                "-" if row.exponent is None else f"{row.exponent:.2f}",
            )
            for row in self.rows
        ]
        return list(table_lines(heads, rows, (True,) * 5, width()))


def copies(*, quick: bool) -> tuple[int, ...]:
    """How many times each picture is in the runs that are measured."""
    return _QUICK_COPIES if quick else _COPIES


def scale(*, quick: bool, progress: Callable[[float], object] = lambda share: None) -> SizeTable:
    """Sweep a few pictures, copy the rows, and write the report of each size in a process of its own."""
    rows: list[Size] = []
    for times in copies(quick=quick):
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            cells = made_run(run, times, pictures=2 if quick else _PICTURES)
            n_bytes = (run / RUN_FILE).stat().st_size
            cpu_s, memory = _reported(run, Path(folder) / "report")
            exponent = None
            if rows:
                exponent = math.log(cpu_s / rows[-1].report_cpu_s) / math.log(cells / rows[-1].cells)
            rows.append(Size(cells, n_bytes / cells, cpu_s, memory / 1e6, exponent))
        progress(1)
    return SizeTable(rows, {**hardware(), "versions": versions()})


def made_run(folder: Path, times: int, *, pictures: int) -> int:
    """A run of the built-in detector's best ``DETECTIONS`` answers, each picture so many times; returns its cells.

    A copy has the rows of its picture under another name and other ids.
    """
    detector = Detector(STOP_SIGN)

    def best(picture: NDArray[np.uint8]) -> tuple[Any, Any, list[str]]:
        found = detector.detect(picture)
        some = np.argsort(-found.scores, kind="stable")[:DETECTIONS]
        names = [detector.contract.classes[number] for number in found.class_ids[some]]
        return found.boxes_xyxy[some], found.scores[some], names

    model = PythonDetector(best, detector.contract.classes, name="stop_sign", together=True)
    signs, plan = datasets.rendered_signs(count=pictures), SweepPlan(_AXES, examples=False)
    evaluate(model, signs, plan=plan, output=folder, strategy="grid", progress=False)
    with Store(folder) as store:
        facts, every = store.pictures(), list(_results(store))
    with Store(folder, create=True) as store:
        for copy in range(1, times):
            store.add([_copied(result, copy) for result in every])
            for name, each in facts.items():
                store.note_picture(_name(name, copy), each)
    truth = json.loads((folder / INSTANCES).read_text())
    write_instances(folder, _truth_of_copies(truth, times))
    return times * len(every)


def _results(store: Store) -> Iterator[CellResult]:
    targets: dict[str, list[Any]] = {}
    for row in store.targets():
        targets.setdefault(row.cell_id, []).append(row)
    for cell in store.cells():
        of_cell = tuple(targets.get(cell.cell_id, ()))
        yield CellResult(cell, of_cell, store.detections(cell.cell_id, cell.model), 0)


def _copied(result: CellResult, copy: int) -> CellResult:
    cell_id = blake2b(f"{result.cell.cell_id} {copy}".encode(), digest_size=10).hexdigest()
    new: dict[str, Any] = {"cell_id": cell_id, "image": _name(result.cell.image, copy)}
    targets = tuple(replace(row, **new) for row in result.targets)
    return replace(result, cell=replace(result.cell, **new), targets=targets)


def _name(image: str, copy: int) -> str:
    return f"{image} copy {copy}" if copy else image


def _truth_of_copies(truth: dict[str, Any], times: int) -> dict[str, Any]:
    """COCO's document for all copies, with ids of their own."""
    images: Sequence[dict[str, Any]] = truth["images"]
    annotations: Sequence[dict[str, Any]] = truth["annotations"]
    every, step = range(times), 1 + max(each["id"] for each in [*images, *annotations])
    return truth | {
        "images": [
            each | {"id": each["id"] + copy * step, "file_name": _name(each["file_name"], copy)}
            for copy in every
            for each in images
        ],
        "annotations": [
            each | {"id": each["id"] + copy * step, "image_id": each["image_id"] + copy * step}
            for copy in every
            for each in annotations
        ],
    }


def _reported(run: Path, output: Path) -> tuple[float, float]:
    """CPU time, s, and memory, bytes, of a process that writes the report."""
    command = [sys.executable, "-c", _REPORT, str(run), str(output)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    cpu_s, memory = map(float, done.stdout.split())
    return cpu_s, memory
