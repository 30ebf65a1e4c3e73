"""A search replayed on what a real detector says, recorded at every node of the plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.bench import decide
from blurnoise_eval.deciding.search import Search

RECORDED = Path(__file__).parents[2] / "data" / "planes-fixed.npz"


def recorded() -> decide.Truth:
    """The built-in detector before 8 pictures of signs: few, and with cliffs."""
    with np.load(RECORDED) as file:
        places, sums, clean = (file[name].astype(float) for name in ("places", "sums", "clean"))
    known = clean.sum(axis=1) >= 1
    sums, clean = sums[known], clean[known]
    total = clean.sum(axis=1)[:, None]
    kept = sums.sum(axis=1) / total
    away = sums - kept[:, None] * clean[:, :, None]
    return decide.Truth(places, kept, np.sqrt((away**2).sum(axis=1)) / total)


@pytest.mark.slow
def test_46_nodes_are_nearer_than_a_grid_of_120_conditions() -> None:
    truth = recorded()
    found = {each.name: each.call() for each in decide.case(truth).contenders}
    wrong = {name: truth.stops_wrong(values) for name, (values, _) in found.items()}
    assert found["grid of 6 exposures"][1] == 120
    assert wrong["grid of 4 exposures"] > wrong["grid of 10 exposures"] > wrong["grid of 16 exposures"]
    search = Search(truth.lines, decide.EXPOSURES, decide.LEVELS)
    while len(search.nodes) < 46:
        places = search.ask()
        search.tell(places, *truth.seen(places))
    assert truth.stops_wrong(truth.through(search.nodes)) < wrong["grid of 6 exposures"]
    assert wrong["decide's search"] <= wrong["grid of 10 exposures"]
