"""A finished run in the explorer: its heat map, and any cell's picture, computed anew from the cell's seed.

A run keeps no pictures but their names, contents' hashes and boxes. They are opened again in ``images``, or, of a run
that is trusted, where it says they were, and are refused where their content is another. Of any other run no file
outside its folder is opened.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from blurnoise.motion.ego import Vehicle
from blurnoise.optics.camera import Camera
from blurnoise.scene.metering import AutoExposure
from blurnoise_eval import datasets
from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.detectors.contract import parse_contract
from blurnoise_eval.detectors.detector import Detector, model_sha256
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.detectors.session import TIMEOUT_S
from blurnoise_eval.grid.axes import AXES, CORE, Axis
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.grid.objects import Objects
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store import queries
from blurnoise_eval.store.checked import check_rows
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.asked import asked
from blurnoise_eval.sweep.exposing import Frame, Scene, frames
from blurnoise_eval.sweep.run_surfaces import asked_enough, criterion_of

_RENDERED = re.compile(r"rendered (?P<sizes>[\d.-]+) px, (?P<number>\d+) of seed (?P<seed>\d+)")
Key = tuple[float | None, ...]


@dataclass(frozen=True)
class HeatMap:
    """A model's mean confidence, rows by columns; None where nothing was computed. values: on the axes that
    are fixed."""

    across: Axis
    down: Axis | None
    columns: tuple[float, ...]
    rows: tuple[float, ...]
    values: tuple[tuple[float | None, ...], ...]
    fixed: tuple[tuple[Axis, float], ...]


class Run:
    """A run's folder, read. Raises :class:`StoreError` for one without a run.

    images: where its pictures are, if not where they were. trusted: labels, pictures, plates and models may be opened
    where the run says they are.
    """

    def __init__(
        self, folder: str | Path, images: str | Path | None = None, *, trusted: bool = False
    ) -> None:
        self.folder, self.images, self.trusted = Path(folder), images, trusted
        with Store(self.folder, shared=True) as store:
            self.manifest: dict[str, Any] = store.about("manifest")
            if self.manifest is None:
                raise StoreError(f"run = {str(folder)!r}: no sweep has begun here")
            check_rows(store)
            plan = store.about("identity")["plan"]
            self._held = store.pictures()
            self._batches = asked(store)
            self.criterion = criterion_of(store, **asked_enough(store))
        self.camera = Camera.from_dict(self.manifest["camera"])
        self.models: tuple[str, ...] = tuple(model["name"] for model in self.manifest["models"])
        self.pictures: tuple[str, ...] = tuple(sorted(self._held))
        self._plan = plan
        self._auto = AutoExposure(**plan["auto_exposure"]) if "auto_exposure" in plan else AutoExposure()
        self.objects = Objects(**plan["objects"]) if "objects" in plan else Objects()
        self._ego = Vehicle(**plan["ego"]) if plan.get("ego") else None

    @cached_property
    def _sums(self) -> dict[str, dict[Key, float | None]]:
        """Mean confidence of every model under each condition."""
        found: dict[str, dict[Key, list[float]]] = {name: {} for name in self.models}
        with Store(self.folder, shared=True) as store:
            for model in self.models:
                for row in queries.target_sums(store, model, FOUND_SCORE):
                    if not row["clean"]:
                        sums = found[model].setdefault(_key(row), [0.0, 0.0])
                        sums[0] += row["target_confidence"]
                        sums[1] += row["n_target_confidence"]
        return {
            model: {key: total / n if n else None for key, (total, n) in sums.items()}
            for model, sums in found.items()
        }

    def heat_map(self, model: str, fixed: Mapping[str, float] | None = None) -> HeatMap:
        """Exposure, or what else varies most, across and the next down; the other axes at ``fixed``, by
        default in the middle of what was computed."""
        means = self._sums[model]
        keys = list(means)
        tested = {
            each: sorted({value for key in keys if (value := key[place]) is not None})
            for place, each in enumerate(AXES)
        }
        varied = [each for each in AXES if len(tested[each]) > 1]
        across = next((each for each in varied if each.name == "exposure_s"), None) or next(
            iter(varied), AXES[0]
        )
        others = sorted((each for each in varied if each is not across), key=lambda each: -len(tested[each]))
        down = others[0] if others else None
        at: dict[str, float | None] = {}
        for each in AXES:
            values: list[Any] = tested[each]
            asked_for = (fixed or {}).get(each.name)
            usual = values[len(values) // 2] if values else None
            at[each.name] = asked_for if asked_for in values else usual
        columns = tuple(tested[across])
        rows = tuple(tested[down]) if down else (math.nan,)
        table = tuple(
            tuple(
                means.get(
                    tuple(
                        {**at, across.name: x, **({down.name: y} if down else {})}[each.name] for each in AXES
                    )
                )
                for x in columns
            )
            for y in rows
        )
        rest = tuple((each, at[each.name]) for each in others[1:] if at[each.name] is not None)
        return HeatMap(across, down, columns, rows, table, rest)  # type: ignore[arg-type]

    def tested(self, name: str) -> list[float]:
        """The values on an axis, increasing."""
        place = [each.name for each in AXES].index(name)
        return sorted(
            {value for means in self._sums.values() for key in means if (value := key[place]) is not None}
        )

    def cell_at(self, at: Mapping[str, float | None], image: str, repeat: int = 0) -> str:
        """The cell's id of a picture under the condition of a table's row. Raises ``ValueError`` for none."""
        for row in self._rows():
            here = row["image"] == image and row["repeat"] == repeat and not row["clean"]
            if here and all(row[name] == value for name, value in at.items()):
                return str(row["cell_id"])
        raise ValueError(f"cell: {image!r} was not computed under these conditions")

    def row(self, cell_id: str) -> dict[str, Any]:
        """A cell's row of the first model. Raises ``ValueError`` for a cell that is not the run's."""
        for row in self._rows():
            if row["cell_id"] == cell_id:
                return row
        raise ValueError(f"cell = {cell_id!r}: is none of the run's; they stand in results.csv")

    def _rows(self) -> Iterator[dict[str, Any]]:
        with Store(self.folder, shared=True) as store:
            yield from store.cells()

    def cell(self, cell_id: str) -> Cell:
        """What the sweep computed, in full: the cell's id is made of it. Raises ``ValueError``."""
        row = self.row(cell_id)
        if row["clean"]:
            return Cell(row["image"], row["repeat"], None, row["seed"])
        grid = self._plan.get("grid")
        stated = [Conditions(**{name: row[name] for name in {*CORE, *grid}})] if grid else []
        stated += [at for batch in self._batches for at in batch.conditions]
        for at in stated:
            cell = Cell(row["image"], row["repeat"], at, row["seed"])
            if cell.cell_id == cell_id:
                return cell
        raise ValueError(f"cell = {cell_id!r}: its conditions are not those of the run's plan")

    def stored(self, cell_id: str, model: str) -> dict[str, Any]:
        """What the run says of a cell: the row of this model, its targets and detections. Raises ``ValueError``."""
        with Store(self.folder, shared=True) as store:
            for row in store.cells():
                if row["cell_id"] == cell_id and row["model"] == model:
                    targets = list(queries.targets_of(store, cell_id, model))
                    return {**row, "targets": targets, "detections": store.detections(cell_id, model)}
        raise ValueError(f"cell = {cell_id!r}: was not shown to {model!r}")

    def frame(self, cell_id: str) -> Frame:
        """The cell's picture, computed anew. Raises ``ValueError``."""
        cell = self.cell(cell_id)
        return self.expose(self.scene(self.picture(cell.image)), cell)

    def scene(self, picture: Picture) -> Scene:
        """The picture as the run's cells saw it."""
        return Scene(picture.load(), self.manifest["grey_anchor"], picture, self.objects)

    def expose(self, scene: Scene, cell: Cell, camera: Camera | None = None) -> Frame:
        """A cell's picture, of its scene, as the run took it or through another camera. Raises ``ValueError``
        where it moved along a file that is not kept."""
        (frame,) = frames(scene, [cell], camera or self.camera, self._auto, self._path, self._ego)
        return frame

    @property
    def _path(self) -> tuple[TrajectorySpec, float] | None:
        told = self._plan.get("trajectory")
        if told is None:
            return None
        with suppress(ValueError):
            stated = TrajectorySpec(told)
            longest = max(self._plan["grid"]["exposure_s"])
            return stated, self._auto.limit_s if longest == math.inf else longest
        raise ValueError(f"run = {str(self.folder)!r}: moved along {told!r}, a file that it does not keep")

    # -- pictures and models that the run names --------------------------------------------------------------

    def picture(self, name: str) -> Picture:
        """A picture of the run, opened again. Raises ``ValueError`` where it is not there, or another by now, and for
        files outside of a run that is not trusted."""
        if name not in self._held:
            raise ValueError(f"picture = {name!r}: is none of the run's")
        identity, content = self._held[name]
        rendered = _RENDERED.fullmatch(identity)
        if rendered:
            picture = _rendered(name, rendered, self.manifest["images"]["source"])
        else:
            if self.objects.plates is not None:
                self._check_trusted("plates", self.objects.plates)
            every = {each.name: each for each in self._opened}
            if name not in every:
                raise ValueError(f"picture = {name!r}: is not in {self._opened.source}")
            picture = every[name]
        if datasets.source_content(picture, picture.load(), self.objects) != content:
            raise ValueError(f"picture = {name!r}: is not what it was when the run was computed")
        return picture

    @cached_property
    def _opened(self) -> PictureSet:
        kind, source = self.manifest["images"]["kind"], self.manifest["images"]["source"]
        folder = Path(self.images) if self.images else None
        if kind == "folder" and folder:
            return datasets.image_folder(folder)
        self._check_trusted("images", source, " --images names the folder." * (kind == "folder"))
        where = Path(source)
        if kind == "folder":
            return datasets.image_folder(where)
        opener: Any = {
            "coco": datasets.coco,
            "yolo": datasets.yolo,
            "bdd": datasets.bdd,
            "text": datasets.texts,
        }.get(kind)
        if opener is None or not where.exists():
            raise ValueError(
                f"images = {source!r}: the run's pictures are no longer there; --images says where they are"
            )
        found: PictureSet = opener(where, **({"images": folder} if folder else {}))
        return found

    def model(self, name: str, timeout_s: float = TIMEOUT_S) -> Model:
        """A model of the run, opened again; the built-in one wherever that lay then. Raises ``ValueError`` where its
        file is gone or another."""
        from blurnoise_models.detector import STOP_SIGN

        (told,) = (model for model in self.manifest["models"] if model["name"] == name)
        path = STOP_SIGN
        if told["sha256"] != model_sha256(STOP_SIGN):
            self._check_trusted("model", told["file"], " --model names one.")
            path = Path(told["file"]).expanduser()
        if not path.is_file():
            raise ValueError(f"model = {told['file']!r}: the run's model is no longer there")
        if model_sha256(path) != told["sha256"]:
            raise ValueError(f"model = {told['file']!r}: is not what it was when the run was computed")
        opened: Model = (
            Detector(
                path, contract=parse_contract(told["contract"], "the run's contract"), timeout_s=timeout_s
            )
            if told.get("kind") == "detector"
            else open_models([path], timeout_s=timeout_s)[0]
        )
        return opened

    def _check_trusted(self, name: str, told: str, otherwise: str = "") -> None:
        if not self.trusted:
            raise ValueError(
                f"{name} = {told!r}: outside the run's folder; --trust opens what a run of your own names.{otherwise}"
            )


def _key(row: Mapping[str, Any]) -> Key:
    return tuple(row[each.name] for each in AXES)


def _rendered(name: str, told: re.Match[str], source: str) -> Picture:
    """The rendered picture of that name, which its identity says how to make."""
    sizes: Sequence[float] = [float(size) for size in told["sizes"].split("-")]
    make = datasets.rendered_texts if source.startswith("texts") else datasets.rendered_signs
    made = make(sizes, count=int(told["number"]) + 1, seed=int(told["seed"]))
    for picture in made:
        if picture.name == name:
            return picture
    raise ValueError(f"picture = {name!r}: is none of {source}")
