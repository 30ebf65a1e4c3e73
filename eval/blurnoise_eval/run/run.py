"""A run: how it was made, its pictures, the tables of its results, and its report.

A run may be anybody's: :meth:`Run.open` checks all of it before a row is believed. Of a run that is not trusted no
file outside its folder is opened, and its regular expression for clusters is not searched for.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.camera import Camera
from blurnoise_eval.answers.clusters import check_cluster
from blurnoise_eval.answers.criterion import Criterion, criterion_for
from blurnoise_eval.answers.recommendation import Averages
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.datasets import Picture, PictureSet, eight_bit
from blurnoise_eval.detectors.contract_files import parse_contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S, model_sha256
from blurnoise_eval.plan.conditions import Cell
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.report.run import RunData, write_tables
from blurnoise_eval.run.coco_export import detection_files, write_detections
from blurnoise_eval.run.computing import Outcome
from blurnoise_eval.run.exposing import Frame, PictureScene, frames
from blurnoise_eval.run.pictures import original_picture, pictures_of_run
from blurnoise_eval.run.score_tables import on_lines, run_averages, score_tables, withheld_models
from blurnoise_eval.run.setup import Batch, Setup, note_batch
from blurnoise_eval.run.tables import of_page, strategy_sentences, summary_of, tables_of
from blurnoise_eval.store import queries
from blurnoise_eval.store.checks import check_rows
from blurnoise_eval.store.columns import CONDITIONS
from blurnoise_eval.store.queries import write_exports
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.files import RUN_FILES, check_outputs, path_within, write_whole, writing
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.working_folder import WorkingFolder, fetched, working_folder

if TYPE_CHECKING:
    from typing import Self

Rows = list[dict[str, Any]]


class Run:
    """A run in its folder, as :func:`~blurnoise_eval.run.evaluation.evaluate` returns it and :meth:`open` reads it.

    Its tables are lists of rows, which ``pandas.DataFrame`` takes as they are:

    ``cells``: a row per picture, condition and model. ``targets``: a row per target of these. ``scores``: a row per
    model and condition. ``curves``: a row per curve over exposure or blur, with its area and where it fails.
    ``models``: a row per model. ``answers``: a row per model, target group, light and velocity, with the exposures
    that fulfil the ``criterion`` and the one to use.

    folder: where it is on this machine. setup: how it was made. trusted: whether labels, pictures and models may be
    opened where the run says they are. outcome: what :func:`evaluate` computed now; None of a run that was opened.

    >>> from blurnoise_eval import Run
    >>> Run.open("nowhere")
    Traceback (most recent call last):
    ...
    blurnoise_eval.store.store.StoreError: run = 'nowhere': holds no results.sqlite; make one with 'blurnoise sweep'
    """

    def __init__(
        self,
        store: Store,
        question: Question | None = None,
        *,
        trusted: bool = True,
        images: str | Path | PictureSet | None = None,
        progress: bool | None = None,
    ) -> None:
        self._store: Store | None = store
        self._lock = RLock()  # SQLite's connection is of one thread
        self._entered = ExitStack()
        self._working = WorkingFolder(store.folder)
        self._images = Path(images) if isinstance(images, str) else images
        self._question, self._progress = question or Question(), progress
        self.folder, self.trusted = store.folder, trusted
        self.setup = Setup.read(store)
        self.outcome: Outcome | None = None

    @classmethod
    def open(
        cls,
        folder: str | Path | WorkingFolder,
        question: Question | None = None,
        *,
        trust: bool = False,
        images: str | Path | PictureSet | None = None,
        progress: bool | None = None,
    ) -> Run:
        """Read and check a run. It may be anybody's; one at a URL is copied to this machine first.

        question: when a score is enough; what it leaves open is as the sweep was asked. trust: the run is this
        user's own, so that files outside its folder may be opened where it says they are; of runs that this user's
        account has computed that is known. images: the folder of the original pictures, or the pictures themselves,
        by default where the sweep found them. progress: whether to draw bars on the terminal.

        Raises :class:`~blurnoise_eval.store.store.StoreError` for a folder without a run, and for a damaged run.
        """
        working = fetched(folder)
        with Store(working.path) as store:
            trusted = trust or store.is_own()
            run = cls(store, question, trusted=trusted, images=images, progress=progress)
            check_rows(store, {name: len(run.setup.classes(name)) for name in run.setup.models})
        run._store, run._working = None, working
        return run

    def __enter__(self) -> Self:
        """Keep the run's file open, so that all that is read is of one moment."""
        self._entered.enter_context(self.store)
        return self

    def __exit__(self, *_: object) -> None:
        self._entered.close()

    @property
    def store(self) -> AbstractContextManager[Store]:
        """The run's rows and documents: ``with run.store as store``. In such a block another gives the same store."""
        return self._opened()

    @contextmanager
    def _opened(self) -> Iterator[Store]:
        with self._lock:
            if self._store is not None:
                yield self._store
                return
            with Store(self.folder) as self._store:
                try:
                    yield self._store
                finally:
                    self._store = None

    # --- how it was made ---

    @property
    def plan(self) -> SweepPlan:
        """The plan of the grid, or of the conditions that a search has chosen."""
        return self.setup.plan

    @property
    def camera(self) -> Camera:
        """The camera that pictures were taken with."""
        return self.setup.camera

    @property
    def question(self) -> Question:
        """When a score is enough: as :meth:`open` was asked, else as the sweep was."""
        return self._question.filled_from(self.setup.question)

    @cached_property
    def criterion(self) -> Criterion:
        """The criterion of the question. Raises ``ValueError`` for a score that the run does not have, and for the
        clusters of a run that is not trusted: a search for their regular expression may never end."""
        asked = self.question
        if asked.cluster is not None and not self.trusted and self._question.cluster is None:
            raise ValueError(
                f"cluster = {asked.cluster!r}: is of a run that is not your own; specify it again if it is harmless"
            )
        reads = any(note["kind"] == "reader" for note in self.setup.models.values())
        rendered = self.setup.manifest["images"]["kind"] == "rendered"
        criterion = criterion_for(asked, rendered=rendered, reads=reads, labelled=self.setup.labelled)
        check_cluster(asked.cluster, self.pictures)
        return criterion

    def note(self, batch: Batch) -> None:
        """Note conditions before they are computed, so that a run that was stopped goes on with the same ones."""
        with self.store as store:
            note_batch(store, batch)
            self.setup = Setup.read(store)

    def forget(self) -> None:
        """Read rows and tables anew when they are asked for again: more cells were computed."""
        for name in ("cells", "targets", "tables", "pictures", "_facts"):
            self.__dict__.pop(name, None)

    # --- tables ---

    @cached_property
    def cells(self) -> Rows:
        """A row per picture, condition and model, as results.csv has them."""
        with self.store as store:
            return [row.columns() for row in store.cells()]

    @cached_property
    def targets(self) -> Rows:
        """A row per cell and target, as targets.csv has them."""
        with self.store as store:
            return [row.columns() for row in store.targets()]

    @property
    def scores(self) -> Rows:
        """A row per model and condition, as scores.csv has them."""
        return [row.columns() for row in self.tables.scores]

    @property
    def curves(self) -> Rows:
        """A row per curve, as curves.csv has them, and the curve itself: ``x`` and ``confidence``."""
        return [row.columns() for row in self.tables.curves]

    @property
    def models(self) -> Rows:
        """A row per model, as models.csv has them."""
        return [row.columns() for row in self.tables.models]

    @property
    def answers(self) -> Rows:
        """For each model, target group, light and velocity the exposures that work, s, and the one to use."""
        return [row.columns() for row in self.tables.answers]

    @property
    def skipped(self) -> Rows:
        """Pictures that could not be read, with the reason."""
        return [row.columns() for row in self.tables.skipped]

    @cached_property
    def tables(self) -> RunData:
        """All tables of the run, values as numbers; computed when they are first asked for."""
        criterion = self.criterion
        with self.store as store:
            steps = store.count_different(*CONDITIONS, "model")
            with ProgressBar("score", steps, self._progress) as advance:
                return tables_of(store, self.setup, criterion, advance)

    @cached_property
    def withheld(self) -> dict[str, str]:
        """Why models have no answers, by their scores on the original pictures."""
        with self.store as store:
            return withheld_models(store, self.setup, self.criterion)

    def score_tables(self) -> list[ScoreTable]:
        """What was measured, by model and group of targets."""
        with self.store as store:
            return list(score_tables(store, self.setup, self.criterion))

    def tables_with_answers(self) -> list[ScoreTable]:
        """What was measured, without the models and groups that have no answers."""
        every = self.score_tables()
        return [table for table in every if table.model not in self.withheld and not table.reference_too_low]

    def averages(self, tables: Iterable[ScoreTable]) -> list[Averages]:
        """Means over groups, lights and speeds, by model, from which an exposure for all of them is recommended."""
        with self.store as store:
            return run_averages(store, self.setup, self.criterion, on_lines(self.setup, tables))

    def summary(self, output: str | Path | WorkingFolder | None = None) -> dict[str, Any]:
        """The contents of summary.json. output: the folder of the report, by default the run's."""
        written = self._output(output)
        places = {
            "run": self._working.with_url(self.folder),
            "report": written.with_url(written.path / "report.html"),
        }
        summary = places | summary_of(self.tables, self.setup)
        if self.outcome is not None:
            names = ("computed", "resumed", "wall_s", "workers_died")
            summary |= {name: getattr(self.outcome, name) for name in names}
        return summary

    def strategy_sentences(self) -> list[str]:
        """How many conditions a search has computed, or why it was the full grid; nothing of other runs."""
        return strategy_sentences(self.setup, self.tables.recommendations)

    # --- pictures and models ---

    @cached_property
    def _facts(self) -> dict[str, Any]:
        with self.store as store:
            return store.pictures()

    @cached_property
    def pictures(self) -> tuple[str, ...]:
        """The names of the pictures, in order."""
        return tuple(sorted(self._facts))

    @cached_property
    def _original_pictures(self) -> PictureSet:
        if isinstance(self._images, PictureSet):
            return self._images
        return pictures_of_run(self.setup.manifest["images"], self._images, self._named_path)

    def _named_path(self, what: str, path: str) -> Path:
        """A path that the run names. Raises ``ValueError`` unless the run is trusted."""
        if not self.trusted:
            other = "--trust opens it, --images a folder of pictures, --model a model"
            raise ValueError(f"{what} = {path!r}: is outside the folder of the run; {other}")
        return Path(path).expanduser()

    def picture(self, name: str) -> Picture:
        """An original picture of the run, in memory. Raises ``ValueError`` where it is missing or has changed, and
        for files outside of a run that is not trusted."""
        if name not in self._facts:
            raise ValueError(f"picture = {name!r}: must be a picture of the run")
        return original_picture(name, self._facts[name], lambda: self._original_pictures)

    def cell(self, **columns: Any) -> Cell:
        """The cell in the middle of the simulated ones that have these values in these columns. Raises ``ValueError``
        where there is none."""
        with self.store as store:
            rows = [*queries.cells_with(store, clean=0, **columns)]
        if not rows:
            text = ", ".join(f"{name} = {value!r}" for name, value in columns.items())
            raise ValueError(f"{text}: must be a simulated picture of the run, as listed in results.csv")
        return self.setup.cell_of(rows[len(rows) // 2])

    def scene(self, picture: Picture) -> PictureScene:
        """The light of a picture, as the run's cells have it."""
        return PictureScene(picture.load(), self.plan, picture)

    def expose(self, scene: PictureScene, cell: Cell, camera: Camera | None = None) -> Frame:
        """A cell's picture, of its scene, as the run took it or through another camera."""
        (frame,) = frames(scene, [cell], camera or self.camera)
        return frame

    def simulate(self, cell_id: str) -> NDArray[np.uint8]:
        """A simulated picture of the run once more, (H, W, 3), uint8, RGB; of an original one the picture itself.

        Raises what :meth:`picture` raises, and ``ValueError`` for another id.
        """
        with self.store as store:
            row = next(queries.cells_with(store, cell_id=cell_id), None)
        if row is None:
            raise ValueError(f"cell_id = {cell_id!r}: must be one of the run, as listed in results.csv")
        if self._scene is None or self._scene[0] != row.image:
            picture = self.picture(row.image)
            self._scene = row.image, picture, self.scene(picture)
        _, picture, scene = self._scene
        return (
            eight_bit(picture.load())
            if row.conditions.original
            else self.expose(scene, self.cell(cell_id=cell_id)).image
        )

    _scene: tuple[str, Picture, PictureScene] | None = None
    """The last picture that was simulated: many cells of one picture come one after the other."""

    def model(self, name: str, timeout_s: float = TIMEOUT_S) -> Detector:
        """A detector of the run, opened again; the built-in one wherever it was then.

        Raises ``ValueError`` where it is missing or has changed, for a reader of text, and for files outside of a run
        that is not trusted.
        """
        from blurnoise_models.detector import STOP_SIGN

        note = self.setup.models[name]
        if note["kind"] != "detector":
            raise ValueError(f"model = {name!r}: is a text recogniser, not a detector")
        built_in = note["sha256"] == model_sha256(STOP_SIGN)
        path = STOP_SIGN if built_in else self._named_path("model", note["file"])
        if not path.is_file() or model_sha256(path) != note["sha256"]:
            raise ValueError(f"model = {note['file']!r}: is missing, or has changed since the run")
        contract = parse_contract(note["contract"], "the run's contract")
        return Detector(path, contract=contract, timeout_s=timeout_s)

    # --- what is written ---

    def _output(self, output: str | Path | WorkingFolder | None) -> WorkingFolder:
        return self._working if output is None else working_folder(output)

    def report(
        self,
        output: str | Path | WorkingFolder | None = None,
        *,
        coco: bool = False,
        overwrite: bool = False,
        before: Callable[[], object] = lambda: None,
    ) -> Path:
        """Write the run's tables, figures and pages; returns the page's path.

        output: the folder, by default the run's. coco: also write detections and targets as COCO's files, see
        :func:`~blurnoise_eval.run.coco_export.write_detections`. overwrite: replace files that blurnoise did not
        write, too. before: called when all files may be written, before the first is. Raises ``OSError``, before
        anything is written where a file may not be replaced.
        """
        folder = self._output(output).path
        with writing(overwrite=overwrite):
            check_outputs(folder, *RUN_FILES)
            if coco:
                check_outputs(path_within(folder, "coco"), *detection_files(self.setup))
            summary = self.summary(output)
            before()
            with self.store as store:
                page = self._write_report(store, folder, summary)
                if coco:
                    write_detections(store, self.setup, folder / "coco")
            return page

    def _write_report(self, store: Store, folder: Path, summary: dict[str, Any]) -> Path:
        from blurnoise_eval.report import charts, failures, page  # matplotlib and plotly

        folder.mkdir(parents=True, exist_ok=True)
        write_exports(store, folder)
        failures.write_failures(store, self.tables, folder, self)
        write_tables(self.tables, folder)
        write_whole(folder / "summary.json", json.dumps(summary, indent=1).encode("utf-8"))
        tables = of_page(self.tables, self.setup)
        with ProgressBar("draw", len(charts.views(tables)), self._progress) as advance:
            return page.write_report(tables, folder, advance, run=str(summary["run"]))
