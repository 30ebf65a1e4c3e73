"""Decisions: which exposures work, from few conditions.

A search asks for nodes of the plane of lux-seconds and pixels, a batch at a time. Each batch is computed into
the run's store, and the scores decide which nodes come next. So a run that was killed can be resumed, and a wider
question starts with the existing nodes. Where the plane does not hold, the full grid is computed, as in a sweep.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera
from blurnoise_eval.answers.clusters import check_cluster
from blurnoise_eval.answers.criterion import Criterion, criterion_for
from blurnoise_eval.answers.recommendation import MOST_COMMON
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.datasets import PictureSet, check_cut
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.evaluation import Evaluation, evaluate
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.report.run import RunData, Tables
from blurnoise_eval.report.words import counted
from blurnoise_eval.run import computing as sweep
from blurnoise_eval.run.computing import Outcome
from blurnoise_eval.run.contract_checks import contracts_chosen
from blurnoise_eval.run.engines import Engine, engine_facts, engine_of, staying
from blurnoise_eval.run.identity import begun_or_gone, note_models, open_run
from blurnoise_eval.run.run import ENOUGH, Batch, Place, ask, asked
from blurnoise_eval.run.score_tables import run_averages, score_tables, withheld_models
from blurnoise_eval.run.search import CHECKED, MOST_NODES, Search
from blurnoise_eval.run.search_space import (
    SearchSpace,
    conditions_at,
    direction_of_all,
    lattice,
    what_breaks,
)
from blurnoise_eval.run.surface import Trend, predicted_table
from blurnoise_eval.run.work import count_cells
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say
from blurnoise_eval.system.working_folder import WorkingFolder, working_folder

_QUESTION = "question"  # under which a run's store keeps what was asked last
_OF_GRID = ("mpc", "rpc")  # means over a grid's conditions; a search's are where it looked
_PREDICTED = "Answers and curves are predicted from these. The intervals include the error of prediction."
_SAME_PLACE = 1e-4  # stops: conditions are rounded
Array = NDArray[np.float64]


def decided(
    models: Sequence[Model],
    pictures: PictureSet,
    camera: Camera,
    plan: SweepPlan,
    question: Question,
    output: str | Path | WorkingFolder,
    *,
    engine: str | Engine = "threads",
    progress: bool | None = None,
) -> Decision:
    """Ask models which exposures of a plan's range work, in a folder; a decision begun there goes on.

    The other arguments are as of :func:`~blurnoise_eval.evaluation.evaluate`, which computes the plan's grid where
    the plane does not hold, or the grid is cheaper. Raises what that raises.
    """
    folder = working_folder(output)
    of_pictures = {"rendered": pictures.kind == "rendered", "labelled": pictures.labelled}
    criterion = criterion_for(question, reads=not isinstance(models[0], Detector), **of_pictures)
    check_cluster(question.cluster, (picture.name for picture in pictures))
    space = SearchSpace({name: plan.values(name) for name in plan.grid})
    most, grid = MOST_NODES + CHECKED, space.grid_conditions
    because = what_breaks(camera, space, plan.trajectory, pulsed=plan.pulsed)
    if not because:
        most = min(most, len(lattice(space.lines, space.exposures_s)))
        because = [f"the grid has {grid} conditions, and a search would need up to {most}"] * (grid < most)
    if progress:
        why = "; ".join(because) or f"a search over at most {most} conditions; the grid has {grid}"
        say(f"decide: {why}", error=True)
    if because:
        evaluate(list(models), pictures, camera, plan, question, folder, engine=engine, progress=progress)
        with Store(folder.path, create=True) as store:
            store.set_about(_QUESTION, asdict(replace(space, because=because)))
        return Decision(folder, question, progress=progress, trust=True)
    further = {name: (value,) for name, value in space.further.items()}
    nodes = replace(plan, grid=further, only=(), direction=direction_of_all(space.lines), vehicle=None)
    if nodes.cuts:
        check_cut(pictures, nodes.objects)
    conditions_at((0.0, 0.0), space.lines, space.exposures_s, space.further).exposure(camera)
    computed_by = engine_of(engine) if isinstance(engine, str) else engine
    with (
        begun_or_gone(folder.path, models, pictures),
        Store(folder.path, create=True) as store,
        staying(computed_by) as engine_kept,
    ):
        models, comparisons = contracts_chosen(models, pictures, say=progress)
        facts = {"command": folder.command, **engine_facts(computed_by)}
        open_run(store, models, camera, pictures, nodes, facts)
        store.set_about(_QUESTION, asdict(space))
        store.set_about(ENOUGH, vars(question))
        run = _Run(store, models, camera, pictures, nodes, space, criterion, engine_kept, progress)
        run.compute()
        note_models(store, models, pictures, comparisons, computed=run.outcome.computed)
    return Decision(folder, question, outcome=run.outcome, progress=progress, trust=True)


@dataclass(frozen=True)
class _Run:
    """A run that a search asks for, with all that its batches are computed with."""

    store: Store
    models: Sequence[Model]
    camera: Camera
    pictures: PictureSet
    plan: SweepPlan
    space: SearchSpace
    criterion: Criterion
    engine: Engine
    progress: bool | None
    outcome: Outcome = field(default_factory=Outcome)

    def compute(self) -> None:
        """Ask and compute, batch by batch, from the state of the store until nothing is left to ask."""
        if before := asked(self.store):  # until the run was stopped, or of a narrower question
            self._up_to(before)
        self._find_edges()
        while common := self._common():
            self._ask((), common)

    def _ask(self, places: Sequence[Place], conditions: Sequence[Conditions]) -> None:
        """Note a batch, then compute it."""
        ask(self.store, Batch(len(self.pictures), tuple(places), tuple(conditions)))
        self._up_to(asked(self.store))

    def _up_to(self, batches: Sequence[Batch]) -> None:
        """Compute every node of the batches for every picture."""
        nodes = tuple(at for batch in batches for at in batch.conditions)
        plan = replace(self.plan, only=nodes, examples=len(batches) == 1)
        cells = count_cells(self.pictures, plan)
        with ProgressBar(f"{len(nodes)} nodes", cells, self.progress) as advance:
            done = sweep.run(
                self.models, self.camera, self.pictures, plan, self.store,
                engine=self.engine, progress=advance, resumed=advance.already,
            )  # fmt: skip
        self.outcome.add(done)
        skipped = self.store.skipped()
        if len(skipped) == len(self.pictures):
            raise ValueError(f"images: none could be read (first: {skipped[0]['reason']})")

    def _find_edges(self) -> None:
        """Ask until the search is done, or no group of targets has a score that means something.

        The search is given each batch once; where the groups become others it begins anew with all of them.
        """
        search, used, groups = self._search(), 0, 0
        while not search.done:
            batches = [batch for batch in asked(self.store) if batch.places]
            if used == len(batches):
                places = [(u, w) for u, w in search.ask().tolist()]
                of = self.space.lines, self.space.exposures_s, self.space.further
                self._ask(places, [conditions_at(at, *of) for at in places])
                continue
            planes = [plane for table in self._tables() for plane in table.on_plane()]
            if not planes:
                return
            if len(planes) != groups:
                search, used, groups = self._search(), 0, len(planes)
            for batch in batches[used:]:
                values, errors = zip(*(_at(plane, batch.places) for plane in planes), strict=True)
                search.tell(batch.places, np.array(values), np.array(errors))
            used = len(batches)

    @cached_property
    def _withheld(self) -> Collection[str]:
        """Models without answers, by the original pictures, which are computed in the first batch."""
        return withheld_models(self.store, self.criterion.cluster)

    def _tables(self) -> Tables:
        """Those of what was measured that have answers."""
        for table in score_tables(self.store, self.criterion):
            if not table.knows_too_little and table.model not in self._withheld:
                yield table

    def _search(self) -> Search:
        lines, exposures_s, trend = self.space.lines, self.space.exposures_s, Trend.of(self.camera)
        return Search(lines, exposures_s, self.criterion.level, most_nodes=MOST_NODES, trend=trend)

    def _common(self) -> tuple[Conditions, ...]:
        """All lights and speeds at the exposure that is recommended for all of them, where no near one was measured
        there; nothing where each model has one, or ``MOST_COMMON`` exposures."""
        tables = on_lines(self.store, self._tables())
        models = run_averages(self.store, tables, self.criterion.level)
        batches = asked(self.store)
        measured = {at.exposure_s for batch in batches if not batch.places for at in batch.conditions}
        wanted = [each for each in (model.unmeasured(measured) for model in models) if each is not None]
        if not wanted or len(measured) >= MOST_COMMON * len(models):
            return ()
        exposure_s = float(np.clip(wanted[0], *self.space.exposures_s))
        at = {"exposure_s": exposure_s, **self.space.further}
        return tuple(Conditions(**at, **line.axes) for line in self.space.lines)


def _at(plane: ScoreTable, places: Sequence[Place]) -> tuple[Array, Array]:
    """The mean and its standard error over clusters at nodes as they were asked, (N,); NaN where nothing is known."""
    away = np.abs(np.array(places)[:, None] - plane.places).max(axis=-1)
    nearest, there = away.argmin(axis=1), away.min(axis=1) <= _SAME_PLACE
    mean, error = (np.where(there, values[nearest], np.nan) for values in (plane.mean, plane.standard_error))
    return mean, error


def question_of(store: Store) -> SearchSpace | None:
    """What was asked of the run last; None of a sweep. Raises ``StoreError`` for one of other software."""
    held = store.about(_QUESTION)
    try:
        question = None if held is None else SearchSpace(**held)
        if question and dict(SweepPlan(question.grid).grid) != {
            n: (*each,) for n, each in question.grid.items()
        }:
            raise ValueError("grid: is none of a plan")
        return question
    except (TypeError, ValueError, AttributeError) as error:
        raise store.damaged(_QUESTION, str(error)) from None


def on_lines(store: Store, measured: Tables) -> Tables:
    """Tables that answer the run's question, by those that were measured; of a full grid these themselves."""
    question = question_of(store)
    if question is None or question.because:
        yield from measured
        return
    trend = Trend.of(Camera.from_dict(store.about("manifest")["camera"]))
    for table in measured:
        for plane in table.on_plane():
            yield predicted_table(plane, question, trend)


