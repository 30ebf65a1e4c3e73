"""Bench of deceitful edges: how often each is withheld or flagged, and how often an honest one is.

Units: errors of MTF50 are shares of the true value; shares of pictures are 0 to 1.
"""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from blurnoise.metrics import Flag, SlantedEdge, information, slanted_edge
from blurnoise.metrics.edge.flags import WITHHELD
from blurnoise_eval.bench.edge_cases import CASES, Case, Draw, Setting, any_setting, smoothed, usual
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.system.threads import limited_threads

Progress = Callable[[float], object]
ENOUGH = 2.0
"""A full scale above every pixel: that nothing stands at it says nothing of clipping before."""
CAUGHT, SPARED = 0.95, 0.02
"""Least share of deceitful edges withheld or flagged, and largest share of honest ones."""
WRONG = 0.03
"""Share of the truth by which a number misses it beyond its own interval, that is wrong."""
SETTINGS = {"usual": usual, "any": any_setting}
_TRUE_OF_HONEST = {
    Flag.NOISE_DOMINATED,
    Flag.NOISE_CORRELATED,
    Flag.EDGE_LEAVES_REGION,
    Flag.REGION_TOO_SMALL,
}
"""What says of an honest edge what is so: of its noise, or that the region drawn is too small for it."""
NOISES: tuple[tuple[str, float | None], ...] = (
    ("white", None), ("Gaussian 0.5 px", 0.5), ("Gaussian 0.8 px", 0.8), ("Gaussian 1.5 px", 1.5), ("columns", 0.0)
)  # fmt: skip
"""Noise by its name and the Gaussian that white noise was passed through, px; 0: half of it is its column's."""
NOISE_CNR = 20.0


@dataclass(frozen=True)
class Extent:
    """pictures: of each case, from the seed ``first`` on. noisy: of each kind of noise."""

    pictures: int = 20
    noisy: int = 100
    first: int = 0


FULL = Extent()
QUICK = Extent(pictures=10, noisy=20)


@dataclass(frozen=True)
class Row:
    """Of one case in one setting: shares, the median error of MTF50 as printed, and the flags' counts.

    wrong: share that is neither withheld nor flagged, and whose 95 % interval ends more than ``WRONG`` off the truth.
    """

    setting: str
    case: str
    deceives: bool
    silent: bool
    pictures: int
    withheld: float
    flagged: float
    wrong: float
    error: float
    flags: str

    @property
    def caught(self) -> float:
        """Share that is withheld or flagged."""
        return self.withheld + self.flagged


@dataclass(frozen=True)
class NoiseRow:
    """Of one kind of noise: share of MTF50's intervals that hold, NEQ(0) over the truth, and what carries a flag."""

    noise: str
    pictures: int
    coverage: float
    neq_0: float
    neq_0_flagged: float
    flagged: float


@dataclass(frozen=True)
class Bench:
    """What was found."""

    rows: list[Row]
    noises: list[NoiseRow]
    extent: Extent

    def losses(self) -> list[str]:
        """Where an edge deceives after all, or an honest one is doubted, and where numbers are plain wrong."""
        return [
            f"{row.case}: {row.caught:.0%} withheld or flagged, wanted "
            + (f"{CAUGHT:.0%} or more" if row.deceives else f"{SPARED:.0%} or less")
            for row in self.rows
            if row.setting == "usual" and not row.silent and not fair(row)
        ] + [
            f"{row.case}, {row.setting} setting: {row.wrong:.0%} are plain wrong, wanted {1 - CAUGHT:.0%} or less"
            for row in self.rows
            if not row.silent and row.wrong > 1 - CAUGHT + 1e-9
        ]

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "extent": asdict(self.extent),
            "losses": self.losses(),
            "rows": [_record(row) for row in self.rows],
            "noises": [
                asdict(row) | {"neq_0": row.neq_0 if math.isfinite(row.neq_0) else None}
                for row in self.noises
            ],
        }


def fair(row: Row) -> bool:
    """Whether a case is caught, or spared, as often as is wanted."""
    return row.caught >= CAUGHT if row.deceives else row.caught <= SPARED


def steps(extent: Extent) -> int:
    """What the shares told to ``progress`` add up to."""
    return len(SETTINGS) * len(CASES) + len(NOISES)


def measure(extent: Extent = FULL, threads: int = 2, progress: Progress = lambda share: None) -> Bench:
    """Make and measure every case in every setting, and the usual edge in every noise."""
    jobs = [(setting, case) for setting in SETTINGS for case in CASES]
    rows: list[Row] = []
    with limited_threads(1), ThreadPoolExecutor(threads) as pool:
        for row in pool.map(partial(_of_job, extent), jobs):
            rows.append(row)
            progress(1)
        noises = []
        for found in pool.map(partial(_in_noise, extent), NOISES):
            noises.append(found)
            progress(1)
    return Bench(rows, noises, extent)


