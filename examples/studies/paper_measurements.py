"""What the items of the rerun measure, each grid once: charts through a camera, and signs before networks.

Exposures are in ms (the paper's unit), light in lux, speeds in px/s along x (the paper's DX).

Networks see signs in two chains. "paper", as the paper's tool makes pictures: grey = 0.2989 R + 0.5870 G + 0.1140 B
of sRGB-coded values, which are taken for light; one plane of noise; 8 bits linear in light. It needs no switch of the
simulator: its light enters as a 16-bit picture coded so that it decodes to the coded grey (to 1e-5 of white), and its
camera has one plane and a straight tone curve. "camera": linear light of three colours, 8 bits sRGB-coded.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from blurnoise_eval import SweepPlan, datasets, evaluate
from blurnoise_eval.measure.charts import measure

from blurnoise import Camera, charts, simulate
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.metrics.edge.measurement import Flag, slanted_edge
from blurnoise.metrics.values import Estimate

CAMERA = "lin2024"
READ_FIELDS = 8
"""Noise fields of a reading, at least: what is read right six times in ten is so in all of three every fifth time."""
SIDE_PX = 320
DARK, BRIGHT, TILT_DEG = 0.18, 0.8, 2.0
"""Levels of the chart's edge, and its angle from vertical."""
Numbers = dict[tuple[str, float, float], Estimate]
"""By metric, or size of the sign, exposure in ms and speed in px/s."""


class NotRun(Exception):
    """Something that a measurement needs is missing; the message says what."""


@dataclass(frozen=True)
class Grid:
    """Exposures and speeds in one light before one camera: of charts, or of signs in a chain before a network.

    read: text is read on the signs; else the signs are detected.
    """

    exposures_ms: tuple[float, ...]
    speeds_px_s: tuple[float, ...]
    illuminance_lux: float = 50.0
    camera: str = CAMERA
    chain: str | None = None
    sizes_px: tuple[int, ...] = ()
    read: bool = False

    def plan(self, repeats: int) -> SweepPlan:
        """The conditions, with a noise field for each repeat."""
        axes = {
            "exposure_s": [1e-3 * ms for ms in self.exposures_ms],
            "illuminance_lux": [self.illuminance_lux],
            "velocity_x_px_s": self.speeds_px_s,
        }
        return SweepPlan(axes, repeats=repeats, examples=False)


@dataclass
class Measurements:
    """The measurements so far. detector, reader: ONNX files; None: the built-in detector, and no reader."""

    detector: Path | None = None
    reader: Path | None = None
    repeats: int = 3
    _done: dict[Grid, Numbers] = field(default_factory=dict)

    def __getitem__(self, grid: Grid) -> Numbers:
        """The numbers of a grid, measured once. Raises :class:`NotRun`."""
        if grid not in self._done:
            self._done[grid] = self._of_charts(grid) if grid.chain is None else self._of_signs(grid)
        return self._done[grid]

    def curve(
        self, grid: Grid, what: str, *, ms: float | None = None, dx: float | None = None
    ) -> dict[float, float]:
        """A metric, or the confidence in signs of one size, over exposure at a speed, or over speed at an exposure.

        Unavailable values are omitted; raises :class:`NotRun` if none is available.
        """
        curve = {
            (at_ms if ms is None else at_dx): estimate.value
            for (name, at_ms, at_dx), estimate in self[grid].items()
            if name == what and ms in (None, at_ms) and dx in (None, at_dx) and estimate.available
        }
        if not curve:
            where = f"{dx:g} px/s" if ms is None else f"{ms:g} ms"
            raise NotRun(f"{what} is not available at {where} and {grid.illuminance_lux:g} lux")
        return dict(sorted(curve.items()))

    def _of_charts(self, grid: Grid) -> Numbers:
        """Every metric; NaN where it is not available."""
        conditions = grid.plan(1).conditions()
        rows = measure(
            Camera.preset(grid.camera), conditions, repeats=self.repeats, threads=os.cpu_count() or 1
        )
        return {(row.metric, *_at(row.at)): row.estimate for row in rows}

    def _of_signs(self, grid: Grid) -> Numbers:
        """The confidence in signs of each size, "50 px".

        Of a detector the mean over noise fields. Of a reader the least of them, 0 where one reads anything but STOP.
        """
        if grid.read and self.reader is None:
            raise NotRun("the networks of PP-OCR are missing: pip install --no-deps rapidocr")
        repeats = max(self.repeats, READ_FIELDS) if grid.read else self.repeats
        confidences: dict[tuple[str, float, float], list[float]] = {}
        with TemporaryDirectory() as folder:
            run = evaluate(
                self.reader if grid.read else self.detector,
                signs(str(grid.chain), grid.sizes_px, read=grid.read),
                camera_of(str(grid.chain), grid.camera),
                grid.plan(repeats),
                output=folder,
                strategy="grid",
                progress=False,
            )
            for row in run.targets:
                if not row["clean"]:
                    confidences.setdefault((row["group"], *_at(row)), []).append(row["confidence"])
        of_fields = np.min if grid.read else np.mean
        return {key: Estimate(float(of_fields(values))) for key, values in confidences.items()}


