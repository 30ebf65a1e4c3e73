"""Dense planes of exposures: a detector asked at every node, kept as sums per cluster, for searches to be replayed.

Domain: nodes (u, w) of :mod:`blurnoise_eval.scoring.plane`, motion along x; a picture is a cluster. A node is taken
at ``EXPOSURE_S``, with the light and the speed that make it.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.axes import AUTOMATIC
from blurnoise_eval.grid.conditions import Cell, Conditions, cell_seed
from blurnoise_eval.scoring.plane import STILL_PX
from blurnoise_eval.sweep.blocks import Block
from blurnoise_eval.sweep.work import Work
from blurnoise_eval.system.files import write_whole

EXPOSURE_S = 0.01
GAINS: tuple[tuple[str, float | None], ...] = (("fixed", None), ("automatic", AUTOMATIC))
"""How the gain is set, and what of it conditions state."""
_CELLS = 64  # that a worker is given at once
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Planes:
    """What a detector scores at N nodes, by G groups of targets and C clusters.

    places: (N, 2). sums: (G, C, N) of its targets' confidences; clean: (G, C) the same of the untouched pictures;
    targets: (G, C) their number. gain: how it was set.
    """

    model: str
    camera: str
    gain: str
    places: Array
    groups: tuple[str, ...]
    clusters: tuple[str, ...]
    sums: Array
    clean: Array
    targets: Array

    def write(self, path: Path) -> None:
        """As one npz, sums in single precision; raises ``OSError``."""
        arrays = {each.name: np.asarray(getattr(self, each.name)) for each in fields(self)}
        arrays["sums"] = self.sums.astype(np.float32)
        packed = io.BytesIO()
        np.savez_compressed(packed, **arrays)  # type: ignore[arg-type]
        write_whole(path, packed.getvalue())

    @classmethod
    def read(cls, path: Path) -> Planes:
        """Those of :meth:`write`."""
        with np.load(path) as file:
            found = {name: file[name] for name in file.files}
        values: dict[str, Any] = {name: str(found[name]) for name in ("model", "camera", "gain")}
        values |= {name: tuple(found[name].tolist()) for name in ("groups", "clusters")}
        values |= {name: found[name].astype(float) for name in ("places", "sums", "clean", "targets")}
        return cls(**values)


def kept(
    folder: Path,
    detector: Detector,
    pictures: PictureSet,
    camera: Camera,
    places: Array,
    progress: Callable[[float], object] = lambda pictures: None,
) -> list[Planes]:
    """A plane for each of ``GAINS``: those in the folder, if they are of the same, or else computed and written.

    A file is planes-GAIN.npz. Raises ``OSError``.
    """
    found = []
    for name, gain_db in GAINS:
        path = folder / f"planes-{name}.npz"
        clusters = tuple(picture.name for picture in pictures)
        made = Planes.read(path) if path.is_file() else None
        same = made is not None and (made.model, made.camera, made.clusters) == (
            detector.name,
            camera.name,
            clusters,
        )
        if made is None or not same or not np.array_equal(made.places, places):
            made = computed(detector, pictures, camera, places, gain_db, progress)
            made.write(path)
        else:
            progress(len(pictures))
        found.append(made)
    return found


def conditions_at(place: Sequence[float], gain_db: float | None = None) -> Conditions:
    """The conditions of a node (u, w)."""
    motion = 2.0 ** place[1]
    return Conditions(
        exposure_s=EXPOSURE_S,
        illuminance_lux=2.0 ** place[0] / EXPOSURE_S,
        velocity_x_px_s=motion / EXPOSURE_S if motion > STILL_PX else 0.0,
        gain_db=gain_db,
    )


def computed(
    detector: Detector,
    pictures: PictureSet,
    camera: Camera,
    places: Array,
    gain_db: float | None = None,
    progress: Callable[[float], object] = lambda pictures: None,
) -> Planes:
    """Ask the detector at every node with every picture, one after the other, one noise field each.

    gain_db: infinite: the camera sets it; None: as the camera is. progress is told pictures.
    """
    order = np.lexsort(places.T)  # those of one blur together
    groups: dict[str, int] = {}
    found: list[dict[tuple[str, int], float]] = []
    for picture in pictures:
        worker = Work((detector,), camera).open(pictures_held=1)
        seed = cell_seed(0, picture.name, 0)
        cells = [Cell(picture.name, 0, None, seed)]
        cells += [Cell(picture.name, 0, conditions_at(places[node], gain_db), seed) for node in order]
        own: dict[tuple[str, int], float] = {}
        for first in range(0, len(cells), _CELLS):
            results = worker.compute(Block(picture, tuple(cells[first : first + _CELLS])))
            for place, result in enumerate(results, start=first - 1):
                for row in result.targets:
                    groups.setdefault(row["group"], len(groups))
                    at = row["group"], -1 if place < 0 else int(order[place])
                    own[at] = own.get(at, 0.0) + row["confidence"]
                    if place < 0:
                        own[row["group"], -2] = own.get((row["group"], -2), 0.0) + 1
        found.append(own)
        progress(1)
    names = tuple(sorted(groups))
    values = np.zeros((len(names), len(found), len(places) + 2))
    for cluster, own in enumerate(found):
        for (group, place), value in own.items():
            values[names.index(group), cluster, place] = value
    clusters = tuple(picture.name for picture in pictures)
    gain = next((name for name, each in GAINS if each == gain_db), f"{gain_db} dB")
    sums, targets, clean = values[..., :-2], values[..., -2], values[..., -1]
    return Planes(detector.name, camera.name, gain, places, names, clusters, sums, clean, targets)
