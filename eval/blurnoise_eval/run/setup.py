"""The setup of a run: its models, pictures, camera, plan and question, read from its documents and checked.

A run may be anybody's, so nothing in it is believed before it is checked; a fault names the run and the document.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import chain
from operator import itemgetter
from typing import Any

from blurnoise.camera import Camera
from blurnoise.scene.exposure import Exposure
from blurnoise_eval.plan.axes import CORE, EXPOSURE, NAMES, axis
from blurnoise_eval.plan.conditions import Cell, Conditions
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.plan.trajectory_spec import TrajectorySpec
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.run.documents import check_files, validated
from blurnoise_eval.run.search_space import SearchSpace
from blurnoise_eval.store import queries
from blurnoise_eval.store.rows import CellRow
from blurnoise_eval.store.store import Store, StoreError

Place = tuple[float, float]
BATCHES, QUESTION, SEARCH_SPACE = "asked", "enough", "question"
"""Keys of the store's documents, as every run so far has them."""


@dataclass(frozen=True)
class Batch:
    """Conditions that a strategy has chosen, noted before they are computed.

    n_pictures: computed under each of them, the first of the run's order. places: of a search, where the conditions
    lie on the plane of :mod:`blurnoise_eval.answers.plane`.
    """

    n_pictures: int
    places: tuple[Place, ...] = ()
    conditions: tuple[Conditions, ...] = ()


def note_batch(store: Store, batch: Batch) -> None:
    """Add a batch to those of the run."""
    noted = {**vars(batch), "conditions": [at.specified for at in batch.conditions]}
    store.set_about(BATCHES, [*(store.about(BATCHES) or ()), noted])


def note_search_space(store: Store, space: SearchSpace | None) -> None:
    """Note what a search is asked, or was asked last; None: a sweep of the grid."""
    if space is not None or store.about(SEARCH_SPACE) is not None:
        store.set_about(SEARCH_SPACE, None if space is None else asdict(space))


