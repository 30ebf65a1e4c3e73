"""An evaluation: models before pictures under a plan's conditions, computed, kept in a folder, and read from it.

What ``blurnoise sweep`` does, for Python: the command calls :func:`evaluate`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.answers.clusters import check_cluster
from blurnoise_eval.answers.criterion import criterion_for
from blurnoise_eval.cameras import find
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.default_camera import default_for
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.detectors.python_models import Find, PythonDetector
from blurnoise_eval.plan.axes import named
from blurnoise_eval.plan.conditions import Part
from blurnoise_eval.plan.plan import SweepPlan, usual_plan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.report.findings import reflectance
from blurnoise_eval.report.run import RunData, Tables, read_run, write_tables
from blurnoise_eval.run import computing as sweep
from blurnoise_eval.run.computing import Outcome
from blurnoise_eval.run.contract_checks import contracts_chosen
from blurnoise_eval.run.engines import Engine, engine_facts, engine_of, staying
from blurnoise_eval.run.exposing import check_plan
from blurnoise_eval.run.identity import begun_or_gone, note_models, open_run
from blurnoise_eval.run.pictures import RunPictures
from blurnoise_eval.run.refining import refined
from blurnoise_eval.run.run import ENOUGH, Run
from blurnoise_eval.run.score_tables import criterion_of
from blurnoise_eval.run.work import count_cells
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store.queries import write_exports
from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import RUN_FILES, check_outputs, write_whole, writing
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.tables import plain
from blurnoise_eval.system.working_folder import WorkingFolder, working_folder

Rows = list[dict[str, Any]]
Given = str | Path | Model | Find
"""A model: a file, one that is open, or a function."""


def evaluate(
    models: Given | Sequence[Given] | None = None,
    pictures: PictureSet | None = None,
    camera: str | Camera | None = None,
    plan: SweepPlan | None = None,
    question: Question | None = None,
    output: str | Path | WorkingFolder = "run",
    *,
    engine: str | Engine = "threads",
    part: str | None = None,
    refine: bool = True,
    progress: bool | None = None,
    overwrite: bool = False,
) -> Evaluation:
    """Run models over pictures under every condition of a plan, as ``blurnoise sweep`` does.

    models: ONNX files, models already opened, or functions from an RGB picture (H, W, 3), uint8, to boxes, scores and
    names of classes (:mod:`blurnoise_eval.detectors.python_models`); by default the built-in stop-sign detector.
    pictures: of :mod:`blurnoise_eval.datasets`; by default rendered stop signs. camera: a preset's name, a file,
    or a camera; by default :func:`~blurnoise_eval.default_camera.default_for` these pictures.
    plan: by default :func:`usual_plan`. question: the score that is enough, and the pictures that count as one; by
    default 0.9 of the score on the original pictures, and a mean confidence of 0.6 for rendered ones. output: the
    run's folder; a run begun there goes on; for one at a URL a
    :func:`~blurnoise_eval.system.working_folder.written_run`. engine: "threads", "processes" or "ray" with a worker
    per core, or an :class:`~blurnoise_eval.run.engines.Engine` such as ``ThreadEngine(2)``. part: "1/4": only the
    first quarter of the pictures, by their names; :func:`~blurnoise_eval.run.merging.merge` joins the parts.
    refine: whether to compute more exposures where a window ends between two tested ones, to a quarter of a stop
    (:mod:`blurnoise_eval.run.refining`); a part refines nothing. progress: whether to draw a bar on the terminal.
    overwrite: replace files in the folder that blurnoise did not write, or that were changed since; inputs and
    folders never are.

    Raises ``TypeError`` for values of another kind, and ``ValueError`` for what cannot be used: a model
    (:class:`~blurnoise_eval.detectors.contract.ModelError`), a folder that holds another run
    (:class:`~blurnoise_eval.store.store.StoreError`), pictures none of which can be read. Raises ``OSError`` where
    the run cannot be written, or would replace a file that is not its own.
    """
    folder = working_folder(output)
    computed_by = engine_of(engine) if isinstance(engine, str) else engine
    named = find(camera) if isinstance(camera, str) else camera  # before anything is opened
    for name, value, kind in (
        ("pictures", pictures, PictureSet),
        ("camera", named, Camera),
        ("plan", plan, SweepPlan),
        ("question", question, Question),
    ):
        if value is not None and not isinstance(value, kind):
            raise TypeError(f"{name} = {value!r}: must be a {kind.__name__}")
    opened = _opened(models, pictures)
    whole = usual_pictures(opened) if pictures is None else pictures
    seen_by = default_for(whole) if named is None else named
    question = Question() if question is None else question
    check_cluster(question.cluster, (picture.name for picture in whole))
    shown, own = whole, None if part is None else Part.parse(part)
    if own is not None:
        shown = replace(whole, pictures=tuple(picture for picture in whole if own.has(picture.name)))
        if not shown:
            raise ValueError(f"part = {part!r}: none of the {len(whole)} pictures are in it")
    plan = usual_plan() if plan is None else plan
    of_pictures = {"rendered": shown.kind == "rendered", "labelled": shown.labelled}
    criterion_for(question, reads=not isinstance(opened[0], Detector), **of_pictures)
    check_plan(plan, seen_by, shown)
    with (
        begun_or_gone(folder.path, opened, whole, overwrite=overwrite),
        Store(folder.path, create=True) as store,
        staying(computed_by) as engine_kept,
    ):
        opened, comparisons = contracts_chosen(opened, whole, say=progress)
        facts = {"command": folder.command, **engine_facts(computed_by)}
        open_run(store, opened, seen_by, shown, plan, facts, whole=whole, part=own)
        store.set_about(ENOUGH, vars(question))

        def compute(plan: SweepPlan, advance: ProgressBar) -> Outcome:
            how: dict[str, Any] = {"progress": advance, "resumed": advance.already}
            return sweep.run(opened, seen_by, shown, plan, store, engine=engine_kept, **how)

        with ProgressBar("sweep", count_cells(shown, plan), progress) as advance:
            outcome = compute(plan, advance)
        if outcome.skipped and len(outcome.skipped) == len(shown):
            raise ValueError(f"images: none could be read (first: {next(iter(outcome.skipped.values()))})")
        if refine and own is None:
            wanted = criterion_of(Run(store))
            refined(store, plan, wanted, len(shown), compute, outcome, progress)
        note_models(store, opened, shown, comparisons, computed=outcome.computed)
    done: dict[str, Any] = {"outcome": outcome, "progress": progress, "images": whole, "trust": True}
    return Evaluation(folder, question, **done)


class Evaluation:
    """A run in its folder: its rows, read when asked for, and its page.

    ``cells``: a row per picture, condition and model. ``targets``: a row per target of these. ``scores``: a row
    per model and condition. ``curves``: one per curve over exposure or blur, with its area and where it fails.
    ``models``: a row per model. ``answers``: one per model, target group, light and velocity: where the ``criterion``
    of ``question`` is fulfilled, and the exposure to use. What the question leaves open is as the sweep was asked.
    ``outcome``: what was computed now, None for a run opened again. ``pandas.DataFrame`` takes each list as it is.
    ``output``: where pages, tables and figures are written, by default the run's folder. ``images``: where the
    original pictures are, or the pictures themselves, by default where the sweep found them. trust: the run is this
    user's own, so that files outside its folder may be opened where it says they are; of runs that this user's
    account has computed that is known. Raises :class:`~blurnoise_eval.store.store.StoreError` for a folder without a
    run, or with one that no sweep has written.
    """

    _on_lines: Callable[[Store, Tables], Tables] = staticmethod(lambda store, measured: measured)

    def __init__(
        self,
        folder: str | Path | WorkingFolder,
        question: Question | None = None,
        *,
        output: str | Path | WorkingFolder | None = None,
        outcome: Outcome | None = None,
        progress: bool | None = None,
        images: str | Path | PictureSet | None = None,
        trust: bool = False,
    ) -> None:
        self._run = working_folder(folder)
        self._written = self._run if output is None else working_folder(output)
        self.folder, self.output = self._run.path, self._written.path
        self.outcome = outcome
        self._progress = progress
        with Run.open(self.folder, trust=trust) as run:
            self.criterion = criterion_of(run, question)
            check_cluster(self.criterion.cluster, run.store.pictures())
            self.pictures = RunPictures(run, images)
            """The run's original pictures, and any of its simulated ones again."""

    @cached_property
    def cells(self) -> Rows:
        """A row per picture, condition and model, as results.csv has them."""
        with Store(self.folder) as store:
            return [named(row) for row in store.cells()]

    @cached_property
    def targets(self) -> Rows:
        """A row per cell and target, as targets.csv has them."""
        with Store(self.folder) as store:
            return [named(row) for row in store.targets()]

    @property
    def scores(self) -> Rows:
        """A row per model and condition, as scores.csv has them."""
        return [named(row) for row in self.data.scores]

    @property
    def curves(self) -> Rows:
        """A row per curve, as curves.csv has them, and the curve itself: ``x`` and ``confidence``."""
        return [named(row) for row in self.data.endurances]

    @property
    def models(self) -> Rows:
        """A row per model, as models.csv has them."""
        return self.data.models

    @property
    def answers(self) -> Rows:
        """For each model, target group, light and velocity the exposures that work, s, and the one to use."""
        return [named(row) for row in self.data.answers]

    @property
    def skipped(self) -> Rows:
        """Pictures that could not be read, with the reason."""
        return self.data.skipped

    @property
    def summary(self) -> dict[str, Any]:
        """What summary.json holds."""
        about = self.data.manifest
        summary: dict[str, Any] = {
            "run": self._run.with_url(self.folder),
            "report": self._written.with_url(self.output / "report.html"),
            "cells": about["n_cells"],
            **{name: about[name] for name in ("missing_cells", "refined")},
            "skipped": self.skipped,
            "criterion": self.criterion.row(),
            "threshold": self.criterion.level,
            **{name: about[name] for name in ("withheld", "withheld_models")},
            "targets_found": about.get("targets_found", {}),
            "reflectance": reflectance(self.data),
            "cluster": self.criterion.cluster,
            "software": about["software"],
            "models": self.models,
            "answers": [{name: plain(value) for name, value in row.items()} for row in self.answers],
        }
        if self.outcome is not None:
            names = ("computed", "resumed", "wall_s", "workers_died")
            summary |= {name: getattr(self.outcome, name) for name in names}
        return summary

    def report(self, *, overwrite: bool = False) -> Path:
        """Write the run's tables, figures and pages; returns the page's path. overwrite: replace files that blurnoise
        did not write, too. Raises ``OSError``."""
        with writing(overwrite=overwrite):
            check_outputs(self.output, *RUN_FILES)
            return self._report()

    def _report(self) -> Path:
        from blurnoise_eval.report import charts, failures, page  # matplotlib and plotly

        self.output.mkdir(parents=True, exist_ok=True)
        with Store(self.folder) as store:
            write_exports(store, self.output)
            failures.write_failures(store, self.data, self.output, self.pictures)
        write_tables(self.data, self.output)
        summary = json.dumps(self.summary, indent=1)
        write_whole(self.output / "summary.json", summary.encode("utf-8"))
        with ProgressBar("draw", len(charts.views(self._shown)), self._progress) as advance:
            return page.write_report(self._shown, self.output, advance)

    def write_fiftyone(self, folder: str | Path) -> str:
        """Write the run as a FiftyOne data set; returns what it holds, in words. Raises ``ValueError`` where no
        picture can be opened, and ``OSError``."""
        from blurnoise_eval.report.fiftyone_export import write_fiftyone

        with (
            Store(self.folder) as store,
            ProgressBar("FiftyOne", len(store.pictures()), self._progress) as advance,
        ):
            return write_fiftyone(store, self.data, self.pictures, Path(folder), advance)

    @property
    def _shown(self) -> RunData:
        """What of the run stands on its page."""
        return self.data

    @cached_property
    def data(self) -> RunData:
        """Everything that the page shows."""
        with Store(self.folder) as store, ExitStack() as bar:
            steps = store.count_different(*CONDITIONS, "model")
            advance = bar.enter_context(ProgressBar("score", steps, self._progress))
            return read_run(store, self.criterion, progress=advance, on_lines=self._on_lines)


