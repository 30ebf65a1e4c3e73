"""Where the CPU time of a sweep's cell goes: its parts, each in compiled functions and in Python.

Domain: ms of CPU per cell, of one thread.
"""

from __future__ import annotations

import cProfile
import pstats
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import onnxruntime

import blurnoise
import blurnoise_eval
from blurnoise_eval import datasets
from blurnoise_eval.bench.programs import sweep_plan
from blurnoise_eval.default_camera import default_for
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.run.work import Block, Work, blocks
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import write_records
from blurnoise_eval.system.machine import hardware, limited_threads, versions
from blurnoise_eval.system.terminal import table_lines, width

PARTS = (
    ("onnxruntime", "onnxruntime/"),
    ("light and blur", "blurnoise/light/", "blurnoise/blur/", "blurnoise/scene/"),
    ("sensor: noise", "blurnoise/sensor/"),
    ("development", "blurnoise/picture/", "blurnoise/camera/"),
    ("letterbox, decoding", "blurnoise_eval/detectors/"),
    ("scoring", "blurnoise_eval/scoring/"),
    ("store", "blurnoise_eval/store/"),
    ("plan, statistics, rows", "blurnoise/", "blurnoise_eval/"),
)
"""Of a cell, with the folders whose functions they are; a library's functions count where they are called."""
_PICTURES, _QUICK_PICTURES, _ROUNDS = 4, 1, 3
_PACKAGES = [Path(str(package.__file__)).parent for package in (blurnoise, blurnoise_eval, onnxruntime)]
Function = tuple[str, int, str]


@dataclass(frozen=True)
class CellPart:
    """CPU time of one part of a cell: in compiled functions, and of Python and its operators."""

    part: str
    native_ms: float
    python_ms: float


@dataclass(frozen=True)
class PartsTable:
    """The parts of a cell, and the machine."""

    title: str
    rows: list[CellPart]
    machine: dict[str, Any]

    def write(self, folder: Path) -> None:
        """Write parts.csv and parts.json; raises ``OSError``."""
        write_records("parts", [asdict(row) for row in self.rows], self.document(), folder)

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {"title": self.title, "machine": self.machine, "rows": [asdict(row) for row in self.rows]}

    def table(self) -> list[str]:
        """A line per part, and one of all."""
        native, python = sum(row.native_ms for row in self.rows), sum(row.python_ms for row in self.rows)
        every = [*self.rows, CellPart("all", native, python)]
        rows = [
            (row.part, f"{row.native_ms:.2f}", f"{row.python_ms:.2f}", f"{row.native_ms + row.python_ms:.2f}")
            for row in every
        ]
        heads = ("ms of CPU per cell", "compiled", "Python", "both")
        return [self.title, *table_lines(heads, rows, (False, True, True, True), width())]


def parts(detector: Detector, pictures: datasets.PictureSet, *, quick: bool) -> PartsTable:
    """The parts of a cell with the default camera, in one thread.

    Cells are timed without a profiler, and then counted with one, which delays Python and hardly compiled functions.
    So these have the time that the profiler sees, and Python has the rest, shared out as the profiler sees it.
    """
    count = _QUICK_PICTURES if quick else _PICTURES
    some = datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[:count])
    plan = sweep_plan(quick=quick)
    work = Work((detector,), default_for(some), plan)
    every = list(blocks(some, plan))
    cells = sum(len(block.cells) for block in every)
    with (
        limited_threads(1),
        ThreadPoolExecutor(1) as pool,
    ):  # as a sweep's, for the main thread infers elsewhere
        cell_ms, profile = pool.submit(_measured, work, every, 1 if quick else _ROUNDS).result()
    cell_ms /= cells
    rows = _rows(pstats.Stats(profile), cells, cell_ms)
    title = f"A cell of a sweep of {detector.name}: {cell_ms:.2f} ms of CPU in one thread"
    return PartsTable(title, rows, {**hardware(), "versions": versions()})


def _measured(work: Work, every: Sequence[Block], rounds: int) -> tuple[float, cProfile.Profile]:
    """The least CPU time of all blocks, ms, and a profile of them, without the preparation of pictures."""
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder), create=True) as store:
        worker = work.open(len(every))

        def compute() -> None:
            for block in every:
                store.add(worker.compute(block))

        compute()
        least_ms = min(_cpu_ms(compute) for _ in range(rounds))
        profile = cProfile.Profile(time.thread_time)
        profile.runcall(compute)
    return least_ms, profile


def _cpu_ms(call: Callable[[], object]) -> float:
    started = time.thread_time()
    call()
    return 1e3 * (time.thread_time() - started)


def _rows(profile: Any, cells: int, cell_ms: float) -> list[CellPart]:
    """The parts, by the profiler's own time of every function. cell_ms: what a cell takes without the profiler."""
    shares: dict[Function, dict[str, float]] = {}

    def parts_of(function: Function, seen: frozenset[Function]) -> dict[str, float]:
        """The share of each part in a function's time: one of ours is of its folder, others of what calls them."""
        if function in shares:
            return shares[function]
        if (part := _part(function)) is not None:
            return shares.setdefault(function, {part: 1.0})
        found: dict[str, float] = {}
        callers = {
            caller: times[2] for caller, times in profile.stats[function][4].items() if caller not in seen
        }
        total = sum(callers.values()) or 1.0
        for caller, spent in callers.items():
            for part, share in parts_of(caller, seen | {function}).items():
                found[part] = found.get(part, 0.0) + share * spent / total
        if not seen:
            shares[function] = found
        return found

    native, python = ({part: 0.0 for part, *_ in PARTS} for _ in range(2))
    for function, (_, _, own_s, *_) in profile.stats.items():
        of = native if function[0] == "~" else python
        for part, share in parts_of(function, frozenset()).items():
            of[part] += 1e3 * share * own_s / cells
    left = max(0.0, cell_ms - sum(native.values())) / max(1e-9, sum(python.values()))
    return [CellPart(part, native[part], python[part] * left) for part, *_ in PARTS]


def _part(function: Function) -> str | None:
    """The part whose folder a function is in, None of a library and of compiled functions."""
    for package in _PACKAGES:
        if function[0].startswith(str(package)):
            inside = Path(function[0]).relative_to(package.parent).as_posix()
            return next(part for part, *folders in PARTS if inside.startswith(tuple(folders)))
    return None
