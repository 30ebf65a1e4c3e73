"""Measurements that items share, each made once: charts through a camera, and signs before networks.

Domain: exposures in ms (the paper's unit), light in lux, speeds in px/s along x (the paper's DX).

Networks see signs in two chains. "paper", as the paper's tool makes pictures: grey = 0.2989 R + 0.5870 G + 0.1140 B
of sRGB-coded values, which are taken for light; one plane of noise; 8 bits linear in light. It needs no switch of the
simulator: its light enters as a 16-bit picture coded so that it decodes to the coded grey (to 1e-5 of white), and its
camera has one plane and a straight tone curve. "camera": linear light of three colours, 8 bits sRGB-coded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
import torch

from blurnoise import charts, simulate
from blurnoise.metrics import Flag, slanted_edge
from blurnoise.metrics.values import Estimate
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import srgb_from_linear
from blurnoise_eval.datasets import RENDERED_SIZE_PX, Image, Picture, PictureSet, Target
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.measure import charts as quality
from blurnoise_eval.plan.conditions import cell_seed
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run import computing as sweep
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.scoring.on_picture import Reader
from blurnoise_eval.store.store import Store

Chain = Literal["paper", "camera"]
CHAINS: tuple[Chain, ...] = ("paper", "camera")
CAMERA = "lin2024"
READ_FIELDS = 8
"""Noise fields of a reading, at least: what is read right six times in ten is so in all of three every fifth time."""
Numbers = dict[tuple[str, float, float], Estimate]
"""By metric, or size of the sign in px, exposure in ms and speed in px/s."""
_SIDE: Any = {"height_px": RENDERED_SIZE_PX, "width_px": RENDERED_SIZE_PX}


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
    _made: dict[Grid, Numbers] = field(default_factory=dict)

    def __getitem__(self, of: Grid) -> Numbers:
        """The numbers of a grid, measured once. Raises :class:`NotRun`."""
        if of not in self._made:
            self._made[of] = of.measure(self)
        return self._made[of]

    def curve(
        self, of: Grid, what: str, *, ms: float | None = None, dx: float | None = None
    ) -> dict[float, float]:
        """A metric, or the confidence in signs of so many px, over exposure at a speed, or over speed at an exposure.

        Unavailable values are omitted; raises :class:`NotRun` if none is available.
        """
        found = {
            (at_ms if ms is None else at_dx): each.value
            for (name, at_ms, at_dx), each in self[of].items()
            if name == what and ms in (None, at_ms) and dx in (None, at_dx) and each.available
        }
        if not found:
            where = f"{dx:g} px/s" if ms is None else f"{ms:g} ms"
            raise NotRun(f"{what} is not available at {where} and {of.illuminance_lux:g} lux")
        return dict(sorted(found.items()))


@dataclass(frozen=True)
class Grid:
    """Exposures and speeds in one light before one camera: of charts, or of signs in a chain before a network.

    read: by the reader of text; else found by the detector.
    """

    exposures_ms: tuple[float, ...]
    speeds_px_s: tuple[float, ...]
    illuminance_lux: float = 50.0
    camera: str = CAMERA
    chain: Chain | None = None
    sizes_px: tuple[int, ...] = ()
    read: bool = False

    def measure(self, using: Measurements) -> Numbers:
        """Every metric of charts, NaN where it is withheld; or the confidence in signs of each size, "50 px".

        A detector's is the mean over noise fields. A reader's is the least of them, 0 where one reads anything but
        STOP.
        """
        axes = {
            "exposure_s": [1e-3 * each for each in self.exposures_ms],
            "illuminance_lux": [self.illuminance_lux],
            "velocity_x_px_s": self.speeds_px_s,
        }
        repeats = max(using.repeats, READ_FIELDS) if self.read else using.repeats
        plan = SweepPlan(axes, repeats=repeats, examples=False)
        if self.chain is None:
            how: Any = {"repeats": repeats, "threads": using.threads}
            rows = quality.measure(Camera.preset(self.camera), plan.conditions(), **how)
            return {(row.metric, *_place(row.at)): row.estimate for row in rows}
        model = using.reader if self.read else using.detector
        if model is None:
            raise NotRun("the networks of PP-OCR are missing: pip install 'blurnoise[ocr]'")
        shown, camera = signs(self.chain, self.sizes_px, read=self.read), camera_of(self.chain, self.camera)
        scores: dict[tuple[str, float, float], list[float]] = {}
        with TemporaryDirectory() as folder, Store(Path(folder, "signs"), create=True) as store:
            sweep.run([model], camera, shown, plan, store, engine=ThreadEngine(using.threads))
            for row in store.targets():
                if not row["clean"]:
                    scores.setdefault((row["group"], *_place(row)), []).append(row["confidence"])
        of_fields = np.min if self.read else np.mean
        return {key: Estimate(float(of_fields(values))) for key, values in scores.items()}


def clips_from_ms(lux: float) -> float:
    """The exposure, ms, from which the bright side of the chart's edge clips, to 0.5 %."""
    camera, generator = Camera.preset(CAMERA), [cell_seed(0, "saturation", 0)]
    levels: Any = {"angle_deg": quality.TILT_DEG, "dark": quality.DARK, "bright": quality.BRIGHT}
    scene = charts.slanted_edge(quality.ALONG_PX, quality.ACROSS_PX, **levels)
    low, high = 500.0 / lux, 2000.0 / lux
    while high / low > 1.005:
        middle = (low * high) ** 0.5
        light: Any = {"exposure_s": 1e-3 * middle, "illuminance_lux": lux}
        dn = simulate(scene, camera, **light, encoding="linear", generator=generator)
        edge: Any = slanted_edge(dn[0], full_scale=camera.saturated_dn)
        low, high = (low, middle) if Flag.CLIPPED in edge.flags else (middle, high)
    return high


