"""Bench of moving things: time against error of every way to move an object, a picture, its rows or its road.

Units: times in ms, or ns per value of the picture, errors in 8-bit sRGB numbers (DN), RMS against exposures of 128 or
more sub-exposures. Every job is judged where its truth is known: around the object, or off the borders.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from blurnoise_eval.bench import motion_objects, motion_paths, motion_road, motion_rows
from blurnoise_eval.bench.motion_job import OURS, Extent, Job
from blurnoise_eval.bench.timing import Quartiles, in_turns_ms, machine, quartiles
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.system.threads import limited_threads

Progress = Callable[[float], object]
FULL = Extent()
QUICK = Extent(360, 640, moments=128, most=6, seconds=0.4)


def jobs() -> tuple[Job, ...]:
    """All that is measured here, with those who can take part."""
    return (*motion_objects.jobs(), motion_paths.job(), motion_rows.job(), motion_road.job())


@dataclass(frozen=True)
class Row:
    """What one method takes, and how far it is from the truth, RMS; at_rest_dn: how far the picture at rest is."""

    job: str
    method: str
    ms: Quartiles
    ns_per_value: float
    to_ours: float
    error_dn: float
    at_rest_dn: float

    def record(self) -> dict[str, Any]:
        """Flat, for a table."""
        flat = asdict(self)
        low, median, high = flat.pop("ms")
        return {**flat, "ms_low": low, "ms_median": median, "ms_high": high}


@dataclass(frozen=True)
class Bench:
    """What was measured, of whom, and on which machine."""

    rows: list[Row]
    extent: Extent
    jobs: tuple[Job, ...]
    machine: dict[str, Any]

    def of(self, job: Job) -> list[Row]:
        """Its rows, as its methods."""
        return [row for row in self.rows if row.job == job.name]

    def losses(self) -> list[str]:
        """What others do that none of ours does as exactly in as little time, and who is not here.

        Left out is what leaves more than a third of the error of doing nothing.
        """
        found = []
        for job in self.jobs:
            families = {method.name: method.family for method in job.methods}
            rows = self.of(job)
            own = [row for row in rows if families[row.method] == OURS]
            for row in rows:
                useful = families[row.method] != OURS and row.error_dn < row.at_rest_dn / 3
                if useful and not any(_matches(each, row) for each in own):
                    error = row.error_dn / own[0].error_dn
                    found.append(
                        f"{job.name}: {row.method} in {row.to_ours:.2f} of our time, {error:.2f} of our error"
                    )
            found += [f"{job.name}: {name} is left out: {why}" for name, why in job.absent.items()]
        return found

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "machine": self.machine,
            "extent": asdict(self.extent),
            "jobs": {
                job.name: {
                    "title": job.title,
                    "methods": {method.name: method.about for method in job.methods},
                    "absent": job.absent,
                }
                for job in self.jobs
            },
            "losses": self.losses(),
            "rows": [row.record() for row in self.rows],
        }


def steps(extent: Extent) -> int:
    """What the shares told to ``progress`` add up to: a case for each job, and its methods."""
    return sum(1 + len(job.methods) for job in jobs())


def measure(extent: Extent = FULL, threads: int = 2, progress: Progress = lambda share: None) -> Bench:
    """Judge and time every method of every job."""
    facts, every = machine(threads), jobs()
    with limited_threads(threads):
        rows = [row for job in every for row in _measured(job, extent, progress)]
    return Bench(rows, extent, every, facts)


def write(bench: Bench, folder: Path) -> None:
    """Write motion.csv, a row per method and job, and motion.json with all else; raises ``OSError``."""
    write_bench("motion", [row.record() for row in bench.rows], bench.document(), folder)


def _measured(job: Job, extent: Extent, progress: Progress) -> Iterator[Row]:
    case = job.case(extent)
    progress(1)
    calls = {method.name: method.of(case) for method in job.methods}
    errors = {name: case.error_dn(call()) for name, call in calls.items()}
    at_rest = case.error_dn(case.picture)
    turns = in_turns_ms(
        calls, fewest=extent.fewest, most=extent.most, seconds=extent.seconds, progress=progress
    )  # fmt: skip
    times = {name: quartiles(measured) for name, measured in turns.items()}
    ours = times[job.methods[0].name].median
    for name, ms in times.items():
        values = ms.median * 1e6 / extent.values
        yield Row(job.name, name, ms, values, ms.median / ours, errors[name], at_rest)


def _matches(own: Row, other: Row) -> bool:
    """Whether one of ours does as well as another's in both, to 2 %."""
    return own.ms.median <= 1.02 * other.ms.median and own.error_dn <= 1.02 * other.error_dn
