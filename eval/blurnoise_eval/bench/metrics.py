"""Bench of slanted edges: the ways to measure one, time beside error, on edges known in closed form.

Units: MTF50 errors are shares of the true value, curve errors shares of the response at 0, times ms per region.
Contrast to noise (CNR): the edge's step over the noise's standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise.metrics import information
from blurnoise_eval.bench.edge_methods import ARRAYS, EXACT, ISO, METHODS, ROWS, EdgeResponse, measured, timed
from blurnoise_eval.bench.edge_truth import closed_edge, closed_mtf, closed_mtf50
from blurnoise_eval.bench.timing import in_turns_ms, machine, quartiles
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.system.threads import limited_threads

Progress = Callable[[float], object]
Blur = dict[str, Any]
LIMITS = {
    "sigma": 0.002,
    "motion": 0.002,
    "long motion": 0.01,
    "angle": 0.002,
    "few phases": 0.01,
    "curve": 0.003,
}
"""Largest error of MTF50, and of the curve up to Nyquist, that is wanted."""
BIAS_LIMITS = {20.0: 0.01, 10.0: 0.03}
SIC_LIMITS = {20.0: 0.03, 6.0: 0.15}
COVERAGE = (0.90, 0.98)
FASTER = 5.0
"""How many calls of ``ROWS`` a region in a batch should be worth."""
MTF_MAPPER = {
    ("sigma", 0.3): 0.0001, ("sigma", 0.5): 0.0002, ("motion", 6.0): -0.0009, ("motion", 10.0): -0.0016,
    ("motion", 30.0): 0.0011, ("angle", 26.565): -0.0134,
}  # fmt: skip
"""Errors of MTF Mapper 0.7.38 on the same edges, run once, 160 x 120 px."""
SHARP: Blur = {"sigma_px": 0.5}
MOVED: Blur = {"sigma_px": 0.3, "motion_px": (6.0, 0.0)}
_OFFSETS_PX = ((0.0, 0.0), (0.37, -0.21), (0.71, 0.4))
_STEP = 0.7  # of the closed edges


@dataclass(frozen=True)
class Extent:
    """How much is measured. pictures: noisy ones per CNR and blur. batch: regions of 100 x 100 px that are timed."""

    sigmas_px: tuple[float, ...] = (0.3, 0.5, 1.0, 2.0, 3.0)
    motions_px: tuple[float, ...] = (1.0, 3.0, 6.0, 10.0, 20.0, 30.0, 60.0)
    angles_deg: tuple[float, ...] = (2.0, 5.0, 8.0, 12.0, 18.435, 26.565)
    cnrs: tuple[float, ...] = (60.0, 20.0, 10.0, 6.0)
    pictures: int = 400
    batch: int = 64
    fewest: int = 5
    most: int = 30
    seconds: float = 5.0


FULL = Extent()
QUICK = Extent(
    (0.5, 3.0), (6.0, 30.0), (5.0, 26.565), (20.0, 6.0), pictures=40, fewest=1, most=3, seconds=0.5
)


@dataclass(frozen=True)
class Row:
    """A ``quantity`` of a method at a ``value`` of what is varied; ``error``: its standard error, if it has one."""

    varied: str
    value: float
    method: str
    quantity: str
    number: float
    error: float | None = None
    flags: str = ""


@dataclass(frozen=True)
class Bench:
    """What was measured, and on which machine."""

    rows: list[Row]
    extent: Extent
    machine: dict[str, Any]

    def of(self, varied: str, quantity: str, method: str) -> list[Row]:
        """The rows of these, by value."""
        key = (varied, quantity, method)
        found = [row for row in self.rows if (row.varied, row.quantity, row.method) == key]
        return sorted(found, key=lambda row: row.value)

    def ms(self, method: str) -> float:
        """Median time per region, ms."""
        return self.of("time", "ms", method)[0].number

    def losses(self) -> list[str]:
        """Where ``exact`` misses what is wanted, and where another method is closer or faster."""
        return [*self._missed(), *self._beaten()]

    def _missed(self) -> Iterator[str]:
        for varied in ("sigma", "motion", "angle"):
            for row in self.of(varied, "mtf50_error", EXACT):
                limit = limit_of(varied, row.value)
                if not abs(row.number) <= limit:
                    yield f"{_place(row)}: MTF50 is off by {row.number:+.2%}, wanted {limit:.1%}"
            for row in self.of(varied, "curve_error", EXACT):
                if _kind(varied, row.value) == varied and not row.number <= LIMITS["curve"]:
                    yield f"{_place(row)}: the curve is off by {row.number:.4f}, wanted {LIMITS['curve']:g}"
        for blur in _NOISY:
            varied = f"cnr, {blur}"
            for row in self.of(varied, "bias", EXACT):
                yield from _too_biased(row, "MTF50", BIAS_LIMITS)
            for row in self.of(varied, "sic_bias", EXACT) if blur == "moved" else ():
                yield from _too_biased(row, "SIC", SIC_LIMITS)
            for row in self.of(varied, "coverage", EXACT):
                if not COVERAGE[0] <= row.number <= COVERAGE[1]:
                    yield f"{_place(row)}: {_percent(row)} of the intervals hold the truth"
        ratio = self.ms(ROWS) / self.ms(EXACT)
        if ratio < FASTER:
            yield f"a region in a batch by exact is worth {ratio:.2f} calls of {ROWS}, wanted {FASTER:g}"

    def _beaten(self) -> Iterator[str]:
        for varied in ("sigma", "motion", "angle"):
            for own in self.of(varied, "mtf50_error", EXACT):
                others = {
                    method: row.number
                    for method in (ISO, ARRAYS)
                    for row in self.of(varied, "mtf50_error", method)
                    if row.value == own.value
                }
                if (varied, own.value) in MTF_MAPPER:
                    others["MTF Mapper"] = MTF_MAPPER[varied, own.value]
                for method, number in others.items():
                    if abs(number) < abs(own.number) - 5e-5:
                        yield f"{_place(own)}: {method} is closer, {number:+.3%} against {own.number:+.3%}"
        for method in (ISO, ARRAYS):
            if self.ms(method) < 0.98 * self.ms(EXACT):
                yield f"{method} takes {self.ms(method) / self.ms(EXACT):.2f} of exact's time"

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "machine": self.machine,
            "extent": asdict(self.extent),
            "methods": METHODS,
            "mtf_mapper": [[varied, value, error] for (varied, value), error in MTF_MAPPER.items()],
            "losses": self.losses(),
            "rows": [_record(row) for row in self.rows],
        }


def steps(extent: Extent) -> int:
    """What the shares told to ``progress`` add up to."""
    noise_free = len(extent.sigmas_px) + len(extent.motions_px) + len(extent.angles_deg)
    return noise_free + len(_NOISY) * len(extent.cnrs) + len(timed(torch.zeros(1, 8, 8)))


def measure(extent: Extent = FULL, threads: int = 2, progress: Progress = lambda share: None) -> Bench:
    """Measure every method's error without noise and with it, and its time. The errors hang on no clock."""
    facts = machine(threads)
    with limited_threads(threads):
        rows = [*_noise_free(extent, progress), *_with_noise(extent, progress), *_times(extent, progress)]
    return Bench(rows, extent, facts)


