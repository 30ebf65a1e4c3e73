"""Bench of scale: what an engine costs per cell, how it grows with workers, and what gives out first on paper.

Domain: workers that sleep for a cell's time and answer with rows of the usual size
(:mod:`blurnoise_eval.bench.scale_work`), so that there can be more of them than cores, and nothing but the engine is
measured. Costs are ms of the driver's processor per cell; with threads they hold the workers', too.
"""

from __future__ import annotations

import math
import os
import pickle
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import closing, nullcontext
from dataclasses import asdict, dataclass, field
from importlib import util
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

from blurnoise_eval.bench import scale_pictures
from blurnoise_eval.bench.family import called, family, held_mb
from blurnoise_eval.bench.made_up_run import CELLS_PER_PICTURE, GRID, scale_of_results
from blurnoise_eval.bench.scale_pictures import Pictures
from blurnoise_eval.bench.scale_work import (
    BLOCKS_PER_PICTURE,
    CAMERA,
    CELLS,
    MadeModel,
    Ready,
    SleepingWork,
    made_blocks,
    made_picture,
    results,
)
from blurnoise_eval.bench.timing import machine
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store.store import JOURNAL_PAGES, Store
from blurnoise_eval.sweep.actors import local_cluster
from blurnoise_eval.sweep.blocks import Block, blocks
from blurnoise_eval.sweep.engines import ENGINES, Engine, staying
from blurnoise_eval.sweep.evaluation import usual_detector
from blurnoise_eval.sweep.flight import IN_FLIGHT
from blurnoise_eval.sweep.lookahead import AHEAD, AHEAD_OF_WORKER
from blurnoise_eval.sweep.run import run
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.files import RUN_FILE

Progress = Callable[[float], object]
JOURNAL_BYTES = JOURNAL_PAGES * 4096
CORES = (1, 10, 100, 1000)
CELL_S = (0.005, 0.015, 0.08, 0.15)
"""What a cell takes on paper: the built-in detector, YOLOX-nano, and networks of 80 and 150 ms."""


@dataclass(frozen=True)
class Extent:
    """How much is measured. workers: numbers of them. cell_s: seconds that a cell takes. seconds: of each point.
    stored: cells of the store's cost. results: cells of the made-up run whose page is made; 0: none."""

    workers: tuple[int, ...] = (1, 2, 4)
    cell_s: tuple[float, ...] = (0.0, 0.015, 0.08)
    seconds: float = 8.0
    stored: int = 4000
    results: int = 1_000_000  # 2 GB on the disk meanwhile


FULL = Extent()
QUICK = Extent((1, 2), (0.0, 0.015), 2.0, 800, 20_000)


@dataclass(frozen=True)
class Row:
    """One engine with so many workers and such a cell.

    rate: cells/s once all are at work. ideal: what the workers' sleep allows, None for no sleep. driver_ms: of its
    processor per cell, the store's left out. start_s: until the first answer; of workers that stayed, short.
    driver_mb: its peak memory so far; worker_mb: of one worker, None for threads and where /proc does not tell.
    """

    engine: str
    workers: int
    cell_s: float
    cells: int
    rate: float
    ideal: float | None
    driver_ms: float
    start_s: float
    driver_mb: float
    worker_mb: float | None


