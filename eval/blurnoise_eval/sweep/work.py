"""Work that travels: models and camera; a worker opens it and computes blocks of cells.

A cell (see :mod:`blurnoise_eval.grid.conditions`) is what :func:`blurnoise.simulate` with the cell's seed gives,
whoever computes it and in whatever order.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass

from blurnoise.motion.ego import Vehicle
from blurnoise.optics.camera import Camera
from blurnoise.scene.metering import USUAL, AutoExposure
from blurnoise_eval.datasets import Picture, UnreadablePicture, encode, source_content, source_identity
from blurnoise_eval.datasets.likeness import look
from blurnoise_eval.grid.conditions import Cell
from blurnoise_eval.grid.objects import USUAL_OBJECTS, Objects
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec
from blurnoise_eval.scoring.on_picture import Model, View
from blurnoise_eval.store.store import CellResult
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.exposing import Scene, frames
from blurnoise_eval.sweep.rows import cell_result

EXAMPLES = "examples"  # folder of the run


@dataclass(frozen=True)
class Work:
    """What every block needs beside itself. It pickles; models are opened again where it arrives."""

    models: tuple[Model, ...]
    camera: Camera
    grey_anchor: str | None = None
    auto_exposure: AutoExposure = USUAL
    objects: Objects = USUAL_OBJECTS
    path: tuple[TrajectorySpec, float] | None = None
    ego: Vehicle | None = None

    def open(self, pictures_held: int) -> Worker:
        """A worker that holds at most so many prepared pictures, at least 1, beside those it works on."""
        return Worker(self, pictures_held)


class PreparedPicture:
    """A picture as light, and every model's answer to it as it is. source: identity and content
    of the picture and its plate."""

    def __init__(
        self,
        picture: Picture,
        models: Sequence[Model],
        grey_anchor: str | None = None,
        objects: Objects = USUAL_OBJECTS,
    ) -> None:
        image = picture.load()
        height, width = image.shape[:2]
        try:
            told = source_identity(picture, objects), source_content(picture, image, objects)
            self.source = *told, width, height, look(image)
            self.scene = Scene(image, grey_anchor, picture, objects)
        except UnreadablePicture as error:
            raise UnreadablePicture(f"{picture.name}: {error}") from None
        self.views: list[View] = [View(model, picture, self.scene.image8) for model in models]


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
        """End what is being computed, in other threads; it is not asked again."""
        self._interrupted = True
        for model in self._work.models:
            if hasattr(model, "interrupt"):  # a reader of somebody else may have none
                model.interrupt()

    def _results(self, prepared: PreparedPicture, block: Block) -> Iterator[CellResult]:
        camera = self._work.camera
        taken = self._work.auto_exposure, self._work.path, self._work.ego
        for frame in frames(prepared.scene, block.cells, camera, *taken):
            kept = frame.cell.cell_id in block.examples
            example = _example_path(frame.cell) if kept else None
            png = encode(frame.image) if kept else None
            for each in prepared.views:
                if self._interrupted:
                    raise InterruptedError(block.picture.name)
                sight = (
                    each.clean
                    if frame.cell.conditions is None
                    else each.look(frame.image, frame.move_boxes, frame.sweep_boxes)
                )
                yield cell_result(frame, each.model.name, camera, sight, example, png, prepared.source)

    def _picture(self, picture: Picture) -> PreparedPicture:
        """Prepared by whichever thread needs it first."""
        key = picture.name, picture.identity  # a worker may outlive a picture's file
        with self._lock:
            prepared = self._prepared.get(key)
            mine = prepared is None
            if prepared is None:
                prepared = self._prepared[key] = Future()
            self._prepared.move_to_end(key)  # those that were used longest ago come first
            for other in [other for other, each in self._prepared.items() if each.done()]:
                if len(self._prepared) > self._held:
                    del self._prepared[other]
        if mine:
            try:
                made = PreparedPicture(picture, self._work.models, self._work.grey_anchor, self._work.objects)
                height, width = made.scene.image8.shape[:2]
                if self._work.camera.cfa not in ("none", "mono") and min(height, width) < 2:
                    raise UnreadablePicture(
                        f"{picture.name}: {width} x {height} px; behind a mosaic it must be at least 2 x 2"
                    )
                prepared.set_result(made)
            except BaseException as error:
                prepared.set_exception(error)
        return prepared.result()


def _example_path(cell: Cell) -> str:
    return f"{EXAMPLES}/{cell.cell_id}.png"
