"""Measurements that items share, each made once: charts through the lin2024 camera, and signs before networks.

Domain: exposures in ms (the paper's unit), light in lux, speeds in px/s along x (the paper's DX).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

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
Progress = Callable[[float], None]


class NotRun(Exception):
    """Something that a measurement needs is missing; the message says what."""


@dataclass(frozen=True)
class Means:
    """What measures: a detector, a reader of text (None: none is installed), noise fields, threads, the seed."""

    detector: Detector
    reader: Reader | None
    repeats: int = 3
    threads: int = 1
    seed: int = 0


class Measurement(Protocol):
    """Something that is measured once. ``steps``: of progress, about half a second each."""

    def steps(self, means: Means) -> float:
        """Of progress, with these means."""

    def measure(self, means: Means, progress: Progress) -> Any:
        """The numbers; raises :class:`NotRun`."""


@dataclass(frozen=True)
class Charts:
    """Every metric of charts over exposures and speeds in one light: (metric, ms, px/s) -> estimate."""

    illuminance_lux: float
    exposures_ms: tuple[float, ...]
    speeds_px_s: tuple[float, ...]
    camera: str = CAMERA

    def plan(self, means: Means) -> SweepPlan:
        """As a sweep."""
        grid = {
            "exposure_s": [1e-3 * each for each in self.exposures_ms],
            "illuminance_lux": [self.illuminance_lux],
            "velocity_x_px_s": self.speeds_px_s,
        }
        return SweepPlan(grid, repeats=means.repeats, seed=means.seed)

    def steps(self, means: Means) -> float:
        """Of progress."""
        return len(self.plan(means).conditions()) * means.repeats

    def measure(self, means: Means, progress: Progress) -> dict[tuple[str, float, float], Estimate]:
        """The estimates; NaN where a metric is withheld."""
        rows = quality.measure(
            Camera.preset(self.camera),
            self.plan(means),
            threads=means.threads,
            progress=lambda count: progress(count * means.repeats),
        )
        return {(row.metric, _ms(row.at), row.at["velocity_x_px_s"]): row.estimate for row in rows}


@dataclass(frozen=True)
class Saturation:
    """The exposure, ms, from which the bright side of the chart's edge clips, by light in lux; to 0.5 %."""

    lights_lux: tuple[float, ...]
    within_lux_ms: tuple[float, float] = (500.0, 2000.0)
    """Light times exposure that does not clip, and that does."""

    def steps(self, means: Means) -> float:
        """Of progress."""
        return float(len(self.lights_lux))

    def measure(self, means: Means, progress: Progress) -> dict[float, float]:
        """By bisection of the exposure's logarithm."""
        camera = Camera.preset(CAMERA)
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
                dn = simulate(
                    scene,
                    camera,
                    exposure_s=1e-3 * middle,
                    illuminance_lux=lux,
                    encoding="linear",
                    generator=[cell_seed(means.seed, "saturation", 0)],
                )
                edge = slanted_edge(dn[0], full_scale=camera.saturated_dn)
                clipped = not isinstance(edge, list) and Flag.CLIPPED in edge.flags
                low, high = (low, middle) if clipped else (middle, high)
            found[lux] = high
            progress(1)
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

    def plan(self, means: Means) -> SweepPlan:
        """As a sweep."""
        grid = {
            "exposure_s": [1e-3 * each for each in self.exposures_ms],
            "illuminance_lux": [self.illuminance_lux],
            "velocity_x_px_s": self.speeds_px_s,
        }
        return SweepPlan(grid, repeats=self._fields(means), seed=means.seed, examples=False)

    def steps(self, means: Means) -> float:
        """Of progress."""
        return (
            self._cost * len(self.sizes_px) * (1 + self._fields(means) * len(self.plan(means).conditions()))
        )

    def measure(self, means: Means, progress: Progress) -> dict[tuple[int, float, float], float]:
        """The confidences."""
        model = means.reader if self.read else means.detector
        if model is None:
            raise NotRun("needs PP-OCR's networks: pip install 'blurnoise[ocr]'")
        shown = chains.signs(self.chain, self.sizes_px, read=self.read)
        camera, plan = chains.camera_of(self.chain, self.camera), self.plan(means)
        scores: dict[tuple[int, float, float], list[float]] = {}
        with TemporaryDirectory() as folder, Store(Path(folder, "signs"), create=True) as store:
            sweep.run(
                [model],
                camera,
                shown,
                plan,
                store,
                engine=ThreadEngine(means.threads),
                progress=lambda cells: progress(self._cost * cells),
            )
            for row in store.targets():
                if not row["clean"]:
                    key = (int(row["group"].split()[0]), _ms(row), row["velocity_x_px_s"])
                    scores.setdefault(key, []).append(row["confidence"])
        of_fields = np.min if self.read else np.mean
        return {key: float(of_fields(values)) for key, values in scores.items()}

    def _fields(self, means: Means) -> int:
        return max(means.repeats, READ_FIELDS) if self.read else means.repeats

    @property
    def _cost(self) -> float:
        return 0.15 if self.read else 0.05


@dataclass
class Measurements:
    """The measurements so far; one that is asked for is made, once."""

    means: Means
    progress: Progress = lambda steps: None
    _made: dict[Measurement, Any] = field(default_factory=dict)

    def __getitem__(self, of: Any) -> Any:
        """The numbers of a measurement. Raises :class:`NotRun`."""
        if of not in self._made:
            self._made[of] = of.measure(self.means, self.progress)
        return self._made[of]


def _ms(row: Mapping[str, Any]) -> float:
    return float(round(1e3 * row["exposure_s"], 6))