def pp_ocr() -> Path | None:
    """The recogniser in the package rapidocr; None where that is not installed."""
    spec = find_spec("rapidocr")
    folders = (spec.submodule_search_locations or ()) if spec else ()
    return max(
        (path for folder in folders for path in Path(folder, "models").glob("*_rec_*.onnx")), default=None
    )


def clips_from_ms(lux: float) -> float:
    """The exposure, ms, from which the bright side of the chart's edge clips, to 0.5 %."""
    camera = Camera.preset(CAMERA)
    edge = charts.slanted_edge(160, 320, angle_deg=TILT_DEG, dark=DARK, bright=BRIGHT)
    low, high = 500.0 / lux, 2000.0 / lux
    while high / low > 1.005:
        middle = (low * high) ** 0.5
        light: Any = {"exposure_s": 1e-3 * middle, "illuminance_lux": lux}
        dn = simulate(edge, camera, **light, encoding="linear", generator=[0])
        clipped = Flag.CLIPPED in slanted_edge(dn[0], full_scale=camera.sensor.saturated_dn).flags
        low, high = (low, middle) if clipped else (middle, high)
    return high


def camera_of(chain: str, name: str = CAMERA) -> Camera:
    """The preset as the chain has it."""
    camera = Camera.preset(name)
    return camera.with_figures(cfa="mono", tone=((0.0, 0.0), (1.0, 1.0))) if chain == "paper" else camera


def signs(chain: str, sizes_px: tuple[int, ...], *, read: bool) -> datasets.PictureSet:
    """A stop sign of each size in the middle of 18 % grey, to be detected or to be read; group "SIZE px"."""
    side: Any = {"height_px": SIDE_PX, "width_px": SIDE_PX}
    pictures = []
    for number, size in enumerate(sizes_px, 1):
        group, name = f"{size} px", f"stop-sign-{size}px-{chain}"
        target = datasets.Target("stop sign", group, charts.stop_sign_box(size, **side))
        if read:
            target = datasets.Target("text", group, charts.stop_sign_text_box(size, **side), text="STOP")
        pictures.append(datasets.Picture(name, (target,), partial(picture, chain, size), name, number))
    return datasets.PictureSet("rendered", f"stop signs on 18 % grey, {chain} chain", tuple(pictures))


def picture(chain: str, size_px: int) -> datasets.Image:
    """The sign as the chain's scene, (320, 320, 3), sRGB-coded: 16 bits of grey, or 8 of colour."""
    scene = charts.stop_sign(size_px, height_px=SIDE_PX, width_px=SIDE_PX)[0]
    coded, depth = srgb_from_linear(scene), "uint8"
    if chain == "paper":
        grey = torch.einsum("c,chw->hw", torch.tensor((0.2989, 0.5870, 0.1140)), coded)
        coded, depth = srgb_from_linear(grey).expand(3, -1, -1), "uint16"
    codes = coded.double().mul(np.iinfo(depth).max).round().permute(1, 2, 0).numpy()
    return np.ascontiguousarray(codes.astype(depth))


def _at(row: Mapping[str, Any]) -> tuple[float, float]:
    """Exposure in ms and speed."""
    return float(round(1e3 * row["exposure_s"], 6)), row["velocity_x_px_s"]
