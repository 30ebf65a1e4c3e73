"""Statements of the paper, the results of the rerun, and the rules by which the two agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from statistics import NormalDist
from typing import NamedTuple

from paper_measurements import Measurements, NotRun

from blurnoise.metrics.values import Estimate

COLUMNS = ("item", "where", "setting", "what", "expected", "result", "rule", "verdict")
Curve = Mapping[float, float]
"""From x to y."""
Range = tuple[float, float, str]
Row = dict[str, str]


class Check(NamedTuple):
    """A statement of the paper, the result of the rerun, and whether the result keeps the rule."""

    what: str
    expected: str
    result: str
    rule: str
    agrees: bool


class Figure(NamedTuple):
    """Measured lines by their labels, and ranges of x that the paper gives: low, high (may be equal), and what."""

    title: str
    x_label: str
    y_label: str
    lines: Mapping[str, Curve]
    published: Sequence[Range] = ()


Parts = Iterator[Check | Figure]


class Item(NamedTuple):
    """An entry of the rerun. where: figure, table or equation of the paper. of: yields its checks and figures."""

    name: str
    title: str
    where: str
    setting: str
    of: Callable[[Measurements], Parts]

    def run(self, measurements: Measurements) -> tuple[list[Row], list[Figure]]:
        """Rows by ``COLUMNS``, and figures; one row that says so where something is missing for the item."""
        about = {"item": self.name, "where": self.where, "setting": self.setting}
        try:
            parts = list(self.of(measurements))
        except NotRun as reason:
            return [{**about, "what": self.title, "result": str(reason), "verdict": "not run"}], []
        checks = [part for part in parts if isinstance(part, Check)]
        rows = []
        for *texts, agrees in checks:
            texts_by_name = dict(zip(Check._fields, texts, strict=False))
            rows.append({**about, **texts_by_name, "verdict": "agrees" if agrees else "differs"})
        return rows, [part for part in parts if isinstance(part, Figure)]


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
