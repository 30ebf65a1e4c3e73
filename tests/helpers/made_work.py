"""Work made up for the bench of scale: a worker that sleeps, and answers with rows of the usual size."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from blurnoise_eval.datasets import Picture, UnreadablePicture
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.scoring.on_picture import ModelOutput
from blurnoise_eval.store.store import CellResult, PictureFacts
from blurnoise_eval.sweep.engines import Answers
from blurnoise_eval.sweep.exposing import Frame
from blurnoise_eval.sweep.work import Block, Work, cell_result
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera

CELLS = 8  # of a block
BLOCKS_PER_PICTURE = 50  # 400 conditions
_TARGETS, _DETECTIONS = 2, 20
CAMERA = Camera.preset("imx250")
_TARGET = {
    "label": "made up",
    "group": "made up, medium (32-96 px)",
    "x0": 1.0,
    "y0": 2.0,
    "x1": 41.0,
    "y1": 42.0,
    "width_px": 40.0,
    "height_px": 40.0,
    "confidence": 0.5,
    "confidence_swept": 0.5,
}


@dataclass(frozen=True)
class SleepingWork:
    """Takes the time that a block's picture names for each cell, and no core."""

    models: tuple[()] = ()

    def open(self, pictures_held: int) -> SleepingWork:
        """The worker is the work."""
        return self

    def compute(self, block: Block) -> list[CellResult]:
        """Rows as those of a detector."""
        time.sleep(float(block.picture.identity) * len(block.cells))
        return results(block)


def results(block: Block) -> list[CellResult]:
    """Rows of a detector that finds 20 boxes and 2 targets in every picture."""
    rng = np.random.default_rng(block.cells[0].seed)
    return [_result(cell, rng) for cell in block.cells]


def made_blocks(count: int, cell_s: float = 0.0) -> Iterator[Block]:
    """So many blocks, pictures one after the other, whose cells take so many seconds each."""
    conditions = [
        [
            Conditions(exposure_s=1e-4 * (1 + number), illuminance_lux=100.0, velocity_x_px_s=float(place))
            for place in range(CELLS)
        ]
        for number in range(BLOCKS_PER_PICTURE)
    ]
    for number in range(count):
        picture = made_picture(number // BLOCKS_PER_PICTURE, f"{cell_s}")
        some = conditions[number % BLOCKS_PER_PICTURE]
        yield Block(picture, tuple(Cell(picture.name, 0, at, number) for at in some))


def made_picture(number: int, identity: str = "") -> Picture:
    """Without targets; it cannot be read."""
    return Picture(f"{number:08}.jpg", (), _never, identity)


@dataclass(frozen=True)
class MadeModel:
    """As far as a sweep asks for it in order to store its rows."""

    name: str = "made up"


@dataclass(frozen=True)
class Ready:
    """An engine that has computed every block before it is asked."""

    answers: Sequence[list[CellResult]]

    def map(self, work: Work, blocks: Iterable[Block]) -> Answers:
        """As of :class:`~blurnoise_eval.sweep.engines.Engine`."""
        yield from zip(blocks, self.answers, strict=True)


def _never() -> NDArray[np.uint8]:
    raise UnreadablePicture("is made up")


def _result(cell: Cell, rng: np.random.Generator) -> CellResult:
    boxes = np.sort(rng.random((_DETECTIONS, 4), np.float32) * 640, axis=1)
    detections = Detections(boxes, rng.random(_DETECTIONS, np.float32), np.zeros(_DETECTIONS, np.int64))
    targets = tuple({"target_id": place, **_TARGET} for place in range(_TARGETS))
    frame = Frame(cell, np.empty((0, 0, 3), np.uint8), 1.0, saturated=0.0, snr_db=30.0, brightness=0.5)
    row = cell_result(frame, "made up", CAMERA, ModelOutput(detections, targets, 1.0, None, 0), None, None)
    return replace(row, picture=PictureFacts("made up", "0" * 64, 640, 480, ""))
