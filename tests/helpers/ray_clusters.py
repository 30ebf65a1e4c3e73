"""Clusters of Ray on this machine, begun again where one does not come up: Ray gives a node 30 s, busy or not."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest

MEMORY = 80_000_000  # bytes, of each node's store
_TRIES = 4
T = TypeVar("T")


@contextmanager
def ray_cluster(cores: int) -> Iterator[Any]:
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


def tried(begin: Callable[[], T], clean: Callable[[], object] = lambda: None) -> T:
    """What begins on a machine that may be busy."""
    for tries_left in reversed(range(_TRIES)):
        try:
            return begin()
        except Exception:  # Ray's own are plain ones
            clean()
            if not tries_left:
                raise
    raise AssertionError


def with_helpers() -> str:
    """PYTHONPATH with this folder."""
    return os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])
