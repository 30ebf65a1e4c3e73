"""Every picture under every condition before every model: models x camera x conditions x pictures -> rows.

A cell (see :mod:`blurnoise_eval.grid.conditions`) is what :func:`blurnoise.simulate` with the cell's seed gives,
whoever computes it and in whatever order; :func:`compute` is all that a worker does.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from blurnoise.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.datasets import Picture, PictureSet, UnreadablePicture
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.grid.axes import NAMES
from blurnoise_eval.grid.conditions import Cell, Conditions, SweepPlan, cell_seed
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.on_picture import Model, Sight, View, view
from blurnoise_eval.store.store import CellResult, Store
from blurnoise_eval.sweep.exposing import Frame, Scene, frames

_BLOCK = 8  # cells that one task computes before it reports
_EXAMPLE_PICTURES = 3
_HOPELESS = 8  # failures of a model, without one answer, after which a sweep gives up


@dataclass
class Outcome:
    """What a sweep did: cells computed now and before, pictures skipped with the reason, seconds."""

    computed: int = 0
    resumed: int = 0
    skipped: dict[str, str] = field(default_factory=dict)
    wall_s: float = 0.0


class Stage:
    """A picture as light, and every model before it."""

    def __init__(self, picture: Picture, models: Sequence[Model]) -> None:
        image = picture.load()
        self.scene = Scene(image)
        self.views: list[View] = [view(model, picture, self.scene.image8) for model in models]


def compute(
    stage: Stage, cells: Sequence[Cell], camera: Camera, keep: _Keep | None = None
) -> Iterator[CellResult]:
    """Simulate each cell's picture and ask every model: one result per cell and model.

    This is all of a worker's task: it needs the picture, the models, the camera and plain cells.
    """
    for frame in frames(stage.scene, cells, camera):
        example = keep(frame) if keep else None
        for each in stage.views:
            sight = each.clean if frame.cell.conditions is None else each.look(frame.image)
            yield _result(frame, each.model.name, camera, sight, example)


def run(
    models: Sequence[Model],
    camera: Camera,
    pictures: PictureSet,
    plan: SweepPlan,
    store: Store,
    *,
    threads: int = 1,
    progress: Callable[[int], None] = lambda cells: None,
) -> Outcome:
    """Compute every cell that ``store`` does not hold yet; ``progress`` is told how many cells are settled.

    Each picture is simulated once for all models. Simulation and inference of a cell run in the same task,
    ``threads`` tasks at a time over each model's one session; the rows do not depend on ``threads``. A
    picture that cannot be read is noted and skipped; one on which a model fails is noted in its row. Raises
    :class:`ModelError` where a model does nothing but fail. KeyboardInterrupt leaves the store whole; the
    same call resumes.
    """
    started = time.perf_counter()
    outcome = Outcome()
    stages = _Stages(models, capacity=threads + 2)
    shown = _example_pictures(pictures) if plan.examples else set()
    keep = _Keep(store.folder, plan.example_conditions())
    hopes = {model.name: _Hope() for model in models}

    def work(picture: Picture, cells: Sequence[Cell]) -> list[CellResult]:
        kept = keep if picture.name in shown else None
        return list(compute(stages.get(picture), cells, camera, kept))

    def settle(picture: Picture, cells: int, finished: Future[list[CellResult]]) -> None:
        try:
            results = finished.result()
        except UnreadablePicture as error:
            outcome.skipped[picture.name] = str(error)
            store.skip(picture.name, str(error))
        else:
            store.add(results)
            outcome.computed += cells
            for result in results:
                hopes[result.cell["model"]].learn(result.cell["error"])
        progress(cells)

    settings = (torch.get_num_threads(), cv2.getNumThreads())
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    pool = ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))
    flying: dict[Future[list[CellResult]], tuple[Picture, int]] = {}
    try:
        for picture, cells in _blocks(pictures, plan):
            done = store.done(picture.name)
            todo = [cell for cell in cells if cell.cell_id not in done]
            outcome.resumed += len(cells) - len(todo)
            progress(len(cells) - len(todo))
            if not todo or picture.name in outcome.skipped:
                progress(len(todo))
                continue
            flying[pool.submit(work, picture, todo)] = (picture, len(todo))
            while len(flying) >= 2 * threads:
                _settle_some(flying, settle)
        while flying:
            _settle_some(flying, settle)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        torch.set_num_threads(settings[0])
        cv2.setNumThreads(settings[1])
        outcome.wall_s = time.perf_counter() - started
    return outcome


def count_cells(pictures: PictureSet, plan: SweepPlan) -> int:
    """How many cells a sweep settles, the clean ones included."""
    return len(pictures) * (1 + plan.repeats * len(plan.conditions()))


def _settle_some(
    flying: dict[Future[list[CellResult]], tuple[Picture, int]],
    settle: Callable[[Picture, int, Future[list[CellResult]]], None],
) -> None:
    finished, _ = wait(flying, return_when=FIRST_COMPLETED)
    for future in finished:
        settle(*flying.pop(future), future)


class _Hope:
    """Whether a model has ever answered; after enough failures without one, the first is the run's."""

    def __init__(self) -> None:
        self._answered, self._failures, self._first = False, 0, ""

    def learn(self, error: str | None) -> None:
        self._answered |= error is None
        if error is not None and not self._answered:
            self._failures += 1
            self._first = self._first or error
            if self._failures >= _HOPELESS:
                raise ModelError(f"{self._first} (and so on every one of {self._failures} pictures)")


