"""Statements of the paper, the results of the rerun, and the rules by which the two agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from statistics import NormalDist
from typing import NamedTuple

from paper_measurements import CHAINS, Measurements, NotRun

from blurnoise.metrics.values import Estimate

VERDICTS = {True: "agrees", False: "differs", None: "not judged"}
NOT_RUN = "not run"
COLUMNS = ("item", "expected", "result", "rule", "verdict", "what", "chain", "where", "setting")
Curve = Mapping[float, float]
"""From x to y."""
Range = tuple[float, float, str]
Row = dict[str, str]


class Check(NamedTuple):
    """A statement of the paper and the result of the rerun.

    agrees: whether the result keeps the rule; None where nothing can be compared.
    """

    what: str
    expected: str
    result: str
    rule: str = ""
    agrees: bool | None = None


class Figure(NamedTuple):
    """Measured lines by their labels, and ranges of x that the paper gives: low, high (may be equal), and what."""

    title: str
    x_label: str
    y_label: str
    lines: Mapping[str, Curve]
    published: Sequence[Range] = ()


Parts = Iterator[Check | Figure]


class Item(NamedTuple):
    """An entry of the rerun.

    where: figure, table or equation of the paper. of: yields the checks and figures of measurements. judged: the
    chain that is compared with the paper; ``of`` is then called for each chain.
    """

    name: str
    title: str
    where: str
    setting: str
    of: Callable[..., Parts]
    judged: str = ""

    def run(self, measurements: Measurements) -> tuple[list[Row], list[Figure]]:
        """Rows by ``COLUMNS``, and figures; one row that says so where something is missing for the item."""
        rows: list[Row] = []
        figures: list[Figure] = []
        try:
            for chain in CHAINS if self.judged else ("",):
                for part in self.of(measurements, chain) if chain else self.of(measurements):
                    if isinstance(part, Figure):
                        figures.append(part._replace(title=f"{part.title}, {chain} chain") if chain else part)
                        continue
                    verdict = VERDICTS[part.agrees if chain == self.judged else None]
                    rows.append(self._row(part, verdict, chain))
        except NotRun as reason:
            return [self._row(Check(self.title, "", str(reason)), NOT_RUN)], []
        return rows, figures

    def _row(self, check: Check, verdict: str, chain: str = "") -> Row:
        about = {"item": self.name, "where": self.where, "setting": self.setting}
        row = {**check._asdict(), **about, "verdict": verdict, "chain": chain}
        return {name: row[name] for name in COLUMNS}


def within(
    what: str, expected: str, value: float, low: float, high: float, unit: str, how: str = "g"
) -> Check:
    """A check that a number lies in a range; an infinite one is none."""
    text = f"{value:{how}} {unit}" if math.isfinite(value) else "none"
    return Check(what, expected, text, f"within {low:{how}}-{high:{how}} {unit}", low <= value <= high)


def even(what: str, expected: str, values: Collection[float], how: str, unit: str, share: float) -> Check:
    """A check that numbers are equal: their range is at most this share of their mean."""
    text = f"{', '.join(format(value, how) for value in values)} {unit}".rstrip()
    spread = (max(values) - min(values)) * len(values) / sum(values)
    return Check(what, expected, text, f"spread within {share:.0%}", spread <= share)


def near(
    what: str, expected: str, estimates: Iterable[Estimate], truth: Sequence[float], text: str, share: float
) -> Check:
    """A check that each of N numbers is within a share of its truth, or that its 95 % interval contains the truth.

    Intervals are widened after Bonferroni, by normal quantiles, because one in twenty of N would fail by chance.
    """
    pairs, normal = list(zip(estimates, truth, strict=True)), NormalDist()
    wider = normal.inv_cdf(1 - 0.025 / len(pairs)) / normal.inv_cdf(0.975)
    errors = [abs(estimate.value / true - 1) for estimate, true in pairs]
    inside = [
        wider * (estimate.low - estimate.value)
        <= true - estimate.value
        <= wider * (estimate.high - estimate.value)
        for estimate, true in pairs
    ]
    agrees = all(error <= share or contained for error, contained in zip(errors, inside, strict=True))
    rule = f"within {share:.0%}, or within the 95 % intervals of all together"
    return Check(what, expected, f"{text}, {max(errors):.2%} off at most", rule, agrees)


def falling(what: str, expected: str, curve: Curve, how: str) -> Check:
    """A check that each of several numbers is below the one before."""
    text = ", ".join(f"{y:{how}} at {x:g}" for x, y in curve.items())
    agrees = len(curve) > 1 and all(after < before for before, after in pairwise(curve.values()))
    return Check(what, expected, text, "falls", agrees)
