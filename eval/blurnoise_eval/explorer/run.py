"""A finished run in the explorer: its heat map, and any cell's picture, computed anew from the cell's seed.

A run keeps no pictures but their names, contents' hashes and boxes. They are opened again in ``images``, or, of a run
that is trusted, where it says they were, and are refused where their content is another. Of any other run no file
outside its folder is opened.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

from blurnoise.optics.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.answers.criterion import CONFIDENCE, KEPT, Criterion
from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.detectors.contract_files import parse_contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S, model_sha256
from blurnoise_eval.grid.axes import AXES, CORE, EXPOSURE, NAMES, Axis
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import open as opened
from blurnoise_eval.sweep.exposing import Frame, Scene, frames
from blurnoise_eval.sweep.score_tables import question_of

_RENDERED = re.compile(r"rendered (?P<sizes>[\d.-]+) px, (?P<number>\d+) of seed (?P<seed>\d+)")
USUAL = Criterion(KEPT, kept=True)
"""What is enough where no run says it in confidences."""
_LABELS = {"coco": datasets.coco, "yolo": datasets.yolo, "bdd": datasets.bdd}


class HeatMap(NamedTuple):
    """A detector's mean confidence by ``across`` and ``down``. cells: by the values on these two, those on all axes,
    and the mean there."""

    across: Axis
    down: Axis
    columns: list[float]
    rows: list[float]
    cells: dict[tuple[float, float], tuple[dict[str, float], float]]


class Run:
    """A run's folder, read. Raises :class:`StoreError` for one without a run, ``ValueError`` for one of readers.

    images: where its pictures are, if not where they were. trusted: labels, pictures and models may be opened
    where the run says they are.
    """

    def __init__(
        self, folder: str | Path, images: str | Path | None = None, *, trusted: bool = False
    ) -> None:
        self.folder, self.images, self.trusted = Path(folder), images and Path(images), trusted
        with opened.Run.open(self.folder) as run:
            self.manifest, self.camera, self.objects = run.manifest, run.camera, run.objects
            self._plan, self._grid, self._batches = run.plan, run.grid, run.asked
            self._held = run.store.pictures()
            asked, _ = question_of(run.store)
        if any(model["kind"] != "detector" for model in self.manifest["models"]):
            raise ValueError(f"run = {str(folder)!r}: is of text recognisers; the explorer shows detectors")
        self.criterion = asked if asked.score == CONFIDENCE else USUAL
        self.means = cache(self._read_means)
        self.models: tuple[str, ...] = tuple(model["name"] for model in self.manifest["models"])
        self.pictures: tuple[str, ...] = tuple(sorted(self._held))

    def _read_means(self, model: str) -> list[tuple[dict[str, float], float]]:
        """A detector's mean confidence under each condition."""
        with Store(self.folder, shared=True) as store:
            rows = [row for row in queries.target_sums(store, model) if not row["clean"]]
        counted = [(row, row["n_target_confidence"]) for row in rows if row["n_target_confidence"]]
        return [({name: row[name] for name in NAMES}, row["target_confidence"] / n) for row, n in counted]

    def heat_map(self, model: str, near: Mapping[str, float]) -> HeatMap:
        """By exposure, or what varies most, and what else varies; the other axes at the tested value nearest to
        ``near``. Of a detector that is not the run's, the first one's."""
        means = self.means(model if model in self.models else self.models[0])
        tested = {each: sorted({at[each.name] for at, _ in means}) for each in AXES}
        varied = sorted(
            AXES, key=lambda each: (len(tested[each]) < 2, each is not EXPOSURE, -len(tested[each]))
        )
        across, down = varied[:2]
        for each in varied[2:]:
            wanted = near[each.name]
            away = {value: (value != wanted, abs(value - wanted)) for value in tested[each]}
            nearest = min(away, key=away.__getitem__, default=None)
            means = [(at, mean) for at, mean in means if at[each.name] == nearest]
        cells = {(at[across.name], at[down.name]): (at, mean) for at, mean in means}
        return HeatMap(across, down, tested[across], tested[down], cells)

    def cell(self, **columns: Any) -> Cell:
        """The cell in the middle of those that hold these values in these columns, in full, as its id is made of it.
        Raises ``ValueError`` for none."""
        with Store(self.folder, shared=True) as store:
            rows = [*queries.cells_with(store, clean=0, **columns)]
        if not rows:
            text = ", ".join(f"{name} = {value!r}" for name, value in columns.items())
            raise ValueError(f"{text}: no simulated picture of the run; they stand in results.csv")
        row = rows[len(rows) // 2]
        planned = [Conditions(**{name: row[name] for name in {*CORE, *self._grid}})] if self._grid else []
        planned += [at for batch in self._batches for at in batch.conditions]
        for at in planned:
            cell = Cell(row["image"], row["repeat"], at, row["seed"])
            if cell.cell_id == row["cell_id"]:
                return cell
        raise ValueError(f"cell = {row['cell_id']!r}: its conditions are not those of the run's plan")

    def scene(self, picture: Picture) -> Scene:
        """The picture as the run's cells saw it."""
        plan = self._plan
        tone, lamps, white = plan.picture_tone, plan.lamps, plan.hdr_white
        return Scene(picture.load(), plan.grey_anchor, picture, self.objects, tone, lamps, white)

    def expose(self, scene: Scene, cell: Cell, camera: Camera | None = None) -> Frame:
        """A cell's picture, of its scene, as the run took it or through another camera."""
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
            pictures = datasets.rendered_signs(
                sizes, count=int(rendered["number"]) + 1, seed=int(rendered["seed"])
            )
        else:
            pictures = self._opened
        picture = next((each for each in pictures if each.name == name), None)
        if picture is None:
            raise ValueError(f"picture = {name!r}: is not in {pictures.source}")
        if datasets.content(picture.load()) != content:
            raise ValueError(f"picture = {name!r}: is not what it was when the run was computed")
        return picture

    @cached_property
    def _opened(self) -> PictureSet:
        kind, source = self.manifest["images"]["kind"], self.manifest["images"]["source"]
        folder = self.images
        if kind == "folder":
            return datasets.image_folder(folder or self._trusted("images", source))
        labels = self._trusted("images", source)
        if kind not in _LABELS or not labels.exists():
            raise ValueError(f"images = {source!r}: the run's pictures are no longer there")
        opener: Any = _LABELS[kind]
        found: PictureSet = opener(labels, **({"images": folder} if folder else {}))
        return found

    def model(self, name: str, timeout_s: float = TIMEOUT_S) -> Detector:
        """A detector of the run, opened again; the built-in one wherever it lay then. Raises ``ValueError`` where it
        is gone or another, and for files outside of a run that is not trusted."""
        from blurnoise_models.detector import STOP_SIGN

        note = next(model for model in self.manifest["models"] if model["name"] == name)
        built_in = note["sha256"] == model_sha256(STOP_SIGN)
        path = STOP_SIGN if built_in else self._trusted("model", note["file"])
        if not path.is_file() or model_sha256(path) != note["sha256"]:
            raise ValueError(f"model = {note['file']!r}: is not there, or another than in the run")
        contract = parse_contract(note["contract"], "the run's contract")
        return Detector(path, contract=contract, timeout_s=timeout_s)

    def _trusted(self, name: str, place: str) -> Path:
        """A path that the run names. Raises ``ValueError`` unless the run is trusted."""
        if not self.trusted:
            other = "--trust opens files of a run of your own, --images a folder, --model a model"
            raise ValueError(f"{name} = {place!r}: outside the run's folder; {other}")
        return Path(place).expanduser()
