"""Whoever computes a sweep, in whatever order: the same rows; and what happens when a worker does not come back."""

import importlib.util
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import warnings
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from band_readers import constant_reader
from blurnoise_eval import datasets
from blurnoise_eval.datasets import Picture
from blurnoise_eval.detectors.ocr import Recogniser
from blurnoise_eval.plan.plan import usual_plan
from blurnoise_eval.run.engines import ProcessEngine, ThreadEngine, engine_of
from blurnoise_eval.run.work import Block, Work, blocks, count_cells
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from plans import plan as swept
from processes import alive, descendants, limited
from signs_in_memory import CAMERA, computed, everything, some_pictures, timeless

PLAN = swept((0.002, 0.0123, 0.03), (3.0, 333.3), (0.0, 333.3), repeats=2)
ONE = swept((0.01,), (50.0,))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    return some_pictures(tmp_path_factory.mktemp("pictures"))


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_rows_depend_neither_on_threads_nor_on_order(detector, pictures, threads):
    """And blocks are taken as they are needed, so that a set may be larger than memory."""
    work = Work((detector,), CAMERA, usual_plan())
    todo = list(blocks(replace(pictures, pictures=pictures.pictures[:2]), PLAN))
    expected = {block: timeless(work.open(1).compute(block)) for block in todo}
    random.Random(threads).shuffle(todo)
    taken = 0

    def counted():
        nonlocal taken
        for block in todo:
            taken += 1
            yield block

    for answered, (block, answer) in enumerate(ThreadEngine(threads).map(work, counted())):
        assert taken - answered <= 2 * threads
        assert isinstance(answer, list)
        assert timeless(answer) == expected.pop(block)
    assert not expected


@pytest.mark.slow
def test_processes_give_what_threads_give(detector, pictures, tmp_path):
    """Rows, pictures, what could not be read, and how many values were not finite, for a reader that gives NaN."""
    rows = np.full((1, 3, 5), 0.2, np.float32)
    rows[0, 1, 2:4] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        broken = Recogniser(constant_reader(tmp_path / "nan.onnx", rows))
    threads = computed(tmp_path / "threads", [detector, broken], pictures, ThreadEngine(2), PLAN)
    # once more, by the copies there
    with pytest.warns(RuntimeWarning, match="nan.onnx: the outputs contain NaN"):
        processes = computed(tmp_path / "processes", [detector, broken], pictures, ProcessEngine(2), PLAN)
    assert everything(tmp_path / "processes") == everything(tmp_path / "threads")
    assert processes.computed == threads.computed == 2 * count_cells(pictures, PLAN) // 3
    assert list(processes.skipped) == list(threads.skipped) == ["empty.png"]
    # A box to read in every cell, two values each; the original picture is asked once.
    with Store(tmp_path / "processes") as store:
        assert queries.non_finite_values(store) == {"nan": 2 * threads.computed, "small": 0}


@pytest.mark.slow
def test_a_picture_that_kills_its_process_is_named_and_skipped(detector, pictures, tmp_path):
    """After a second try; everything else is as if it were not there, and the next run takes it up once mended."""
    good = pictures.pictures[0]
    deadly = Picture("deadly.png", good.targets, partial(os._exit, 9), good.identity)
    shown = replace(pictures, pictures=(good, deadly, replace(good, name="c.png")))
    with limited(560):
        outcome = computed(tmp_path / "run", [detector], shown, ProcessEngine(1), ONE)
    assert outcome.workers_died == 2
    assert "died" in outcome.skipped["deadly.png"]
    with Store(tmp_path / "run") as store:
        assert [cell.image for cell in store.cells()] == ["a.png", "a.png", "c.png", "c.png"]
        skipped = {row.image: row.reason for row in store.skipped()}
    assert skipped == outcome.skipped
    mended = replace(shown, pictures=(good, replace(deadly, load=good.load), shown.pictures[2]))
    outcome = computed(tmp_path / "run", [detector], mended, ThreadEngine(1), ONE)
    assert (outcome.resumed, outcome.computed) == (4, 2)
    computed(tmp_path / "anew", [detector], mended, ThreadEngine(1), ONE)
    assert everything(tmp_path / "run") == everything(tmp_path / "anew")


