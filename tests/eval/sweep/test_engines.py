"""Whoever computes a sweep, in whatever order: the same rows; and what happens when a worker does not come back."""

from __future__ import annotations

import importlib.util
import json
import multiprocessing
import os
import pickle
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from band_readers import constant_reader
from blurnoise_eval import datasets
from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.ocr import Recogniser
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.engines import ProcessEngine, RayEngine, ThreadEngine, engine_of, staying
from blurnoise_eval.sweep.engines.base import shared_out
from blurnoise_eval.sweep.work import Block, Work, blocks, count_cells
from plans import plan as swept
from small_sweeps import (
    CAMERA,
    PLAN,
    alive,
    computed,
    descendants,
    everything,
    killed_once,
    limited,
    small_detector,
    some_pictures,
    timeless,
)


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return small_detector(tmp_path_factory.mktemp("model"))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> PictureSet:
    return some_pictures(tmp_path_factory.mktemp("pictures"))


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_rows_depend_neither_on_threads_nor_on_order(
    detector: Detector, pictures: PictureSet, threads: int
) -> None:
    work = Work((detector,), CAMERA)
    whole = replace(pictures, pictures=pictures.pictures[:2])
    todo = list(blocks(whole, PLAN))
    expected = {block: timeless(work.open(1).compute(block)) for block in todo}
    random.Random(threads).shuffle(todo)
    for block, answer in ThreadEngine(threads).map(work, todo):
        assert isinstance(answer, list)
        assert timeless(answer) == expected.pop(block)
    assert not expected


@pytest.mark.slow
def test_processes_give_what_threads_give(detector: Detector, pictures: PictureSet, tmp_path: Path) -> None:
    """Rows, pictures, what could not be read, and how many values were not finite, for a reader that gives NaN."""
    rows = np.full((1, 3, 5), 0.2, np.float32)
    rows[0, 1, 2:4] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        broken = Recogniser(constant_reader(tmp_path / "nan.onnx", rows))
    done = {}
    for engine in (ThreadEngine(2), ProcessEngine(2)):
        # The copies of the models in other processes warn for the first time; here it was warned of on opening.
        told = pytest.warns(RuntimeWarning, match="nan.onnx: outputs contain NaN")
        with told if isinstance(engine, ProcessEngine) else warnings.catch_warnings():
            folder = tmp_path / type(engine).__name__
            done[type(engine)] = computed(folder, [detector, broken], pictures, engine)
    threads, processes = done[ThreadEngine], done[ProcessEngine]
    assert everything(tmp_path / "ProcessEngine") == everything(tmp_path / "ThreadEngine")
    assert processes.computed == threads.computed == 2 * count_cells(pictures, PLAN) // 3
    assert list(processes.skipped) == ["empty.png"]
    assert processes.skipped == threads.skipped
    # A box to read in every cell, two values each; the original picture is asked once.
    with Store(tmp_path / "ProcessEngine") as store:
        assert queries.non_finite_values(store) == {"nan": 2 * threads.computed, "small": 0}


@pytest.mark.parametrize("workers", [1, 3])
def test_blocks_are_taken_as_needed(detector: Detector, pictures: PictureSet, workers: int) -> None:
    taken = 0

    def counted() -> Iterator[Block]:
        nonlocal taken
        for block in blocks(replace(pictures, pictures=pictures.pictures[:2]), PLAN):
            taken += 1
            yield block

    answered = 0
    for _ in ThreadEngine(workers).map(Work((detector,), CAMERA), counted()):
        assert taken - answered <= 2 * workers
        answered += 1
    assert answered == taken > 6


