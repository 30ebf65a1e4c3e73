"""Sweeps of small pictures, a sign or noise, in memory or in files, and all that they leave in a store."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import matched_filter
import numpy as np
from blurnoise_eval import datasets
from blurnoise_eval.datasets import Picture, PictureSet, Target, UnreadablePicture
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.run.computing import compute
from blurnoise_eval.store.store import Store
from plans import plan as swept

from blurnoise import Camera, charts
from blurnoise.camera.colour import srgb_from_linear

CAMERA = Camera.preset("imx250")
SIZE_PX, HEIGHT_PX, WIDTH_PX = 24, 54, 64
PLAN = swept((0.002, 0.0123, 0.03), (3.0, 333.3), (0.0, 333.3), (0.0, -77.1), repeats=2)
BOX = tuple(float(edge) for edge in charts.stop_sign_box(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX))
_TIMES = ("simulate_ms", "infer_ms", "computed_by")


def matched_detector(folder):
    return Detector(matched_filter.build(folder / "small.onnx", sizes_px=(24, 16, 10), input_px=64))


def sign(dtype=np.uint8, right_px=0):
    linear = charts.stop_sign(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX)
    coded = np.roll(srgb_from_linear(linear)[0].permute(1, 2, 0).numpy(), right_px, axis=1)
    return np.round(coded * np.iinfo(dtype).max).astype(dtype)


def noise(height, width):
    return np.random.default_rng(5).integers(0, 256, (height, width, 3), np.uint8)


def picture(name, load=sign, labels=("stop sign",)):
    """A picture with a sign's box for each label; without labels, whatever is found when clean."""
    targets = None if labels is None else tuple(Target(label, f"a {label}", BOX) for label in labels)
    return Picture(name, targets, load, f"{name} rendered")


def picture_set(*pictures):
    return PictureSet("folder", "memory", pictures)


TWO = picture_set(picture("a"), picture("b", partial(noise, 40, 51), None))


def some_pictures(folder):
    """Files: a sign whose text is known, the same moved, and one of 0 bytes."""
    datasets.write_picture(folder / "a.png", sign())
    datasets.write_picture(folder / "b.png", sign(right_px=5))
    (folder / "empty.png").write_bytes(b"")
    targets = (Target("stop sign", "signs", BOX), Target("text", "texts", BOX, text="STOP"))
    shown = datasets.image_folder(folder)
    return replace(shown, pictures=tuple(replace(each, targets=targets) for each in shown), categories={})


def everything(run):
    """All that a run found, but not how long it took; and the pictures that it kept."""
    if isinstance(run, Path):
        with Store(run) as store:
            return everything(store)
    rows = list(run.cells())
    cells = [{key: value for key, value in row.stored().items() if key not in _TIMES} for row in rows]
    found = [run.detections(row.cell_id, row.model) for row in rows]
    boxes = [(each.boxes_xyxy.tobytes(), each.scores.tobytes(), each.class_ids.tobytes()) for each in found]
    kept = {path.name: path.read_bytes() for path in (run.folder / "examples").glob("*.png")}
    return [cells, [row.stored() for row in run.targets()], boxes, run.skipped(), kept]


def timeless(results):
    return [
        [replace(result.cell, simulate_ms=None, infer_ms=None), result.targets, result.example_png]
        + [part.tobytes() for part in (result.detections.boxes_xyxy, result.detections.scores)]
        for result in results
    ]


def rows_of(folder, *arguments, **options):
    with Store(folder, create=True) as store:
        compute(*arguments, store, **options)
        return everything(store)


def computed(folder, models, shown, engine, plan, **options):
    with Store(folder, create=True) as store:
        return compute(models, CAMERA, shown, plan, store, engine=engine, **options)


def unreadable():
    raise UnreadablePicture("bad.png: is empty (0 bytes)")
