"""Image quality against exposure, light and motion: charts as a camera would take them, and every metric of them.

Domain: charts are linear reflectance; measured are the camera's digital numbers with the black level removed, before
any development but a digital gain. Edges, patches and signs have the same two levels, so they saturate together:
``DARK``, the grey on which Lin et al. 2024 (Sensors 24(16) 5135) place their targets, and ``BRIGHT``, the white of
their stop signs.

Every number rests on noise of its own chart and repeat; conditions share it, and differ by physics, not by luck.
A number that any repeat withholds is withheld. PSNR and SSIM compare a stop sign, divided by what white would give
and cut to [0, 1], with the scene itself; clipping is one of the differences they are there to tell.

Motion of 1 to 2 px rings by 2 % of a step in a picture that pixels have sampled: the flag "sharpened" there is the
simulator's doing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import torch
from torch import Tensor

from blurnoise import charts, simulate
from blurnoise.metrics import Flag, SlantedEdge, information, slanted_edge
from blurnoise.metrics.patches import detection_probability, patch_contrast, patch_snr, psnr, ssim
from blurnoise.metrics.values import BatchEstimate, Estimate
from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import photoelectrons
from blurnoise_eval.cameras import behind_one_filter
from blurnoise_eval.grid.axes import AUTOMATIC, EGO, blur_px
from blurnoise_eval.grid.conditions import Conditions, SweepPlan, cell_seed
from blurnoise_eval.system.tables import finite
from blurnoise_eval.system.threads import limited_threads

DARK, BRIGHT = 0.18, 0.8
TILT_DEG = 2.0
"""Of both edges: an edge along the motion is blurred by its sine, at 2° by 1 px where the other is by 30 px."""
ACROSS_PX, ALONG_PX = 320, 160
SPARE_PX = 64
"""Of the chart, beyond each end of the edge: motion along it by up to twice this brings nothing else in."""
PATCH_PX = 240  # as in Lin et al., 4.1
SIGN_PX, SIGN_PICTURE_PX = 100, 200
TARGET_PX = 10
"""Side of the square for the ideal observer: a stroke of a letter on a sign of 200 px."""
WEBER, TOLERANCE = BRIGHT / DARK - 1, 0.5
CLIPPED = "clipped"
_WITHHELD = frozenset({CLIPPED, "noiseless", "not_finite", "no_light"})
_CLIPPED_SHARE = 0.005


class Charts:
    """The charts under one condition as the camera has them, a frame per repeat, measured where a metric asks."""

    def __init__(self, camera: Camera, conditions: Conditions, repeats: int, seed: int) -> None:
        self._at = conditions.exposure(camera)
        self._taker, self._digital_db = self._at.amplified
        self._camera = _with_gain(self._taker, self._digital_db)
        self._moved_px = [abs(moved) for moved in conditions.displacement_px]
        self._repeats, self._seed = repeats, seed

    def frames(self, name: str) -> Tensor:
        """Digital numbers (n, 1, H, W) of a chart by its name in :func:`_scenes`, not rounded after digital gain."""
        dn = simulate(
            _scenes()[name].expand(self._repeats, -1, -1, -1),
            self._taker,
            exposure_s=self._at.exposure_s,
            illuminance_lux=self._at.illuminance_lux,
            velocity_px_s=self._at.velocity_px_s,
            temperature_c=self._at.temperature_c,
            encoding="linear",
            generator=[cell_seed(self._seed, name, repeat) for repeat in range(self._repeats)],
        )
        if self._digital_db == 0:
            return dn
        black = self._camera.black_level_dn
        amplified = (dn - black) * 10 ** (self._digital_db / 20) + black
        return amplified.clamp(0.0, self._camera.full_scale_dn)

    @cached_property
    def across_x(self) -> list[SlantedEdge]:
        """The edge that motion along x blurs."""
        dn = self.frames("across_x")[..., SPARE_PX : SPARE_PX + ALONG_PX, :]
        return self._edges(dn, along_px=self._moved_px[1], seed=0)

    @cached_property
    def across_y(self) -> list[SlantedEdge]:
        """The edge that motion along y blurs."""
        dn = self.frames("across_y")[..., SPARE_PX : SPARE_PX + ALONG_PX]
        return self._edges(dn, along_px=self._moved_px[0], seed=1)

    def _edges(self, dn: Tensor, *, along_px: float, seed: int) -> list[SlantedEdge]:
        if along_px > 2 * SPARE_PX:
            return [SlantedEdge("exact", frozenset({Flag.REGION_TOO_SMALL}))] * len(dn)
        full, black = self._camera.saturated_dn, self._camera.black_level_dn
        edges = slanted_edge(dn.clamp(max=full), full_scale=full, black_level=black, seed=seed)
        return edges if isinstance(edges, list) else [edges]

    @cached_property
    def patches(self) -> tuple[Tensor, Tensor]:
        """The bright and the dark patch above black, (n, H, W)."""
        black = self._camera.black_level_dn
        return self.frames("bright").double()[:, 0] - black, self.frames("dark").double()[:, 0] - black

    @cached_property
    def snr(self) -> tuple[BatchEstimate, BatchEstimate]:
        """Mean over deviation of the bright and of the dark patch."""
        black = self._camera.black_level_dn
        limits = (-black, self._camera.saturated_dn - black)
        bright, dark = (patch_snr(patch, limits_dn=limits) for patch in self.patches)
        return bright, dark

    def of_patches(self, batch: BatchEstimate) -> list[Estimate]:
        """Estimates of what rests on both patches, either of which may be clipped."""
        bright, dark = self.snr
        return _estimates(batch, clipped=bright.flags[CLIPPED] | dark.flags[CLIPPED])

    def of_sign(self, compare: Callable[..., Tensor]) -> list[Estimate]:
        """A comparison of the stop sign, as a share of white, with its scene; clipping is a part of it."""
        frame, camera = self._sign, self._camera
        light_e = photoelectrons(camera, self._at.illuminance_lux, self._at.exposure_s)
        seen = (frame - camera.black_level_dn) / (camera.system_gain_dn_per_e * light_e or math.nan)
        value = compare(seen.clamp(0, 1), _scenes()["sign"].double().expand_as(seen), data_range=1.0)
        none = torch.full_like(value, math.nan)
        dark = torch.full_like(value, light_e == 0, dtype=torch.bool)
        found = _estimates(BatchEstimate(value, none, none, {"no_light": dark}))
        cut = ((frame >= camera.saturated_dn) | (frame <= 0)).double().mean((1, 2, 3)) > _CLIPPED_SHARE
        return [
            replace(each, flags=each.flags | {CLIPPED}) if clipped else each
            for each, clipped in zip(found, cut.tolist(), strict=True)
        ]

    @cached_property
    def _sign(self) -> Tensor:
        return self.frames("sign").double()


@dataclass(frozen=True)
class Metric:
    """A metric's name in tables, its title and unit, what exactly it is, and how it is measured.

    of: an estimate per repeat. log: drawn over a logarithmic axis. share: it lies between 0 and 1.
    """

    name: str
    title: str
    unit: str
    about: str
    of: Callable[[Charts], list[Estimate]]
    log: bool = False
    share: bool = False


def _across_x(name: str) -> Callable[[Charts], list[Estimate]]:
    return lambda charts: [edge.estimate(name) for edge in charts.across_x]


def _both_edges(measure: Callable[..., Estimate], **how: Any) -> Callable[[Charts], list[Estimate]]:
    return lambda charts: [
        measure(x, y, **how) for x, y in zip(charts.across_x, charts.across_y, strict=True)
    ]


def _contrast(name: str) -> Callable[[Charts], list[Estimate]]:
    return lambda charts: charts.of_patches(getattr(patch_contrast(*charts.patches), name))


def _neq_0(charts: Charts) -> list[Estimate]:
    """The square of the bright patch's SNR: white noise has its variance as spectrum."""
    white, _ = charts.snr
    low, high = white.low.clamp_min(0).square(), white.high.square()
    return _estimates(replace(white, value=white.value.square(), low=low, high=high))


