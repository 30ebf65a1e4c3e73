"""Scores at nodes: sums of a run's tables, conditions of one node together."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.maps.nodes import at_nodes, nodes_at
from made_maps import KEEP, row
from made_tables import table
from plans import IMX250


def test_conditions_of_one_node_are_summed_and_clusters_left_out() -> None:
    """50 lux x 10 ms is 25 lux x 20 ms; picture c is only in the second light."""
    plane = nodes_at([row(0.01, 50.0), row(0.02, 25.0), row(0.04, 25.0)], IMX250, ())
    sums = np.array([[[1.0], [0.0], [0.0]], [[0.2], [0.4], [0.9]], [[0.0], [0.6], [0.0]]])
    counts = np.array([[[2.0], [0.0], [0.0]], [[1.0], [1.0], [1.0]], [[0.0], [3.0], [0.0]]])
    of_lights = table(sums, [0.01, 0.02, 0.04], counts=counts, kept=True)
    of_lights.conditions["illuminance_lux"][1:] = 25.0
    found = at_nodes(of_lights, plane, KEEP, 40.0)
    assert found.values == pytest.approx([2.2 / 7, 0.9])
    assert found.without[:, 0] == pytest.approx([1.2 / 5, 1.6 / 5, 1.6 / 4])
    assert found.without[0, 1] == pytest.approx(0.9)  # a is not there
    assert np.isnan(found.without[1, 1])  # without b nothing is left
    assert found.enough.level == 0.9
    assert found.known.all()


def test_what_was_not_measured_is_not_told() -> None:
    plane = nodes_at([row(0.01, 50.0), row(0.02, 50.0)], IMX250, ())
    found = at_nodes(table(np.array([[[1.0]]]), [0.01], counts=2.0), plane, KEEP, 40.0)
    assert found.known.tolist() == [True, False]
