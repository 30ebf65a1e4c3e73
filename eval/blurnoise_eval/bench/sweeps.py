"""Speed of a sweep beside bare onnxruntime on the same threads, and what of a cell's time goes where."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from blurnoise.optics.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep.blocks import Block, blocks, count_cells
from blurnoise_eval.sweep.engines import ThreadEngine
from blurnoise_eval.sweep.exposing import Frame, Scene, frames
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.machine import hardware
from blurnoise_eval.system.threads import limited_threads

_PICTURES = 8  # of a sweep
_CAMERA = Camera.preset("imx250")
_AXES = {
    "exposure_s": (0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045, 0.06, 0.09),
    "illuminance_lux": (1.0, 10.0, 100.0),
    "velocity_x_px_s": (0.0, 200.0, 500.0, 1000.0),
}
_BLOCKS = 12  # timed part by part


class _Rate(NamedTuple):
    """Pictures or cells per second, and per second of all cores' time."""

    per_s: float
    per_core_s: float


def sweep_speed(
    detector: Detector, pictures: datasets.PictureSet, threads: int, folder: Path, rounds: int = 3
) -> dict[str, Any]:
    """Cells per second of a sweep beside pictures per second of bare onnxruntime, taken in turns.

    Bare: ``session.run`` alone, on inputs prepared beforehand, over the same shared session and as many
    threads. The sweep reads, simulates, infers, decodes, scores and stores. Peak memory is that of the process,
    before the first and after the last sweep, the last with twice as many cells. Ratios by core time are what those
    of throughput would be with the cores to themselves.
    Core time of a cell in ms is that of one thread, see :func:`_cell_ms`.
    """
    pictures = datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[:_PICTURES])
    loaded = [datasets.eight_bit(picture.load()) for picture in pictures]
    blobs = [detector.prepare(image)[0] for image in loaded]
    bare: list[_Rate] = []
    swept: list[_Rate] = []
    seconds = 0.0
    peak_mb: list[float] = []
    for turn in range(rounds):
        plan = SweepPlan(_AXES, repeats=2 if turn == rounds - 1 else 1, seed=turn, examples=False)
        cells = count_cells(pictures, plan)
        bare.append(
            _bare_rate(detector, blobs, threads, max(100, int(seconds * (bare[-1].per_s if bare else 0))))
        )
        with Store(folder / f"turn-{turn}", create=True) as store:
            engine, core_s = ThreadEngine(threads), time.process_time()
            outcome = sweep.run([detector], _CAMERA, pictures, plan, store, engine=engine)
        swept.append(_Rate(cells / outcome.wall_s, cells / (time.process_time() - core_s)))
        seconds = outcome.wall_s
        peak_mb.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    ratio, core_time_ratio = np.median(np.array(swept) / np.array(bare), axis=0).tolist()
    return {
        "model": detector.name,
        "pictures": f"{len(pictures)}, {pictures.kind}, the first {loaded[0].shape[1]}x{loaded[0].shape[0]}",
        "threads": threads,
        "cells": count_cells(pictures, plan),
        "bare_onnxruntime_per_s": float(np.median([rate.per_s for rate in bare])),
        "sweep_cells_per_s": float(np.median([rate.per_s for rate in swept])),
        "sweep_to_bare": ratio,
        "sweep_to_bare_core_time": core_time_ratio,
        "cell_ms": _cell_ms(detector, pictures),
        "peak_memory_mb": [round(value) for value in peak_mb],
        **hardware(),
    }


def _cell_ms(detector: Detector, pictures: datasets.PictureSet) -> dict[str, float]:
    """Median core time of a cell's parts, ms, blocks of cells by turns on one thread.

    "score and rows": of all that a worker does, what the other parts leave.
    """
    plan = SweepPlan(_AXES, examples=False)
    some = datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[:1])
    every = [block for block in blocks(some, plan) if block.cells[0].conditions is not None]
    worker = Work((detector,), _CAMERA).open(1)
    scene = Scene(some.pictures[0].load())
    rounds: list[dict[str, float]] = []

    def timed(times: dict[str, float], part: str, call: Callable[[], Any]) -> Any:
        started = time.thread_time()
        answer = call()
        times[part] = times.get(part, 0.0) + 1e3 * (time.thread_time() - started)
        return answer

    with limited_threads(1):
        for block in [every[0], *every[:: max(1, len(every) // _BLOCKS)]]:
            times: dict[str, float] = {}
            seen = timed(times, "simulate", partial(_exposed, scene, block))
            for frame in seen:
                blob, placement = timed(times, "prepare", partial(detector.prepare, frame.image))
                outputs = timed(times, "infer", partial(detector.run, blob))
                timed(times, "decode", partial(detector.decode, outputs, placement))
            timed(times, "all", partial(worker.compute, block))
            rest = 2 * times["all"] - sum(times.values())
            parts = {**times, "score and rows": rest}
            rounds.append({part: each / len(block.cells) for part, each in parts.items()})
    return {part: float(np.median([each[part] for each in rounds[1:]])) for part in rounds[0]}


def _exposed(scene: Scene, block: Block) -> list[Frame]:
    return list(frames(scene, block.cells, _CAMERA))


def _bare_rate(detector: Detector, blobs: list[Any], threads: int, count: int) -> _Rate:
    def infer(index: int) -> None:
        detector.run(blobs[index % len(blobs)])

    with limited_threads(1), ThreadPoolExecutor(threads) as pool:
        list(pool.map(infer, range(2 * threads)))
        started, core_s = time.perf_counter(), time.process_time()
        list(pool.map(infer, range(count)))
        return _Rate(count / (time.perf_counter() - started), count / (time.process_time() - core_s))
