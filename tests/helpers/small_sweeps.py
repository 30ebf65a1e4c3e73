"""Small sweeps for engines: a detector of signs, pictures of one, and all that a run finds."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import matched_filter
import numpy as np
from blurnoise_eval import datasets
from blurnoise_eval.datasets import PictureSet, Target
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.store.store import CellResult, Store
from blurnoise_eval.sweep.engines import Engine
from blurnoise_eval.sweep.run import Outcome, run
from plans import plan as swept

from blurnoise import Camera, charts
from blurnoise.optics.colour import srgb_from_linear

CAMERA = Camera.preset("imx250")
PLAN = swept((0.002, 0.0123, 0.03), (3.0, 333.3), (0.0, 333.3), repeats=2)
SIZE_PX, HEIGHT_PX, WIDTH_PX = 24, 54, 64
BOX = tuple(float(edge) for edge in charts.stop_sign_box(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX))


def small_detector(folder: Path) -> Detector:
    """Of 64 px, in the folder."""
    path = folder / "small.onnx"
    return Detector(matched_filter.build(path, sizes_px=(24, 16, 10), input_px=64))


def some_pictures(folder: Path) -> PictureSet:
    """A sign whose text is known, the same moved, and a file of 0 bytes."""
    linear = charts.stop_sign(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX)
    sign = srgb_from_linear(linear)[0].mul(255).round().byte().permute(1, 2, 0).numpy()
    datasets.write_picture(folder / "a.png", sign)
    datasets.write_picture(folder / "b.png", np.roll(sign, 5, axis=1))
    (folder / "empty.png").write_bytes(b"")
    targets = (Target("stop sign", "signs", BOX), Target("text", "texts", BOX, text="STOP"))
    shown = datasets.image_folder(folder)
    return replace(shown, pictures=tuple(replace(each, targets=targets) for each in shown), categories={})


def everything(folder: Path) -> list[Any]:
    """All that a run found, but not how long it took; and the pictures it kept."""
    with Store(folder) as store:
        cells = [
            {
                key: value
                for key, value in cell.items()
                if key not in ("simulate_ms", "infer_ms", "computed_by")
            }
            for cell in store.cells()
        ]
        found = [store.detections(cell["cell_id"], cell["model"]) for cell in cells]
        boxes = [(each.boxes_xyxy.tobytes(), each.scores.tobytes()) for each in found]
        kept = {path.name: path.read_bytes() for path in (folder / "examples").glob("*.png")}
        return [cells, list(store.targets()), boxes, store.skipped(), kept]


def computed(
    folder: Path,
    models: list[Any],
    shown: PictureSet,
    engine: Engine,
    plan: SweepPlan = PLAN,
    progress: Callable[[int], None] = lambda cells: None,
) -> Outcome:
    with Store(folder, create=True) as store:
        return run(models, CAMERA, shown, plan, store, engine=engine, progress=progress)


def killed_once(told: Path, load: Callable[[], Any]) -> Any:
    """What ``load`` gives, but the first of all processes to ask is killed. The file tells that it was."""
    try:
        told.touch(exist_ok=False)
    except FileExistsError:
        pass
    else:
        os.kill(os.getpid(), signal.SIGKILL)
    return load()


def lasting_once(told: Path, load: Callable[[], Any]) -> Any:
    """What ``load`` gives, but the first of all processes to ask never has it. The file tells whose child that is."""
    if told.exists():
        return load()
    written = told.with_suffix(".new")
    written.write_text(f"{os.getppid()}")
    written.replace(told)
    return threading.Event().wait()


def process_states() -> dict[int, tuple[str, int, int, str]]:
    """State, parent, group and time of start of every process, by its number. Linux."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = stat.read_text()
        except OSError:  # gone meanwhile
            continue
        fields = text[text.rindex(")") + 2 :].split()
        found[int(stat.parent.name)] = fields[0], int(fields[1]), int(fields[2]), fields[19]
    return found


def descendants(process: int) -> set[tuple[int, str]]:
    """Numbers and times of start of a process and all that it and its children began."""
    states = process_states()
    family = {process}
    while more := {number for number, (_, parent, *_) in states.items() if parent in family} - family:
        family |= more
    return {(number, states[number][3]) for number in family if number in states}


def alive(family: set[tuple[int, str]]) -> set[tuple[int, str]]:
    """Those of the family that still run."""
    return family & {
        (number, began) for number, (state, _, _, began) in process_states().items() if state != "Z"
    }


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise ``TimeoutError`` inside after so long. Main thread."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"not done after {seconds:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def timeless(results: list[CellResult]) -> list[Any]:
    return [
        [{k: v for k, v in result.cell.items() if not k.endswith("_ms")}, result.targets, result.example_png]
        + [part.tobytes() for part in (result.detections.boxes_xyxy, result.detections.scores)]
        for result in results
    ]