@dataclass(frozen=True)
class Bench:
    """What was found, and how it was made.

    store_ms: of a cell, in the driver: what a sweep does beside its engine. cell_bytes: of its rows as they travel;
    disk_bytes: as they are stored; block_bytes: of a block as it travels, and about as it waits. pictures: what
    they cost on the way to workers. results: :func:`~blurnoise_eval.bench.made_up_run.scale_of_results`. Both are
    empty where they were not asked for. left_out: engines whose workers could not be had, with the reason.
    """

    rows: list[Row]
    store_ms: float
    cell_bytes: float
    disk_bytes: float
    extent: Extent
    machine: dict[str, Any]
    block_bytes: float = 1000.0
    pictures: Pictures | None = None
    results: dict[str, float] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)

    def cost_ms(self, engine: str) -> float:
        """Of the driver per cell, store included, with cells that take no time."""
        free = [
            row.driver_ms
            for row in self.rows
            if row.engine == engine and row.cell_s == min(self.extent.cell_s)
        ]
        return min(free) + self.store_ms

    def most_rate(self, engine: str) -> float:
        """Cells/s at which the driver has nothing left."""
        return 1e3 / self.cost_ms(engine)

    def paper(self, engine: str, cell_s: float, cores: float) -> float:
        """Cells/s of so many cores."""
        return min(cores / cell_s, self.most_rate(engine))

    @property
    def engines(self) -> list[str]:
        """Those measured whose workers are processes: threads share one interpreter."""
        return [name for name in dict.fromkeys(row.engine for row in self.rows) if name != "threads"]

    def losses(self) -> list[str]:
        """What gives out first, with the arithmetic."""
        told = [*self.left_out]
        for engine in self.engines:
            cost, most = self.cost_ms(engine), self.most_rate(engine)
            told.append(
                f"{engine}: {cost - self.store_ms:.2f} ms of the driver and {self.store_ms:.2f} ms of the store a "
                f"cell: at most 1000 / {cost:.2f} = {most:.0f} cells/s; for cells of t ms on t / {cost:.2f} cores"
            )
            told += [
                f"{engine}, {1e3 * cell_s:g} ms a cell: {1 / cell_s:.1f} cells/s a core, the driver is full from "
                f"{most * cell_s:.0f} cores on"
                for cell_s in CELL_S
            ]
            mb_s, held = most * self.cell_bytes / 1e6, CORES[-1] * IN_FLIGHT * CELLS * self.cell_bytes / 1e6
            waiting = AHEAD + AHEAD_OF_WORKER * CORES[-1]
            told.append(
                f"{engine}, at that rate: {mb_s:.1f} MB/s of rows come in, {most * self.disk_bytes / 1e6:.1f} MB/s "
                f"are stored; {CORES[-1]} cores x {IN_FLIGHT} blocks x {CELLS} cells hold {held:.0f} MB at most, and "
                f"{waiting} blocks that wait {waiting * self.block_bytes / 1e6:.0f} MB"
            )
            told += self._of_pictures(engine, most)
            if written := self.results.get("written_bytes"):
                told.append(
                    f"{engine}, at that rate: {most * written / 1e6:.0f} MB/s written, {written / 1e3:.0f} kB a cell "
                    f"with the journal, and {2 * most * written / JOURNAL_BYTES:.1f} syncs/s at most"
                )
        if self.results:
            told.append(
                "page and tables of {cells:.0f} cells: {wall_s:.0f} s, {cpu_s:.0f} s of a core, {peak_mb:.0f} MB; "
                "{store_ms:.2f} ms and {store_bytes:.0f} bytes a cell in the store".format(**self.results)
            )
        return told

    def _of_pictures(self, engine: str, most: float) -> list[str]:
        """What they cost, as blocks are handed out and if they were taken as they come, each by another worker."""
        if self.pictures is None:
            return []
        told, file_mb = [], self.pictures.file_bytes / 1e6
        for workers, begun in self.pictures.workers.items():
            times = begun, float(min(workers, BLOCKS_PER_PICTURE))
            mb_s = [most / CELLS_PER_PICTURE * each * file_mb for each in times]
            work = CELLS_PER_PICTURE * self.pictures.cell_ms
            share = [100 * each * self.pictures.begun_ms / work for each in times]
            begin_ms, cell_ms = self.pictures.begun_ms, self.pictures.cell_ms
            told.append(
                f"{engine}, at that rate, {workers} workers: each picture is begun by {times[0]:.1f} of them, "
                f"not {times[1]:.0f}: {mb_s[0]:.1f}, not {mb_s[1]:.1f} MB/s are read; {begin_ms:.1f} ms for "
                f"each beside {cell_ms:.1f} ms a cell, {share[0]:.1f}, not {share[1]:.1f} % of the work"
            )
        return told

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "extent": asdict(self.extent),
            "machine": self.machine,
            "store_ms": self.store_ms,
            "cell_bytes": self.cell_bytes,
            "block_bytes": self.block_bytes,
            "pictures": None if self.pictures is None else asdict(self.pictures),
            "disk_bytes": self.disk_bytes,
            "cost_ms": {engine: self.cost_ms(engine) for engine in self.engines},
            "paper": [
                {
                    "engine": engine,
                    "cell_s": cell_s,
                    "cores": cores,
                    "rate": self.paper(engine, cell_s, cores),
                }
                for engine in self.engines
                for cell_s in CELL_S
                for cores in CORES
            ],
            "results": self.results,
            "losses": self.losses(),
            "rows": [asdict(row) for row in self.rows],
        }


def engines() -> list[str]:
    """Those of ``ENGINES`` that can be had here."""
    return [name for name in ENGINES if name != "ray" or util.find_spec("ray")]


def steps(extent: Extent) -> int:
    """What the shares told to ``progress`` add up to."""
    return len(engines()) * len(extent.workers) * len(extent.cell_s) + 1 + bool(extent.results)


