"""Ray's tasks: the rows of the threads, whatever dies. Two nodes of one core each, and one for the driver alone."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.engines import RayEngine, ThreadEngine
from plans import plan as swept
from ray_clusters import MEMORY, ray_cluster, tried
from small_sweeps import (
    computed,
    everything,
    killed_once,
    lasting_once,
    limited,
    small_detector,
    some_pictures,
)

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.slow
LONGEST_S = 560
LEAST = 241 + 8  # cells settled: those of the picture that cannot be read, and a block
LONG = swept(tuple(ms / 1e3 for ms in range(1, 61)), (50.0, 200.0), (0.0, 300.0))


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return small_detector(tmp_path_factory.mktemp("model"))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> PictureSet:
    return some_pictures(tmp_path_factory.mktemp("pictures"))


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Connected; the node of the driver has no core to compute on."""
    with ray_cluster(0) as cluster:
        with limited(LONGEST_S):
            ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
        yield cluster


@pytest.fixture
def nodes(cluster: Any) -> list[Any]:
    """Two nodes of a core each, put back where a test has lost one."""
    with limited(LONGEST_S):
        while len(cluster.worker_nodes) < 2:
            tried(lambda: cluster.add_node(num_cpus=1, object_store_memory=MEMORY))
        cluster.wait_for_nodes()
    return list(cluster.worker_nodes)


@pytest.fixture(scope="module")
def expected(detector: Detector, pictures: PictureSet, tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    folder = tmp_path_factory.mktemp("expected")
    computed(folder, [detector], pictures, ThreadEngine(2), LONG)
    return everything(folder)


def after(cells: int, act: Callable[[], None]) -> Callable[[int], None]:
    """Act once, when so many cells are settled."""
    settled, acted = 0, False

    def told(more: int) -> None:
        nonlocal settled, acted
        settled += more
        if settled >= cells and not acted:
            acted = True
            act()

    return told


@pytest.mark.usefixtures("nodes")
def test_tasks_give_what_threads_give(
    detector: Detector, pictures: PictureSet, tmp_path: Path, expected: list[Any]
) -> None:
    with limited(LONGEST_S):
        outcome = computed(tmp_path, [detector], pictures, RayEngine(2), LONG)
    assert everything(tmp_path) == expected
    assert outcome.workers_died == 0
    assert list(outcome.skipped) == ["empty.png"]
    assert ray.is_initialized()  # as before


@pytest.mark.usefixtures("nodes")
def test_a_worker_that_is_killed_is_replaced(
    detector: Detector, pictures: PictureSet, tmp_path: Path, expected: list[Any]
) -> None:
    first, *others = pictures.pictures
    # another identity: a worker of the test before may hold the picture prepared
    fatal = replace(first, load=partial(killed_once, tmp_path / "killed", first.load), identity="killed once")
    shown = replace(pictures, pictures=(fatal, *others))
    with limited(LONGEST_S):
        outcome = computed(tmp_path / "run", [detector], shown, RayEngine(2), LONG)
    assert (tmp_path / "killed").exists()
    assert outcome.workers_died == 0  # Ray itself has computed its task again
    assert list(outcome.skipped) == ["empty.png"]
    assert everything(tmp_path / "run") == expected


@pytest.mark.usefixtures("nodes")
def test_a_picture_that_kills_its_worker_is_named_and_skipped(
    detector: Detector, pictures: PictureSet, tmp_path: Path
) -> None:
    plan = swept((0.01,), (50.0,))
    good = pictures.pictures[0]
    deadly = Picture("deadly.png", good.targets, os.abort, good.identity)
    shown = replace(pictures, pictures=(good, deadly, replace(good, name="c.png")))
    with limited(LONGEST_S):
        outcome = computed(tmp_path / "run", [detector], shown, RayEngine(2), plan)
    assert outcome.workers_died == 2
    assert list(outcome.skipped) == ["deadly.png"]
    assert "died" in outcome.skipped["deadly.png"]
    whole = replace(shown, pictures=(good, shown.pictures[2]))
    computed(tmp_path / "anew", [detector], whole, ThreadEngine(1), plan)
    ours, theirs = everything(tmp_path / "run"), everything(tmp_path / "anew")
    assert ours[:3] == theirs[:3]


def test_a_node_that_is_lost_costs_nothing(
    detector: Detector,
    pictures: PictureSet,
    tmp_path: Path,
    expected: list[Any],
    cluster: Any,
    nodes: list[Any],
) -> None:
    """Lost while its worker reads a picture, whichever of the two that is."""
    first, *others = pictures.pictures
    read, ended = tmp_path / "read", threading.Event()
    lasting = replace(first, load=partial(lasting_once, read, first.load), identity="lasting once")

    def lose() -> None:
        while not read.exists() and not ended.wait(0.02):
            pass
        raylet = int(read.read_text())
        (node,) = (node for node in nodes if node.all_processes["raylet"][0].process.pid == raylet)
        cluster.remove_node(node, allow_graceful=False)

    loser = threading.Thread(target=lose, daemon=True)
    loser.start()
    with limited(LONGEST_S):
        shown = replace(pictures, pictures=(lasting, *others))
        outcome = computed(tmp_path / "run", [detector], shown, RayEngine(2), LONG)
    ended.set()
    loser.join()
    assert outcome.workers_died == 0
    assert list(outcome.skipped) == ["empty.png"]
    assert everything(tmp_path / "run") == expected


def test_without_any_node_the_run_ends_and_its_store_is_whole(
    detector: Detector,
    pictures: PictureSet,
    tmp_path: Path,
    expected: list[Any],
    cluster: Any,
    nodes: list[Any],
) -> None:
    engine = RayEngine(2)

    def remove_all() -> None:
        for node in nodes:
            cluster.remove_node(node, allow_graceful=False)
        engine.patience_s = 3.0

    with (
        limited(LONGEST_S),
        pytest.raises(ChildProcessError, match=r"engine = 'ray': no worker was available for 3.0 s"),
    ):
        computed(tmp_path, [detector], pictures, engine, LONG, after(LEAST, remove_all))
    with Store(tmp_path) as store:
        kept = len(list(store.cells()))
    assert kept > 0
    outcome = computed(tmp_path, [detector], pictures, ThreadEngine(2), LONG)
    assert outcome.resumed == kept
    assert everything(tmp_path) == expected
