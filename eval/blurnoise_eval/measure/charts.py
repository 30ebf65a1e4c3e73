"""Image quality of simulated charts over exposure, light and motion.

Domain: charts are linear reflectance; metrics are measured on the digital numbers of the camera without the black
level, before development except for a digital gain. Edges, patches and signs have the same two levels, so that they
saturate together: ``DARK``, the grey background of the targets of Lin et al. 2024 (Sensors 24(16) 5135), and
``BRIGHT``, the white of their stop signs.

Each chart and repeat has its own noise, which all conditions share: conditions differ by physics, not by chance. A
metric is available if it is available in every repeat. PSNR and SSIM compare a stop sign, divided by the signal of
white and limited to [0, 1], with the scene; clipping is one of the differences that they measure.

Motion of 1 to 2 px rings by 2 % of a step in a sampled picture: there, the simulator causes the flag "sharpened".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from blurnoise import charts, simulate
from blurnoise.camera import Camera
from blurnoise.camera.radiometry import photoelectrons
from blurnoise.camera.spectra import Curve
from blurnoise.light.lamp import Pwm
from blurnoise.metrics import Flag, SlantedEdge, flicker, information, slanted_edge
from blurnoise.metrics.patches import (
    contrast_transfer_accuracy,
    patch_contrast,
    patch_snr,
    psnr,
    ssim,
    veiling_glare,
)
from blurnoise.metrics.sharpness import star_response
from blurnoise.metrics.values import BatchEstimate, Estimate
from blurnoise_eval.cameras import behind_one_filter
from blurnoise_eval.measure.edges import EDGE_METRICS, EdgePair, Metric, TargetSquare
from blurnoise_eval.plan.axes import EGO, MOVES, blur_px
from blurnoise_eval.plan.conditions import Conditions, cell_seed
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.system.files import write_records
from blurnoise_eval.system.machine import limited_threads
from blurnoise_eval.system.tables import finite

DARK, BRIGHT = 0.18, 0.8
TILT_DEG = 2.0
"""Tilt of both edges: motion along an edge blurs it by the sine, at 2° by 1 px where it blurs the other by 30 px."""
ACROSS_PX, ALONG_PX = 320, 160
SPARE_PX = 64
"""Margin beyond each end of the edge: motion along the edge by up to twice this keeps its ends out of the region."""
PATCH_PX = 240  # as in Lin et al., 4.1
SIGN_PX, SIGN_PICTURE_PX = 100, 200
TARGET_PX = 10
"""Side of the square of the ideal observer: a stroke of a letter on a sign of 200 px."""
STAR_PX = 256
TRAP_PX = 24
"""Radius of the light trap, 3 % of its picture; side of the square in it that is measured, and of lit patches."""
LAMP_FRAMES = 60
WEBER, TOLERANCE = BRIGHT / DARK - 1, 0.5
CLIPPED = "clipped"
_WITHHELD = frozenset({CLIPPED, "noiseless", "not_finite", "no_light"})
_CLIPPED_SHARE = 0.005
_STEADY = torch.ones(1, dtype=torch.float64)
_STEADY_LAMP = Pwm(frequency_hz=1.0, duty=1.0)


class Charts:
    """Simulated charts under one condition, a frame per repeat; each is simulated when a metric needs it."""

    def __init__(
        self,
        camera: Camera,
        conditions: Conditions,
        repeats: int,
        seed: int,
        spectrum: Curve | None = None,
        lamp: Pwm = _STEADY_LAMP,
    ) -> None:
        self._lamp = lamp
        self._at = conditions.exposure(camera, spectrum=spectrum)  # headlamps, if any, light no chart
        self._camera, digital_db = self._at.amplified
        self._gain, self._black = 10 ** (digital_db / 20), camera.sensor.black_level_dn
        self._full = self._camera.sensor.saturated_dn
        if digital_db:
            amplified_dn = math.floor((self._full - self._black) * self._gain + self._black)
            self._full = min(camera.sensor.full_scale_dn, amplified_dn)
        self._moved_px = [abs(moved) for moved in conditions.displacement_px]
        self._repeats, self._seed = repeats, seed

    def frames(self, name: str, light: Tensor = _STEADY) -> Tensor:
        """Digital numbers (n, 1, H, W) of a chart of :func:`_scenes`, not rounded after digital gain; with factors on
        the light (F,) those of n times F frames."""
        dn = simulate(
            _scenes()[name].expand(self._repeats * len(light), -1, -1, -1),
            self._camera,
            exposure_s=self._at.exposure_s,
            illuminance_lux=self._at.illuminance_lux * light.repeat(self._repeats),
            velocity_px_s=self._at.velocity_px_s,
            temperature_c=self._at.temperature_c,
            illuminant=self._at.illuminant,
            encoding="linear",
            generator=[cell_seed(self._seed, name, number) for number in range(self._repeats * len(light))],
        )
        amplified = (dn - self._black) * self._gain + self._black
        return dn if self._gain == 1 else amplified.clamp(0.0, self._camera.sensor.full_scale_dn)

    @cached_property
    def edges(self) -> tuple[list[SlantedEdge], ...]:
        """The edge that motion along x blurs, and the edge that motion along y blurs."""
        levels: Any = {"full_scale": self._full, "black_level": self._black}
        edges: list[Any] = []
        for axis, along_px in enumerate(self._moved_px[::-1]):
            dn = self.frames(("across_x", "across_y")[axis]).narrow(2 + axis, SPARE_PX, ALONG_PX)
            edges.append(slanted_edge(dn.clamp(max=self._full), **levels, seed=axis))
            if along_px > 2 * SPARE_PX:
                edges[axis] = [SlantedEdge("exact", frozenset({Flag.REGION_TOO_SMALL}))] * self._repeats
        return tuple(edges)

    @cached_property
    def patches(self) -> tuple[Tensor, Tensor]:
        """The bright and the dark patch above black, (n, H, W)."""
        bright, dark = (self.frames(name).double()[:, 0] - self._black for name in ("bright", "dark"))
        return bright, dark

    @cached_property
    def star(self) -> list[Estimate]:
        """MTF50 of the Siemens star, by the mean power of its segments."""
        modulation = (BRIGHT - DARK) / (BRIGHT + DARK)
        dn = self.frames("star").double()[:, 0]
        return [
            Estimate(math.nan, flags=frozenset({CLIPPED}))
            if float((frame >= self._full).double().mean()) > _CLIPPED_SHARE
            else star_response(frame - self._black, modulation=modulation).mtf50
            for frame in dn
        ]

    @cached_property
    def glare(self) -> list[Estimate]:
        """Veiling glare index, of the middle of a light trap and of the white field along the border."""
        dn = self.frames("trap").double()[:, 0]
        trap = slice((PATCH_PX - TRAP_PX) // 2, (PATCH_PX + TRAP_PX) // 2)
        black, white = dn[:, trap, trap], dn[:, :TRAP_PX]
        cut = ((black <= 0).double() + (white >= self._full).double().mean((1, 2), keepdim=True)).mean((1, 2))
        index = veiling_glare(black - self._black, white - self._black)
        return estimates_of(replace(index, flags={**index.flags, CLIPPED: cut > _CLIPPED_SHARE}))

    def of_lamp(self, index: Callable[[Tensor], BatchEstimate]) -> list[Estimate]:
        """An index of the means of a white patch in the lamp's light, of frames that begin all over its period."""
        starts_s = torch.arange(LAMP_FRAMES, dtype=torch.float64) / LAMP_FRAMES / self._lamp.frequency_hz
        dn = self.frames("lit", self._lamp.factor(self._at.exposure_s, starts_s)).double()
        frames = (dn - self._black).view(self._repeats, LAMP_FRAMES, -1)
        cut = (dn >= self._full).double().view(self._repeats, -1).mean(1) > _CLIPPED_SHARE
        found = index(frames.mean(2))
        return estimates_of(replace(found, flags={**found.flags, CLIPPED: cut}), {CLIPPED})

    @cached_property
    def snr(self) -> list[BatchEstimate]:
        """SNR of the bright and of the dark patch."""
        limits = (-self._black, self._full - self._black)
        return [patch_snr(patch, limits_dn=limits) for patch in self.patches]

    def of_patches(self, batch: BatchEstimate) -> list[Estimate]:
        """Estimates of a metric of both patches, missing if either is clipped."""
        bright, dark = self.snr
        clipped = bright.flags[CLIPPED] | dark.flags[CLIPPED]
        return estimates_of(replace(batch, flags={**batch.flags, CLIPPED: clipped}))

    @cached_property
    def _sign(self) -> Tensor:
        return self.frames("sign").double()

    def of_sign(self, compare: Callable[..., Tensor]) -> list[Estimate]:
        """Compare the stop sign, as a share of white, with its scene; clipping counts as a difference."""
        at = self._at
        light_e = photoelectrons(self._camera, at.illuminance_lux, at.exposure_s, at.illuminant)
        white_dn = self._camera.sensor.system_gain_dn_per_e * self._gain * light_e
        sign = ((self._sign - self._black) / (white_dn or math.nan)).clamp(0, 1)
        value = compare(sign, _scenes()["sign"].double().expand_as(sign), data_range=1.0)
        cut = ((self._sign >= self._full) | (self._sign <= 0)).double().mean((1, 2, 3)) > _CLIPPED_SHARE
        none = torch.full_like(value, math.nan)
        flags = {CLIPPED: cut, "no_light": torch.full_like(cut, light_e == 0)}
        return estimates_of(BatchEstimate(value, none, none, flags), {"no_light"})