class Decision(Evaluation):
    """As :class:`Evaluation`; ``answers`` and ``curves`` are of the lines asked for, ``scores`` of the nodes.

    Of a run that no search has asked for it is an Evaluation.
    """

    _on_lines = staticmethod(on_lines)

    @cached_property
    def decided(self) -> dict[str, Any] | None:
        """The numbers of ``nodes``, ``pictures`` and ``cells`` that were computed, and of the ``grid_cells`` that the
        grid would need; ``because``: why the full grid was computed. None of a run without a question."""
        with Store(self.folder) as store:
            question, batches = question_of(store), asked(store)
            if question is None:
                return None
            repeats = store.about("identity")["plan"]["repeats"]
            n_pictures = store.about("manifest")["images"]["count"]
        grid = question.grid_conditions
        nodes = grid if question.because else sum(len(batch.conditions) for batch in batches)
        cells = {"cells": nodes * n_pictures * repeats, "grid_cells": grid * n_pictures * repeats}
        return {"nodes": nodes, "pictures": n_pictures, **cells, "because": list(question.because)}

    @property
    def _searched(self) -> bool:
        return self.decided is not None and not self.decided["because"]

    def how(self) -> list[str]:
        """In words: the number of conditions, or why the full grid was computed; nothing for other runs."""
        of = self.decided
        if of is None:
            return []
        if of["because"]:
            return [f"The full grid of {of['nodes']} conditions was computed: {'; '.join(of['because'])}."]
        return [
            f"{counted(of['nodes'], 'condition')} with {counted(of['pictures'], 'picture')}: "
            f"{counted(of['cells'], 'cell')}. The grid would need {of['grid_cells']} without its refinement."
        ]

    @property
    def summary(self) -> dict[str, Any]:
        """The contents of summary.json, with ``decided``."""
        return {**super().summary, "decided": self.decided}

    @cached_property
    def data(self) -> RunData:
        """Everything that the page shows; after a search without the means over a grid."""
        data = super().data
        if not self._searched:
            data.manifest["warnings"] += self.how()
            return data
        data.manifest["searched"] = [*self.how(), _PREDICTED]
        data.manifest["taken"] = [row for row in data.scores if not row["clean"]]
        unknown = {f"{name}{end}": None for name in _OF_GRID for end in ("", "_low", "_high")}
        return replace(data, models=[{**model, **unknown} for model in data.models])

    @property
    def _shown(self) -> RunData:
        if not self._searched:
            return self.data
        return replace(self.data, scores=[row for row in self.data.scores if row["clean"]])