@pytest.mark.slow
def test_a_picture_that_kills_its_process_is_named_and_skipped(
    detector: Detector, pictures: PictureSet, tmp_path: Path
) -> None:
    """After a second try; everything else is as if it were not there, and the next run takes it up once mended."""
    plan = swept((0.01,), (50.0,))
    good = pictures.pictures[0]
    deadly = Picture("deadly.png", good.targets, partial(os._exit, 9), good.identity)
    shown = replace(pictures, pictures=(good, deadly, replace(good, name="c.png")))
    with limited(560):
        outcome = computed(tmp_path / "run", [detector], shown, ProcessEngine(1), plan)
    assert outcome.workers_died == 2
    assert list(outcome.skipped) == ["deadly.png"]
    with Store(tmp_path / "run") as store:
        assert [cell["image"] for cell in store.cells()] == ["a.png", "a.png", "c.png", "c.png"]
        (skipped,) = store.skipped()
    assert skipped["image"] == "deadly.png"
    assert skipped["reason"] == outcome.skipped["deadly.png"]
    assert "died" in skipped["reason"]
    mended = replace(shown, pictures=(good, replace(deadly, load=good.load), shown.pictures[2]))
    outcome = computed(tmp_path / "run", [detector], mended, ThreadEngine(1), plan)
    assert (outcome.resumed, outcome.computed) == (4, 2)
    computed(tmp_path / "anew", [detector], mended, ThreadEngine(1), plan)
    assert everything(tmp_path / "run") == everything(tmp_path / "anew")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="kills by SIGKILL")
def test_a_process_that_is_killed_is_replaced(
    detector: Detector, pictures: PictureSet, tmp_path: Path
) -> None:
    """Killed once, at the picture it reads, as if from outside; the picture is then read by another."""
    first = pictures.pictures[0]
    fatal = replace(first, load=partial(killed_once, tmp_path / "killed", first.load))
    with limited(560):
        outcome = computed(
            tmp_path / "run",
            [detector],
            replace(pictures, pictures=(fatal, *pictures.pictures[1:])),
            ProcessEngine(2),
        )
    assert (tmp_path / "killed").exists()
    assert outcome.workers_died == 1
    assert list(outcome.skipped) == ["empty.png"]
    computed(tmp_path / "anew", [detector], pictures, ThreadEngine(2))
    assert everything(tmp_path / "run") == everything(tmp_path / "anew")


def test_a_worker_reads_a_picture_again_when_its_file_has_changed(
    pictures: PictureSet, detector: Detector
) -> None:
    """Workers of a cluster outlive a sweep."""
    first, second, _ = pictures.pictures
    worker = Work((detector,), CAMERA).open(2)
    changed = replace(second, name=first.name)
    block, other = (
        next(iter(blocks(replace(pictures, pictures=(picture,)), PLAN))) for picture in (first, changed)
    )
    assert timeless(worker.compute(block)) != timeless(worker.compute(other))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("engine", ["processes", "ray"])
@pytest.mark.parametrize("how", ["interrupted", "killed"])
def test_no_process_outlives_its_sweep(
    pictures: PictureSet, detector: Detector, tmp_path: Path, engine: str, how: str
) -> None:
    """Ctrl-C reaches every process of the terminal's group; kill -9 reaches only the first. The store is whole."""
    if engine == "ray":
        pytest.importorskip("ray")
    shown = datasets.image_folder(Path(pictures.source))
    command = ["sweep", "--model", str(detector.path), "--images", shown.source, "--exposure-ms", "1:60:1"]
    command += ["--lux", "50", "--dx", "0,300", "--gain", "auto", "--engine", engine, "--threads", "2"]
    command += ["--camera", "imx250"]
    command += ["-o", str(tmp_path / "run")]
    started = [sys.executable, "-m", "blurnoise_eval.cli", *command]
    process = subprocess.Popen(
        started, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, text=True
    )
    deadline = time.monotonic() + 560  # a killed driver's cluster goes a minute later
    while not _some_rows(tmp_path / "run"):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    family = descendants(process.pid)
    assert len(family) > 2
    if how == "interrupted":
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.kill()
    _, told = process.communicate(timeout=300)
    if how == "interrupted":
        assert process.returncode == 130
        assert told.strip().splitlines()[-1] == "blurnoise: interrupted; what was finished is kept"
        assert "Traceback" not in told
    while left := alive(family):
        assert time.monotonic() < deadline, left
        time.sleep(0.02)
    with Store(tmp_path / "run") as store:
        kept = len(list(store.cells()))
    assert kept > 0
    plan = swept(tuple(ms / 1e3 for ms in range(1, 61)), (50.0,), (0.0, 300.0), gain_db=("auto",))
    outcome = computed(tmp_path / "run", [detector], shown, ThreadEngine(2), plan)
    assert outcome.resumed == kept < kept + outcome.computed == 2 * count_cells(shown, plan) // 3
    computed(tmp_path / "anew", [detector], shown, ThreadEngine(2), plan)
    assert everything(tmp_path / "run") == everything(tmp_path / "anew")


