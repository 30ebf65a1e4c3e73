"""The pictures of a finished run: opened again, and any cell's picture, simulated again from the cell's seed.

A run keeps no pictures but their names, contents' hashes and boxes. They are opened again in ``images``, or, of a run
that is trusted, where it says they were, and are refused where their content is another. Of any other run no file
outside its folder is opened.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise_eval import datasets
from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.label_formats import format_named
from blurnoise_eval.plan.axes import CORE
from blurnoise_eval.plan.conditions import Cell, Conditions
from blurnoise_eval.run.exposing import Frame, Scene, frames
from blurnoise_eval.run.run import Run
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.urls import is_url

_RENDERED = re.compile(r"rendered (?P<sizes>[\d.-]+) px, (?P<number>\d+) of seed (?P<seed>\d+)")


class RunPictures:
    """The pictures of an open run.

    images: where they are, if not where they were, or the pictures themselves. Labels, pictures and models are opened
    where a run says they are, if it is trusted.
    """

    def __init__(self, run: Run, images: str | Path | PictureSet | None = None) -> None:
        self.folder, self.trusted = run.folder, run.trusted
        self._images = images if isinstance(images, PictureSet) or not images else Path(images)
        self.manifest, self.camera, self.objects = run.manifest, run.camera, run.objects
        self.plan, self._grid, self._batches = run.plan, run.grid, run.asked
        self._held = run.store.pictures()
        self.pictures: tuple[str, ...] = tuple(sorted(self._held))

    def cell(self, **columns: Any) -> Cell:
        """The cell in the middle of those that hold these values in these columns, in full, as its id is made of it.
        Raises ``ValueError`` for none."""
        with Store(self.folder) as store:
            rows = [*queries.cells_with(store, clean=0, **columns)]
        if not rows:
            text = ", ".join(f"{name} = {value!r}" for name, value in columns.items())
            raise ValueError(f"{text}: must be a simulated picture of the run, as listed in results.csv")
        row = rows[len(rows) // 2]
        planned = [Conditions(**{name: row[name] for name in {*CORE, *self._grid}})] if self._grid else []
        planned += [at for batch in self._batches for at in batch.conditions]
        for at in planned:
            cell = Cell(row["image"], row["repeat"], at, row["seed"])
            if cell.cell_id == row["cell_id"]:
                return cell
        raise ValueError(f"cell = {row['cell_id']!r}: its conditions are not in the plan of the run")

    def scene(self, picture: Picture) -> Scene:
        """The picture as the run's cells saw it."""
        return Scene(picture.load(), self.plan, picture)

    def expose(self, scene: Scene, cell: Cell, camera: Camera | None = None) -> Frame:
        """A cell's picture, of its scene, as the run took it or through another camera."""
        (frame,) = frames(scene, [cell], camera or self.camera)
        return frame

    def picture(self, name: str) -> Picture:
        """A picture of the run, in memory. Raises ``ValueError`` where it is not there, or another by now, and for
        files outside of a run that is not trusted."""
        if name not in self._held:
            raise ValueError(f"picture = {name!r}: must be a picture of the run")
        identity, content, *_ = self._held[name]
        rendered = _RENDERED.fullmatch(identity)
        if rendered:
            sizes = [float(size) for size in rendered["sizes"].split("-")]
            number, seed = int(rendered["number"]), int(rendered["seed"])
            pictures = datasets.rendered_signs(sizes, count=number + 1, seed=seed)
        else:
            pictures = self._opened
        picture = next((each for each in pictures if each.name == name), None)
        if picture is None:
            raise ValueError(f"picture = {name!r}: is not in {pictures.source}")
        image = picture.load()
        if datasets.content(image) != content:
            raise ValueError(f"picture = {name!r}: has changed since the run was computed")
        return replace(picture, load=lambda: image)

    @cached_property
    def _opened(self) -> PictureSet:
        kind, source = self.manifest["images"]["kind"], self.manifest["images"]["source"]
        folder = self._images
        if isinstance(folder, PictureSet):
            return folder
        at = self.manifest["images"].get("at", {})
        where = at.get("source", source)
        if kind == "folder":
            return datasets.image_folder(folder or self._trusted("images", where))
        labels = self._trusted("images", where)
        if folder is None and at and not is_url(at["folder"]):
            folder = self._trusted("images", at["folder"])
        of = format_named(kind)
        if of is None or not labels.exists():
            raise ValueError(f"images = {source!r}: must be a folder with the pictures of the run")
        found: PictureSet = of.open(labels, **({"images": folder} if folder else {}))
        return found

    def _trusted(self, name: str, place: str) -> Path:
        """A path that the run names. Raises ``ValueError`` unless the run is trusted."""
        if not self.trusted:
            other = "--trust opens it, --images a folder of pictures, --model a model"
            raise ValueError(f"{name} = {place!r}: is outside the folder of the run; {other}")
        return Path(place).expanduser()
