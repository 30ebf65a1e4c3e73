"""Every picture under every condition through one detector: model x camera x conditions x pictures -> rows.

A cell (see :mod:`blurnoise_eval.conditions`) is what :func:`blurnoise.simulate` with the cell's seed gives,
whoever computes it and in whatever order; here it is computed with what cells of one picture share.
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
from numpy.typing import NDArray
from torch import Tensor

from blurnoise import rng, sensor
from blurnoise.camera import Camera
from blurnoise.plan import plan as needs_of
from blurnoise.simulate import frame_pattern, lens_and_motion, scene_reflectance
from blurnoise_eval import datasets
from blurnoise_eval.conditions import Cell, Conditions, Plan, cell_seed
from blurnoise_eval.datasets import Picture, PictureSet, Target, UnreadablePicture
from blurnoise_eval.onnx_model import Detector
from blurnoise_eval.records import Detections
from blurnoise_eval.scoring import target_confidence
from blurnoise_eval.store import CellResult, Store

OWN_TARGET_SCORE = 0.25
"""Without boxes, what the detector finds in the clean picture at this score or above is the target."""
_BLOCK = 8  # cells that one task computes before it reports
_EXAMPLE_PICTURES = 3


@dataclass
class Outcome:
    """What a sweep did: cells computed now and before, pictures skipped with the reason, seconds."""

    computed: int = 0
    resumed: int = 0
    skipped: dict[str, str] = field(default_factory=dict)
    wall_s: float = 0.0


def run(
    detector: Detector,
    camera: Camera,
    pictures: PictureSet,
    plan: Plan,
    store: Store,
    *,
    threads: int = 1,
    progress: Callable[[int], None] = lambda cells: None,
) -> Outcome:
    """Compute every cell that ``store`` does not hold yet; ``progress`` is told how many cells are settled.

    Simulation and inference of a cell run in the same task, ``threads`` tasks at a time over the detector's
    one session; the rows do not depend on ``threads``. A picture that cannot be read is noted and skipped.
    KeyboardInterrupt leaves the store whole; the same call resumes.
    """
    started = time.perf_counter()
    outcome = Outcome()
    done = store.done()
    scenes = _Scenes(detector, camera, capacity=threads + 2)
    examples = plan.example_conditions() if plan.examples else set()
    shown = _example_pictures(pictures)
    folder = store.folder / "examples"
    if examples:
        folder.mkdir(exist_ok=True)

    def compute(picture: Picture, cells: Sequence[Cell], keep: bool) -> list[CellResult]:
        scene = scenes.get(picture)
        kept = folder if keep and examples else None
        return list(_expose_block(scene, cells, detector, camera, plan, examples, kept))

    def settle(picture: Picture, cells: int, finished: Future[list[CellResult]]) -> None:
        try:
            results = finished.result()
        except UnreadablePicture as error:
            outcome.skipped[picture.name] = str(error)
            store.skip(picture.name, str(error))
        else:
            store.add(results)
            outcome.computed += len(results)
        progress(cells)

    settings = (torch.get_num_threads(), cv2.getNumThreads())
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    pool = ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))
    flying: dict[Future[list[CellResult]], tuple[Picture, int]] = {}
    try:
        for picture, cells in _blocks(pictures, plan):
            todo = [cell for cell in cells if cell.cell_id not in done]
            outcome.resumed += len(cells) - len(todo)
            progress(len(cells) - len(todo))
            if not todo or picture.name in outcome.skipped:
                progress(len(todo))
                continue
            flying[pool.submit(compute, picture, todo, picture.name in shown)] = (picture, len(todo))
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


def count_cells(pictures: PictureSet, plan: Plan) -> int:
    """How many cells a sweep settles, the clean ones included."""
    return len(pictures) * (1 + plan.repeats * len(plan.conditions()))


def _settle_some(
    flying: dict[Future[list[CellResult]], tuple[Picture, int]],
    settle: Callable[[Picture, int, Future[list[CellResult]]], None],
) -> None:
    finished, _ = wait(flying, return_when=FIRST_COMPLETED)
    for future in finished:
        settle(*flying.pop(future), future)


def _example_pictures(pictures: Iterable[Picture]) -> set[str]:
    """The pictures with the largest targets, or the first, where the detector still has to find them."""

    def largest(picture: Picture) -> float:
        boxes = (target.box_xyxy for target in picture.targets or ())
        return max(((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes), default=0.0)

    return {picture.name for picture in sorted(pictures, key=largest, reverse=True)[:_EXAMPLE_PICTURES]}


def _blocks(pictures: Iterable[Picture], plan: Plan) -> Iterator[tuple[Picture, list[Cell]]]:
    """Cells in tasks. A picture's clean cell, which makes its scene, comes before the last one's conditions."""
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
    picture: Picture, conditions: Sequence[Conditions], plan: Plan
) -> Iterator[tuple[Picture, list[Cell]]]:
    """Blocks of conditions of one displacement, which share a blur."""
    for repeat in range(plan.repeats):
        seed = cell_seed(plan.seed, picture.name, repeat)
        for _, same in groupby(conditions, key=lambda at: at.displacement_px):
            cells = [Cell(picture.name, repeat, at, seed) for at in same]
            for start in range(0, len(cells), _BLOCK):
                yield picture, cells[start : start + _BLOCK]


class _Scene:
    """What all conditions of one picture share."""

    def __init__(self, picture: Picture, detector: Detector, camera: Camera) -> None:
        image = picture.load()
        self.image8 = datasets.eight_bit(image)
        self.sharp = _reflectance(image).contiguous()
        started = time.perf_counter()
        self.clean = detector.detect(self.image8)
        self.clean_ms = 1e3 * (time.perf_counter() - started)
        classes = detector.contract.classes
        self.targets = _own_targets(self.clean, classes) if picture.targets is None else picture.targets
        ids = {name: index for index, name in enumerate(classes)}
        self.class_ids = [ids.get(target.label) for target in self.targets]  # None: unknown to the model
        self._fields: OrderedDict[int, Tensor] = OrderedDict()
        self._lock = threading.Lock()

    def normal(self, seed: int) -> Tensor:
        """The noise field of a seed, (1, 3, H, W); the last two are kept."""
        with self._lock:
            if seed not in self._fields:
                self._fields[seed] = rng.standard_normal([seed], self.sharp)
                while len(self._fields) > 2:
                    self._fields.popitem(last=False)
            return self._fields[seed]


class _Scenes:
    """The scenes of the pictures in flight, each made once, by whichever task needs it first."""

    def __init__(self, detector: Detector, camera: Camera, capacity: int) -> None:
        self._detector, self._camera, self._capacity = detector, camera, capacity
        self._scenes: OrderedDict[str, Future[_Scene]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, picture: Picture) -> _Scene:
        with self._lock:
            scene = self._scenes.get(picture.name)
            mine = scene is None
            if scene is None:
                scene = self._scenes[picture.name] = Future()
                while len(self._scenes) > self._capacity:
                    self._scenes.popitem(last=False)
        if mine:
            try:
                scene.set_result(_Scene(picture, self._detector, self._camera))
            except BaseException as error:
                scene.set_exception(error)
        return scene.result()


def _reflectance(image: datasets.Image) -> Tensor:
    """``scene_reflectance`` of a picture (H, W, 3), (1, 3, H, W): looked up, since its codes are integers."""
    codes = torch.arange(np.iinfo(image.dtype).max + 1, dtype=torch.float32) / float(
        np.iinfo(image.dtype).max
    )
    table = scene_reflectance(codes[None, None, None], "srgb").flatten()
    planes = [torch.from_numpy(plane.astype(np.int32)).flatten() for plane in cv2.split(image)]
    looked_up = torch.stack([table.index_select(0, plane) for plane in planes])
    return looked_up.view(1, 3, *image.shape[:2])


def _own_targets(clean: Detections, classes: Sequence[str]) -> tuple[Target, ...]:
    targets = []
    for box, score, class_id in zip(clean.boxes_xyxy, clean.scores, clean.class_ids, strict=True):
        if score >= OWN_TARGET_SCORE:
            x0, y0, x1, y1 = (float(edge) for edge in box)
            group = datasets.size_group(x1 - x0, y1 - y0, "found when clean")
            targets.append(Target(classes[class_id], group, (x0, y0, x1, y1)))
    return tuple(targets)


def _expose_block(
    scene: _Scene,
    cells: Sequence[Cell],
    detector: Detector,
    camera: Camera,
    plan: Plan,
    examples: set[Conditions],
    folder: Path | None,
) -> Iterator[CellResult]:
    """Simulate and infer cells of one displacement: the lines below are ``simulate``, its blur shared."""
    if cells[0].conditions is None:
        path = _keep(scene.image8, folder, cells[0])
        yield _result(cells[0], scene, scene.clean, detector, camera, 0.0, scene.clean_ms, path)
        return
    on_sensor: dict[tuple[float, bool], Tensor] = {}  # by defocus, and whether it moves
    displacement = cells[0].conditions.displacement_px
    per_lux_s = sensor.electrons_per_lux_s(camera)
    for cell in cells:
        at = cell.conditions
        if at is None:
            continue
        started = time.perf_counter()
        # As float32 and in this order, as simulate computes it.
        lux, exposure_s = np.float32(at.illuminance_lux), np.float32(at.exposure_s)
        needs = needs_of(
            camera,
            exposure_s=float(exposure_s),
            illuminance_lux=float(lux),
            displacement_px=displacement,
            temperature_c=float(np.float32(plan.temperature_c)),
        )
        through = (needs.camera.defocus_radius_px, needs.moves)
        if through not in on_sensor:
            motion = displacement if needs.moves else (0.0, 0.0)
            on_sensor[through] = lens_and_motion(scene.sharp, needs.camera, motion)
        seen = sensor.read_out(
            on_sensor[through],
            needs.camera,
            white_e=float(lux * exposure_s * np.float32(per_lux_s)),
            exposure_s=at.exposure_s,
            temperature_c=plan.temperature_c,
            generator=[cell.seed],
            fixed_pattern=frame_pattern(needs.camera, scene.sharp, 0),
            noise=needs.noisy,
            normal=scene.normal(cell.seed),
            tones=sensor.tones_8bit(camera),
        )
        image = np.asarray(cv2.merge(list(seen[0].numpy())), np.uint8)
        simulate_ms = 1e3 * (time.perf_counter() - started)
        started = time.perf_counter()
        detections = detector.detect(image)
        infer_ms = 1e3 * (time.perf_counter() - started)
        path = _keep(
            np.asarray(image, np.uint8), folder if at in examples and cell.repeat == 0 else None, cell
        )
        yield _result(cell, scene, detections, detector, camera, simulate_ms, infer_ms, path)


def _keep(image: NDArray[np.uint8], folder: Path | None, cell: Cell) -> str | None:
    if folder is None:
        return None
    path = folder / f"{cell.cell_id}.png"
    datasets.write_picture(path, image)
    return f"{folder.name}/{path.name}"


def _result(
    cell: Cell,
    scene: _Scene,
    detections: Detections,
    detector: Detector,
    camera: Camera,
    simulate_ms: float,
    infer_ms: float,
    example: str | None,
) -> CellResult:
    at = cell.conditions
    shared = {
        "cell_id": cell.cell_id,
        "model": detector.name,
        "camera": camera.name,
        "image": cell.image,
        "repeat": cell.repeat,
        "clean": at is None,
        "exposure_s": at and at.exposure_s,
        "illuminance_lux": at and at.illuminance_lux,
        "velocity_x_px_s": at and at.velocity_x_px_s,
        "velocity_y_px_s": at and at.velocity_y_px_s,
        "blur_px": at and at.blur_px,
    }
    rows: list[dict[str, Any]] = []
    for index, (target, class_id) in enumerate(zip(scene.targets, scene.class_ids, strict=True)):
        if class_id is None:
            continue
        x0, y0, x1, y1 = target.box_xyxy
        row = {"target_id": index, "group": target.group, "label": target.label}
        row |= {"x0": x0, "y0": y0, "x1": x1, "y1": y1, "width_px": x1 - x0, "height_px": y1 - y0}
        row["confidence"] = target_confidence(detections, target.box_xyxy, class_id)
        rows.append({**shared, **row})
    confidences = [row["confidence"] for row in rows]
    summary = {
        "seed": cell.seed,
        "n_targets": len(rows),
        "target_confidence": float(np.mean(confidences)) if rows else None,
        "detection_rate": float(np.mean(np.array(confidences) >= OWN_TARGET_SCORE)) if rows else None,
        "n_detections": len(detections),
        "simulate_ms": simulate_ms,
        "infer_ms": infer_ms,
        "error": None,
        "example": example,
    }
    return CellResult({**shared, **summary}, tuple(rows), detections)