def estimates_of(batch: BatchEstimate, withholding: Collection[str] = _WITHHELD) -> list[Estimate]:
    """An estimate per item of a batch (n,), NaN where a flag of ``withholding`` is raised."""
    numbers = zip(batch.value.tolist(), batch.low.tolist(), batch.high.tolist(), strict=True)
    raised = {name: where.tolist() for name, where in batch.flags.items()}
    estimates = []
    for index, (value, low, high) in enumerate(numbers):
        flags = frozenset(name for name, where in raised.items() if where[index])
        withheld = not flags.isdisjoint(withholding)
        estimates.append(Estimate(math.nan, flags=flags) if withheld else Estimate(value, low, high, flags))
    return estimates


def squared(batch: BatchEstimate) -> BatchEstimate:
    """The squares of numbers >= 0."""
    return BatchEstimate(batch.value**2, batch.low.clamp_min(0) ** 2, batch.high**2, batch.flags)


def mean_of(estimates: Sequence[Estimate]) -> Estimate:
    """Mean of independent estimates of one number; NaN if one of them is NaN, with the flags of all.

    >>> mean_of([Estimate(1.0, 0.5, 1.5), Estimate(2.0, 1.5, 2.5)]).value
    1.5
    """
    count = len(estimates)
    value = math.fsum(estimate.value for estimate in estimates) / count
    below = math.fsum(estimate.value - estimate.low for estimate in estimates) / count**1.5
    above = math.fsum(estimate.high - estimate.value for estimate in estimates) / count**1.5
    flags = frozenset[str]().union(*(estimate.flags for estimate in estimates))
    return Estimate(value, value - below, value + above, flags)


