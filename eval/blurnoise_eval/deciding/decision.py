"""A decision: a run that a search has asked for, with its answers on the lines of its question.

The same tables, figures and page as of a sweep: what stands at a tested exposure there is predicted here, from the
nodes, with what they leave open in every interval. Where the plane did not hold it is a sweep, and says why.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

from blurnoise.camera import Camera
from blurnoise_eval.deciding.observed import observed
from blurnoise_eval.deciding.on_lines import predicted_surfaces
from blurnoise_eval.deciding.question import Question
from blurnoise_eval.deciding.trend import Trend
from blurnoise_eval.report.data import RunData
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.scoring.surfaces import Surface
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.asked import asked
from blurnoise_eval.sweep.evaluation import Evaluation
from blurnoise_eval.sweep.run_surfaces import grouped_surfaces

QUESTION, BECAUSE = "question", "not the plane because"
"""Under which a run's store keeps what was asked last, and why the plane does not hold."""
_GRID_EXPOSURES = 10  # of the grid that a search is compared with
_OF_GRID = ("mpc", "rpc")  # means over a grid's conditions; a search's are where it looked


def surfaces_on_lines(store: Store, criterion: Criterion, cluster: str | None) -> Iterator[list[Surface]]:
    """Those that answer the run's question, of one model and group together; of a full grid as they were measured."""
    if store.about(BECAUSE) or store.about(QUESTION) is None:
        yield from grouped_surfaces(store, criterion, cluster)
        return
    question = Question.from_dict(store.about(QUESTION))
    trend = Trend.of(Camera.from_dict(store.about("manifest")["camera"]))
    for seen in observed(store, criterion, cluster):
        yield list(predicted_surfaces(seen, question, trend))


class Decision(Evaluation):
    """As :class:`Evaluation`; ``answers`` and ``curves`` are of the lines asked for, ``scores`` of the nodes.

    Of a run that no search has asked for it is an Evaluation.
    """

    _surfaces_of = staticmethod(surfaces_on_lines)

    @cached_property
    def decided(self) -> dict[str, Any] | None:
        """How: ``nodes``, ``pictures``, ``cells`` that were asked for, ``grid_cells`` that as many exposures as
        ``grid_exposures`` would take; ``because``: why it was a full grid. None of a run without a question."""
        with Store(self.folder) as store:
            if store.about(QUESTION) is None:
                return None
            question, batches = Question.from_dict(store.about(QUESTION)), asked(store)
            repeats = store.about("identity")["plan"]["repeats"]
            because = store.about(BECAUSE)
            n_pictures = batches[-1].n_pictures if batches else store.about("manifest")["images"]["count"]
        n_nodes = sum(len(batch.conditions) for batch in batches)
        if because:
            n_nodes = math.prod(map(len, question.grid.values()))
        return {
            "nodes": n_nodes,
            "pictures": n_pictures,
            "cells": n_nodes * n_pictures * repeats,
            "grid_exposures": _GRID_EXPOSURES,
            "grid_cells": _GRID_EXPOSURES * len(question.lines) * n_pictures * repeats,
            "because": because,
        }

    def how(self) -> list[str]:
        """In words: how many conditions it took, or why it was the full grid; none of another run."""
        of = self.decided
        if of is None:
            return []
        if of["because"]:
            return [f"A grid of {of['nodes']} conditions, not a search: {'; '.join(of['because'])}."]
        return [
            f"{of['nodes']} conditions before {of['pictures']} pictures: {of['cells']} cells, where"
            f" {of['grid_exposures']} exposures under every light at every speed would take {of['grid_cells']}."
        ]

    @property
    def summary(self) -> dict[str, Any]:
        """What summary.json holds, and ``decided``."""
        return {**super().summary, "decided": self.decided}

    @cached_property
    def _data(self) -> RunData:
        data = super()._data
        if self.decided is None:
            return data
        if self.decided["because"]:
            data.manifest["warnings"] += self.how()
            return data
        ends = ("", "_low", "_high")
        unknown = dict.fromkeys(f"{name}{end}" for name in _OF_GRID for end in ends)
        return replace(data, models=[{**model, **unknown} for model in data.models])

    @property
    def _shown(self) -> RunData:
        if self.decided is None or self.decided["because"]:
            return self._data
        return replace(self._data, scores=[row for row in self._data.scores if row["clean"]])