def judged(case: Case, seeds: Iterable[int], setting: str = "usual") -> Row:
    """The case's pictures of these seeds in a setting of ``SETTINGS``, measured."""
    edges, errors, wrong = [], [], 0
    for seed in seeds:
        draw = Draw.of(zlib.crc32(f"{case.name}, {setting}".encode()), seed)
        at = SETTINGS[setting](draw)
        picture, truth = case.make(at, draw), case.mtf50(at)
        edge = one(slanted_edge(picture, full_scale=ENOUGH, bootstrap=0))
        wrong += not edge.flags and abs(edge.mtf50 / truth - 1) > WRONG and _plain_wrong(picture, truth)
        edges.append(edge if case.deceives else replace(edge, flags=edge.flags - _TRUE_OF_HONEST))
        errors.append(edge.mtf50 / truth - 1)
    withheld = sum(bool(edge.flags & WITHHELD) for edge in edges)
    flagged = sum(bool(edge.flags) for edge in edges) - withheld
    told = [error for error in errors if math.isfinite(error)]
    counts = Counter(flag.name.lower() for edge in edges for flag in edge.flags)
    return Row(
        setting=setting,
        case=case.name,
        deceives=case.deceives,
        silent=case.silent,
        pictures=len(edges),
        withheld=withheld / len(edges),
        flagged=flagged / len(edges),
        wrong=wrong / len(edges),
        error=float(np.median(told)) if told else math.nan,
        flags=" ".join(f"{name}:{count}" for name, count in counts.most_common()),
    )


def _plain_wrong(picture: torch.Tensor, truth: float) -> bool:
    """Whether MTF50 is told without a flag, and its interval ends more than ``WRONG`` off the truth."""
    edge = one(slanted_edge(picture, full_scale=ENOUGH))
    low, high = edge.intervals.get("mtf50", (truth, truth))
    return not edge.flags and max(low / truth - 1, 1 - high / truth) > WRONG


def one(found: SlantedEdge | list[SlantedEdge]) -> SlantedEdge:
    """The only edge of a picture that is no batch."""
    return found[0] if isinstance(found, list) else found


def write(bench: Bench, folder: Path) -> None:
    """Write edges.csv, a row per case and setting, and edges.json; raises ``OSError``."""
    write_bench("edges", [_record(row) for row in bench.rows], bench.document(), folder)


def _of_job(extent: Extent, job: tuple[str, Case]) -> Row:
    setting, case = job
    return judged(case, range(extent.first, extent.first + extent.pictures), setting)


def _in_noise(extent: Extent, kind: tuple[str, float | None]) -> NoiseRow:
    name, sigma_px = kind
    at = Setting(offset_px=(0.3, 0.1))
    deviation = (at.bright - at.dark) / NOISE_CNR
    draws = [Draw.of(zlib.crc32(name.encode()), extent.first + seed) for seed in range(extent.noisy)]
    fields = torch.stack([_field(draw, (at.height_px, at.width_px), sigma_px) for draw in draws])
    found = slanted_edge((at.edge() + deviation * fields)[:, None], full_scale=9.0, bootstrap=200)
    edges = [edge for edge in found if edge.intervals] if isinstance(found, list) else [found]
    inside = [low <= at.mtf50 <= high for low, high in (edge.intervals["mtf50"] for edge in edges)]
    told = [information.neq_0(edge) for edge in edges]
    truth = (at.bright / deviation) ** 2 / _power_at_0(sigma_px)
    flagged = sum(Flag.NOISE_CORRELATED in edge.flags for edge in edges) + len(draws) - len(edges)
    return NoiseRow(
        noise=name,
        pictures=len(draws),
        coverage=float(np.mean(inside)),
        neq_0=float(np.median([number.value for number in told])) / truth,
        neq_0_flagged=float(np.mean([bool(number.flags) for number in told])),
        flagged=flagged / len(draws),
    )


def _field(draw: Draw, shape: tuple[int, int], sigma_px: float | None) -> torch.Tensor:
    """Noise of variance 1, (H, W)."""
    spare = 8
    white = draw.normal((shape[0] + 2 * spare, shape[1] + 2 * spare))
    if sigma_px is None:
        field = white
    elif sigma_px:
        field = smoothed(white, sigma_px) * math.sqrt(_power_at_0(sigma_px))
    else:
        field = (white + draw.normal((white.shape[1],))) / math.sqrt(2)
    return field[spare:-spare, spare:-spare]


def _power_at_0(sigma_px: float | None) -> float:
    """NPS(0) over the variance. Of columns it is that along them, as good as infinite: NaN."""
    if sigma_px is None:
        return 1.0
    if not sigma_px:
        return math.nan
    point = torch.zeros(41, 41, dtype=torch.float64)
    point[20, 20] = 1
    return float(1 / smoothed(point, sigma_px).square().sum())


def _record(row: Row) -> dict[str, Any]:
    return asdict(row) | {"error": row.error if math.isfinite(row.error) else None}
