"""A sweep survives its own death, a picture that cannot be used, and a set larger than memory."""

from __future__ import annotations

import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep.engines import ThreadEngine
from blurnoise_eval.sweep.work import count_cells
from numpy.typing import NDArray
from plans import plan as swept
from signs_in_memory import (
    CAMERA,
    PLAN,
    TWO,
    everything,
    matched_detector,
    n_done,
    noise,
    picture,
    picture_set,
    rows_of,
    unreadable,
)

from blurnoise import Camera


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return matched_detector(tmp_path_factory.mktemp("model"))


@pytest.fixture(scope="module")
def uninterrupted(detector: Detector, tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    return rows_of(tmp_path_factory.mktemp("run"), [detector], CAMERA, TWO, PLAN)


@pytest.mark.parametrize(("threads", "after"), [(1, 1), (1, 20), (3, 25)])
def test_interrupted_sweep_goes_on(
    detector: Detector, tmp_path: Path, uninterrupted: list[Any], threads: int, after: int
) -> None:
    settled = 0

    def interrupt(cells: int) -> None:
        nonlocal settled
        settled += cells
        if settled >= after:
            raise KeyboardInterrupt

    total = count_cells(TWO, PLAN)
    with Store(tmp_path, create=True) as store:
        with pytest.raises(KeyboardInterrupt):
            sweep.run([detector], CAMERA, TWO, PLAN, store, engine=ThreadEngine(threads), progress=interrupt)
        kept = n_done(store)  # the store is whole: it can be read at once
        assert after <= kept < total
    told: list[int] = []
    with Store(tmp_path) as store:
        outcome = sweep.run(
            [detector], CAMERA, TWO, PLAN, store, engine=ThreadEngine(threads), progress=told.append
        )
        assert (outcome.resumed, outcome.computed) == (kept, total - kept)
        assert sum(told) == total
        assert everything(store) == uninterrupted
        again = sweep.run([detector], CAMERA, TWO, PLAN, store)
        assert (again.resumed, again.computed) == (total, 0)


@pytest.mark.parametrize("threads", [1, 2])
def test_pictures_in_memory_do_not_grow_with_the_set(
    detector: Detector, tmp_path: Path, threads: int
) -> None:
    live: set[int] = set()
    most = 0

    def load() -> NDArray[np.uint8]:
        nonlocal most
        image = noise(32, 32)
        live.add(id(image))
        weakref.finalize(image, live.discard, id(image))
        most = max(most, len(live))
        return image

    many = picture_set(*[picture(f"p{index}", load) for index in range(40)])
    plan = swept((0.01,), (50.0,), repeats=2)
    with Store(tmp_path, create=True) as store:
        sweep.run([detector], CAMERA, many, plan, store, engine=ThreadEngine(threads))
        assert n_done(store) == count_cells(many, plan) == 120
    # Scenes that are kept, and one that each task at work may still hold.
    assert most <= 2 * threads + 2


@pytest.mark.parametrize("threads", [1, 3])
def test_unreadable_picture_is_named_and_skipped(detector: Detector, tmp_path: Path, threads: int) -> None:
    pictures = picture_set(picture("a"), picture("bad.png", unreadable), picture("z"))
    told: list[int] = []
    for turn in ("first", "again"):
        told.clear()
        with Store(tmp_path, create=True) as store:
            outcome = sweep.run(
                [detector], CAMERA, pictures, PLAN, store, engine=ThreadEngine(threads), progress=told.append
            )
            assert outcome.skipped == {"bad.png": "bad.png: is empty (0 bytes)"}
            assert [entry["image"] for entry in store.skipped()] == ["bad.png"]
            assert {cell["image"] for cell in store.cells()} == {"a", "z"}, turn
            assert sum(told) == count_cells(pictures, PLAN)


def test_a_picture_too_thin_for_a_mosaic_is_skipped_and_named(detector: Detector, tmp_path: Path) -> None:
    shown = picture_set(picture("thin", lambda: noise(1, 40)), picture("whole", lambda: noise(43, 61)))
    plan = swept((0.004,), (33.3,), examples=False)
    with Store(tmp_path / "mosaic", create=True) as store:
        outcome = sweep.run([detector], Camera.preset("imx250c"), shown, plan, store)
    assert list(outcome.skipped) == ["thin"]
    assert "40 x 1 px; behind a mosaic it must be at least 2 x 2" in outcome.skipped["thin"]
