"""Ray's tasks: the rows of the threads, whatever dies. Two nodes of one core each, and one for the driver alone."""

import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import pytest
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.engines import RayEngine, ThreadEngine
from plans import plan as swept
from processes import MEMORY, lasting_once, limited, ray_cluster, tried
from signs_in_memory import computed, everything, some_pictures

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.slow
LONGEST_S = 560
LEAST = 241 + 8  # cells settled: those of the picture that cannot be read, and a block
LONG = swept(tuple(ms / 1e3 for ms in range(1, 61)), (50.0, 200.0), (0.0, 300.0))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    return some_pictures(tmp_path_factory.mktemp("pictures"))


@pytest.fixture(scope="module")
def cluster():
    """Connected; the node of the driver has no core to compute on."""
    with ray_cluster(0) as cluster:
        with limited(LONGEST_S):
            ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
        yield cluster


@pytest.fixture
def nodes(cluster):
    """Two nodes of a core each, put back where a test has lost one."""
    with limited(LONGEST_S):
        while len(cluster.worker_nodes) < 2:
            tried(lambda: cluster.add_node(num_cpus=1, object_store_memory=MEMORY))
        cluster.wait_for_nodes()
    return list(cluster.worker_nodes)


@pytest.fixture(scope="module")
def expected(detector, pictures, tmp_path_factory):
    folder = tmp_path_factory.mktemp("expected")
    computed(folder, [detector], pictures, ThreadEngine(2), LONG)
    return everything(folder)


def test_a_node_that_is_lost_costs_nothing(detector, pictures, tmp_path, expected, cluster, nodes):
    """Lost while its worker reads a picture, whichever of the two that is."""
    first, *others = pictures.pictures
    read, ended = tmp_path / "read", threading.Event()
    # another identity: a worker of the test before may hold the picture prepared
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
    assert (outcome.workers_died, list(outcome.skipped)) == (0, ["empty.png"])
    assert everything(tmp_path / "run") == expected


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


def test_without_any_node_the_run_ends_and_its_store_is_whole(
    detector, pictures, tmp_path, expected, cluster, nodes
):
    engine = RayEngine(2)

    def remove_all() -> None:
        for node in nodes:
            cluster.remove_node(node, allow_graceful=False)
        engine.patience_s = 3.0

    gone = pytest.raises(ChildProcessError, match=r"engine = 'ray': no worker was available for 3.0 s")
    with limited(LONGEST_S), gone:
        computed(tmp_path, [detector], pictures, engine, LONG, progress=after(LEAST, remove_all))
    with Store(tmp_path) as store:
        kept = len(list(store.cells()))
    assert kept > 0
    outcome = computed(tmp_path, [detector], pictures, ThreadEngine(2), LONG)
    assert outcome.resumed == kept
    assert everything(tmp_path) == expected