def write(bench: Bench, folder: Path) -> None:
    """Write metrics.csv, a row per number, and metrics.json; raises ``OSError``."""
    write_bench("metrics", [_record(row) for row in bench.rows], bench.document(), folder)


def _noise_free(extent: Extent, progress: Progress) -> Iterator[Row]:
    cases: list[tuple[str, float, Blur]] = [
        ("sigma", value, {"sigma_px": value}) for value in extent.sigmas_px
    ]
    cases += [("motion", value, {"sigma_px": 0.3, "motion_px": (value, 0.0)}) for value in extent.motions_px]
    cases += [("angle", value, {"sigma_px": 0.5, "angle_deg": value}) for value in extent.angles_deg]
    for varied, value, blur in cases:
        wide = max(160, 7 * math.ceil(value)) if varied == "motion" else 160
        regions = torch.stack([closed_edge(120, wide, offset_px=at, **blur) for at in _OFFSETS_PX])
        truth = closed_mtf50(**blur)
        for method in (EXACT, ISO, ARRAYS):
            curves = measured(method, regions)
            errors = [curve.mtf50 / truth - 1 for curve in curves]
            flags = " ".join(sorted({f.name.lower() for c in curves if c.edge for f in c.edge.flags}))
            yield Row(varied, value, method, "mtf50_error", max(errors, key=abs), flags=flags)
            yield Row(
                varied, value, method, "curve_error", max(_off(curve, blur) for curve in curves), flags=flags
            )
        progress(1)


def _off(curve: EdgeResponse, blur: Blur) -> float:
    """Largest difference from the truth up to 0.5 cycles/px; infinite where nothing was told."""
    band = curve.frequencies <= 0.5
    truth = closed_mtf(curve.frequencies[band], **blur)
    return float(np.abs(curve.response[band] - truth).max()) if len(truth) else math.inf


