"""Deciding: which exposures work, from as few pictures as that takes.

A search asks for nodes of the plane of lux-seconds and pixels, a batch at a time; each is a plan that
:func:`~blurnoise_eval.sweep.run.run` computes into the run's store, and the scores there decide what to ask next. So
a run that was killed goes on where it was, and a wider question begins with all nodes there are. Where the plane does
not hold it is the full grid, as a sweep has it.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import in_range, integer
from blurnoise.optics.camera import Camera
from blurnoise_eval.answers.clusters import cluster_of
from blurnoise_eval.answers.criterion import PRECISIONS, Criterion, stated
from blurnoise_eval.answers.recommendation import MOST_COMMON
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.datasets import PictureSet, check_cut
from blurnoise_eval.deciding.decision import Decision, answering, answers_of, note_question
from blurnoise_eval.deciding.kriging import Trend
from blurnoise_eval.deciding.lines import conditions_at, direction_of_all, lattice
from blurnoise_eval.deciding.question import Question, what_breaks
from blurnoise_eval.deciding.search import CHECKED, MOST_NODES, Search
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.evaluation import evaluate
from blurnoise_eval.grid.axes import EGO
from blurnoise_eval.grid.conditions import Conditions, SweepPlan
from blurnoise_eval.grid.nodes import NodePlan
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep.asked import Batch, Place, ask, asked
from blurnoise_eval.sweep.beginning import begun_or_gone
from blurnoise_eval.sweep.blocks import count_cells
from blurnoise_eval.sweep.contract_checks import contracts_chosen
from blurnoise_eval.sweep.engines import Engine, engine_facts, engine_of, staying
from blurnoise_eval.sweep.model_notes import note_models
from blurnoise_eval.sweep.run import Outcome
from blurnoise_eval.sweep.run_folder import open_run
from blurnoise_eval.sweep.run_scores import withheld_models
from blurnoise_eval.sweep.score_tables import ENOUGH, run_averages, score_tables
from blurnoise_eval.system.files import RUN_FILE
from blurnoise_eval.system.progress import progress_bar, tell_of
from blurnoise_eval.system.terminal import say
from blurnoise_eval.system.working_folder import WorkingFolder, working_folder

FIRST_PICTURES = 20
"""With which a decision begins that takes no more than it needs; from then on it doubles them."""
_SAME_PLACE = 1e-4  # stops: conditions are rounded
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Precision:
    """When it is enough. regret: no recommended exposure loses more at 95 %. edge_stops: no end of a window has a
    wider 95 % interval, stops. Where both are None all pictures are taken; where both are given, either is enough.
    most_nodes: from which on nothing more is searched for. Raises ``ValueError``."""

    regret: float | None = None
    edge_stops: float | None = None
    most_nodes: int = MOST_NODES

    def __post_init__(self) -> None:
        if self.regret is not None:
            in_range("regret", self.regret, 0.0, 1.0)
        if self.edge_stops is not None:
            in_range("edge_stops", self.edge_stops, 0.0, 64.0, above=True)
        integer("most_nodes", self.most_nodes, 12, 10_000)

    @property
    def stated(self) -> bool:
        """Whether fewer pictures than all may be enough."""
        return self.regret is not None or self.edge_stops is not None

    def reached(self, answers: Sequence[dict[str, Any]]) -> bool:
        """Whether the answers are as precise."""
        regrets = [answer["regret_95"] for answer in answers if answer["recommended_s"] is not None]
        if self.regret is not None and regrets and None not in regrets and max(regrets) <= self.regret:
            return True
        widths = [width for answer in answers for width in _edge_widths(answer)]
        return self.edge_stops is not None and bool(widths) and max(widths) <= self.edge_stops

    def most_asked(self, question: Question) -> int:
        """How many conditions a search asks for at most, where the surface is smooth."""
        return min(len(lattice(question.lines, question.exposures_s)), self.most_nodes + CHECKED)


def decided(
    models: Sequence[Model],
    pictures: PictureSet,
    camera: Camera,
    plan: SweepPlan,
    output: str | Path | WorkingFolder,
    *,
    threshold: float | None = None,
    keep: float | None = None,
    score: str | None = None,
    cluster: str | None = None,
    precision: Precision = Precision(),
    engine: str | Engine = "threads",
    threads: int | None = 1,
    progress: bool | None = None,
    command: str = "blurnoise_eval.decided",
) -> Decision:
    """Ask models which exposures of a plan's range work, in a folder; a decision begun there goes on.

    The other arguments are as of :func:`~blurnoise_eval.evaluation.evaluate`, which computes the plan's grid where
    the plane does not hold, or the grid is cheaper. Raises what that raises.
    """
    folder = working_folder(output)
    enough: dict[str, Any] = {"threshold": threshold, "keep": keep, "score": score}
    kinds = {"rendered": pictures.kind == "rendered", "reads": not isinstance(models[0], Detector)}
    criterion = stated(threshold, keep, score, **kinds)
    if criterion.score in PRECISIONS:
        raise ValueError(
            f"score = {score!r}: must be one that each target has, for a search to tell it of nodes"
        )
    cluster_of("", cluster)
    question = _question(plan, camera, folder, precision)
    if progress and not question.because:
        most = precision.most_asked(question)
        told = f"a search of at most {most} conditions; the grid has {question.grid_conditions}"
        say(f"decide: {question.cheaper[0] if question.cheaper else told}", error=True)
    if not question.searched:
        evaluate(
            list(models), pictures, camera, plan, folder,
            **enough, cluster=cluster, engine=engine, threads=threads, progress=progress, command=command,
        )  # fmt: skip
        with Store(folder.path) as store:
            note_question(store, question)
        return Decision(folder, **enough, cluster=cluster, progress=progress)
    nodes = NodePlan(
        (), question.further, direction_of_all(question.lines), plan.repeats, plan.seed,
        grey_anchor=plan.grey_anchor, auto_exposure=plan.auto_exposure, objects=plan.objects,
    )  # fmt: skip
    if nodes.cuts:
        check_cut(pictures, nodes.objects)
    conditions_at((0.0, 0.0), question.lines, question.exposures_s, question.further).exposure(camera)
    computed_by = engine_of(engine, threads) if isinstance(engine, str) else engine
    facts = {"command": command, **engine_facts(engine, threads)}
    with (
        begun_or_gone(folder.path),
        Store(folder.path, create=True) as store,
        staying(computed_by) as engine_kept,
    ):
        models, comparisons = contracts_chosen(models, pictures, say=progress)
        open_run(store, models, camera, pictures, nodes, facts)
        note_question(store, question)
        store.set_about(ENOUGH, enough)
        drawn = _drawn(pictures, plan.seed, cluster)
        computing = _Computing(
            store, models, camera, drawn, nodes, question, criterion, cluster, engine_kept, progress
        )
        computing.search(precision)
        note_models(store, models, pictures, comparisons, computed=computing.outcome.computed)
    return Decision(folder, **enough, cluster=cluster, outcome=computing.outcome, progress=progress)


def _question(plan: SweepPlan, camera: Camera, folder: WorkingFolder, precision: Precision) -> Question:
    """The question of a plan, with why the grid answers it if it does. The grid is cheaper where it has fewer
    conditions than a search may ask for, unless a search has begun in the folder."""
    question = Question({name: plan.values(name) for name in plan.grid})
    because = question.not_on_a_plane or what_breaks(
        camera,
        question.exposures_s,
        question.lines,
        question.further.get("temperature_c", 25.0),
        plan.trajectory,
        bool(question.further.get(EGO.name)) or plan.ego is not None,
    )
    if because or precision.stated:
        return replace(question, because=because)
    most, grid = precision.most_asked(question), question.grid_conditions
    if grid >= most:
        return question
    if (folder.path / RUN_FILE).is_file():
        with Store(folder.path) as store:
            if any(batch.places for batch in asked(store)):
                return question
    return replace(question, cheaper=[f"it has {grid} conditions, a search would ask for up to {most}"])


@dataclass(frozen=True)
class _Computing:
    """A run that a search asks for, with all that its batches are computed with."""

    store: Store
    models: Sequence[Model]
    camera: Camera
    pictures: PictureSet
    plan: NodePlan
    question: Question
    criterion: Criterion
    cluster: str | None
    engine: Engine
    progress: bool | None
    outcome: Outcome = field(default_factory=Outcome)

    def search(self, precision: Precision) -> None:
        """Ask and compute, batch by batch, from where the store is until it is enough."""
        if before := len(asked(self.store)):  # asked until the run was stopped, or of a narrower question
            self.up_to(0)
            self.up_to(before - 1)
        for n_pictures in _stages(len(self.pictures), precision, asked(self.store)):
            if (batches := asked(self.store)) and batches[-1].n_pictures < n_pictures:
                self.ask(n_pictures)
            self._find_edges(n_pictures, precision.most_nodes)
            while common := self._common():
                self.ask(n_pictures, (), common)
            if precision.stated and precision.reached(answers_of(self.store, self.criterion, self.cluster)):
                break

    def ask(
        self, n_pictures: int, places: Sequence[Place] = (), conditions: Sequence[Conditions] = ()
    ) -> None:
        """Note a batch, then compute it."""
        ask(self.store, Batch(n_pictures, tuple(places), tuple(conditions)))
        self.up_to(len(asked(self.store)) - 1)

    def up_to(self, last: int) -> None:
        """Every node of the batches up to the last, before the pictures that it names."""
        batches = asked(self.store)[: last + 1]
        nodes = tuple(at for batch in batches for at in batch.conditions)
        some = replace(self.pictures, pictures=self.pictures.pictures[: batches[-1].n_pictures])
        plan = replace(self.plan, nodes=nodes, examples=last == 0)
        with progress_bar(f"{len(nodes)} nodes", count_cells(some, plan), self.progress) as advance:
            done = sweep.run(
                self.models, self.camera, some, plan, self.store,
                engine=self.engine, progress=advance, resumed=advance.already, died=tell_of(advance),
            )  # fmt: skip
        self.outcome.add(done)
        skipped = self.store.skipped()
        if len(skipped) == len(some):
            raise ValueError(f"images: none could be read (first: {skipped[0]['reason']})")

    def _find_edges(self, n_pictures: int, most_nodes: int) -> None:
        """Ask until the search is done, or no group of targets has a score that means something.

        The search is told each batch once; where the groups become others it begins anew with all of them.
        """
        search = self._search(most_nodes)
        if not self._batches:
            self._ask_nodes(n_pictures, search)
        unfit = withheld_models(self.store, self.cluster)
        told = groups = 0
        while known := list(self._planes(unfit)):
            if len(known) != groups:
                search, told, groups = self._search(most_nodes), 0, len(known)
            batches = self._batches
            for batch in batches[told:]:
                values, errors = zip(*(_at(each, batch.places) for each in known), strict=True)
                search.tell(batch.places, np.array(values), np.array(errors))
            told = len(batches)
            if search.done:
                return
            self._ask_nodes(n_pictures, search)

    def _search(self, most_nodes: int) -> Search:
        lines, exposures_s = self.question.lines, self.question.exposures_s
        trend = Trend.of(self.camera)
        return Search(lines, exposures_s, self.criterion.level, most_nodes=most_nodes, trend=trend)

    @property
    def _batches(self) -> list[Batch]:
        """Those that a search has asked."""
        return [batch for batch in asked(self.store) if batch.places]

    def _planes(self, unfit: Container[str]) -> Iterator[ScoreTable]:
        """The scores of every group on the plane, but of unfit models."""
        for table in score_tables(self.store, self.criterion, self.cluster):
            if not table.knows_too_little and table.model not in unfit:
                yield from table.on_plane()

    def _ask_nodes(self, n_pictures: int, search: Search) -> None:
        of = self.question
        places = [(u, w) for u, w in search.ask().tolist()]
        self.ask(
            n_pictures, places, [conditions_at(at, of.lines, of.exposures_s, of.further) for at in places]
        )

    def _common(self) -> tuple[Conditions, ...]:
        """All lights and speeds at the exposure that is recommended for all of them, where no near one was measured
        there; nothing where each model has one, or ``MOST_COMMON`` exposures."""
        tables = answering(self.store, self.criterion, self.cluster)
        models = run_averages(self.store, tables, self.criterion.level)
        batches = asked(self.store)
        measured = {at.exposure_s for batch in batches if not batch.places for at in batch.conditions}
        if len(measured) >= MOST_COMMON * len(models):
            return ()
        wanted = (each.unmeasured(measured) for each in models)
        exposure_s = next((each for each in wanted if each is not None), None)
        if exposure_s is None:
            return ()
        low, high = self.question.exposures_s
        at = {"exposure_s": min(max(exposure_s, low), high), **self.question.further}
        return tuple(Conditions(**at, **line.axes) for line in self.question.lines)


def _at(seen: ScoreTable, places: Sequence[Place]) -> tuple[Array, Array]:
    """The mean and its standard error over clusters at nodes as they were asked, (N,); NaN where nothing is known."""
    away = np.abs(np.array(places)[:, None] - seen.places).max(axis=-1)
    nearest, there = away.argmin(axis=1), away.min(axis=1) <= _SAME_PLACE
    mean, error = (np.where(there, values[nearest], np.nan) for values in (seen.mean, seen.standard_error))
    return mean, error


def _drawn(pictures: PictureSet, seed: int, cluster: str | None) -> PictureSet:
    """The pictures in an order drawn by a hash of their clusters' names, so that more of them begin with the same."""

    def order(name: str) -> tuple[bytes, str]:
        key = repr((seed, cluster_of(name, cluster)))
        return hashlib.blake2b(key.encode("utf-8", "backslashreplace"), digest_size=8).digest(), name

    return replace(pictures, pictures=tuple(sorted(pictures, key=lambda picture: order(picture.name))))


def _stages(count: int, precision: Precision, before: Sequence[Batch]) -> Iterator[int]:
    """With how many pictures, one after the other: all, unless fewer may be enough."""
    some = max([FIRST_PICTURES, *(batch.n_pictures for batch in before)])
    while precision.stated and some < count:
        yield some
        some *= 2
    yield count


def _edge_widths(answer: dict[str, Any]) -> Iterator[float]:
    """Stops between the ends of the intervals of a window's ends; infinite where one is not known."""
    low_s, high_s = answer["exposures_s"][0], answer["exposures_s"][-1]
    for window, *bounds in zip(
        answer["windows_s"], answer["windows_low_s"], answer["windows_high_s"], strict=True
    ):
        for end, (low, high) in zip(window, bounds, strict=True):
            if low_s < end < high_s:
                yield math.inf if low is None or high is None else math.log2(high / low)
