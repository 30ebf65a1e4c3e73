"""Speed of a sweep beside bare onnxruntime on the same threads."""

from __future__ import annotations

import resource
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from blurnoise.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep.blocks import count_cells
from blurnoise_eval.sweep.engines import ThreadEngine
from blurnoise_eval.system.machine import hardware
from blurnoise_eval.system.threads import limited_threads

_PICTURES = 8  # of a sweep


def sweep_speed(
    detector: Detector, pictures: datasets.PictureSet, threads: int, folder: Path, rounds: int = 3
) -> dict[str, Any]:
    """Cells per second of a sweep beside pictures per second of bare onnxruntime, taken in turns.

    Bare: ``session.run`` alone, on inputs prepared beforehand, over the same shared session and as many
    threads. The sweep reads, simulates, infers, decodes, scores and stores. Peak memory is that of the
    process, before the first and after the last sweep, the last with twice as many cells.
    """
    pictures = datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[:_PICTURES])
    loaded = [datasets.eight_bit(picture.load()) for picture in pictures]
    blobs = [detector.prepare(image)[0] for image in loaded]
    bare: list[float] = []
    swept: list[float] = []
    seconds = 0.0
    peak_mb: list[float] = []
    for turn in range(rounds):
        plan = SweepPlan(
            {
                "exposure_s": (0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045, 0.06, 0.09),
                "illuminance_lux": (1.0, 10.0, 100.0),
                "velocity_x_px_s": (0.0, 200.0, 500.0, 1000.0),
            },
            repeats=2 if turn == rounds - 1 else 1,
            seed=turn,
            examples=False,
        )
        cells = count_cells(pictures, plan)
        bare.append(_bare_rate(detector, blobs, threads, max(100, int(seconds * np.median(bare or [0])))))
        with Store(folder / f"turn-{turn}", create=True) as store:
            engine = ThreadEngine(threads)
            outcome = sweep.run([detector], Camera.preset("imx250"), pictures, plan, store, engine=engine)
        swept.append(cells / outcome.wall_s)
        seconds = outcome.wall_s
        peak_mb.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return {
        "model": detector.name,
        "pictures": f"{len(pictures)}, {pictures.kind}, the first {loaded[0].shape[1]}x{loaded[0].shape[0]}",
        "threads": threads,
        "cells": count_cells(pictures, plan),
        "bare_onnxruntime_per_s": float(np.median(bare)),
        "sweep_cells_per_s": float(np.median(swept)),
        "sweep_to_bare": float(np.median(np.array(swept) / np.array(bare))),
        "peak_memory_mb": [round(value) for value in peak_mb],
        **hardware(),
    }


def _bare_rate(detector: Detector, blobs: list[Any], threads: int, count: int) -> float:
    def infer(index: int) -> None:
        detector.run(blobs[index % len(blobs)])

    with limited_threads(1), ThreadPoolExecutor(threads) as pool:
        list(pool.map(infer, range(2 * threads)))
        started = time.perf_counter()
        list(pool.map(infer, range(count)))
        return count / (time.perf_counter() - started)
