"""A search: few nodes, edges found, always the same; and what it does where the surface is none."""

import numpy as np
import populations_on_planes as made
import pytest
from blurnoise_eval.run.edge_search import EdgeSearch
from blurnoise_eval.run.surface import Predicted
from made_tables import on_plane

GRID = 10 * len(made.LINES)  # conditions of the matching grid


def search(level=0.8, lines=made.LINES, most_nodes=72):
    return EdgeSearch(lines, made.EXPOSURES, level, most_nodes=most_nodes)


def predicted(found, rates, references=made.REFERENCES):
    nodes = found.nodes
    counts = np.repeat(references[:, None], len(nodes), axis=1)
    return Predicted(on_plane(nodes, rates(nodes) * counts, counts))


def test_few_nodes_find_the_edges():
    """A quarter of the grid's calls; half of the edges within 0.05 stops, the rest within a quarter; none missed."""
    found = search((0.8, 0.9))
    asked = made.searched(found, made.photographs)
    assert found.done
    assert found.precise
    assert not found.not_smooth
    assert sum(map(len, asked)) == len(found.nodes) <= GRID / 4
    surface = predicted(found, made.photographs)

    def mean(places):
        sums, counts = surface.on(places)
        return np.asarray(sums.sum(axis=0) / counts.sum(axis=0))

    for level in (0.8, 0.9):
        errors = []
        for line in made.LINES:
            own = made.edges(mean, line, level)
            for edge in made.edges(lambda places: made.seen(made.photographs, places).mean, line, level):
                errors.append(min((abs(edge - each) for each in own), default=np.inf))
        assert len(errors) > 10
        assert np.median(errors) < 0.05
        assert max(errors) < 0.25


@pytest.mark.slow
def test_a_notch_is_answered_by_the_lattice():
    found = search()
    made.searched(found, made.notched)
    assert found.not_smooth
    assert found.done
    assert len(found.nodes) == len(found.lattice)