def _edge_metric(metric: str, name: str, title: str, about: str, axis: int = 0) -> Metric:
    """A metric of ``EDGE_METRICS`` for the edges across x (axis 0) or y; both are used where it needs two."""
    base = next(entry for entry in EDGE_METRICS if entry.name == metric)

    def measure_edges(charts: Charts) -> list[Estimate]:
        pairs = zip(charts.edges[axis], charts.edges[1 - axis], strict=True)
        return [base.of(EdgePair(*pair, TargetSquare())) for pair in pairs]

    return replace(base, name=name, title=title, about=about, of=measure_edges)


def _snri(charts: Charts) -> list[Estimate]:
    """The target is as high as the step of the edges: a white square on grey."""
    pairs = zip(*charts.edges, strict=True)
    return [information.square_snr(*pair, side_px=TARGET_PX) for pair in pairs]


def _contrast(name: str) -> Callable[[Charts], list[Estimate]]:
    return lambda charts: charts.of_patches(getattr(patch_contrast(*charts.patches), name))


def _cta(charts: Charts) -> list[Estimate]:
    return charts.of_patches(contrast_transfer_accuracy(*charts.patches, nominal=WEBER, tolerance=TOLERANCE))


_UPRIGHT, _LYING = f"edge {TILT_DEG:g}° from vertical", f"edge {TILT_DEG:g}° from horizontal"
_RADIAL = "Lin et al. eq. 7, with the blur across {} in all directions"
_SIGN = f"{SIGN_PX} px stop sign against the scene"
METRICS: tuple[Metric, ...] = (
    _edge_metric("mtf50", "mtf50_x", "MTF50 across x", _UPRIGHT),
    _edge_metric("mtf50", "mtf50_y", "MTF50 across y", f"{_LYING}, so motion along x blurs it by its sine", 1),
    _edge_metric(
        "edge_snr_db", "edge_snr_db", "Edge SNR", "20 log10(step / root of the sides' mean variance), vertical edge"
    ),
    Metric("cnr", "CNR", "1", "(bright - dark) / root of their mean variance, even patches", _contrast("cnr"), "log"),
    Metric(
        "patch_snr_bright", "Patch SNR, white", "1", f"mean/deviation at reflectance {BRIGHT:g}",
        lambda charts: estimates_of(charts.snr[0]), "log",
    ),
    Metric(
        "patch_snr_dark", "Patch SNR, grey", "1", f"mean/deviation at reflectance {DARK:g}",
        lambda charts: estimates_of(charts.snr[1]), "log",
    ),
    _edge_metric("sic_radial", "sic_radial_x", "SIC, radial, of x", _RADIAL.format("x")),
    _edge_metric("sic_radial", "sic_radial_y", "SIC, radial, of y", _RADIAL.format("y"), 1),
    _edge_metric(
        "sic_square", "sic_square", "SIC, square", "all frequencies of the pixel grid, from both edges"
    ),
    Metric(
        "neq_0", "NEQ(0)", "quanta/px", f"mean²/variance at reflectance {BRIGHT:g}",  # white noise: its spectrum
        lambda charts: estimates_of(squared(charts.snr[0])), "log",
    ),
    _edge_metric(
        "neq_integral", "neq_integral", "NEQ, whole band", "NEQ over the square of frequencies, from both edges"
    ),
    Metric(
        "snri", f"SNRI, {TARGET_PX} px square", "1", "ideal observer, a white square on grey, from both edges",
        _snri, "log",
    ),
    Metric(
        "michelson", "Michelson contrast", "1", "(bright - dark)/(bright + dark), even patches",
        _contrast("michelson"), "share",
    ),
    Metric(
        "cta", "CTA", "1", f"share of pixel pairs within ±{TOLERANCE:.0%} of Weber contrast {WEBER:.3g}",
        _cta, "share",
    ),
    _edge_metric("acutance", "acutance_x", "Acutance, of x", "SFR across x as the eye weighs it, 60 px per degree"),
    Metric(
        "mtf50_star", "MTF50 of a star", "cycles/px", "s-SFR of a Siemens star, mean power of 8 segments",
        lambda charts: charts.star, "log",
    ),
    Metric(
        "veiling_glare", "Veiling glare", "1", "light trap over the white field about it, which is the whole picture",
        lambda charts: charts.glare,
    ),
    Metric("psnr_db", "PSNR", "dB", _SIGN, lambda charts: charts.of_sign(psnr)),
    Metric("ssim", "SSIM", "1", _SIGN, lambda charts: charts.of_sign(ssim), "share"),
)  # fmt: skip
"""The metrics of charts; a new metric is one entry, and appears in tables and figures."""

