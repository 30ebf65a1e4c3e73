"""Bench of sensor noise: every way to draw it, time beside distance from the exact law, taken in turns.

Units: means and read noise in electrons (e-), times in ns per value, distances as total variation (0 to 1) of
the final digital numbers at 1 DN/e-, where nothing hides between two of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

import torch

from blurnoise_eval.bench import laws
from blurnoise_eval.bench.laws import Converter
from blurnoise_eval.bench.samplers import Sampler, equal_chances, samplers
from blurnoise_eval.bench.timing import Quartiles, in_turns_ms, machine, quartiles
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.system.threads import limited_threads

Progress = Callable[[float], object]
YARDSTICK = "torch.randn"
"""One normal value per pixel, of the same shape: what times are compared with."""


@dataclass(frozen=True)
class Extent:
    """How much is measured.

    shape: (B, C, H, W) of every draw, which is judged by all its values. A call is repeated from ``fewest``
    to ``most`` times, as often as fits into ``seconds``.
    """

    means_e: tuple[float, ...] = (0.1, 1, 3, 10, 30, 100, 1000, 10000)
    read_noises_e: tuple[float, ...] = (2.44, 0.3)
    shape: tuple[int, int, int, int] = (8, 3, 512, 512)
    fewest: int = 2
    most: int = 8
    seconds: float = 0.4

    @property
    def samples(self) -> int:
        """Values of a draw."""
        return prod(self.shape)


FULL = Extent()
QUICK = Extent((1, 10, 100, 1000), shape=(2, 3, 256, 256), seconds=0.05)


@dataclass(frozen=True)
class Row:
    """A sampler at one mean and read noise.

    to_randn: median time over that of ``YARDSTICK`` in the same turns. sampled: distance of the drawn values'
    frequencies, which lies above the true one on average and at ``floor`` for an exact sampler. integrated:
    the distance itself, over equal steps of the normal's probability; None where counts come from elsewhere.
    """

    sampler: str
    read_noise_e: float
    mean_e: float
    ns: Quartiles
    to_randn: float
    sampled: float
    floor: float
    integrated: float | None

    @property
    def distance(self) -> float:
        """The best that is known: integrated, else what sampling shows above its floor, 0 at least."""
        return max(0.0, self.sampled - self.floor) if self.integrated is None else self.integrated

    def record(self) -> dict[str, Any]:
        """Flat, for a table."""
        flat = asdict(self)
        low, median, high = flat.pop("ns")
        return {**flat, "ns_low_quartile": low, "ns_median": median, "ns_high_quartile": high}


@dataclass(frozen=True)
class Bench:
    """What was measured, of whom, and on which machine."""

    rows: list[Row]
    extent: Extent
    samplers: list[Sampler]
    machine: dict[str, Any]

    def row(self, sampler: str, read_noise_e: float, mean_e: float) -> Row:
        """The row of these."""
        key = (sampler, read_noise_e, mean_e)
        return next(row for row in self.rows if (row.sampler, row.read_noise_e, row.mean_e) == key)

    def noticed(self, row: Row) -> bool:
        """Whether its samples lie farther from the exact law than exact ones would, by three deviations."""
        return row.sampled > row.floor + 3 * laws.spread(self.extent.samples)

    def losses(self) -> list[str]:
        """Where somebody else's sampler takes 2 % less time than ``auto``, or is closer to the exact law.

        Closer where both are integrated, or by three deviations of an estimate from samples.
        """
        found = []
        others = [sampler.name for sampler in self.samplers if not sampler.ours]
        for read, other in product(self.extent.read_noises_e, others):
            pairs = [
                (self.row("auto", read, mean), self.row(other, read, mean)) for mean in self.extent.means_e
            ]
            faster = [
                f"{theirs.ns.median / own.ns.median:.2f} of it at {own.mean_e:g} e-"
                for own, theirs in pairs
                if theirs.ns.median < 0.98 * own.ns.median
            ]
            closer = [
                f"{own.distance:.4f} at {own.mean_e:g} e-"
                for own, theirs in pairs
                if self._doubt(theirs) + theirs.distance < own.distance
            ]
            name = f"read noise {read:g} e-: {other}"
            if faster:
                found.append(f"{name} takes less time than auto: {', '.join(faster)}")
            if closer:
                found.append(f"{name} is closer to the exact law than auto, off by {', '.join(closer)}")
        return found

    def _doubt(self, row: Row) -> float:
        return 3 * laws.spread(self.extent.samples) if row.integrated is None else 0.0

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "machine": self.machine,
            "extent": asdict(self.extent),
            "converters": [asdict(Converter(read)) for read in self.extent.read_noises_e],
            "samplers": {sampler.name: sampler.about for sampler in self.samplers},
            "yardstick": YARDSTICK,
            "losses": self.losses(),
            "rows": [row.record() for row in self.rows],
        }


def steps(extent: Extent) -> int:
    """What the shares told to ``progress`` add up to."""
    return len(extent.means_e) * (2 * len(extent.read_noises_e) * len(samplers()) + 1)


def measure(extent: Extent = FULL, threads: int = 2, progress: Progress = lambda share: None) -> Bench:
    """Time and judge every sampler at every mean and read noise."""
    facts = machine(threads)
    with limited_threads(threads):
        normal = equal_chances(extent.shape)
        rows = [row for mean_e in extent.means_e for row in _at(mean_e, normal, extent, progress)]
    return Bench(rows, extent, samplers(), facts)


def write(bench: Bench, folder: Path) -> None:
    """Write noise.csv, a row per sampler, mean and read noise, and noise.json; raises ``OSError``."""
    write_bench("noise", [row.record() for row in bench.rows], bench.document(), folder)


def _at(mean_e: float, normal: torch.Tensor, extent: Extent, progress: Progress) -> Iterator[Row]:
    means = torch.full_like(normal, mean_e)
    drawn: dict[tuple[str, float], torch.Tensor] = {}

    def keep(sampler: Sampler, read: float) -> None:
        drawn[sampler.name, read] = sampler.draw(means, Converter(read))

    methods = samplers()
    calls: dict[tuple[str, float], Callable[[], object]] = {
        (sampler.name, read): partial(keep, sampler, read)
        for read, sampler in product(extent.read_noises_e, methods)
    }
    calls[YARDSTICK, 0.0] = partial(torch.randn, extent.shape)
    turns = in_turns_ms(
        calls, fewest=extent.fewest, most=extent.most, seconds=extent.seconds, progress=progress
    )
    times = {key: quartiles([1e6 * ms / extent.samples for ms in values]) for key, values in turns.items()}
    for read in extent.read_noises_e:
        converter = Converter(read)
        exact = laws.exact(mean_e, converter)
        floor = laws.floor(exact, extent.samples)
        for sampler in methods:
            ns = times[sampler.name, read]
            sampled = laws.of_values(drawn[sampler.name, read].numpy(), converter.full_scale_dn)
            law = sampler.law and sampler.law(means, converter, normal)
            progress(1)
            yield Row(
                sampler.name, read, mean_e, ns,
                to_randn=ns.median / times[YARDSTICK, 0.0].median,
                sampled=laws.distance(sampled, exact),
                floor=floor,
                integrated=None if law is None else laws.distance(law, exact),
            )  # fmt: skip
