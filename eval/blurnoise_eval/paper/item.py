"""Items of the rerun: statements of the paper, each beside what is found here and the rule by which the two agree."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from statistics import NormalDist
from typing import NamedTuple

from blurnoise.metrics.values import Estimate
from blurnoise_eval.paper.measurement import CHAINS, Chain, NotRun

AGREES, DIFFERS, NOT_RUN, NOT_JUDGED = "agrees", "differs", "not run", "not judged"
COLUMNS = ("item", "expected", "found", "rule", "verdict", "what", "chain", "place", "setting")


@dataclass(frozen=True)
class Check:
    """One statement of the paper beside what is found.

    agrees: whether ``found`` keeps the rule; None where nothing can be held to the paper, or the chain is not the
    paper's. chain: in which it was found, where pictures go to a network.
    """

    what: str
    expected: str
    found: str
    rule: str
    agrees: bool | None
    chain: str = ""
    not_run: bool = False

    @property
    def verdict(self) -> str:
        """In words."""
        if self.not_run:
            return NOT_RUN
        return NOT_JUDGED if self.agrees is None else AGREES if self.agrees else DIFFERS


class Line(NamedTuple):
    """A line of a figure; y is NaN where a number is withheld. dashed: a closed form, or the chain beside.

    colour: place among the figure's colours; None: the next one.
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False
    colour: int | None = None


class Figure(NamedTuple):
    """Lines, and what the paper says as ranges or places of x.

    quoted: (low, high, label) of x; low equals high for one place. level: of y, a share. points: without lines.
    """

    title: str
    x_label: str
    y_label: str
    lines: Sequence[Line]
    quoted: Sequence[tuple[float, float, str]] = ()
    logarithmic: bool = True
    points: bool = False
    level: float | None = None


Parts = Iterator[Check | Figure]


class Item(NamedTuple):
    """An entry of the rerun. place: figure, table or equation of the paper.

    of: gives the checks and figures of measurements. judged: the chain that is held to the paper; ``of`` is then
    called for each chain.
    """

    name: str
    title: str
    place: str
    setting: str
    of: Callable[..., Parts]
    judged: Chain | None = None

    def run(self, measured: object) -> Outcome:
        """What is found; where something is missing for it, a check that says so."""
        checks: list[Check] = []
        figures: list[Figure] = []
        try:
            for chain in CHAINS if self.judged else ("",):
                for part in self.of(measured, chain) if chain else self.of(measured):
                    if isinstance(part, Figure):
                        figures.append(part)
                    else:
                        agrees = part.agrees if chain in ("", self.judged) else None
                        checks.append(replace(part, chain=chain, agrees=agrees))
        except NotRun as reason:
            return Outcome(self, [Check(self.title, "", str(reason), "", None, not_run=True)], [])
        return Outcome(self, checks, figures)


class Outcome(NamedTuple):
    """An item with what was found."""

    item: Item
    checks: Sequence[Check]
    figures: Sequence[Figure]

    def rows(self) -> list[dict[str, str]]:
        """The item's rows of paper.csv, by ``COLUMNS``."""
        shared = {"item": self.item.name, "place": self.item.place, "setting": self.item.setting}
        rows = [{**asdict(check), "verdict": check.verdict, **shared} for check in self.checks]
        return [{name: row[name] for name in COLUMNS} for row in rows]


def all_near(found: Iterable[Estimate], expected: Sequence[float], share: float) -> bool:
    """Whether each lies within a share of what is expected, or its 95 % interval holds that, of all N together.

    Each interval is widened as Bonferroni does, by normal quantiles: one in twenty of N would fail by chance.
    """
    normal = NormalDist()
    wider = normal.inv_cdf(1 - 0.025 / max(len(expected), 1)) / normal.inv_cdf(0.975)
    return all(
        abs(each.value / at - 1) <= share
        or wider * (each.low - each.value) <= at - each.value <= wider * (each.high - each.value)
        for each, at in zip(found, expected, strict=True)
    )


def falls(values: Iterable[float]) -> bool:
    """Whether each value is below the one before."""
    return all(after < before for before, after in pairwise(values))


def spread(values: Sequence[float]) -> float:
    """Largest less smallest, as a share of the mean."""
    return (max(values) - min(values)) * len(values) / sum(values)


def listed(values: Iterable[float], how: str = "g") -> str:
    """'1, 2.5'."""
    return ", ".join(format(value, how) for value in values)
