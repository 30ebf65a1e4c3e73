"""Work of a sweep: its cells in blocks, each a worker's task; models and camera, which travel; and a worker.

A cell (see :mod:`blurnoise_eval.plan.conditions`) is what :func:`blurnoise.simulate` with the cell's seed gives,
whoever computes it and in whatever order.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Collection, Iterable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from itertools import groupby, pairwise, product
from typing import NamedTuple

import numpy as np
import torch

from blurnoise.camera import Camera
from blurnoise_eval.datasets import Picture, PictureSet, UnreadablePicture, content, encode
from blurnoise_eval.datasets.likeness import perceptual_hash
from blurnoise_eval.plan.axes import blur_px
from blurnoise_eval.plan.conditions import Cell, Conditions, cell_seed
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.exposing import Frame, PictureScene, frames
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.on_picture import Model, ModelOnPicture, ModelOutput
from blurnoise_eval.store.columns import ORIGINAL, AxisValues
from blurnoise_eval.store.rows import CellRow, OfLamp, TargetRow
from blurnoise_eval.store.store import CellResult, PictureFacts

_CELLS = 8  # at least, that a worker computes before it reports: a block costs whoever hands it out 1 to 2 ms
EXAMPLES, _EXAMPLE_PICTURES = "examples", 3  # folder of the run; how many are kept


@dataclass(frozen=True)
class Block:
    """Cells of one picture. examples: ids of those whose pictures are kept, for people to look at."""

    picture: Picture
    cells: tuple[Cell, ...]
    examples: frozenset[str] = frozenset()

    @classmethod
    def joined(cls, blocks: Sequence[Block]) -> Block:
        """One block with the cells of all, which are of one picture."""
        cells = tuple(cell for block in blocks for cell in block.cells)
        return cls(blocks[0].picture, cells, frozenset().union(*(block.examples for block in blocks)))

    def without(self, done: Collection[str]) -> Block:
        """Those cells whose ids are not ``done``."""
        todo = tuple(cell for cell in self.cells if cell.cell_id not in done)
        return Block(self.picture, todo, self.examples)


def count_cells(pictures: PictureSet, plan: SweepPlan) -> int:
    """How many cells a sweep has, the clean ones included."""
    return len(pictures) * plan.cells_per_picture


def blocks(pictures: PictureSet, plan: SweepPlan) -> Iterator[Block]:
    """Every cell once. A picture's clean cell, which prepares it, comes before the last one's conditions."""
    shown = _example_pictures(pictures) if plan.examples else set()
    kept, together = (None, *plan.example_conditions()), _together(plan.conditions())

    def block(picture: Picture, repeat: int, some: Iterable[Conditions | None]) -> Block:
        seed = cell_seed(plan.seed, picture.name, repeat)
        cells = tuple(Cell(picture.name, repeat, at, seed) for at in some)
        if picture.name not in shown or repeat:
            return Block(picture, cells)
        return Block(picture, cells, frozenset(each.cell_id for each in cells if each.conditions in kept))

    for before, picture in pairwise([None, *pictures, None]):
        if picture is not None:
            yield block(picture, 0, [None])
        if before is not None:
            for repeat, some in product(range(plan.repeats), together):
                yield block(before, repeat, some)


def _together(conditions: Iterable[Conditions]) -> list[list[Conditions]]:
    """Conditions in their order, enough for a block at a time; the lights of one blur and exposure stay together."""
    found: list[list[Conditions]] = []
    for _, lights in groupby(conditions, key=lambda at: (at.blurs_as, at.exposure_s)):
        if not found or len(found[-1]) >= _CELLS:
            found.append([])
        found[-1] += lights
    return found


def _example_pictures(pictures: Iterable[Picture]) -> set[str]:
    """The pictures with the largest targets, or the first ones without labels."""

    def largest(picture: Picture) -> float:
        boxes = (target.box_xyxy for target in picture.targets or ())
        return max(((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes), default=0.0)

    return {picture.name for picture in sorted(pictures, key=largest, reverse=True)[:_EXAMPLE_PICTURES]}


@dataclass(frozen=True)
class Work:
    """What every block needs beside itself. It pickles; models are opened again where it arrives."""

    models: tuple[Model, ...]
    camera: Camera
    plan: SweepPlan

    def open(self, pictures_held: int) -> Worker:
        """A worker that holds at most so many prepared pictures, at least 1, beside those it works on."""
        return Worker(self, pictures_held)


class PreparedPicture(NamedTuple):
    """A picture as light, every model's answer to it as it is, and what of it the store notes."""

    scene: PictureScene
    views: list[ModelOnPicture]
    facts: PictureFacts

    @classmethod
    def of(cls, picture: Picture, work: Work) -> PreparedPicture:
        """Raises ``UnreadablePicture``."""
        image = picture.load()
        height, width = image.shape[:2]
        if work.camera.sensor.cfa not in ("none", "mono") and min(height, width) < 2:
            raise UnreadablePicture(
                f"{picture.name}: {width} x {height} px; must be at least 2 x 2 for a camera with a mosaic"
            )
        try:
            scene = PictureScene(image, work.plan, picture)
        except UnreadablePicture as error:
            raise UnreadablePicture(f"{picture.name}: {error}") from None
        views: list[ModelOnPicture] = [ModelOnPicture(model, picture, scene.image8) for model in work.models]
        return cls(
            scene,
            views,
            PictureFacts(
                picture.identity,
                content(image),
                width,
                height,
                perceptual_hash(image),
                scene.headlit_text(work.camera),
            ),
        )