def _cdp(charts: Charts) -> list[Estimate]:
    found = detection_probability(*charts.patches, nominal=WEBER, tolerance=TOLERANCE)
    return charts.of_patches(found)


METRICS = (
    Metric(
        "mtf50_x", "MTF50 across x", "cycles/px", f"edge {TILT_DEG:g}° from vertical", _across_x("mtf50"), log=True
    ),
    Metric(
        "mtf50_y", "MTF50 across y", "cycles/px",
        f"edge {TILT_DEG:g}° from horizontal, so motion along x blurs it by its sine",
        lambda charts: [edge.estimate("mtf50") for edge in charts.across_y], log=True,
    ),
    Metric(
        "edge_snr_db", "Edge SNR", "dB", "20 log10(step / root of the sides' mean variance), vertical edge",
        _across_x("edge_snr_db"),
    ),
    Metric(
        "cnr", "CNR", "1", "(bright - dark) / root of their mean variance, even patches", _contrast("cnr"), log=True,
    ),
    Metric(
        "patch_snr_bright", "Patch SNR, white", "1", f"mean/deviation at reflectance {BRIGHT:g}",
        lambda charts: _estimates(charts.snr[0]), log=True,
    ),
    Metric(
        "patch_snr_dark", "Patch SNR, grey", "1", f"mean/deviation at reflectance {DARK:g}",
        lambda charts: _estimates(charts.snr[1]), log=True,
    ),
    Metric(
        "sic_radial_x", "SIC, radial, of x", "bits/px", "Lin et al. eq. 7, as if all blur were that across x",
        lambda charts: [information.capacity_radial(edge) for edge in charts.across_x],
    ),
    Metric(
        "sic_radial_y", "SIC, radial, of y", "bits/px", "Lin et al. eq. 7, as if all blur were that across y",
        lambda charts: [information.capacity_radial(edge) for edge in charts.across_y],
    ),
    Metric(
        "sic_square", "SIC, square", "bits/px", "all frequencies of the pixel grid, from both edges",
        _both_edges(information.capacity_square),
    ),
    Metric("neq_0", "NEQ(0)", "quanta/px", f"mean²/variance at reflectance {BRIGHT:g}", _neq_0, log=True),
    Metric(
        "neq_integral", "NEQ, whole band", "quanta/px", "NEQ over the square of frequencies, from both edges",
        _both_edges(information.neq_integral), log=True,
    ),
    Metric(
        "snri", f"SNRI, {TARGET_PX} px square", "1", "ideal observer, a white square on grey, from both edges",
        _both_edges(information.square_snr, side_px=TARGET_PX), log=True,
    ),
    Metric(
        "michelson", "Michelson contrast", "1", "(bright - dark)/(bright + dark), even patches",
        _contrast("michelson"), share=True,
    ),
    Metric(
        "cdp", "CDP", "1", f"share of pixel pairs within ±{TOLERANCE:.0%} of Weber contrast {WEBER:.3g}", _cdp,
        share=True,
    ),
    Metric(
        "psnr_db", "PSNR", "dB", f"{SIGN_PX} px stop sign against the scene", lambda charts: charts.of_sign(psnr)
    ),
    Metric(
        "ssim", "SSIM", "1", f"{SIGN_PX} px stop sign against the scene", lambda charts: charts.of_sign(ssim),
        share=True,
    ),
)  # fmt: skip
"""All that is measured: a new metric is a line here, and appears in tables, figures and maps."""


