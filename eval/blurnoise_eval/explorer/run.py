"""A finished run in the explorer: its heat map, and any cell's picture, computed anew from the cell's seed.

A run keeps no pictures but their names, contents' hashes and boxes. They are opened again in ``images``, or, of a run
that is trusted, where it says they were, and are refused where their content is another. Of any other run no file
outside its folder is opened.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.deciding.decision import Decision
from blurnoise_eval.detectors.contract_files import parse_contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S
from blurnoise_eval.detectors.model_files import model_sha256
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.grid.axes import AXES, CORE, EXPOSURE, Axis
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.report.opening import opening
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import open as opened
from blurnoise_eval.sweep.exposing import Frame, Scene, frames
from blurnoise_eval.sweep.score_tables import asked_enough, criterion_of

_RENDERED = re.compile(r"rendered (?P<sizes>[\d.-]+) px, (?P<number>\d+) of seed (?P<seed>\d+)")
_LABELS = {"coco": datasets.coco, "yolo": datasets.yolo, "bdd": datasets.bdd, "text": datasets.texts}
Key = tuple[float | None, ...]


@dataclass(frozen=True)
class HeatMap:
    """A model's mean confidence by ``across`` and ``down``; the other axes are at ``at``. cells: (column, row) to the
    mean, of what was computed."""

    across: Axis
    down: Axis | None
    columns: tuple[float, ...]
    rows: tuple[float, ...]
    at: Mapping[str, float | None]
    cells: Mapping[tuple[int, int], float]

    def condition(self, column: int, row: int) -> dict[str, float | None]:
        """The values on all axes."""
        down = {self.down.name: self.rows[row]} if self.down else {}
        return {**self.at, self.across.name: self.columns[column], **down}


class Run:
    """A run's folder, read. Raises :class:`StoreError` for one without a run.

    images: where its pictures are, if not where they were. trusted: labels, pictures, plates and models may be opened
    where the run says they are.
    """

    def __init__(
        self, folder: str | Path, images: str | Path | None = None, *, trusted: bool = False
    ) -> None:
        self.folder, self.images, self.trusted = Path(folder), images, trusted
        with opened.Run.open(self.folder) as run:
            self.manifest, self.camera, self.objects = run.manifest, run.camera, run.objects
            self._plan, self._grid, self._batches = run.plan, run.grid, run.asked
            self._lost = run.planned.get("trajectory") if run.trajectory is None else None
            self._held = run.store.pictures()
            self._enough = asked_enough(run.store)
            self.criterion = criterion_of(run.store, **self._enough)
        self.models: tuple[str, ...] = tuple(model["name"] for model in self.manifest["models"])
        self.pictures: tuple[str, ...] = tuple(sorted(self._held))

    @cached_property
    def answer(self) -> str:
        """What the run's report opens with. Raises :class:`StoreError`."""
        opened_with = opening(Decision(self.folder, **self._enough, progress=False).data)
        notes = (f"{title}: {text}" for title, text in opened_with.notes)
        return "\n".join((*opened_with.sentences, *notes))

    @cached_property
    def _means(self) -> dict[str, dict[Key, float]]:
        """Mean confidence of every model under each condition."""
        sums: dict[str, dict[Key, list[float]]] = {name: {} for name in self.models}
        with Store(self.folder, shared=True) as store:
            for model in self.models:
                for row in queries.target_sums(store, model):
                    if not row["clean"]:
                        own = sums[model].setdefault(tuple(row[each.name] for each in AXES), [0.0, 0.0])
                        own[0] += row["target_confidence"]
                        own[1] += row["n_target_confidence"]
        return {
            model: {key: total / n for key, (total, n) in own.items() if n} for model, own in sums.items()
        }

    def heat_map(self, model: str, near: Mapping[str, float | None]) -> HeatMap:
        """Exposure, or what else varies most, across and the next down; the other axes at the tested value nearest to
        that of ``near``. Of a model that is not the run's, the first model's."""
        means = self._means.get(model, self._means[self.models[0]])
        tested = {
            each.name: sorted({value for key in means if (value := key[place]) is not None})
            for place, each in enumerate(AXES)
        }
        varied = [each for each in AXES if len(tested[each.name]) > 1] or [AXES[0]]
        varied.sort(key=lambda each: (each is not EXPOSURE, -len(tested[each.name])))
        across, down = varied[0], varied[1] if len(varied) > 1 else None
        at = {
            name: min(
                values,
                key=lambda value: (value != near[name], abs(value - (near[name] or 0.0))),
                default=None,
            )
            for name, values in tested.items()
        }
        columns, rows = tuple(tested[across.name]), tuple(tested[down.name]) if down else (math.nan,)
        found = HeatMap(across, down, columns, rows, at, {})
        cells = {
            (column, row): means[key]
            for column in range(len(columns))
            for row in range(len(rows))
            if (key := tuple(found.condition(column, row).values())) in means
        }
        return replace(found, cells=cells)

    def start(self) -> str:
        """The id of the cell in the middle of those of the first picture. Raises ``ValueError`` for none."""
        with Store(self.folder, shared=True) as store:
            rows = [*queries.cells_with(store, image=self.pictures[0], repeat=0, clean=0)]
        if not rows:
            raise ValueError("run: has no cell yet")
        return str(rows[len(rows) // 2]["cell_id"])

    def cell_at(self, condition: Mapping[str, float | None], image: str) -> str:
        """The cell's id of a picture under a condition. Raises ``ValueError`` for none."""
        with Store(self.folder, shared=True) as store:
            for row in queries.cells_with(store, image=image, repeat=0, clean=0, **condition):
                return str(row["cell_id"])
        raise ValueError(f"cell: {image!r} was not computed under these conditions")

    def cell(self, cell_id: str) -> Cell:
        """What the sweep computed, in full: the cell's id is made of it. Raises ``ValueError``."""
        with Store(self.folder, shared=True) as store:
            row = next(queries.cells_with(store, cell_id=cell_id), None)
        if row is None:
            raise ValueError(f"cell = {cell_id!r}: is none of the run's; they stand in results.csv")
        if row["clean"]:
            raise ValueError(f"cell = {cell_id!r}: is an original picture")
        planned = [Conditions(**{name: row[name] for name in {*CORE, *self._grid}})] if self._grid else []
        planned += [at for batch in self._batches for at in batch.conditions]
        for at in planned:
            cell = Cell(row["image"], row["repeat"], at, row["seed"])
            if cell.cell_id == cell_id:
                return cell
        raise ValueError(f"cell = {cell_id!r}: its conditions are not those of the run's plan")

    def scene(self, picture: Picture) -> Scene:
        """The picture as the run's cells saw it."""
        return Scene(picture.load(), self.manifest["grey_anchor"], picture, self.objects)

    def expose(self, scene: Scene, cell: Cell, camera: Camera | None = None) -> Frame:
        """A cell's picture, of its scene, as the run took it or through another camera. Raises ``ValueError``
        where it moved along a file that is not kept."""
        if self._lost:
            raise ValueError(
                f"run = {str(self.folder)!r}: moved along {self._lost!r}, which it does not keep"
            )
        plan = self._plan
        (frame,) = frames(scene, [cell], camera or self.camera, plan.auto_exposure, plan.path, plan.ego)
        return frame

    def picture(self, name: str) -> Picture:
        """A picture of the run, opened again. Raises ``ValueError`` where it is not there, or another by now, and for
        files outside of a run that is not trusted."""
        if name not in self._held:
            raise ValueError(f"picture = {name!r}: is none of the run's")
        identity, content, *_ = self._held[name]
        rendered = _RENDERED.fullmatch(identity)
        if rendered:
            sizes = [float(size) for size in rendered["sizes"].split("-")]
            texts = self.manifest["images"]["source"].startswith("texts")
            make = datasets.rendered_texts if texts else datasets.rendered_signs
            pictures = make(sizes, count=int(rendered["number"]) + 1, seed=int(rendered["seed"]))
        else:
            if self.objects.plates is not None:
                self._check_trusted("plates", self.objects.plates)
            pictures = self._opened
        picture = next((each for each in pictures if each.name == name), None)
        if picture is None:
            raise ValueError(f"picture = {name!r}: is not in {pictures.source}")
        if datasets.source_content(picture, picture.load(), self.objects) != content:
            raise ValueError(f"picture = {name!r}: is not what it was when the run was computed")
        return picture

    @cached_property
    def _opened(self) -> PictureSet:
        kind, source = self.manifest["images"]["kind"], self.manifest["images"]["source"]
        folder = Path(self.images) if self.images else None
        if kind == "folder" and folder:
            return datasets.image_folder(folder)
        self._check_trusted("images", source)
        if kind == "folder":
            return datasets.image_folder(Path(source))
        if kind not in _LABELS or not Path(source).exists():
            raise ValueError(f"images = {source!r}: the run's pictures are no longer there")
        opener: Any = _LABELS[kind]
        found: PictureSet = opener(Path(source), **({"images": folder} if folder else {}))
        return found

    def model(self, name: str, timeout_s: float = TIMEOUT_S) -> Model:
        """A model of the run, opened again; the built-in one wherever it lay then. Raises ``ValueError`` where it is
        gone or another, and for files outside of a run that is not trusted."""
        from blurnoise_models.detector import STOP_SIGN

        note = next(model for model in self.manifest["models"] if model["name"] == name)
        path = Path(note["file"]).expanduser()
        if note["sha256"] == model_sha256(STOP_SIGN):
            path = STOP_SIGN
        else:
            self._check_trusted("model", note["file"])
        if not path.is_file() or model_sha256(path) != note["sha256"]:
            raise ValueError(f"model = {note['file']!r}: is not there, or another than in the run")
        if note.get("kind") != "detector":
            return open_models([path], timeout_s=timeout_s)[0]
        contract = parse_contract(note["contract"], "the run's contract")
        return Detector(path, contract=contract, timeout_s=timeout_s)

    def _check_trusted(self, name: str, place: str) -> None:
        if not self.trusted:
            other = "--trust opens files of a run of your own, --images a folder, --model a model"
            raise ValueError(f"{name} = {place!r}: outside the run's folder; {other}")