def test_a_worker_reads_a_picture_again_when_its_file_has_changed(pictures, detector):
    """Workers of a cluster outlive a sweep."""
    first, second, _ = pictures.pictures
    worker = Work((detector,), CAMERA, usual_plan()).open(2)
    block, other = (
        next(iter(blocks(replace(pictures, pictures=(each,)), PLAN)))
        for each in (first, replace(second, name=first.name))
    )
    assert timeless(worker.compute(block)) != timeless(worker.compute(other))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("engine", ["processes", "ray"])
@pytest.mark.parametrize("how", ["interrupted", "killed"])
def test_no_process_outlives_its_sweep(pictures, detector, tmp_path, engine, how):
    """Ctrl-C reaches every process of the terminal's group; kill -9 reaches only the first. The store is whole."""
    if engine == "ray":
        pytest.importorskip("ray")
    shown = datasets.image_folder(Path(pictures.source))
    words = f"sweep --exposure-ms 1:60:1 --lux 50 --dx 0,300 --gain auto --engine {engine} --threads 2"
    (tmp_path / "plan.yaml").write_text("picture_tone: srgb\n")  # as in the plan below, of no photographs
    words += f" --plan {tmp_path / 'plan.yaml'} --camera imx250 --model {detector.path}"
    words += f" --images {shown.source} -o {tmp_path / 'run'}"
    process = subprocess.Popen(
        [sys.executable, "-m", "blurnoise_eval.cli", *words.split()],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, text=True,
    )  # fmt: skip
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
        assert process.returncode == -signal.SIGINT
        assert told.strip().splitlines()[-1] == "blurnoise: interrupted; finished work is kept"
        assert "Traceback" not in told
    while left := alive(family):
        assert time.monotonic() < deadline, left
        time.sleep(0.02)
    with Store(tmp_path / "run") as store:
        kept = len(list(store.cells()))
    plan = swept(tuple(ms / 1e3 for ms in range(1, 61)), (50.0,), (0.0, 300.0), gain_db=("auto",))
    outcome = computed(tmp_path / "run", [detector], shown, ThreadEngine(2), plan)
    assert 0 < outcome.resumed == kept < kept + outcome.computed == 2 * count_cells(shown, plan) // 3
    computed(tmp_path / "anew", [detector], shown, ThreadEngine(2), plan)
    assert everything(tmp_path / "run") == everything(tmp_path / "anew")


def _some_rows(run):
    """Whether a run that is being computed has committed cells: read from a copy, its file being locked."""
    if not (run / "results.sqlite").exists():
        return False
    with tempfile.TemporaryDirectory() as folder:
        for file in run.glob("results.sqlite*"):
            shutil.copy(file, folder)
        with closing(sqlite3.connect(Path(folder, "results.sqlite"))) as copy, suppress(sqlite3.Error):
            return bool(copy.execute("SELECT count(*) FROM cells").fetchone()[0])
    return False


@pytest.mark.slow
def test_what_does_not_pickle_is_named(detector, pictures):
    lambdas = replace(pictures.pictures[0], name="made up", load=lambda: np.zeros((9, 9, 3), np.uint8))
    work = Work((detector,), CAMERA, usual_plan())
    with pytest.raises(ValueError, match=r"picture 'made up' cannot be sent .*use 'threads'"):
        list(ProcessEngine(1).map(work, [Block(lambdas, ())]))


def test_engines_by_name(monkeypatch):
    assert engine_of("threads", 3) == ThreadEngine(3)
    assert engine_of("processes", 2) == ProcessEngine(2)
    with pytest.raises(ValueError, match=r"engine = 'rays': must be one of 'threads', 'processes', 'ray'"):
        engine_of("rays", 1)
    for name in ("threads", "processes"):
        with pytest.raises(ValueError, match=f"{name} = 0: must be >= 1"):
            engine_of(name, 0)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"'ray': needs the package ray: pip install 'blurnoise\[ray\]'"):
        engine_of("ray", 2)
