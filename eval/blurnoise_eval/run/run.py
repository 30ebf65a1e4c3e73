"""A run that is there, opened: its plan, camera, models and pictures as objects, beside its store."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise.scene.scene import Exposure
from blurnoise_eval.plan.axes import NAMES, axis
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.objects import Objects
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.plan.trajectory_spec import TrajectorySpec
from blurnoise_eval.run.documents import check_files, validated
from blurnoise_eval.store import queries
from blurnoise_eval.store.checks import check_rows
from blurnoise_eval.store.store import Store, StoreError

Place = tuple[float, float]
_KEY = "asked"
ENOUGH = "enough"
"""The key of a run's store for the last question."""


@dataclass(frozen=True)
class Batch:
    """Nodes asked at a time, and of how many pictures, the first of the run's order, every node is asked since."""

    n_pictures: int
    places: tuple[Place, ...] = ()
    conditions: tuple[Conditions, ...] = ()


def asked(store: Store) -> tuple[Batch, ...]:
    """Every batch in order; none where no search has asked."""
    every = map(itemgetter("n_pictures", "places", "conditions"), _document(store, _KEY) or ())
    with _named(store, _KEY):
        return tuple(
            Batch(n_pictures, tuple((u, w) for u, w in places), tuple(map(_conditions, conditions)))
            for n_pictures, places, conditions in every
        )


def ask(store: Store, batch: Batch) -> None:
    """Note one batch more."""
    noted = {**vars(batch), "conditions": [at.stated for at in batch.conditions]}
    store.set_about(_KEY, [*(store.about(_KEY) or ()), noted])


def _conditions(values: Mapping[str, float]) -> Conditions:
    return Conditions(**{name: axis(name).checked([value])[0] for name, value in values.items()})


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
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise store.damaged(key, str(error)) from None


class Run:
    """A run that has begun, in its open store. Raises :class:`StoreError` for one that has not.

    manifest: title, models, camera, images, versions, as plain values. planned: those of the plan, by which runs are
    told apart. trusted: labels, pictures and models may be opened where the run says they are, and its pattern of
    clusters be searched for.
    """

    def __init__(self, store: Store, *, trusted: bool = True) -> None:
        self.store, self.folder, self.trusted = store, store.folder, trusted
        if store.about("manifest") is None or store.about("identity") is None:
            raise StoreError(f"run = {str(store.folder)!r}: contains no sweep")
        self.manifest: dict[str, Any] = _document(store, "manifest")
        with _named(store, "identity"):
            self.planned: dict[str, Any] = dict(_document(store, "identity")["plan"])

    @classmethod
    @contextmanager
    def open(cls, folder: str | Path, *, trust: bool = False) -> Iterator[Run]:
        """The run in a folder, read and checked as a whole: it may be anybody's.

        trust: it is this user's own; a run of which this user's sweep has written every document is so anyway.
        """
        with Store(Path(folder)) as store:
            run = cls(store, trusted=trust or store.is_own())
            _ = run.camera, run.asked, run.plan, run.question, run.wall_s
            names = [model["name"] for model in run.manifest["models"]]
            if len(set(names)) < len(names):
                raise store.damaged("manifest", "models of one name")
            check_rows(store, {name: len(run.classes(name)) for name in names})
            yield run

    @cached_property
    def camera(self) -> Camera:
        """The camera that pictures were taken with."""
        with _named(self.store, "camera"):
            check_files(self.manifest["camera"])
            return Camera.from_dict(self.manifest["camera"])

    @cached_property
    def question(self) -> Question:
        """The question that the sweep was asked."""
        with _named(self.store, ENOUGH):
            return Question(**(_document(self.store, ENOUGH) or {}))

    @cached_property
    def wall_s(self) -> float:
        """Time that the run took so far."""
        return float(_document(self.store, "wall_s") or 0.0)

    def classes(self, model: str) -> list[str]:
        """The names of a detector's classes; none of a reader."""
        with _named(self.store, "manifest"):
            note = self.models[model]
            found = note["contract"]["classes"] if note["kind"] == "detector" else []
            if not all(isinstance(name, str) for name in found):
                raise ValueError(f"classes of {model!r} must be names")
            return list(found)

    @property
    def models(self) -> dict[str, dict[str, Any]]:
        """What the manifest says of each model, by its name."""
        return {model["name"]: model for model in self.manifest["models"]}

    @property
    def labelled(self) -> bool:
        """Whether the pictures came with labels."""
        return bool(self.manifest["images"]["labelled"])

    @cached_property
    def asked(self) -> tuple[Batch, ...]:
        """What a search, or the refinement of a grid's windows, has asked for."""
        return asked(self.store)

    @property
    def grid(self) -> Mapping[str, list[float]]:
        """Values by axis; none of a search."""
        values: Mapping[str, list[float]] = self.planned.get("grid", {})
        return values

    @property
    def objects(self) -> Objects:
        """What moves where not all of a picture does."""
        return self.plan.objects

    @cached_property
    def trajectory(self) -> TrajectorySpec | None:
        """What pictures do beside their velocity."""
        with _named(self.store, "trajectory"):
            held = self.manifest["trajectory"]
            return TrajectorySpec(held["text"], held["content"]) if held else None

    @cached_property
    def plan(self) -> SweepPlan:
        """The plan of the grid, or of the nodes that a search has asked for so far."""
        with _named(self.store, "plan"):
            nodes = () if self.grid else tuple(at for batch in self.asked for at in batch.conditions)
            plan = SweepPlan.from_dict(self.planned, self.trajectory, nodes)
            if json.loads(json.dumps(plan.to_dict())) != self.planned:
                raise ValueError("is none that a sweep writes")
            return plan

    def missing_cells(self) -> int:
        """How many of the plan's cells are not there, those of skipped pictures apart."""
        chosen: int = self.planned["repeats"] * sum(len(batch.conditions) for batch in self.asked)
        n_pictures = self.manifest["images"]["count"]
        per_picture = chosen + (self.plan.cells_per_picture if self.grid else 1)
        if not self.grid:
            n_pictures = self.asked[-1].n_pictures if self.asked else 0
        there = queries.count_cells_of_read(self.store)
        return int((n_pictures - len(self.store.skipped())) * per_picture - there)

    def exposure(self, at: Mapping[str, Any]) -> Exposure:
        """The exposure under the conditions of a row, which is not of an original picture."""
        conditions = Conditions(**{axis: at[axis] for axis in NAMES})
        return conditions.exposure(self.camera, vehicle=self.plan.vehicle)
