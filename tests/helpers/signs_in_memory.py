"""Sweeps of pictures in memory, a sign or noise, and all that they leave in a store."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matched_filter
import numpy as np
from blurnoise_eval.datasets import Picture, PictureSet, Target, UnreadablePicture
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from numpy.typing import NDArray
from plans import plan as swept

from blurnoise import Camera, charts
from blurnoise.optics.colour import srgb_from_linear

CAMERA = Camera.preset("imx250")
SIZE_PX, HEIGHT_PX, WIDTH_PX = 24, 54, 64
PLAN = swept(
    exposures_s=(0.002, 0.0123, 0.03),
    lights_lux=(3.0, 333.3),
    right_px_s=(0.0, 333.3),
    down_px_s=(0.0, -77.1),
    repeats=2,
)


def matched_detector(folder: Path) -> Detector:
    return Detector(matched_filter.build(folder / "small.onnx", sizes_px=(24, 16, 10), input_px=64))


def sign(dtype: type = np.uint8) -> NDArray[Any]:
    linear = charts.stop_sign(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX)
    coded = srgb_from_linear(linear)[0].permute(1, 2, 0).numpy()
    return np.round(coded * np.iinfo(dtype).max).astype(dtype)


def noise(height: int, width: int) -> NDArray[np.uint8]:
    return np.random.default_rng(5).integers(0, 256, (height, width, 3), np.uint8)


BOX = tuple(float(edge) for edge in charts.stop_sign_box(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX))


def picture(
    name: str, load: Callable[[], NDArray[Any]] = sign, labels: Sequence[str] | None = ("stop sign",)
) -> Picture:
    """A picture with a sign's box for each label; without labels, whatever is found when clean."""
    targets = None if labels is None else tuple(Target(label, f"a {label}", BOX) for label in labels)
    return Picture(name, targets, load, f"{name} rendered")


def picture_set(*pictures: Picture) -> PictureSet:
    return PictureSet("folder", "memory", pictures)


TWO = picture_set(picture("a"), picture("b", partial(noise, 40, 51), None))


def everything(store: Store) -> list[Any]:
    """All that a run found, but not how long it took."""
    cells = [
        {key: value for key, value in cell.items() if key not in ("simulate_ms", "infer_ms", "computed_by")}
        for cell in store.cells()
    ]
    found = [store.detections(cell["cell_id"], cell["model"]) for cell in cells]
    boxes = [(each.boxes_xyxy.tobytes(), each.scores.tobytes(), each.class_ids.tobytes()) for each in found]
    return [cells, list(store.targets()), boxes, store.skipped()]


def n_done(store: Store) -> int:
    return len({row["cell_id"] for row in store.rows("SELECT cell_id FROM cells")})


def rows_of(folder: Path, *arguments: Any, **options: Any) -> list[Any]:
    with Store(folder, create=True) as store:
        sweep.run(*arguments, store, **options)
        return everything(store)


def unreadable() -> NDArray[Any]:
    raise UnreadablePicture("bad.png: is empty (0 bytes)")