_NOISY: dict[str, Blur] = {"sharp": SHARP, "moved": MOVED}


def _with_noise(extent: Extent, progress: Progress) -> Iterator[Row]:
    for (name, blur), cnr in ((each, cnr) for each in _NOISY.items() for cnr in extent.cnrs):
        clean = closed_edge(100, 100, offset_px=(0.3, 0.1), **blur)
        generator = torch.Generator().manual_seed(round(cnr))
        noise = torch.randn(extent.pictures, 100, 100, generator=generator, dtype=torch.float64)
        regions = clean + noise * (_STEP / cnr)
        truth, varied = closed_mtf50(**blur), f"cnr, {name}"
        bits = float(_capacity(np.linspace(0, 0.5, 513), closed_mtf(np.linspace(0, 0.5, 513), **blur), cnr))
        for method in (EXACT, ISO, ARRAYS):
            curves = measured(method, regions, bootstrap=200 if method == EXACT else 0)
            yield _mean(varied, cnr, method, "bias", [curve.mtf50 / truth - 1 for curve in curves])
            yield _mean(varied, cnr, method, "sic_bias", [_bits(curve, cnr) / bits - 1 for curve in curves])
            ends = [curve.edge.intervals["mtf50"] for curve in curves if curve.edge and curve.edge.intervals]
            if ends:
                yield _mean(
                    varied, cnr, method, "coverage", [float(low <= truth <= high) for low, high in ends]
                )
        progress(1)


def _bits(curve: EdgeResponse, cnr: float) -> float:
    """Capacity; where a method has no resamples, the plain estimator, told the true signal and noise."""
    if curve.edge is not None and curve.edge.resamples is not None:
        return information.capacity_radial(curve.edge).value
    return float(_capacity(curve.frequencies, curve.response, cnr)) if len(curve.response) else math.nan


def _capacity(frequencies: NDArray[np.float64], response: NDArray[np.float64], cnr: float) -> Tensor:
    return information.shannon_capacity_radial(
        torch.from_numpy(frequencies),
        power=torch.from_numpy(response) ** 2,
        signal_pp=_STEP,
        noise_variance=(_STEP / cnr) ** 2,
    )


def _mean(varied: str, value: float, method: str, quantity: str, numbers: Sequence[float]) -> Row:
    told = np.array([number for number in numbers if math.isfinite(number)])
    if not len(told):
        return Row(varied, value, method, quantity, math.nan, flags="withheld")
    withheld = f"{len(numbers) - len(told)} of {len(numbers)} withheld" if len(told) < len(numbers) else ""
    error = float(told.std()) / math.sqrt(len(told))
    return Row(varied, value, method, quantity, float(told.mean()), error, withheld)


def _times(extent: Extent, progress: Progress) -> Iterator[Row]:
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(extent.batch, 100, 100, generator=generator, dtype=torch.float64)
    calls = timed(closed_edge(100, 100, **SHARP) + 0.01 * noise)
    times = in_turns_ms(
        calls, fewest=extent.fewest, most=extent.most, seconds=extent.seconds, progress=progress
    )
    for method, values in times.items():
        spread = quartiles([value / extent.batch for value in values])
        yield Row("time", extent.batch, method, "ms", spread.median, (spread.high - spread.low) / 2)


def limit_of(varied: str, value: float) -> float:
    """The largest error of MTF50 that is wanted at a value of what is varied."""
    return LIMITS[_kind(varied, value)]


def _kind(varied: str, value: float) -> str:
    """The name among ``LIMITS`` of what a value asks for."""
    if varied == "motion" and value > 10:
        return "long motion"
    return "few phases" if varied == "angle" and value > 12 else varied


def _too_biased(row: Row, of: str, limits: dict[float, float]) -> Iterator[str]:
    limit = limits.get(row.value, math.inf)
    if not abs(row.number) <= limit:
        yield f"{_place(row)}: {of} is biased by {_percent(row)}, wanted {limit:.0%}"


def _percent(row: Row) -> str:
    return f"{row.number:.1%} ± {row.error or 0:.1%}"


def _place(row: Row) -> str:
    unit = {"sigma": " px", "motion": " px", "angle": "°"}.get(row.varied, "")
    return f"{row.varied} {row.value:g}{unit}"


def _record(row: Row) -> dict[str, Any]:
    record = asdict(row)
    return record | {"number": row.number if math.isfinite(row.number) else None}
