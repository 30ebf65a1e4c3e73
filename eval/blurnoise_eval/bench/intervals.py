"""Bench of intervals: how often each kind holds the truth, and how wide it is, in populations made for it.

Domain: nominal 95 %. Pictures are the clusters. Widths are in the quantity's own unit: confidence, AP, or stops of
exposure for the ends of a window.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from blurnoise._core.checks import integer
from blurnoise_eval.bench.simulated import EXPOSURES_S, POPULATIONS, Array, Population, ranked
from blurnoise_eval.bench.timing import machine
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.scoring import certainty
from blurnoise_eval.scoring.certainty import Ends
from blurnoise_eval.scoring.matching import mean_over

Progress = Callable[[float], object]
CANDIDATES = ("percentile", "Student", "Hall", "joined", "bounded")
QUANTITIES = ("mean confidence", "window's start", "window's end", "AUC", "difference", "AP50")
WANTED = (0.93, 0.98)
"""Shares of intervals that hold the truth: what is asked for."""
_DRAWS = 400  # of the percentile bootstrap
_BATCH = 100  # samples drawn at once
_WIDTHS = 100  # samples whose windows are searched for both ends of an edge's interval
_FINE = 12  # places between two exposures


def taken(quantity: str) -> str:
    """The candidate that the rest of the package uses for a quantity: "bounded" for means of what lies in [0, 1]."""
    return "bounded" if quantity in ("mean confidence", "AUC", "AP50") else "joined"


@dataclass(frozen=True)
class Extent:
    """How much is simulated. replications: samples of pictures of each number. truth: batches of 100 x 100 pictures
    that stand for the whole population."""

    replications: int = 600
    pictures: tuple[int, ...] = (3, 5, 8, 12, 20, 35)
    seed: int = 0
    truth: int = 40

    def __post_init__(self) -> None:
        integer("replications", self.replications, 1, 100_000)
        integer("seed", self.seed, 0, 2**32 - 1)


FULL = Extent()
QUICK = Extent(100, (3, 8, 20))


@dataclass(frozen=True)
class Row:
    """One candidate for one quantity from so many pictures.

    coverage: share of samples whose interval holds the truth, mean over the exposures; least: at the worst of
    them. width: median over samples and exposures of high less low.
    """

    population: str
    quantity: str
    pictures: int
    candidate: str
    coverage: float
    least: float
    width: float


@dataclass(frozen=True)
class Bench:
    """What was found, and how it was made."""

    rows: list[Row]
    extent: Extent
    machine: dict[str, Any]

    def row(self, population: str, quantity: str, pictures: int, candidate: str) -> Row:
        """The row of these."""
        key = (population, quantity, pictures, candidate)
        return next(r for r in self.rows if (r.population, r.quantity, r.pictures, r.candidate) == key)

    def losses(self) -> list[str]:
        """Where the candidate taken holds in less or more than is wanted, from the fewest pictures told of."""
        low, high = WANTED
        return [
            f"{row.quantity} of {row.population}, {row.pictures} pictures: {row.candidate} holds in "
            f"{100 * row.coverage:.1f} %"
            for row in self.rows
            if row.candidate == taken(row.quantity)
            and row.pictures >= certainty.FEWEST
            and not low <= row.coverage <= high
        ]

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "extent": asdict(self.extent),
            "machine": self.machine,
            "wanted": list(WANTED),
            "taken": {quantity: taken(quantity) for quantity in QUANTITIES},
            "losses": self.losses(),
            "rows": [asdict(row) for row in self.rows],
        }


def steps(extent: Extent) -> int:
    """What the shares told to ``progress`` add up to."""
    return len(POPULATIONS) * len(extent.pictures)


def measure(extent: Extent = FULL, threads: int = 1, progress: Progress = lambda share: None) -> Bench:
    """Draw samples of pictures, and hold every candidate's interval to what the whole population has."""
    rows: list[Row] = []
    for place, population in enumerate(POPULATIONS):
        truth = _truth(population, extent.truth, np.random.default_rng([extent.seed, place]))
        for pictures in extent.pictures:
            generator = np.random.default_rng([extent.seed, place, pictures])
            rows += _rows(population, pictures, extent.replications, truth, generator)
            progress(1)
    return Bench(rows, extent, machine(threads))


def write(bench: Bench, folder: Path) -> None:
    """Write intervals.csv, a row per population, quantity, number and candidate, and intervals.json."""
    write_bench("intervals", [asdict(row) for row in bench.rows], bench.document(), folder)


class _Truth(NamedTuple):
    first: Array
    second: Array
    ap50: float


class _Sample(NamedTuple):
    """Sums and numbers of confidences by picture, (pictures, samples, exposures); average precision of each."""

    first: Array
    second: Array
    counts: Array
    ap50: Array
    without: Array
    drawn: Array


def _truth(population: Population, batches: int, generator: np.random.Generator) -> _Truth:
    totals = np.zeros((3, len(EXPOSURES_S)))
    for _ in range(batches):
        seen = population.draw(generator, 100, 100)
        totals += [
            _sum(seen.first).sum((0, 1)),
            _sum(seen.second).sum((0, 1)),
            _count(seen.first).sum((0, 1)),
        ]
    whole = population.draw(generator, 750 * batches, 1)
    ranking = ranked(whole.first[:, :, 0], generator, as_one=True)
    return _Truth(totals[0] / totals[2], totals[1] / totals[2], float(ranking.ap50(np.ones(1))))