_FRAMES = f"{LAMP_FRAMES} frames of a white patch in the light of pwm"
LAMP_METRICS: tuple[Metric, ...] = (
    Metric(
        "fmi", "Flicker modulation index", "1", f"(max - min)/(max + min), {_FRAMES}",
        lambda charts: charts.of_lamp(flicker.modulation_index), "share",
    ),
    Metric(
        "mmp", "Modulation mitigation", "1", f"share of frames within 10 % of the mean, {_FRAMES}",
        lambda charts: charts.of_lamp(flicker.mitigation_probability), "share",
    ),
)  # fmt: skip
"""The further metrics where a plan has a pulsed lamp."""


@dataclass(frozen=True)
class MetricRow:
    """One metric under one condition: the mean of ``repeats``, in ``repeats_available`` of which it is available.

    at: the value of the condition on every axis.
    """

    at: Mapping[str, float]
    metric: str
    estimate: Estimate
    repeats_available: int
    repeats: int

    def record(self) -> dict[str, Any]:
        """A row of a table, with None for missing values; flags in alphabetical order."""
        return {
            **self.at,
            "blur_px": blur_px(self.at),
            "metric": self.metric,
            **{name: finite(getattr(self.estimate, name)) for name in ("value", "low", "high")},
            "flags": " ".join(sorted(self.estimate.flags)),
            "repeats_available": self.repeats_available,
            "repeats": self.repeats,
        }