def camera_of(chain: Chain, name: str = CAMERA) -> Camera:
    """The preset as the chain has it."""
    camera = Camera.preset(name)
    return replace(camera, cfa="mono", tone=((0.0, 0.0), (1.0, 1.0))) if chain == "paper" else camera


def signs(chain: Chain, sizes_px: tuple[int, ...], *, read: bool) -> PictureSet:
    """A stop sign of each size in the middle of 320 px of 18 % grey, to be found or to be read; group "SIZE px"."""
    pictures = []
    for place, size in enumerate(sizes_px, 1):
        group, name = f"{size} px", f"stop-sign-{size}px-{chain}"
        target = Target("stop sign", group, charts.stop_sign_box(size, **_SIDE))
        if read:
            target = Target("text", group, charts.stop_sign_text_box(size, **_SIDE), text="STOP")
        pictures.append(Picture(name, (target,), partial(picture, chain, size), name, place))
    return PictureSet("rendered", f"stop signs on 18 % grey, {chain} chain", tuple(pictures))


def picture(chain: Chain, size_px: int) -> Image:
    """The sign as the chain's scene, (320, 320, 3), sRGB-coded: 16 bits of grey, or 8 of colour."""
    coded, kind = srgb_from_linear(charts.stop_sign(size_px, **_SIDE)[0]), "uint8"
    if chain == "paper":
        grey = torch.einsum("c,chw->hw", torch.tensor((0.2989, 0.5870, 0.1140)), coded)
        coded, kind = srgb_from_linear(grey).expand(3, -1, -1), "uint16"
    codes = coded.double().mul(np.iinfo(kind).max).round().permute(1, 2, 0).numpy()
    return np.ascontiguousarray(codes.astype(kind))


def _place(row: Mapping[str, Any]) -> tuple[float, float]:
    """Exposure in ms and speed."""
    return float(round(1e3 * row["exposure_s"], 6)), row["velocity_x_px_s"]