def _sample(population: Population, pictures: int, count: int, generator: np.random.Generator) -> _Sample:
    weights = _drawn_weights(pictures)
    leaving = 1 - np.eye(pictures)
    found: list[tuple[Array, Array, Array]] = []
    precision = []
    for start in range(0, count, _BATCH):
        seen = population.draw(generator, pictures, min(_BATCH, count - start))
        found.append((_sum(seen.first), _sum(seen.second), _count(seen.first)))
        for one in np.moveaxis(seen.first, 2, 0):
            ranking = ranked(one, generator)
            precision.append(ranking.ap50(np.concatenate([np.ones((1, pictures)), leaving, weights])))
    first, second, counts = (np.concatenate(parts, axis=1) for parts in zip(*found, strict=True))
    every = np.array(precision).T
    return _Sample(first, second, counts, every[0], every[1 : 1 + pictures], every[1 + pictures :])


def _rows(
    population: Population, pictures: int, count: int, truth: _Truth, generator: np.random.Generator
) -> Iterator[Row]:
    sample = _sample(population, pictures, count, generator)
    weights = _drawn_weights(pictures)
    centre = [certainty.mean_of(sums, sample.counts) for sums in (sample.first, sample.second)]
    departure = [certainty.departures(sums, sample.counts) for sums in (sample.first, sample.second)]
    number = np.tensordot(weights, sample.counts, 1)
    drawn = [np.tensordot(weights, sums, 1) / number for sums in (sample.first, sample.second)]
    share, gap = (0.0, 1.0), (-1.0, 1.0)
    curves = (truth.first, centre[0], departure[0], drawn[0])
    others = (truth.second, centre[1], departure[1], drawn[1])
    known: dict[str, tuple[Any, ...]] = {
        "mean confidence": (*curves, share),
        "AUC": (*(mean_over(EXPOSURES_S, curve) for curve in curves), share),
        "difference": (*(one - other for one, other in zip(curves, others, strict=True)), gap),
        "AP50": (
            *(truth.ap50, sample.ap50, certainty.jackknife(sample.ap50, sample.without), sample.drawn),
            share,
        ),
    }
    for quantity, (true, middle, away, resampled, within) in known.items():
        for candidate, ends in _ends(middle, away, resampled, within).items():
            width = float(np.nanmedian(ends.high - ends.low))
            yield _row(population, quantity, pictures, candidate, _holds(ends, true), width)
    yield from _edges(population, pictures, sample, truth)


def _edges(population: Population, pictures: int, sample: _Sample, truth: _Truth) -> Iterator[Row]:
    """A window's ends: the exposures at which the mean of z, confidence above the threshold, may be 0."""
    x, level = np.log2(EXPOSURES_S), population.threshold
    z = (sample.first - level * sample.counts) / sample.counts.mean(axis=0)
    weights = _drawn_weights(pictures)
    top = int(truth.first.argmax())
    fine = np.linspace(0, len(x) - 1, (len(x) - 1) * _FINE + 1)
    within = (-level, 1 - level)

    def at(place: Array) -> Mapping[str, Ends]:
        """Intervals of z's mean at exposures between the tested ones."""
        before = np.minimum(place.astype(int), len(x) - 2)
        share = place - before
        here = z[..., before] * (1 - share) + z[..., before + 1] * share
        mean = here.mean(axis=0)
        return _ends(mean, here - mean, np.tensordot(weights, here, 1) / pictures, within)

    for quantity, up, half in (
        ("window's start", True, fine[fine <= top]),
        ("window's end", False, fine[fine >= top]),
    ):
        curve = np.interp(half, np.arange(len(x)), truth.first)
        crossing = half[np.argmax(curve >= level)] if up else half[np.argmax(curve < level)]
        before = crossing - 1 / _FINE
        value = np.interp([before, crossing], half, curve)
        true = before + (level - value[0]) / (value[1] - value[0]) / _FINE
        at_truth = at(np.array([true]))
        z, whole = z[:, :_WIDTHS], z
        along = at(half)
        z = whole
        steps = np.gradient(np.interp(half, np.arange(len(x)), x))
        for candidate, ends in at_truth.items():
            open_to = (along[candidate].low <= 0) & (along[candidate].high >= 0)
            width = float(np.median((open_to * steps).sum(axis=-1)))
            yield _row(population, quantity, pictures, candidate, _holds(ends, 0.0), width)


def _ends(centre: Array, departure: Array, drawn: Array, within: tuple[float, float]) -> Mapping[str, Ends]:
    """Every candidate's interval, in the order of ``CANDIDATES``; the last two are the package's own."""
    low, high = np.nanquantile(drawn, (0.025, 0.975), axis=0)
    return {
        "percentile": Ends(low, high),
        "Student": certainty.student(centre, departure),
        "Hall": certainty.hall(centre, departure),
        "joined": certainty.joined(centre, departure),
        "bounded": certainty.bounded(centre, departure, within),
    }


def _holds(ends: Ends, true: Array | float) -> Array:
    """Share of samples whose interval holds the truth, per exposure."""
    rounding = 1e-12
    return np.atleast_1d(np.mean((ends.low - rounding <= true) & (true <= ends.high + rounding), axis=0))


def _row(
    population: Population, quantity: str, pictures: int, candidate: str, held: Array, width: float
) -> Row:
    return Row(population.name, quantity, pictures, candidate, float(held.mean()), float(held.min()), width)


def _drawn_weights(pictures: int) -> Array:
    """How often each picture counts in the draws of the percentile bootstrap."""
    drawn = np.random.default_rng(0).multinomial(pictures, np.full(pictures, 1 / pictures), _DRAWS)
    return drawn.astype(float)


def _sum(confidence: Array) -> Array:
    return np.asarray(np.nansum(confidence, axis=1))


def _count(confidence: Array) -> Array:
    return np.asarray(np.isfinite(confidence).sum(axis=1), float)