@dataclass(frozen=True)
class Setup:
    """What a run was asked, and with what: the content of its documents.

    manifest: title, models, camera, pictures and versions as plain values. identity: by which runs are told apart.
    plan: of the grid, or of the nodes that a search has chosen so far. batches: what a search, or the
    refinement of a grid, has chosen. question: as the run was asked last. search_space: of a search; None of a grid.
    wall_s: the time that the run has taken so far.
    """

    manifest: dict[str, Any]
    identity: dict[str, Any]
    camera: Camera
    plan: SweepPlan
    batches: tuple[Batch, ...]
    question: Question
    search_space: SearchSpace | None
    wall_s: float

    @classmethod
    def read(cls, store: Store) -> Setup:
        """The setup of a run that has begun. Raises :class:`StoreError` for one that has not, or is damaged."""
        if store.about("manifest") is None or store.about("identity") is None:
            raise StoreError(f"run = {str(store.folder)!r}: contains no sweep")
        manifest: dict[str, Any] = _document(store, "manifest")
        identity: dict[str, Any] = _document(store, "identity")
        with _named(store, "camera"):
            check_files(manifest["camera"])
            camera = Camera.from_dict(manifest["camera"])
        batches = _batches(store)
        with _named(store, "identity"):
            plan = _plan(dict(identity["plan"]), manifest["trajectory"], batches)
        with _named(store, QUESTION):
            question = Question(**(_document(store, QUESTION) or {}))
        with _named(store, SEARCH_SPACE):
            space = _search_space(_document(store, SEARCH_SPACE))
        wall_s = float(_document(store, "wall_s") or 0.0)
        setup = cls(manifest, identity, camera, plan, batches, question, space, wall_s)
        with _named(store, "manifest"):
            setup._check_models()
        return setup

    def _check_models(self) -> None:
        names = [note["name"] for note in self.manifest["models"]]
        if len(set(names)) < len(names):
            raise ValueError("models of one name")
        for name in names:
            if not all(isinstance(label, str) for label in self.classes(name)):
                raise ValueError(f"classes of {name!r} must be names")

    @property
    def planned(self) -> dict[str, Any]:
        """The plain values of the plan."""
        return dict(self.identity["plan"])

    @cached_property
    def models(self) -> dict[str, dict[str, Any]]:
        """What the manifest says of each model, by its name."""
        return {note["name"]: note for note in self.manifest["models"]}

    def classes(self, model: str) -> list[str]:
        """The names of a detector's classes; none of a reader."""
        note = self.models[model]
        return list(note["contract"]["classes"]) if note["kind"] == "detector" else []

    @property
    def labelled(self) -> bool:
        """Whether the pictures came with labels."""
        return bool(self.manifest["images"]["labelled"])

    @property
    def grid(self) -> Mapping[str, list[float]]:
        """Values by axis; none of a search."""
        values: Mapping[str, list[float]] = self.planned.get("grid", {})
        return values

    @property
    def grid_exposures_s(self) -> tuple[float, ...]:
        """The exposures of the grid; none of a search, or where the camera sets them."""
        exposures = tuple(self.grid.get(EXPOSURE.name, ()))
        return () if AUTOMATIC in exposures else exposures

    @property
    def searched(self) -> bool:
        """Whether conditions were chosen by a search."""
        return self.search_space is not None and not self.search_space.because

    @property
    def predicted(self) -> bool:
        """Whether answers are predicted between the nodes of a search over the plane, and not measured."""
        return self.searched and not self.grid

    @property
    def chosen(self) -> int:
        """How many conditions a strategy has chosen."""
        return len(self._chosen)

    @property
    def has_whole_grid(self) -> bool:
        """Whether a search has chosen all conditions of the grid."""
        return self._chosen.issuperset(self.plan.conditions())

    @property
    def refined(self) -> int:
        """How many conditions were chosen beyond a grid that is computed as a whole."""
        return len(self._chosen - self._of_grid) if self._of_grid and self.grid_exposures_s else 0

    @cached_property
    def _chosen(self) -> frozenset[Conditions]:
        return frozenset(at for batch in self.batches for at in batch.conditions)

    @cached_property
    def _of_grid(self) -> frozenset[Conditions]:
        """The conditions of a grid that is computed as a whole."""
        return frozenset(self.plan.conditions() if self.grid and not self.searched else ())

    @property
    def monotone(self) -> bool:
        """Whether more motion can only hurt: without a trajectory."""
        return self.manifest.get("trajectory") is None

    def exposure(self, at: Mapping[str, Any]) -> Exposure:
        """The exposure under the conditions of a row, which is not of an original picture."""
        conditions = Conditions(**{name: at[name] for name in NAMES})
        return conditions.exposure(
            self.camera,
            vehicle=self.plan.vehicle,
            spectrum=self.plan.own_spectrum,
            infrared=self.plan.infrared,
        )

    def cell_of(self, row: CellRow) -> Cell:
        """The cell of a row, which is not of an original picture.

        Raises ``ValueError`` where no condition of the plan has its id.
        """
        # an id is made of the axes that a plan names: those of the grid, or of what was chosen later
        names = {*CORE, *self.grid, *self.plan.spanned}
        of_grid = [Conditions(**{name: row.conditions[name] for name in names})] if self.grid else []
        for at in chain(of_grid, *(batch.conditions for batch in self.batches)):
            cell = Cell(row.image, row.repeat, at, row.seed)
            if cell.cell_id == row.cell_id:
                return cell
        raise ValueError(f"cell = {row.cell_id!r}: its conditions are not in the plan of the run")

    def missing_cells(self, store: Store) -> int:
        """How many of the plan's cells are not computed yet, those of skipped pictures apart."""
        n_pictures = self.manifest["images"]["count"]
        # Each picture has one cell besides: the original.
        per_picture = 1 + self.planned["repeats"] * len(self._of_grid | self._chosen)
        if not self.grid:
            n_pictures = self.batches[-1].n_pictures if self.batches else 0
        n_computed = queries.count_cells_of_read(store)
        return int((n_pictures - len(store.skipped())) * per_picture - n_computed)


def _document(store: Store, key: str) -> Any:
    with _named(store, key):
        return validated(key, store.about(key))


@contextmanager
def _named(store: Store, key: str) -> Iterator[None]:
    """A fault in a document as an error that names the run."""
    try:
        yield
    except StoreError:
        raise
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        raise store.damaged(key, str(error)) from None


def _batches(store: Store) -> tuple[Batch, ...]:
    every = map(itemgetter("n_pictures", "places", "conditions"), _document(store, BATCHES) or ())
    with _named(store, BATCHES):
        return tuple(
            Batch(n_pictures, tuple((u, w) for u, w in places), tuple(map(_conditions, conditions)))
            for n_pictures, places, conditions in every
        )


def _conditions(values: Mapping[str, float]) -> Conditions:
    return Conditions(**{name: axis(name).checked([value])[0] for name, value in values.items()})


def _plan(
    planned: Mapping[str, Any], trajectory: Mapping[str, Any] | None, batches: tuple[Batch, ...]
) -> SweepPlan:
    """The plan that its plain values say. Raises ``ValueError`` unless these are what a sweep writes for it."""
    path = TrajectorySpec(trajectory["text"], trajectory["content"]) if trajectory else None
    chosen = [] if "grid" in planned else [at for batch in batches for at in batch.conditions]
    plan = SweepPlan.from_dict(planned, path, chosen)
    # Edited values would give the cells other ids than those of the run's rows.
    if json.loads(json.dumps(plan.to_dict())) != planned:
        raise ValueError("is none that a sweep writes")
    return plan


def _search_space(document: Any) -> SearchSpace | None:
    """What was asked of a search last. Raises ``ValueError`` for a grid that is none of a plan."""
    if document is None:
        return None
    space = SearchSpace(**document)
    if dict(SweepPlan(space.grid).grid) != {name: tuple(values) for name, values in space.grid.items()}:
        raise ValueError("grid: is none of a plan")
    return space
