"""Bench of a sweep: beside bare onnxruntime on the same threads, and the parts of a cell's time."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.bench.contest import Case, Contender, Contest
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run
from blurnoise_eval.sweep.engines import ThreadEngine
from blurnoise_eval.sweep.exposing import Scene, frames
from blurnoise_eval.sweep.work import Work, blocks
from blurnoise_eval.system.threads import limited_threads

_EXPOSURES_S = (0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045, 0.06, 0.09)
_CAMERA = Camera.preset("imx250")


def sweep(detector: Detector, pictures: datasets.PictureSet, threads: int, *, quick: bool) -> Contest:
    """Cells of two pictures by a sweep, beside ``session.run`` alone on as many prepared inputs; then a cell's parts.

    The sweep reads, simulates, infers, decodes, scores and stores. A cell's parts are timed on one thread.
    """
    axes = {
        "exposure_s": _EXPOSURES_S[::5] if quick else _EXPOSURES_S,
        "illuminance_lux": (1.0, 10.0, 100.0),
        "velocity_x_px_s": (0.0, 200.0, 500.0, 1000.0),
    }
    plan = SweepPlan(axes, examples=False)
    some = datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[:2])
    return Contest(
        "sweep", f"A sweep of {detector.name}",
        [partial(_whole, detector, some, plan, threads), partial(_parts, detector, some, plan)],
        cost_unit="ms per cell", seconds=10.0,
    )  # fmt: skip


def _whole(detector: Detector, pictures: datasets.PictureSet, plan: SweepPlan, threads: int) -> Case:
    inputs = [detector.prepare(datasets.eight_bit(picture.load()))[0] for picture in pictures]
    cells = sum(len(block.cells) for block in blocks(pictures, plan))

    def bare() -> None:
        with limited_threads(1), ThreadPoolExecutor(threads) as pool:
            list(pool.map(detector.run, [inputs[index % len(inputs)] for index in range(cells)]))

    def swept() -> None:
        with tempfile.TemporaryDirectory() as folder, Store(Path(folder), create=True) as store:
            run.run([detector], _CAMERA, pictures, plan, store, engine=ThreadEngine(threads))

    ways = [Contender("bare onnxruntime", bare), Contender("sweep", swept, True)]
    return Case(f"{cells} cells, {threads} threads", ways, units=cells)


def _parts(detector: Detector, pictures: datasets.PictureSet, plan: SweepPlan) -> Case:
    one = datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[:1])
    some = [block for block in blocks(one, plan) if block.cells[0].conditions is not None]
    scene, worker = Scene(one.pictures[0].load()), Work((detector,), _CAMERA).open(1)
    images = [frame.image for block in some for frame in frames(scene, block.cells, _CAMERA)]
    inputs, placements = zip(*map(detector.prepare, images), strict=True)
    outputs = [detector.run(each) for each in inputs]

    def part(name: str, call: Callable[..., Any], *items: Iterable[Any], ours: bool = True) -> Contender:
        def all_of_them() -> None:
            with limited_threads(1):
                list(map(call, *items))

        return Contender(name, all_of_them, ours)

    ways = [
        part("all", worker.compute, some),
        part("simulate", lambda block: list(frames(scene, block.cells, _CAMERA)), some),
        part("prepare", detector.prepare, images),
        part("infer", detector.run, inputs, ours=False),
        part("decode", detector.decode, outputs, placements),
    ]
    return Case("parts of a cell, one thread", ways, units=len(images))