class _Keep:
    """Writes the pictures that people will look at."""

    def __init__(self, run: Path, conditions: set[Conditions]) -> None:
        self._folder, self._conditions = run / "examples", conditions

    def __call__(self, frame: Frame) -> str | None:
        """The file's path within the run, None where the cell's picture is not kept."""
        cell = frame.cell
        if cell.conditions is not None and (cell.repeat > 0 or cell.conditions not in self._conditions):
            return None
        self._folder.mkdir(exist_ok=True)
        path = self._folder / f"{cell.cell_id}.png"
        datasets.write_picture(path, np.asarray(frame.image, np.uint8))
        return f"{self._folder.name}/{path.name}"


class _Stages:
    """The stages of the pictures in flight, each made once, by whichever task needs it first."""

    def __init__(self, models: Sequence[Model], capacity: int) -> None:
        self._models, self._capacity = models, capacity
        self._stages: OrderedDict[str, Future[Stage]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, picture: Picture) -> Stage:
        with self._lock:
            stage = self._stages.get(picture.name)
            mine = stage is None
            if stage is None:
                stage = self._stages[picture.name] = Future()
                while len(self._stages) > self._capacity:
                    self._stages.popitem(last=False)
        if mine:
            try:
                stage.set_result(Stage(picture, self._models))
            except BaseException as error:
                stage.set_exception(error)
        return stage.result()


def _example_pictures(pictures: Iterable[Picture]) -> set[str]:
    """The pictures with the largest targets, or the first, where the model still has to find them."""

    def largest(picture: Picture) -> float:
        boxes = (target.box_xyxy for target in picture.targets or ())
        return max(((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes), default=0.0)

    return {picture.name for picture in sorted(pictures, key=largest, reverse=True)[:_EXAMPLE_PICTURES]}


def _blocks(pictures: Iterable[Picture], plan: SweepPlan) -> Iterator[tuple[Picture, list[Cell]]]:
    """Cells in tasks. A picture's clean cell, which makes its stage, comes before the last one's conditions."""
    conditions = plan.conditions()
    waiting: Picture | None = None
    for picture in pictures:
        yield picture, [Cell(picture.name, 0, None, cell_seed(plan.seed, picture.name, 0))]
        if waiting:
            yield from _condition_blocks(waiting, conditions, plan)
        waiting = picture
    if waiting:
        yield from _condition_blocks(waiting, conditions, plan)


def _condition_blocks(
    picture: Picture, conditions: Sequence[Conditions], plan: SweepPlan
) -> Iterator[tuple[Picture, list[Cell]]]:
    """Blocks of conditions that share a blur; those of one exposure stay together."""
    for repeat in range(plan.repeats):
        seed = cell_seed(plan.seed, picture.name, repeat)
        for _, same in groupby(conditions, key=lambda at: at.blurs_as):
            block: list[Cell] = []
            for _, lights in groupby(same, key=lambda at: at.exposure_s):
                block += [Cell(picture.name, repeat, at, seed) for at in lights]
                if len(block) >= _BLOCK:
                    yield picture, block
                    block = []
            if block:
                yield picture, block


def _result(frame: Frame, model: str, camera: Camera, sight: Sight, example: str | None) -> CellResult:
    cell, at = frame.cell, frame.cell.conditions
    shared = {
        "cell_id": cell.cell_id,
        "model": model,
        "camera": camera.name,
        "image": cell.image,
        "repeat": cell.repeat,
        "clean": at is None,
        **(dict.fromkeys(NAMES) if at is None else at.on(camera)),
        "blur_px": at and at.blur_px,
    }
    rows: list[dict[str, Any]] = [{**shared, **row} for row in sight.targets]
    confidences = np.array([row["confidence"] for row in rows])
    summary = {
        "seed": cell.seed,
        "n_targets": len(rows),
        "target_confidence": float(confidences.mean()) if rows else None,
        "detection_rate": float((confidences >= FOUND_SCORE).mean()) if rows else None,
        "n_detections": len(sight.detections),
        "simulate_ms": frame.simulate_ms,
        "infer_ms": sight.infer_ms,
        "error": sight.error,
        "example": example,
    }
    return CellResult({**shared, **summary}, tuple(rows), sight.detections)
