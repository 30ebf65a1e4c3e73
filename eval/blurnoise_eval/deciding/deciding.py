"""Deciding: which exposures work, from as few pictures as that takes.

A search asks for nodes of the plane of lux-seconds and pixels, a batch at a time; each is a plan that
:func:`~blurnoise_eval.sweep.run.run` computes into the run's store, and what the store then holds says what to ask
next. So the search is a function of the store: a run that was killed goes on where it was, and a wider question
begins with all nodes there are. Where the plane does not hold it is the full grid, as a sweep has it.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import in_range, integer
from blurnoise.motion.ego import Vehicle
from blurnoise.optics.camera import Camera
from blurnoise_eval.answers.clusters import cluster_of
from blurnoise_eval.answers.criterion import PRECISIONS, Criterion, stated
from blurnoise_eval.answers.recommendation import MOST_COMMON
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.datasets import PictureSet, check_cut
from blurnoise_eval.deciding.decision import BECAUSE, CHEAPER, QUESTION, Decision, answering, answers_of
from blurnoise_eval.deciding.nodes import lattice
from blurnoise_eval.deciding.plane_holds import what_breaks
from blurnoise_eval.deciding.question import Question
from blurnoise_eval.deciding.realised import conditions_at
from blurnoise_eval.deciding.search import CHECKED, MOST_NODES, Search
from blurnoise_eval.deciding.trend import Trend
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.evaluation import engine_facts, evaluate, progress_bar, tell_of
from blurnoise_eval.grid.axes import EGO, VELOCITY
from blurnoise_eval.grid.conditions import Conditions, SweepPlan
from blurnoise_eval.grid.nodes import NodePlan
from blurnoise_eval.grid.objects import USUAL_OBJECTS, Objects
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep.asked import Batch, Place, ask, asked
from blurnoise_eval.sweep.beginning import begun_or_gone
from blurnoise_eval.sweep.blocks import count_cells
from blurnoise_eval.sweep.contract_choice import contracts_chosen
from blurnoise_eval.sweep.engines import Engine, engine_of, staying
from blurnoise_eval.sweep.model_notes import note_models
from blurnoise_eval.sweep.run import Outcome
from blurnoise_eval.sweep.run_folder import open_run
from blurnoise_eval.sweep.run_scores import withheld_models
from blurnoise_eval.sweep.score_tables import ENOUGH, run_averages, score_tables
from blurnoise_eval.system.files import RUN_FILE
from blurnoise_eval.system.terminal import say
from blurnoise_eval.system.working_folder import WorkingFolder, working_folder

FIRST_PICTURES = 20
"""With which a decision begins that takes no more than it needs; from then on it doubles them."""
_SAME_PLACE = 1e-4  # stops: conditions are rounded
_AT_REST = (1.0, 0.0)  # the direction of what does not move
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Precision:
    """When it is enough. regret: no recommended exposure loses more at 95 %. edge_stops: no end of a window has a
    wider 95 % interval, stops. Where neither is stated all pictures are taken; where both are, either is enough.
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
        if not answers:
            return False
        lost = [answer["regret_95"] for answer in answers if answer["recommended_s"] is not None]
        known = [each for each in lost if each is not None]
        if self.regret is not None and known and len(known) == len(lost) and max(known) <= self.regret:
            return True
        widths = [width for answer in answers for width in _edge_widths(answer)]
        return self.edge_stops is not None and bool(widths) and max(widths) <= self.edge_stops


