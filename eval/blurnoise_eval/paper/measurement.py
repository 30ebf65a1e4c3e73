"""Measurements that items share, each made once: charts through a camera, and signs before networks.

Domain: exposures in ms (the paper's unit), light in lux, speeds in px/s along x (the paper's DX).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from blurnoise import charts, simulate
from blurnoise.metrics import Flag, slanted_edge
from blurnoise.metrics.estimate import Estimate
from blurnoise.optics.camera import Camera
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import SweepPlan, cell_seed
from blurnoise_eval.paper import chains
from blurnoise_eval.quality import measure as quality
from blurnoise_eval.scoring.on_picture import Reader
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep.engines import ThreadEngine

CAMERA = "lin2024"
READ_FIELDS = 8
"""Noise fields of a reading, at least: what is read right six times in ten is so in all of three every fifth time."""


class NotRun(Exception):
    """Something that a measurement needs is missing; the message says what."""


@dataclass
class Measurements:
    """The measurements so far, and what makes them. reader: of text, None where none is installed. repeats: noise
    fields."""

    detector: Detector
    reader: Reader | None
    repeats: int = 3
    threads: int = 1
    seed: int = 0
    _made: dict[Any, Any] = field(default_factory=dict)

    def __getitem__(self, of: Any) -> Any:
        """The numbers of a measurement, made once. Raises :class:`NotRun`."""
        if of not in self._made:
            self._made[of] = of.measure(self)
        return self._made[of]


@dataclass(frozen=True)
class Charts:
    """Every metric of charts over exposures and speeds in one light: (metric, ms, px/s) -> estimate."""

    illuminance_lux: float
    exposures_ms: tuple[float, ...]
    speeds_px_s: tuple[float, ...]
    camera: str = CAMERA

    def measure(self, using: Measurements) -> dict[tuple[str, float, float], Estimate]:
        """The estimates; NaN where a metric is withheld."""
        rows = quality.measure(
            Camera.preset(self.camera),
            SweepPlan(_grid(self)).conditions(),
            repeats=using.repeats,
            seed=using.seed,
            threads=using.threads,
        )
        return {(row.metric, *_place(row.at)): row.estimate for row in rows}


@dataclass(frozen=True)
class Saturation:
    """The exposure, ms, from which the bright side of the chart's edge clips, by light in lux; to 0.5 %.

    within_lux_ms: light times exposure that does not clip, and that does.
    """

    lights_lux: tuple[float, ...]
    within_lux_ms: tuple[float, float] = (500.0, 2000.0)

    def measure(self, using: Measurements) -> dict[float, float]:
        """By bisection of the exposure's logarithm."""
        camera, seed = Camera.preset(CAMERA), cell_seed(using.seed, "saturation", 0)
        scene = charts.slanted_edge(
            quality.ALONG_PX,
            quality.ACROSS_PX,
            angle_deg=quality.TILT_DEG,
            dark=quality.DARK,
            bright=quality.BRIGHT,
        )
        found: dict[float, float] = {}
        for lux in self.lights_lux:
            low, high = (each / lux for each in self.within_lux_ms)
            while high / low > 1.005:
                middle = (low * high) ** 0.5
                light: Any = {"exposure_s": 1e-3 * middle, "illuminance_lux": lux}
                dn = simulate(scene, camera, **light, encoding="linear", generator=[seed])
                edge = slanted_edge(dn[0], full_scale=camera.saturated_dn)
                clipped = not isinstance(edge, list) and Flag.CLIPPED in edge.flags
                low, high = (low, middle) if clipped else (middle, high)
            found[lux] = high
        return found


@dataclass(frozen=True)
class Signs:
    """Signs of each size before the detector or the reader: (size, ms, px/s) -> confidence.

    A detector's is the mean over noise fields. A reader's is the least of them, 0 where one reads anything but STOP.
    """

    chain: chains.Chain
    read: bool
    sizes_px: tuple[int, ...]
    exposures_ms: tuple[float, ...]
    speeds_px_s: tuple[float, ...]
    illuminance_lux: float = 50.0
    camera: str = CAMERA

    def measure(self, using: Measurements) -> dict[tuple[int, float, float], float]:
        """The confidences."""
        model = using.reader if self.read else using.detector
        if model is None:
            raise NotRun("needs PP-OCR's networks: pip install 'blurnoise[ocr]'")
        repeats = max(using.repeats, READ_FIELDS) if self.read else using.repeats
        plan = SweepPlan(_grid(self), repeats=repeats, seed=using.seed, examples=False)
        shown = chains.signs(self.chain, self.sizes_px, read=self.read)
        camera, engine = chains.camera_of(self.chain, self.camera), ThreadEngine(using.threads)
        scores: dict[tuple[int, float, float], list[float]] = {}
        with TemporaryDirectory() as folder, Store(Path(folder, "signs"), create=True) as store:
            sweep.run([model], camera, shown, plan, store, engine=engine)
            for row in store.targets():
                if not row["clean"]:
                    key = (int(row["group"].split()[0]), *_place(row))
                    scores.setdefault(key, []).append(row["confidence"])
        of_fields = np.min if self.read else np.mean
        return {key: float(of_fields(values)) for key, values in scores.items()}


def _grid(of: Charts | Signs) -> dict[str, list[float]]:
    return {
        "exposure_s": [1e-3 * each for each in of.exposures_ms],
        "illuminance_lux": [of.illuminance_lux],
        "velocity_x_px_s": list(of.speeds_px_s),
    }


def _place(row: Mapping[str, Any]) -> tuple[float, float]:
    """Exposure in ms and speed."""
    return float(round(1e3 * row["exposure_s"], 6)), row["velocity_x_px_s"]