class Worker:
    """Computes blocks; any number of threads may ask at once. Pictures in use are prepared once, and kept."""

    def __init__(self, work: Work, pictures_held: int) -> None:
        self._work, self._held = work, pictures_held
        self._prepared: OrderedDict[tuple[str, str], Future[PreparedPicture]] = OrderedDict()
        self._lock = threading.Lock()
        self._interrupted = False

    def compute(self, block: Block) -> list[CellResult]:
        """Simulate each cell's picture and ask every model: one result per cell and model.

        Raises :class:`~blurnoise_eval.datasets.UnreadablePicture`; a picture on which a model fails is noted in
        its row.
        """
        return list(self._results(self._picture(block.picture), block))

    def interrupt(self) -> None:
        """End what other threads compute, for good."""
        self._interrupted = True
        for model in self._work.models:
            if hasattr(model, "interrupt"):  # a reader of somebody else may have none
                model.interrupt()

    def _results(self, prepared: PreparedPicture, block: Block) -> Iterator[CellResult]:
        work = self._work
        for frame in frames(prepared.scene, block.cells, work.camera):
            kept = frame.cell.cell_id in block.examples
            example = f"{EXAMPLES}/{frame.cell.cell_id}.png" if kept else None
            png = encode(frame.image) if kept else None
            for each in prepared.views:
                if self._interrupted:
                    raise InterruptedError(block.picture.name)
                sight = (
                    each.clean
                    if frame.cell.conditions is None
                    else each.evaluate(frame.image, frame.move_boxes, frame.sweep_boxes, frame.invented)
                )
                of = frame, each.model.name, work.camera, sight, example, png, prepared.facts
                yield cell_result(*of, lamp=self._lamp(frame))

    def _lamp(self, frame: Frame) -> OfLamp | None:
        """The columns of a pulsed lamp, where the run has one."""
        if not self._work.plan.pulsed:
            return None
        lamp = None if frame.exposure is None else frame.exposure.lamp
        return OfLamp(None if lamp is None else lamp.phase, frame.missed_pulse)

    def _picture(self, picture: Picture) -> PreparedPicture:
        """Prepared by whichever thread needs it first."""
        key = picture.name, picture.identity  # a worker may outlive a picture's file
        with self._lock:
            mine = key not in self._prepared
            prepared = self._prepared.setdefault(key, Future())
            self._prepared.move_to_end(key)  # those that were used longest ago come first
            for other in [other for other, each in self._prepared.items() if each.done()]:
                if len(self._prepared) > self._held:
                    del self._prepared[other]
        if mine:
            try:
                prepared.set_result(PreparedPicture.of(picture, self._work))
            except BaseException as error:
                prepared.set_exception(error)
        return prepared.result()


def cell_result(
    frame: Frame,
    model: str,
    camera: Camera,
    sight: ModelOutput,
    example: str | None,
    example_png: bytes | None,
    facts: PictureFacts | None = None,
    lamp: OfLamp | None = None,
) -> CellResult:
    """The rows of one cell and model. example: where the frame is kept in the run's folder, as PNG. lamp: of a run
    with a pulsed lamp."""
    cell, at, taken = frame.cell, frame.cell.conditions, frame.exposure
    conditions = ORIGINAL if at is None else AxisValues.of(at.on(camera))
    moved_px = blur_px({**at.specified, "exposure_s": taken.exposure_s}) if at and taken else None
    key = cell.cell_id, model, camera.name, cell.image, cell.repeat, conditions
    blurs_px = [moved_px] * len(sight.targets)
    if taken is not None and taken.drives and sight.targets:
        height, width = frame.image.shape[:2]
        middles = torch.tensor([[row.x0 + row.x1, row.y0 + row.y1] for row in sight.targets]).double() / 2
        blurs_px = torch.linalg.vector_norm(taken.displacements_px(middles, (height, width)), dim=1).tolist()
    rows = sight.targets
    if at is not None:
        blurs_px = [frame.own_px.get(row.target_id, own) for row, own in zip(rows, blurs_px, strict=True)]
    invented = [row.inpainted_share for row in rows if row.inpainted_share is not None]
    confidences = np.array([row.confidence for row in rows])
    row = CellRow(
        *key,
        moved_px,
        seed=cell.seed,
        n_targets=len(rows),
        target_confidence=float(confidences.mean()) if rows else None,
        detection_rate=float((confidences >= FOUND_SCORE).mean()) if rows else None,
        n_detections=sight.detections.boxes,
        saturated_share=frame.saturated,
        applied_exposure_s=None if taken is None else taken.exposure_s,
        applied_gain_db=None if taken is None else taken.gain_db,
        snr_db=frame.snr_db,
        brightness=frame.brightness,
        inpainted_share=(float(np.mean(invented)) if any(invented) else 0.0) if rows and at else None,
        simulate_ms=frame.simulate_ms,
        infer_ms=sight.infer_ms,
        error=sight.error,
        example=example,
        lamp=lamp,
    )
    targets = tuple(TargetRow(*key, own, of) for own, of in zip(blurs_px, rows, strict=True))
    return CellResult(row, targets, sight.detections, sight.non_finite_values, example_png, facts)
