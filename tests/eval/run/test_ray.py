"""Ray's tasks: the rows of the threads, whatever dies. Two nodes of one core each, and one for the driver alone."""

import threading
from dataclasses import replace
from functools import partial

import pytest
from blurnoise_eval.datasets import rendered_signs
from blurnoise_eval.detectors.python_models import PythonDetector
from blurnoise_eval.run.engines import RayEngine, ThreadEngine
from plans import plan as swept
from processes import MEMORY, lasting_once, limited, ray_cluster, tried
from signs_in_memory import computed, everything, some_pictures

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.slow
LONGEST_S = 560
SHORT = swept((0.003, 0.03), (50.0,))
LONG = swept(tuple(ms / 1e3 for ms in range(1, 61)), (50.0, 200.0), (0.0, 300.0))


def test_functions_travel_by_value(detector, tmp_path):
    """Of a script, whose names a worker does not know, as of this test."""

    def find(picture):
        found = detector.detect(picture)
        return found.boxes_xyxy, found.scores, ["stop sign"] * len(found)

    model, pictures = PythonDetector(find, ("stop sign",)), rendered_signs((50,), count=2)
    computed(tmp_path / "expected", [model], pictures, ThreadEngine(2), SHORT)
    with limited(LONGEST_S):
        computed(tmp_path / "run", [model], pictures, RayEngine(1), SHORT)
    assert everything(tmp_path / "run") == everything(tmp_path / "expected")


def test_a_node_that_is_lost_costs_nothing(detector, tmp_path):
    """Lost while its worker reads a picture, whichever of the two that is; the driver's node has no core."""
    (tmp_path / "pictures").mkdir()
    pictures = some_pictures(tmp_path / "pictures")
    computed(tmp_path / "expected", [detector], pictures, ThreadEngine(2), LONG)
    first, *others = pictures.pictures
    read, ended = tmp_path / "read", threading.Event()
    lasting = replace(first, load=partial(lasting_once, read, first.load))

    def lose():
        while not read.exists() and not ended.wait(0.02):
            pass
        raylet = int(read.read_text())
        (node,) = (
            each for each in cluster.worker_nodes if each.all_processes["raylet"][0].process.pid == raylet
        )
        cluster.remove_node(node, allow_graceful=False)

    with ray_cluster(0) as cluster, limited(LONGEST_S):
        ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
        while len(cluster.worker_nodes) < 2:
            tried(lambda: cluster.add_node(num_cpus=1, object_store_memory=MEMORY))
        cluster.wait_for_nodes()
        loser = threading.Thread(target=lose, daemon=True)
        loser.start()
        shown = replace(pictures, pictures=(lasting, *others))
        outcome = computed(tmp_path / "run", [detector], shown, RayEngine(2), LONG)
        ended.set()
        loser.join()
    assert (outcome.workers_died, list(outcome.skipped)) == (0, ["empty.png"])
    assert everything(tmp_path / "run") == everything(tmp_path / "expected")
