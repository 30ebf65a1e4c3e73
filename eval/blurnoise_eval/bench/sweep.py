"""Bench of a sweep: beside bare onnxruntime on the same threads."""

from __future__ import annotations

import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from blurnoise.optics.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.bench.contest import Case, Contender, Contest
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run import computing as run
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.run.work import blocks
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.machine import limited_threads

_EXPOSURES_S = (0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045, 0.06, 0.09)
_CAMERA = Camera.preset("imx250")


def sweep(detector: Detector, pictures: datasets.PictureSet, threads: int, *, quick: bool) -> Contest:
    """Cells of two pictures by a sweep, beside ``session.run`` alone on as many prepared inputs.

    The sweep reads, simulates, infers, decodes, scores and stores.
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
        [partial(_case, detector, some, plan, threads)],
        cost_unit="ms per cell", seconds=10.0,
    )  # fmt: skip


def _case(detector: Detector, pictures: datasets.PictureSet, plan: SweepPlan, threads: int) -> Case:
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