@dataclass(frozen=True)
class Row:
    """One metric under one condition, the mean of ``repeats``; ``told`` of them have a number.

    at: the condition's actual number on every axis.
    """

    at: Mapping[str, float]
    metric: str
    estimate: Estimate
    told: int
    repeats: int

    @property
    def blur_px(self) -> float:
        """Length of the motion blur, px."""
        return blur_px(self.at)

    def record(self) -> dict[str, Any]:
        """As a table's row: None for what is withheld or has no interval, flags in alphabetical order."""
        return {
            **self.at,
            "blur_px": self.blur_px,
            "metric": self.metric,
            **{name: finite(getattr(self.estimate, name)) for name in ("value", "low", "high")},
            "flags": " ".join(sorted(self.estimate.flags)),
            "told": self.told,
            "repeats": self.repeats,
        }


def measure(
    camera: Camera,
    conditions: Sequence[Conditions],
    *,
    repeats: int = 1,
    seed: int = 0,
    threads: int = 1,
    progress: Callable[[float], object] = lambda count: None,
) -> list[Row]:
    """Every metric under every condition, in their order; the same rows whatever the threads.

    Of a camera with a mosaic the pixels behind its strongest filter, as if all were. ``progress`` receives 1 for
    every condition. Raises what :func:`blurnoise.simulate` does; :func:`check` finds the same before any work.
    """
    camera = behind_one_filter(camera)

    def at(condition: Conditions) -> list[Row]:
        taken, numbers = Charts(camera, condition, repeats, seed), condition.on(camera)
        found = [(metric.name, metric.of(taken)) for metric in METRICS]
        return [
            Row(numbers, name, together(each), sum(one.told for one in each), repeats) for name, each in found
        ]

    rows: list[Row] = []
    pool = ThreadPoolExecutor(threads)
    with limited_threads(1):  # conditions are worked on side by side, each on one core
        try:
            for found in pool.map(at, conditions):
                rows += found
                progress(1)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    return rows