def decided(
    models: Sequence[Model],
    pictures: PictureSet,
    camera: Camera,
    question: Question,
    output: str | Path | WorkingFolder,
    *,
    threshold: float | None = None,
    keep: float | None = None,
    score: str | None = None,
    cluster: str | None = None,
    precision: Precision = Precision(),
    repeats: int = 1,
    seed: int = 0,
    grey_anchor: str | None = None,
    trajectory: str | None = None,
    ego: Vehicle | None = None,
    objects: Objects = USUAL_OBJECTS,
    engine: str | Engine = "threads",
    threads: int | None = 1,
    address: str | None = None,
    progress: bool | None = None,
    command: str = "blurnoise_eval.decided",
) -> Decision:
    """Ask models what the question asks, in a folder; one begun there goes on.

    The other arguments are as of :func:`~blurnoise_eval.evaluation.evaluate`, which computes the full grid
    where the plane does not hold. Raises what that raises.
    """
    folder = working_folder(output)
    enough: dict[str, Any] = {"threshold": threshold, "keep": keep, "score": score, "cluster": cluster}
    shared: dict[str, Any] = {
        "repeats": repeats,
        "seed": seed,
        "grey_anchor": grey_anchor,
        "objects": objects,
    }
    criterion = stated(
        threshold,
        keep,
        score,
        rendered=pictures.kind == "rendered",
        reads=not isinstance(models[0], Detector),
    )
    if criterion.score in PRECISIONS:
        raise ValueError(
            f"score = {score!r}: must be one that each target has, for a search to tell it of nodes"
        )
    cluster_of("", cluster)
    temperature = question.further.get("temperature_c", 25.0)
    path = None if trajectory is None else TrajectorySpec.parse(trajectory)
    drives = bool(question.further.get(EGO.name)) or ego is not None
    because = question.not_on_a_plane or what_breaks(
        camera, question.exposures_s, question.lines, temperature, path, drives
    )
    cheaper = [] if because or precision.stated else _cheaper(folder, question, precision)
    if progress and not because:
        most = _most_nodes(question, precision)
        told = f"a search of at most {most} conditions; the grid has {question.grid_conditions}"
        say(f"decide: {cheaper[0] if cheaper else told}", error=True)
    if because or cheaper:
        evaluate(
            list(models), pictures, camera, SweepPlan(question.grid, **shared, trajectory=path, ego=ego), folder,
            **enough, engine=engine, threads=threads, address=address, progress=progress, command=command,
        )  # fmt: skip
        with Store(folder.path) as store:
            store.set_about(BECAUSE, because)
            store.set_about(CHEAPER, cheaper)
            store.set_about(QUESTION, question.to_dict())
        return Decision(folder, **enough, progress=progress)
    direction = next((line.direction for line in question.lines if line.direction), _AT_REST)
    plan = NodePlan((), question.further, direction, **shared)
    if plan.cuts:
        check_cut(pictures, objects)
    conditions_at((0.0, 0.0), question.lines, question.exposures_s, question.further).exposure(camera)
    computed_by = engine_of(engine, threads, address) if isinstance(engine, str) else engine
    facts = {"command": command, **engine_facts(engine, threads)}
    with (
        begun_or_gone(folder.path),
        Store(folder.path, create=True) as store,
        staying(computed_by) as engine_kept,
    ):
        models, comparisons = contracts_chosen(models, pictures, say=progress)
        open_run(store, models, camera, pictures, plan, facts)
        store.set_about(QUESTION, question.to_dict())
        store.set_about(BECAUSE, [])
        store.set_about(ENOUGH, {name: enough[name] for name in ("threshold", "keep", "score")})
        drawn = _drawn(pictures, seed, cluster)
        computing = _Computing(store, folder, models, camera, drawn, plan, engine_kept, progress)
        _search(computing, question, criterion, cluster, precision)
        note_models(store, models, pictures, comparisons, computed=computing.outcome.computed)
    return Decision(folder, **enough, outcome=computing.outcome, progress=progress)


def _most_nodes(question: Question, precision: Precision) -> int:
    """How many conditions a search asks for at most, where the surface is smooth."""
    return min(len(lattice(question.lines, question.exposures_s)), precision.most_nodes + CHECKED)


