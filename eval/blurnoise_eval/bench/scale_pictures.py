"""Pictures on their way to workers: what it costs to begin with one, and how many workers begin with each.

Domain: a picture of 640 x 480 px as JPEG, the built-in detector, ms of a core. Who begins with which is found by
handing out the blocks of 400 conditions as engines do, to workers that ask in any order.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from blurnoise.optics.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.bench.made_up_run import GRID
from blurnoise_eval.bench.scale_work import BLOCKS_PER_PICTURE, made_picture
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.sweep.blocks import Block, blocks
from blurnoise_eval.sweep.lookahead import Lookahead
from blurnoise_eval.sweep.work import PreparedPicture, Work
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.threads import limited_threads

WORKERS = (32, 1000)
_SIZE_PX = (640, 480)
_TIMES = 5


@dataclass(frozen=True)
class Pictures:
    """begun_ms: to read a picture, decode it and ask the model about it as it is; cell_ms: for a condition then.
    file_bytes: of the picture. workers: of so many how many begin with each picture, in the mean."""

    begun_ms: float
    cell_ms: float
    file_bytes: int
    workers: dict[int, float]


def measure(detector: Detector) -> Pictures:
    """Medians, with one thread."""
    noise = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)
    _, coded = cv2.imencode(".jpg", cv2.resize(noise, _SIZE_PX, interpolation=cv2.INTER_CUBIC))
    with TemporaryDirectory() as folder, limited_threads(1):
        write_whole(Path(folder) / "a.jpg", coded.tobytes())
        shown = datasets.image_folder(Path(folder))
        (picture,) = shown
        begun_ms = _ms(lambda: PreparedPicture(picture, (detector,)))
        some = list(blocks(shown, SweepPlan(GRID, examples=False)))[1::10]
        worker = Work((detector,), Camera.preset("imx250")).open(1)
        worker.compute(replace(some[0], cells=()))
        cell_ms = statistics.mean(_ms(partial(worker.compute, of)) / len(of.cells) for of in some)
    return Pictures(begun_ms, cell_ms, len(coded), {workers: begun_by(workers) for workers in WORKERS})


def begun_by(workers: int) -> float:
    """How many of so many workers begin with each of twice as many pictures, in the mean."""
    pictures = [made_picture(number) for number in range(2 * workers)]
    ahead = Lookahead(Block(picture, ()) for picture in pictures for _ in range(BLOCKS_PER_PICTURE))
    rng = np.random.default_rng(workers)
    begun = set[tuple[int, str]]()
    while (block := ahead.next_for(worker := int(rng.integers(workers)))) is not None:
        begun.add((worker, block.picture.name))
    return len(begun) / len(pictures)


def _ms(act: Callable[[], Any]) -> float:
    spent = []
    for _ in range(_TIMES):
        started = time.process_time()
        act()
        spent.append(1e3 * (time.process_time() - started))
    return statistics.median(spent)
