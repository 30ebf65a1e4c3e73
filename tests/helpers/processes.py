"""Processes that are killed and counted, and clusters of Ray, begun again where one does not come up."""

import os
import signal
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import pytest

MEMORY = 80_000_000  # bytes, of each node's store
_TRIES = 4  # Ray gives a node 30 s, busy or not
T = TypeVar("T")


@contextmanager
def ray_cluster(cores):
    """A cluster whose head has so many cores; its workers import what stands in this folder."""
    import ray
    from ray.cluster_utils import Cluster

    head = {"num_cpus": cores, "include_dashboard": False, "object_store_memory": MEMORY}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", with_helpers())
        cluster = tried(lambda: Cluster(initialize_head=True, head_node_args=head), ray.shutdown)
        try:
            yield cluster
        finally:
            ray.shutdown()
            cluster.shutdown()


def tried(begin, clean=lambda: None):
    """What begins on a machine that may be busy."""
    for tries_left in reversed(range(_TRIES)):
        try:
            return begin()
        except Exception:  # Ray's own are plain ones
            clean()
            if not tries_left:
                raise
    raise AssertionError


def with_helpers():
    """PYTHONPATH with this folder."""
    return os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])


def lasting_once(told, load):
    """What ``load`` gives, but the first of all processes to ask never has it. The file tells whose child that is."""
    if told.exists():
        return load()
    written = told.with_suffix(".new")
    written.write_text(f"{os.getppid()}")
    written.replace(told)
    return threading.Event().wait()


def process_states():
    """State, parent and time of start of every process, by its number. Linux."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = stat.read_text()
        except OSError:  # gone meanwhile
            continue
        fields = text[text.rindex(")") + 2 :].split()
        found[int(stat.parent.name)] = fields[0], int(fields[1]), fields[19]
    return found


def descendants(process):
    """Numbers and times of start of a process and all that it and its children began."""
    states = process_states()
    family = {process}
    while more := {number for number, (_, parent, _) in states.items() if parent in family} - family:
        family |= more
    return {(number, states[number][2]) for number in family if number in states}


def alive(family):
    """Those of the family that still run."""
    return family & {
        (number, began) for number, (state, _, began) in process_states().items() if state != "Z"
    }


@contextmanager
def limited(seconds):
    """Raise ``TimeoutError`` inside after so long. Main thread."""

    def stop(*_):
        raise TimeoutError(f"not done after {seconds:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
