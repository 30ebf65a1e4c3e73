"""Contents: a run's rows are of the pictures and the models that it was begun with, or the run is refused."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import matched_filter
import numpy as np
import onnx
import pytest
from blurnoise_eval.datasets import Image, image_folder, write_picture
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep.run_folder import open_run
from onnx import numpy_helper
from plans import plan

from blurnoise.optics.camera import Camera

CAMERA = Camera.preset("imx250")
PLAN: SweepPlan = plan((0.004,), (33.3,), (0.0, 333.3), examples=False)


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    return Detector(matched_filter.build(path, sizes_px=(24, 16, 10), input_px=64))


def noise(seed: int) -> Image:
    return np.random.default_rng(seed).integers(0, 256, (41, 53, 3), np.uint8)


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    for seed, name in enumerate("ab"):
        write_picture(folder / f"{name}.bmp", noise(seed))
    return folder


def swept_folder(detector: Detector, photos: Path, run: Path, **changed: Any) -> tuple[int, int]:
    """Computed and resumed cells."""
    pictures = replace(image_folder(photos), **changed)
    with Store(run, create=True) as store:
        open_run(store, [detector], CAMERA, pictures, PLAN, {})
        done = sweep.run([detector], CAMERA, pictures, PLAN, store)
    return done.computed, done.resumed


def replace_keeping_times(file: Path, picture: Image) -> None:
    before = file.stat()
    write_picture(file, picture)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert file.stat().st_size == before.st_size


def test_a_picture_of_the_same_size_is_another(detector: Detector, photos: Path, tmp_path: Path) -> None:
    assert swept_folder(detector, photos, tmp_path / "run") == (6, 0)
    replace_keeping_times(photos / "b.bmp", noise(7))
    with pytest.raises(StoreError, match=r"holds a run with another picture 'b\.bmp'"):
        swept_folder(detector, photos, tmp_path / "run")
    (photos / "b.bmp").unlink()
    write_picture(photos / "b.bmp", noise(1))  # the old one, in a new file
    assert swept_folder(detector, photos, tmp_path / "run") == (0, 6)
    (photos / "b.bmp").write_bytes(b"")
    with pytest.raises(StoreError, match=r"another picture 'b\.bmp'"):
        swept_folder(detector, photos, tmp_path / "run")


def test_a_copied_set_is_the_same(
    detector: Detector, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every picture is read once to learn it, and then not again."""
    assert swept_folder(detector, photos, tmp_path / "run") == (6, 0)
    shutil.copytree(photos, tmp_path / "copy")
    assert swept_folder(detector, tmp_path / "copy", tmp_path / "run") == (0, 6)
    monkeypatch.setattr(
        "blurnoise_eval.datasets.folder.read_picture", lambda path, _: pytest.fail(f"read {path}")
    )
    assert swept_folder(detector, tmp_path / "copy", tmp_path / "run") == (0, 6)


def test_a_picture_that_nothing_is_known_of_may_change(
    detector: Detector, photos: Path, tmp_path: Path
) -> None:
    (photos / "b.bmp").write_bytes(b"not yet")
    assert swept_folder(detector, photos, tmp_path / "run") == (3, 0)
    write_picture(photos / "b.bmp", noise(1))
    assert swept_folder(detector, photos, tmp_path / "run") == (3, 3)


def test_a_picture_that_changes_under_the_sweep_ends_it(
    detector: Detector, photos: Path, tmp_path: Path
) -> None:
    """The rows of both would stand under one name; those of the first stay."""
    (first, second) = image_folder(photos)
    seen: list[int] = []

    def changing() -> Image:
        seen.append(1)
        return noise(len(seen))

    pictures = replace(image_folder(photos), pictures=(replace(first, load=changing), second))
    with Store(tmp_path / "run", create=True) as store:
        open_run(store, [detector], CAMERA, pictures, PLAN, {})
        done = sweep.run([detector], CAMERA, pictures, PLAN, store)
        assert done.computed == 6
    more = replace(PLAN, repeats=2)
    with Store(tmp_path / "run") as store:
        before = list(store.cells())
        with pytest.raises(StoreError, match=r"picture 'a\.bmp' is not what it was"):
            sweep.run([detector], CAMERA, pictures, more, store)
        assert [cell for cell in store.cells() if cell["image"] == "a.bmp"] == [
            cell for cell in before if cell["image"] == "a.bmp"
        ]


def with_weights_beside(detector: Detector, folder: Path, gain: float) -> Path:
    folder.mkdir(exist_ok=True)
    model = onnx.load(detector.path)
    largest = max(model.graph.initializer, key=lambda tensor: len(tensor.raw_data))
    weights = numpy_helper.to_array(largest)
    largest.CopyFrom(numpy_helper.from_array((weights * gain).astype(weights.dtype), largest.name))
    beside = folder / "m.onnx.data"
    beside.unlink(missing_ok=True)  # which would be appended to
    onnx.save(model, folder / "m.onnx", save_as_external_data=True, location=beside.name, size_threshold=1000)
    return folder / "m.onnx"


def test_weights_beside_the_model_are_the_model(detector: Detector, photos: Path, tmp_path: Path) -> None:
    path = with_weights_beside(detector, tmp_path / "model", 1.0)
    graph, first = path.read_bytes(), Detector(path)
    swept_folder(first, photos, tmp_path / "run")
    assert swept_folder(Detector(path), photos, tmp_path / "run") == (0, 6)
    with_weights_beside(detector, tmp_path / "model", 0.5)
    assert path.read_bytes() == graph
    with pytest.raises(StoreError, match="another model"):
        swept_folder(Detector(path), photos, tmp_path / "run")