def measure(
    camera: Camera,
    conditions: Sequence[Conditions],
    *,
    repeats: int = 1,
    seed: int = 0,
    spectrum: Curve | None = None,
    lamp: Pwm | None = None,
    threads: int = 1,
    progress: Callable[[float], object] = lambda count: None,
) -> list[MetricRow]:
    """Measure every metric under every condition, in their order, independent of the number of threads.

    A camera with a mosaic is simulated as if all pixels had its strongest filter. spectrum: of the illuminant "own".
    lamp: that ``LAMP_METRICS`` are of; None: without them. ``progress`` receives 1 for every condition. Raises what
    :func:`blurnoise.simulate` does; :func:`check` raises the same before any work.
    """
    camera = behind_one_filter(camera)

    def at(condition: Conditions) -> list[MetricRow]:
        charts, numbers = (
            Charts(camera, condition, repeats, seed, spectrum, lamp or _STEADY_LAMP),
            condition.on(camera),
        )
        rows = []
        for metric in METRICS if lamp is None else (*METRICS, *LAMP_METRICS):
            estimates = metric.of(charts)
            available = sum(estimate.available for estimate in estimates)
            rows.append(MetricRow(numbers, metric.name, mean_of(estimates), available, repeats))
        return rows

    rows: list[MetricRow] = []
    with limited_threads(1), ThreadPoolExecutor(threads) as pool:  # each condition on one core
        for of_condition in pool.map(at, conditions):
            rows += of_condition
            progress(1)
    return rows


def check(camera: Camera, plan: SweepPlan) -> None:
    """Raise ``ValueError`` for conditions that charts or the camera do not allow."""
    needed = {
        MOVES.name: "all, as a chart has no moving targets",
        EGO.name: "0, as a chart is not a road",
    }
    for name, must in needed.items():
        if any(plan.values(name)):
            raise ValueError(f"{name}: must be {must}")
    if plan.beams:
        raise ValueError("headlamp: must be off, as a chart has no targets")
    if plan.lamps is not None and (plan.lamps.on_targets or plan.lamps.pwm is None):
        raise ValueError("emitters, pwm_mask: must be left out; a pulsed lamp lights the chart as a whole")
    if plan.infrared is not None:
        raise ValueError("infrared: must be left out; charts are measured in visible light")
    if len(camera.sensor.captures) > 1:  # a chart's metrics are of one frame's digital numbers
        count = len(camera.sensor.captures)
        raise ValueError(f"camera: {camera.name!r} has {count} captures; must have one for a chart")
    for conditions in plan.conditions():
        conditions.exposure(camera, spectrum=plan.own_spectrum)


def metrics_in(rows: Sequence[MetricRow]) -> list[Metric]:
    """The metrics that rows are of, in the order of tables."""
    names = {row.metric for row in rows}
    return [metric for metric in (*METRICS, *LAMP_METRICS) if metric.name in names]


def write(rows: Sequence[MetricRow], camera: Camera, plan: SweepPlan, folder: Path) -> None:
    """Write quality.csv, a row per condition and metric, and quality.json with definitions; raises ``OSError``."""
    records, about = [row.record() for row in rows], ("name", "title", "unit", "about")
    document = {
        "camera": camera.to_dict(),
        "plan": plan.to_dict(),
        "metrics": {
            metric.name: {name: getattr(metric, name) for name in about} for metric in metrics_in(rows)
        },
        "rows": records,
    }
    write_records("quality", records, document, folder)


@cache
def _scenes() -> dict[str, Tensor]:
    """The charts, (1, C, H, W) linear reflectance."""
    edge = {"dark": DARK, "bright": BRIGHT}
    along, side = ALONG_PX + 2 * SPARE_PX, SIGN_PICTURE_PX
    white = charts.flat_patch(PATCH_PX, PATCH_PX, reflectance=BRIGHT)
    x = torch.arange(PATCH_PX) - (PATCH_PX - 1) / 2
    return {
        "across_x": charts.slanted_edge(along, ACROSS_PX, angle_deg=TILT_DEG, **edge),
        "across_y": charts.slanted_edge(ACROSS_PX, along, angle_deg=90 + TILT_DEG, **edge),
        "bright": white,
        "dark": charts.flat_patch(PATCH_PX, PATCH_PX, reflectance=DARK),
        "star": charts.siemens_star(STAR_PX, dark=DARK, bright=BRIGHT),
        "trap": white * (torch.hypot(x, x[:, None]) >= TRAP_PX),
        "lit": white[..., :TRAP_PX, :TRAP_PX],
        "sign": charts.stop_sign(SIGN_PX, height_px=side, width_px=side, background=DARK),
    }