def _some_rows(run: Path) -> bool:
    """Whether a run that is being computed has committed cells: read from a copy, its file being locked."""
    if not (run / "results.sqlite").exists():
        return False
    with tempfile.TemporaryDirectory() as folder:
        for file in run.glob("results.sqlite*"):
            shutil.copy(file, folder)
        with closing(sqlite3.connect(Path(folder, "results.sqlite"))) as copy, suppress(sqlite3.Error):
            return bool(copy.execute("SELECT count(*) FROM cells").fetchone()[0])
    return False


_FIRST_WORKER = """
import os, sys, time
from pathlib import Path
from blurnoise import Camera
from blurnoise_eval.sweep.engines.processes import _Pool
pool = _Pool(b"", 1)
pool.submit(None)
(number,) = pool._executor._processes
status = dict(line.split(":", 1) for line in Path(f"/proc/{number}/status").read_text().splitlines())
pool.stop()
sys.exit(not int(status["SigBlk"], 16) >> 1 & 1)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_no_interrupt_reaches_a_worker_that_begins() -> None:
    """The first of all, too, which Python begins right after a helper of its own: it takes seconds to import."""
    assert subprocess.run([sys.executable, "-c", _FIRST_WORKER], timeout=300, check=False).returncode == 0


_UNGUARDED = """
from blurnoise_eval import evaluate
evaluate(output="run", engine="processes", threads=2)
"""


@pytest.mark.slow
def test_a_program_that_starts_itself_again_is_told_why(tmp_path: Path) -> None:
    """Each worker imports the program that started it."""
    (tmp_path / "unguarded.py").write_text(_UNGUARDED)
    done = subprocess.run(
        [sys.executable, "unguarded.py"], cwd=tmp_path, stderr=subprocess.PIPE, text=True, timeout=500
    )
    assert "ChildProcessError: engine = 'processes': " in done.stderr.splitlines()[-1]
    assert "no if __name__ == '__main__'" in done.stderr.splitlines()[-1]


@pytest.mark.slow
def test_processes_stay_between_maps_of_the_same_work(detector: Detector, pictures: PictureSet) -> None:
    work, started = Work((detector,), CAMERA), set[int]()
    some = list(blocks(replace(pictures, pictures=pictures.pictures[:1]), swept((0.01,), (50.0,))))
    with staying(ProcessEngine(1)) as engine:
        for each in (work, work, replace(work, grey_anchor="mean")):
            assert len(list(engine.map(each, some))) == 1
            started |= {process.pid or 0 for process in multiprocessing.active_children()}
        assert len(started) == 2
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(("workers", "holders"), [(1, 1), (2, 2), (12, 2)])
def test_a_picture_goes_to_few_workers(pictures: PictureSet, workers: int, holders: int) -> None:
    """Every cell once and in order; a picture is split only where there are fewer pictures than workers."""
    plan = swept((0.01, 0.02, 0.04), (50.0, 100.0), (0.0, 300.0))
    many = replace(pictures, pictures=tuple(replace(pictures.pictures[0], name=f"{n}.png") for n in range(6)))
    whole = list(blocks(many, plan))
    shared = list(shared_out(iter(whole), workers))
    for picture in many:
        own = [block for block in shared if block.picture.name == picture.name]
        assert len(own) <= holders + 1  # one more where a group of blocks ends
        cells = [cell for block in whole if block.picture.name == picture.name for cell in block.cells]
        assert [cell for block in own for cell in block.cells] == cells
        examples = [block.examples for block in whole if block.picture.name == picture.name]
        assert frozenset().union(*(block.examples for block in own)) == frozenset().union(*examples)


@pytest.mark.slow
def test_what_does_not_pickle_is_named(detector: Detector, pictures: PictureSet) -> None:
    lambdas = replace(pictures.pictures[0], name="made up", load=lambda: np.zeros((9, 9, 3), np.uint8))
    work = Work((detector,), CAMERA)
    with pytest.raises(ValueError, match=r"picture 'made up' cannot be sent .*use 'threads'"):
        list(ProcessEngine(1).map(work, [Block(lambdas, ())]))
    with pytest.raises(ValueError, match="models cannot be sent"):
        list(ProcessEngine(1).map(replace(work, models=(lambda: None,)), []))  # type: ignore[arg-type]


def test_engines_by_name() -> None:
    assert engine_of("threads", 3) == ThreadEngine(3)
    assert engine_of("processes", 2) == ProcessEngine(2)
    with pytest.raises(ValueError, match=r"engine = 'rays': must be one of 'threads', 'processes', 'ray'"):
        engine_of("rays", 1)
    for name in ("threads", "processes"):
        with pytest.raises(ValueError, match=f"{name} = 0: must be >= 1"):
            engine_of(name, 0)


def test_ray_needs_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        ValueError, match=r"engine = 'ray': needs the package ray: pip install 'blurnoise\[ray\]'"
    ):
        engine_of("ray", 2)


@pytest.mark.parametrize("how", [{"workers": None, "address": "here:6379"}, {"workers": 3}])
def test_ray_by_name(how: dict[str, Any]) -> None:
    pytest.importorskip("ray")
    assert engine_of("ray", **how) == RayEngine(**how)
    with pytest.raises(ValueError, match=r"ray = 0: must be >= 1"):
        engine_of("ray", 0)


def pictures_of(kind: str, folder: Path) -> PictureSet:
    """Two pictures, the first with a sign."""
    if kind == "rendered":
        return datasets.rendered_signs()
    for name, value in (("a.png", 50), ("b.png", 90)):
        datasets.write_picture(folder / name, np.full((20, 30, 3), value, np.uint8))
    instances = {
        "images": [{"id": 1, "file_name": "a.png"}, {"id": 2, "file_name": "b.png"}],
        "categories": [{"id": 1, "name": "sign"}],
        "annotations": [{"id": 7, "image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4], "note": ["kept"]}],
    }
    (folder / "coco.json").write_text(json.dumps(instances))
    return datasets.coco(folder / "coco.json") if kind == "coco" else datasets.image_folder(folder)


@pytest.mark.parametrize("kind", ["coco", "folder", "rendered"])
def test_work_and_blocks_of_every_kind_of_pictures_travel(
    kind: str, tmp_path: Path, detector: Detector
) -> None:
    shown = pictures_of(kind, tmp_path)
    plan = swept((0.01,), (50.0,))
    work = Work((detector,), CAMERA)
    sent, copies = pickle.loads(pickle.dumps((work, list(blocks(shown, plan)))))
    assert sent.camera == CAMERA
    for block, copy in zip(blocks(shown, plan), copies, strict=True):
        ours, theirs = block.picture, copy.picture
        assert (copy.cells, copy.examples) == (block.cells, block.examples)
        assert (theirs.name, theirs.targets, theirs.image_id) == (ours.name, ours.targets, ours.image_id)
        assert [t.annotation for t in theirs.targets or ()] == [t.annotation for t in ours.targets or ()]
        np.testing.assert_array_equal(theirs.load(), ours.load())
    assert pickle.loads(pickle.dumps(shown)).categories == shown.categories
