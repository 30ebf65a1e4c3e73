"""A decision: a run that a search has asked for, with its answers on the lines of its question.

The same tables, figures and page as of a sweep, but predicted from the nodes, with what they leave open in every
interval. Where the grid was computed instead, it is a sweep, and says why.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.deciding.kriging import Trend
from blurnoise_eval.deciding.predicted import predicted_table
from blurnoise_eval.deciding.question import Question
from blurnoise_eval.evaluation import Evaluation
from blurnoise_eval.report.run import RunData, Tables
from blurnoise_eval.report.words import counted
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.asked import asked
from blurnoise_eval.sweep.run_scores import withheld_models
from blurnoise_eval.sweep.score_tables import score_tables

_QUESTION = "question"  # under which a run's store keeps what was asked last
_OF_GRID = ("mpc", "rpc")  # means over a grid's conditions; a search's are where it looked
_PREDICTED = "Answers and curves are predicted from these; what that leaves open is in the intervals."


def note_question(store: Store, question: Question) -> None:
    """Keep what is asked of the run."""
    names = ("grid", "because", "cheaper")
    store.set_about(_QUESTION, {name: getattr(question, name) for name in names})


def question_of(store: Store) -> Question | None:
    """What was asked of the run last; None of a sweep. Raises ``StoreError`` for one of other software."""
    held = store.about(_QUESTION)
    try:
        return None if held is None else Question(**held)
    except TypeError:
        raise store.damaged(_QUESTION, "must have grid, because and cheaper") from None


def on_lines(store: Store, measured: Tables) -> Tables:
    """Tables that answer the run's question, by those that were measured; of a full grid these themselves."""
    question = question_of(store)
    if question is None or not question.searched:
        yield from measured
        return
    trend = Trend.of(Camera.from_dict(store.about("manifest")["camera"]))
    for table in measured:
        for seen in table.on_plane():
            yield predicted_table(seen, question, trend)


def answering(store: Store, criterion: Criterion, cluster: str | None) -> list[ScoreTable]:
    """The tables of all that has answers, on the lines of the run's question."""
    unfit = withheld_models(store, cluster)
    measured = (table for table in score_tables(store, criterion, cluster) if table.model not in unfit)
    return [table for table in on_lines(store, measured) if not table.knows_too_little]


def answers_of(store: Store, criterion: Criterion, cluster: str | None) -> list[dict[str, Any]]:
    """The answers of a run that a search has asked for, as ``Decision.answers`` has them."""
    return [answer for table in answering(store, criterion, cluster) for answer in answers(table, criterion)]


class Decision(Evaluation):
    """As :class:`Evaluation`; ``answers`` and ``curves`` are of the lines asked for, ``scores`` of the nodes.

    Of a run that no search has asked for it is an Evaluation.
    """

    _on_lines = staticmethod(on_lines)

    @cached_property
    def decided(self) -> dict[str, Any] | None:
        """How: ``nodes``, ``pictures``, ``cells`` that were asked for, ``grid_cells`` that the grid would take;
        ``because``: why it was a full grid. None of a run without a question."""
        with Store(self.folder, shared=True) as store:
            question, batches = question_of(store), asked(store)
            if question is None:
                return None
            repeats = store.about("identity")["plan"]["repeats"]
            n_pictures = batches[-1].n_pictures if batches else store.about("manifest")["images"]["count"]
        grid = question.grid_conditions
        nodes = sum(len(batch.conditions) for batch in batches) if question.searched else grid
        return {
            "nodes": nodes,
            "pictures": n_pictures,
            "cells": nodes * n_pictures * repeats,
            "grid_cells": grid * n_pictures * repeats,
            "because": [*question.because, *question.cheaper],
        }

    def how(self) -> list[str]:
        """In words: how many conditions it took, or why it was the full grid; none of another run."""
        of = self.decided
        if of is None:
            return []
        if of["because"]:
            return [f"A grid of {of['nodes']} conditions, not a search: {'; '.join(of['because'])}."]
        return [
            f"{counted(of['nodes'], 'condition')} before {counted(of['pictures'], 'picture')}:"
            f" {counted(of['cells'], 'cell')}, where the grid would take {of['grid_cells']} before it is refined."
        ]

    @property
    def summary(self) -> dict[str, Any]:
        """What summary.json holds, and ``decided``."""
        return {**super().summary, "decided": self.decided}

    @cached_property
    def data(self) -> RunData:
        """Everything that the page shows; of a search without what a grid would need."""
        data = super().data
        if self.decided is None:
            return data
        if self.decided["because"]:
            data.manifest["warnings"] += self.how()
            return data
        data.manifest["searched"] = [*self.how(), _PREDICTED]
        data.manifest["taken"] = [row for row in data.scores if not row["clean"]]
        unknown = {f"{name}{end}": None for name in _OF_GRID for end in ("", "_low", "_high")}
        return replace(data, models=[{**model, **unknown} for model in data.models])

    @property
    def _shown(self) -> RunData:
        if self.decided is None or self.decided["because"]:
            return self.data
        return replace(self.data, scores=[row for row in self.data.scores if row["clean"]])
