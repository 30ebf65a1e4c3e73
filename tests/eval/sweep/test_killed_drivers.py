"""Drivers that are killed over and over, and begun again: the rows of a run that nothing broke, and nothing is lost.

When they are killed is told in cells that they have settled, by a fixed seed; how far they get until it reaches them
depends on the machine, what comes of it does not.
"""

from __future__ import annotations

import os
import pickle
import random
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.engines import ThreadEngine
from blurnoise_eval.sweep.work import count_cells
from blurnoise_eval.system.urls import location
from blurnoise_eval.system.working_folder import read_run
from plans import plan as swept
from ray_clusters import ray_cluster, with_helpers
from s3_servers import BUCKET, at, s3_server
from small_sweeps import computed, everything, limited, small_detector, some_pictures

pytestmark = pytest.mark.slow
PLAN = swept(tuple(ms / 1e3 for ms in range(1, 13)), (50.0, 200.0), (0.0, 300.0))

_DRIVER = """
import pickle, sys
from pathlib import Path
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.engines import RayEngine, ThreadEngine
from blurnoise_eval.sweep.run import run
from blurnoise_eval.system import working_folder
from blurnoise_eval.system.urls import location
from small_sweeps import CAMERA
given, where, address = sys.argv[1:]
detector, pictures, plan = pickle.loads(Path(given).read_bytes())
engine = RayEngine(2, address) if address else ThreadEngine(2)
with working_folder.written_run(location(where)) as folder, Store(folder.path, create=True) as store:
    run(
        [detector], CAMERA, pictures, plan, store, engine=engine, progress=lambda cells: print(cells, flush=True)
    )
"""


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> tuple[Detector, PictureSet]:
    shown = some_pictures(tmp_path_factory.mktemp("pictures"))
    return small_detector(tmp_path_factory.mktemp("model")), replace(shown, pictures=shown.pictures[:2])


@pytest.fixture(scope="module")
def unbroken(given: tuple[Detector, PictureSet], tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    folder = tmp_path_factory.mktemp("unbroken")
    computed(folder, [given[0]], given[1], ThreadEngine(2), PLAN)
    return everything(folder)


def driven(command: list[str], kill_at: int | None, env: dict[str, str]) -> int:
    """Begin a driver and kill it once it has settled so many cells, None: never. How many it was heard to have."""
    settled = 0
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": with_helpers(), **env},
    ) as driver:
        assert driver.stdout is not None
        for line in driver.stdout:
            settled += int(line)
            if kill_at is not None and settled >= kill_at:
                driver.kill()
                break
        _, complaint = driver.communicate()
    assert kill_at is not None or driver.returncode == 0, complaint
    assert kill_at is None or settled >= kill_at, complaint
    return settled


def moments(given: tuple[Detector, PictureSet], seed: int, count: int) -> Iterator[int]:
    """When to kill: at the first sign of life, and later and later."""
    cells = count_cells(given[1], PLAN)
    yield 1
    yield from sorted(random.Random(seed).sample(range(2, cells - 10), count - 1))


def command(given: tuple[Detector, PictureSet], folder: Path, where: object, address: str = "") -> list[str]:
    (folder / "given").write_bytes(pickle.dumps((*given, PLAN)))
    return [sys.executable, "-c", _DRIVER, str(folder / "given"), str(where), address]


def test_with_actors(given: tuple[Detector, PictureSet], tmp_path: Path, unbroken: list[Any]) -> None:
    """What a driver was heard to have settled, the next finds."""
    pytest.importorskip("ray")
    run = tmp_path / "run"
    with limited(550), ray_cluster(2) as cluster:
        driver = command(given, tmp_path, run, cluster.address)
        for kill_at in moments(given, 7, 2):
            settled = driven(driver, kill_at, {})
            with Store(run) as store:
                assert len(list(store.cells())) >= settled
        assert driven(driver, None, {}) == count_cells(given[1], PLAN)
    assert everything(run) == unbroken


def test_with_a_run_on_s3(
    given: tuple[Detector, PictureSet], tmp_path: Path, unbroken: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is killed goes on from what its machine has, and is put in the end; another machine reads it."""
    pytest.importorskip("s3fs")
    where = f"s3://{BUCKET}/run"
    with limited(550), s3_server() as server:
        at(server, monkeypatch.setenv)
        import s3fs

        s3fs.S3FileSystem(skip_instance_cache=True).mkdir(BUCKET)
        driver = command(given, tmp_path, where)
        for kill_at in [*moments(given, 8, 3), None]:
            settled = driven(driver, kill_at, {"BLURNOISE_CACHE": str(tmp_path / "machine")})
        assert settled == count_cells(given[1], PLAN)
        monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "reader"))
        with read_run(location(where)) as folder:
            assert everything(folder.path) == unbroken
