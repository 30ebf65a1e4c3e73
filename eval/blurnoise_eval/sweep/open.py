"""A run that is there, opened: its plan, camera, models and pictures as objects, beside its store."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise.scene.scene import Exposure
from blurnoise_eval.grid.axes import NAMES
from blurnoise_eval.grid.conditions import Conditions, SweepPlan
from blurnoise_eval.grid.objects import Objects
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.work import cells_per_picture

Place = tuple[float, float]
_KEY = "asked"


@dataclass(frozen=True)
class Batch:
    """Nodes asked at a time, and of how many pictures, the first of the run's order, every node is asked since."""

    n_pictures: int
    places: tuple[Place, ...] = ()
    conditions: tuple[Conditions, ...] = ()


def asked(store: Store) -> tuple[Batch, ...]:
    """Every batch in order; none where no search has asked."""
    return tuple(
        Batch(
            each["n_pictures"],
            tuple((u, w) for u, w in each["places"]),
            tuple(Conditions(**at) for at in each["conditions"]),
        )
        for each in store.about(_KEY) or ()
    )


def ask(store: Store, batch: Batch) -> None:
    """Note one batch more."""
    noted = {**vars(batch), "conditions": [at.stated for at in batch.conditions]}
    store.set_about(_KEY, [*(store.about(_KEY) or ()), noted])


class Run:
    """A run that has begun, in its open store. Raises :class:`StoreError` for one that has not.

    manifest: title, models, camera, images, versions, as plain values. planned: those of the plan, by which runs are
    told apart.
    """

    def __init__(self, store: Store) -> None:
        self.store, self.folder = store, store.folder
        manifest, identity = store.about("manifest"), store.about("identity")
        if manifest is None or identity is None:
            raise StoreError(f"run = {str(store.folder)!r}: contains no sweep")
        self.manifest: dict[str, Any] = manifest
        self.planned: dict[str, Any] = identity["plan"]

    @classmethod
    @contextmanager
    def open(cls, folder: str | Path, *, shared: bool = True) -> Iterator[Run]:
        """The run in a folder. shared: other readers may have it open, too."""
        with Store(Path(folder), shared=shared) as store:
            yield cls(store)

    @cached_property
    def camera(self) -> Camera:
        """The camera that pictures were taken with."""
        return Camera.from_dict(self.manifest["camera"])

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
        held = self.manifest.get("trajectory")
        return TrajectorySpec(held["text"], held["content"]) if held else None

    @cached_property
    def plan(self) -> SweepPlan:
        """The plan of the grid, or of the nodes that a search has asked for so far."""
        if self.grid:
            return SweepPlan(**{**self.planned, "trajectory": self.trajectory})
        held = {name: value for name, value in self.planned.items() if name not in ("further", "direction")}
        grid = {name: (value,) for name, value in self.planned["further"].items()}
        nodes = tuple(at for batch in self.asked for at in batch.conditions)
        return SweepPlan(grid, **held, only=nodes, direction=tuple(self.planned["direction"]))

    def missing_cells(self) -> int:
        """How many of the plan's cells are not there, those of skipped pictures apart."""
        chosen: int = self.planned["repeats"] * sum(len(batch.conditions) for batch in self.asked)
        n_pictures = self.manifest["images"]["count"]
        per_picture = chosen + (cells_per_picture(self.plan) if self.grid else 1)
        if not self.grid:
            n_pictures = self.asked[-1].n_pictures if self.asked else 0
        there = queries.count_cells_of_read(self.store)
        return int((n_pictures - len(self.store.skipped())) * per_picture - there)

    def exposure(self, at: Mapping[str, Any]) -> Exposure:
        """The exposure under the conditions of a row, which is not of an original picture."""
        conditions = Conditions(**{axis: at[axis] for axis in NAMES})
        return conditions.exposure(self.camera, vehicle=self.plan.ego)
