"""Bench of a whole program: a sweep, and its inference alone."""

from __future__ import annotations

import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from blurnoise_eval import datasets
from blurnoise_eval.bench.contest import Case, Contender, Contest
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.system.machine import limited_threads

_EXPOSURES_S = (0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045, 0.06, 0.09)


def sweep(detector: Detector, pictures: datasets.PictureSet, threads: int, *, quick: bool) -> Contest:
    """Cells of up to twenty pictures by a sweep, and ``session.run`` alone on as many prepared inputs.

    The sweep reads, simulates with the default camera, infers, decodes, scores and stores.
    """
    plan = sweep_plan(quick=quick)
    some = datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[:20])
    return Contest(
        "sweep", f"A sweep of {detector.name}",
        [partial(_cells, detector, some, plan, threads)],
        unit="ms per cell", seconds=10.0,
    )  # fmt: skip


def sweep_plan(*, quick: bool) -> SweepPlan:
    """The conditions of the benches of a sweep: ten exposures, three lights, four speeds; two exposures of them.

    >>> len(sweep_plan(quick=True).conditions())
    24
    """
    axes = {
        "exposure_s": _EXPOSURES_S[::5] if quick else _EXPOSURES_S,
        "illuminance_lux": (1.0, 10.0, 100.0),
        "velocity_x_px_s": (0.0, 200.0, 500.0, 1000.0),
    }
    return SweepPlan(axes, examples=False)


def _cells(detector: Detector, pictures: datasets.PictureSet, plan: SweepPlan, threads: int) -> Case:
    inputs = [detector.prepare(datasets.eight_bit(picture.load()))[0] for picture in pictures]
    cells = len(pictures) * (1 + len(plan.conditions()))  # each picture is inferred as it is, too

    def bare() -> None:
        with limited_threads(1), ThreadPoolExecutor(threads) as pool:
            list(pool.map(detector.run, [inputs[index % len(inputs)] for index in range(cells)]))

    def swept() -> None:
        with tempfile.TemporaryDirectory() as folder:
            engine = ThreadEngine(threads)
            evaluate(
                detector,
                pictures,
                plan=plan,
                output=folder,
                engine=engine,
                strategy="grid",
                progress=False,
            )

    ways = [Contender("bare onnxruntime", bare), Contender("sweep", swept, True)]
    return Case(f"{cells} cells, {threads} threads", ways, units=cells)