def _cheaper(folder: WorkingFolder, question: Question, precision: Precision) -> list[str]:
    """Why the grid is computed, where it has fewer conditions than a search may ask for; a search that has begun in
    the folder goes on."""
    most, grid = _most_nodes(question, precision), question.grid_conditions
    if grid >= most:
        return []
    if (folder.path / RUN_FILE).is_file():
        with Store(folder.path) as store:
            if any(batch.places for batch in asked(store)):
                return []
    return [f"it has {grid} conditions, a search would ask for up to {most}"]


@dataclass(frozen=True)
class _Computing:
    """What a run's batches are computed with, into its store."""

    store: Store
    folder: WorkingFolder
    models: Sequence[Model]
    camera: Camera
    pictures: PictureSet
    plan: NodePlan
    engine: Engine
    progress: bool | None
    outcome: Outcome = field(default_factory=Outcome)

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


def _search(
    computing: _Computing, question: Question, criterion: Criterion, cluster: str | None, precision: Precision
) -> None:
    """Ask and compute, batch by batch, from where the store stands until it is enough."""
    store = computing.store
    if before := len(asked(store)):  # what was asked until the run was stopped, or of a narrower question
        computing.up_to(0)
        computing.up_to(before - 1)
    for n_pictures in _stages(len(computing.pictures), precision, asked(store)):
        if (batches := asked(store)) and batches[-1].n_pictures < n_pictures:
            ask(store, Batch(n_pictures))
            computing.up_to(len(batches))
        while places := _next(store, question, criterion, cluster, precision.most_nodes):
            found = [
                conditions_at(place, question.lines, question.exposures_s, question.further)
                for place in places
            ]
            ask(store, Batch(n_pictures, tuple(places), tuple(found)))
            computing.up_to(len(asked(store)) - 1)
        while common := _common(store, question, criterion, cluster):
            ask(store, Batch(n_pictures, (), common))
            computing.up_to(len(asked(store)) - 1)
        if precision.stated and precision.reached(answers_of(store, criterion, cluster)):
            break


def _next(
    store: Store, question: Question, criterion: Criterion, cluster: str | None, most_nodes: int
) -> tuple[Place, ...]:
    """What the search asks next, by all that the store holds, told batch by batch as it was asked; nothing where it
    has enough, or no group of targets can be told."""
    trend = Trend.of(Camera.from_dict(store.about("manifest")["camera"]))
    search = Search(question.lines, question.exposures_s, criterion.level, most_nodes=most_nodes, trend=trend)
    batches = [batch for batch in asked(store) if batch.places]
    unfit = withheld_models(store, cluster) if batches else {}
    known = [
        plane
        for table in (score_tables(store, criterion, cluster) if batches else ())
        if not table.knows_too_little and table.model not in unfit
        for plane in table.on_plane()
    ]
    if batches and not known:
        return ()
    for batch in batches:
        values, errors = zip(*(_at(each, batch.places) for each in known), strict=True)
        search.tell(batch.places, np.array(values), np.array(errors))
    return tuple((u, w) for u, w in search.ask().tolist())


def _common(
    store: Store, question: Question, criterion: Criterion, cluster: str | None
) -> tuple[Conditions, ...]:
    """All lights and speeds at the exposure that is recommended for all of them, where no near one was measured
    there; nothing where each model has one, or ``MOST_COMMON`` exposures."""
    models = run_averages(store, answering(store, criterion, cluster), criterion.level)
    measured = {at.exposure_s for batch in asked(store) if not batch.places for at in batch.conditions}
    if len(measured) >= MOST_COMMON * len(models):
        return ()
    wanted = (each.unmeasured(measured) for each in models)
    exposure_s = next((each for each in wanted if each is not None), None)
    if exposure_s is None:
        return ()
    low, high = question.exposures_s
    at = {"exposure_s": min(max(exposure_s, low), high), **question.further}
    return tuple(
        Conditions(
            **at, illuminance_lux=line.illuminance_lux, **dict(zip(VELOCITY, line.velocity_px_s, strict=True))
        )
        for line in question.lines
    )


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