def usual_pictures(models: Sequence[Model]) -> PictureSet:
    """Rendered stop signs for detectors; for readers, the word on them."""
    return datasets.rendered_signs() if isinstance(models[0], Detector) else datasets.rendered_texts()


def _opened(models: Any, pictures: PictureSet | None) -> list[Model]:
    if models is None:
        from blurnoise_models.detector import STOP_SIGN

        models = STOP_SIGN
    each = list(models) if isinstance(models, Sequence) and not isinstance(models, str) else [models]
    if not each:
        raise ValueError("models = []: must contain at least one model")
    opened = iter(open_models([model for model in each if isinstance(model, (str, Path))]))
    found: list[Model] = []
    for model in each:
        if isinstance(model, (str, Path)):
            found.append(next(opened))
        elif isinstance(model, Detector) or hasattr(model, "read"):
            found.append(model)
        else:
            found.append(_of_python(model, pictures))
    if len({isinstance(model, Detector) for model in found}) > 1:
        raise ValueError(
            "models: must be detectors or text readers, not both; evaluate them in separate runs"
        )
    return found


def _of_python(model: Any, pictures: PictureSet | None) -> Model:
    """A function that returns names of classes as a detector of those that the pictures have."""
    kinds = "a file, a Detector, a reader of text, or a function of pictures"
    if not callable(model):
        raise TypeError(f"models: {model!r}: must be {kinds}")
    if hasattr(model, "state_dict"):  # a network of torch's
        raise TypeError(
            f"models: {type(model).__name__}: must be wrapped as TorchvisionDetector(network, classes)"
        )
    if pictures is None or not pictures.categories:
        raise ValueError(
            f"models: {model!r}: the pictures have no class names; wrap it as PythonDetector(find, classes)"
        )
    return PythonDetector(model, tuple(pictures.categories))