def check(camera: Camera, plan: SweepPlan) -> None:
    """Raise ``ValueError`` for conditions that the camera cannot take, or a gain that is left to it.

    Its meter would set another for every chart.
    """
    for name in plan.grid:
        if AUTOMATIC in plan.values(name):
            raise ValueError(
                f"{name} = 'auto': must be numbers; the charts have no one mean for a camera to meter"
            )
    if plan.cuts:
        raise ValueError("moves: must be all; a chart has no targets that could move by themselves")
    if any(plan.values(EGO.name)):
        raise ValueError(f"{EGO.name}: must be 0; a chart is no road")
    for conditions in plan.conditions():
        conditions.exposure(camera)


def together(estimates: Sequence[Estimate]) -> Estimate:
    """The mean of independent estimates of one number, with its interval; NaN where one of them is withheld."""
    count = len(estimates)
    value = math.fsum(estimate.value for estimate in estimates) / count
    below = math.fsum(estimate.value - estimate.low for estimate in estimates) / count**1.5
    above = math.fsum(estimate.high - estimate.value for estimate in estimates) / count**1.5
    flags = frozenset[str]().union(*(estimate.flags for estimate in estimates))
    return Estimate(value, value - below, value + above, flags)


@cache
def _scenes() -> dict[str, Tensor]:
    """The charts, (1, C, H, W) linear reflectance."""
    edge = {"dark": DARK, "bright": BRIGHT}
    along, side = ALONG_PX + 2 * SPARE_PX, SIGN_PICTURE_PX
    return {
        "across_x": charts.slanted_edge(along, ACROSS_PX, angle_deg=TILT_DEG, **edge),
        "across_y": charts.slanted_edge(ACROSS_PX, along, angle_deg=90 + TILT_DEG, **edge),
        "bright": charts.flat_patch(PATCH_PX, PATCH_PX, reflectance=BRIGHT),
        "dark": charts.flat_patch(PATCH_PX, PATCH_PX, reflectance=DARK),
        "sign": charts.stop_sign(SIGN_PX, height_px=side, width_px=side, background=DARK),
    }


def _with_gain(camera: Camera, gain_db: float) -> Camera:
    """The camera as if its digital gain were the converter's: as many DN per electron, and the same end of scale."""
    if gain_db == 0:
        return camera
    gain, black = 10 ** (gain_db / 20), camera.black_level_dn
    clip_dn = min(
        camera.full_scale_dn, math.floor((camera.clip_dn - black) * gain + black)
    )  # what clips reaches it
    per_e = camera.system_gain_dn_per_e * gain
    return replace(camera, system_gain_dn_per_e=per_e, full_well_e=max(clip_dn - black, 1.0) / per_e)


def _estimates(batch: BatchEstimate, **flags: Tensor) -> list[Estimate]:
    """An estimate per item of the batch (n,), with ``flags`` beside its own; they may withhold it."""
    raised = {name: where.tolist() for name, where in (dict(batch.flags) | flags).items()}
    numbers = (batch.value.tolist(), batch.low.tolist(), batch.high.tolist())
    found = []
    for index, (value, low, high) in enumerate(zip(*numbers, strict=True)):
        names = frozenset(name for name, where in raised.items() if where[index])
        withheld = names & _WITHHELD
        found.append(Estimate(math.nan, flags=names) if withheld else Estimate(value, low, high, names))
    return found