def measure(extent: Extent = FULL, threads: int = 1, progress: Progress = lambda share: None) -> Bench:
    """Every engine with every number of workers and every cell; then the store, and a run's page."""
    rows: list[Row] = []
    left_out = []
    for name in engines():
        own: list[Row] = []
        try:
            with local_cluster(max(extent.workers)) if name == "ray" else nullcontext():
                for workers in extent.workers:
                    with staying(ENGINES[name](workers)) as engine:
                        for cell_s in extent.cell_s:
                            own.append(_row(name, engine, workers, cell_s, extent.seconds))
                            progress(1)
            rows += own
        except ChildProcessError as error:  # what others cost is known all the same
            left_out.append(f"{name}: left out ({error})")
            progress(len(extent.workers) * len(extent.cell_s) - len(own))
    store_ms, disk_bytes = _store(extent.stored)
    progress(1)
    results_of: dict[str, float] = {}
    pictures = scale_pictures.measure(usual_detector()) if extent.results else None
    if extent.results:
        with TemporaryDirectory() as folder:
            results_of = scale_of_results(Path(folder) / "run", extent.results, usual_detector())
        progress(1)
    some = list(made_blocks(8))
    cell_bytes = sum(len(pickle.dumps(results(block))) for block in some) / len(some) / CELLS
    block_bytes = sum(len(pickle.dumps(block)) for block in some) / len(some)
    return Bench(
        rows,
        store_ms,
        cell_bytes,
        disk_bytes,
        extent,
        machine(threads),
        block_bytes,
        pictures,
        results_of,
        left_out,
    )


def write(bench: Bench, folder: Path) -> None:
    """Write scale.csv, a row per engine, number of workers and cell, and scale.json."""
    write_bench("scale", [asdict(row) for row in bench.rows], bench.document(), folder)


def _row(name: str, engine: Engine, workers: int, cell_s: float, seconds: float) -> Row:
    """Blocks until the time is over, counted once every worker is at work; the last ones are waited for."""
    began = time.perf_counter()
    until, first_s, worker_mb = float("inf"), 0.0, None
    count, started, spent = 0, 0.0, 0.0
    counted, wall_s, cpu_s = 0, 0.0, 0.0
    warm = 4 * workers
    # Many blocks wait to be handed out; where each takes long, no more are made than fill the time.
    most = warm + math.ceil(workers * (seconds / (CELLS * cell_s) + 2)) if cell_s else 1 << 30

    def asked() -> Iterator[Block]:
        yield from takewhile(lambda _: time.perf_counter() < until, made_blocks(most, cell_s))

    with closing(engine.map(cast(Work, SleepingWork()), asked())) as answers:
        for _, answer in answers:
            if isinstance(answer, Exception):
                raise answer
            now, count = time.perf_counter(), count + 1
            first_s = first_s or now - began
            if count == warm:
                started, spent = time.perf_counter(), time.process_time()
                until = started + seconds
                worker_mb = None if name == "threads" else _worker_mb(name)
            elif count > warm and (now <= until or not counted):
                counted, wall_s, cpu_s = count - warm, now - started, time.process_time() - spent
    cells = counted * CELLS
    return Row(
        name, workers, cell_s, cells, cells / wall_s, workers / cell_s if cell_s else None, 1e3 * cpu_s / cells,
        first_s, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, worker_mb,
    )  # fmt: skip


def _store(cells: int) -> tuple[float, float]:
    """ms of the processor for a cell beside its engine, its block made and its rows stored; bytes on the disk."""
    pictures = tuple(made_picture(number, "made up") for number in range(-(-cells // CELLS_PER_PICTURE)))
    shown, plan = PictureSet("coco", "made up", pictures), SweepPlan(GRID, examples=False)
    answers = [results(block) for block in blocks(shown, plan)]
    with TemporaryDirectory() as folder:
        with Store(Path(folder), create=True) as store:
            started = time.process_time()
            done = run([cast(Model, MadeModel())], CAMERA, shown, plan, store, engine=Ready(answers))
            spent = time.process_time() - started
        size = (Path(folder) / RUN_FILE).stat().st_size
    return 1e3 * spent / done.computed, size / done.computed


def _worker_mb(name: str) -> float | None:
    """Mean memory of the processes of this one in which workers are."""
    marks = {"processes": b"spawn_main", "ray": b"ray::RayWorker"}
    own = [process for process in family(os.getpid()) if marks[name] in called(process)]
    sizes = [size for size in map(held_mb, own) if size]
    return sum(sizes) / len(sizes) if sizes else None
