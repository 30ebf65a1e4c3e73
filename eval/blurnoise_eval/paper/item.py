"""Items of the rerun: statements of the paper, each beside what is found here and the rule by which the two agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from statistics import NormalDist
from typing import NamedTuple

from blurnoise.metrics.values import Estimate
from blurnoise_eval.paper.measurement import CHAINS, Chain, Measurements, NotRun

VERDICTS = {True: "agrees", False: "differs", None: "not judged"}
NOT_RUN = "not run"
COLUMNS = ("item", "expected", "found", "rule", "verdict", "what", "chain", "place", "setting")
Curve = Mapping[float, float]
"""From x to y."""
Range = tuple[float, float, str]


class Check(NamedTuple):
    """One statement of the paper beside what is found.

    agrees: whether ``found`` keeps the rule; None where nothing can be held to the paper.
    """

    what: str
    expected: str
    found: str
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

    def run(self, measured: Measurements) -> Outcome:
        """What is found; where something is missing for it, a check that says so."""
        rows: list[dict[str, str]] = []
        figures: list[Figure] = []
        try:
            for chain in CHAINS if self.judged else ("",):
                for part in self.of(measured, chain) if chain else self.of(measured):
                    if isinstance(part, Check):
                        verdict = VERDICTS[part.agrees if chain in ("", self.judged) else None]
                        rows.append(self._row(part, verdict, chain))
                    else:
                        figures.append(part._replace(title=f"{part.title}, {chain} chain") if chain else part)
        except NotRun as reason:
            return Outcome(self, [self._row(Check(self.title, "", str(reason)), NOT_RUN)], [])
        return Outcome(self, rows, figures)

    def _row(self, check: Check, verdict: str, chain: str = "") -> dict[str, str]:
        own = {"item": self.name, "place": self.place, "setting": self.setting}
        row = {**check._asdict(), **own, "verdict": verdict, "chain": chain}
        return {name: row[name] for name in COLUMNS}


class Outcome(NamedTuple):
    """An item with what was found; rows: of paper.csv, by ``COLUMNS``."""

    item: Item
    rows: list[dict[str, str]]
    figures: list[Figure]


def within(
    what: str, expected: str, found: float, low: float, high: float, unit: str, how: str = "g"
) -> Check:
    """A check that a number lies in a range; an infinite one is none."""
    text = f"{found:{how}} {unit}" if math.isfinite(found) else "none"
    return Check(what, expected, text, f"within {low:{how}}-{high:{how}} {unit}", low <= found <= high)


def even(what: str, expected: str, found: Collection[float], how: str, unit: str, share: float) -> Check:
    """A check that numbers are equal: from the least to the greatest it is at most this share of their mean."""
    text = f"{', '.join(format(each, how) for each in found)} {unit}".rstrip()
    spread = (max(found) - min(found)) * len(found) / sum(found)
    return Check(what, expected, text, f"spread within {share:.0%}", spread <= share)


def near(
    what: str, expected: str, found: Iterable[Estimate], truth: Sequence[float], text: str, share: float
) -> Check:
    """A check that each number lies within a share of its truth, or its 95 % interval holds that, of all N together.

    Each interval is widened as Bonferroni does, by normal quantiles: one in twenty of N would fail by chance.
    """
    pairs, normal = list(zip(found, truth, strict=True)), NormalDist()
    wider = normal.inv_cdf(1 - 0.025 / len(pairs)) / normal.inv_cdf(0.975)
    off = [abs(each.value / at - 1) for each, at in pairs]
    inside = [
        wider * (each.low - each.value) <= at - each.value <= wider * (each.high - each.value)
        for each, at in pairs
    ]
    agrees = all(apart <= share or holds for apart, holds in zip(off, inside, strict=True))
    rule = f"within {share:.0%}, or within the 95 % intervals of all together"
    return Check(what, expected, f"{text}, {max(off):.2%} off at most", rule, agrees)


def falling(what: str, expected: str, found: Curve, how: str) -> Check:
    """A check that each of several numbers is below the one before."""
    text = ", ".join(f"{y:{how}} at {x:g}" for x, y in found.items())
    agrees = len(found) > 1 and all(after < before for before, after in pairwise(found.values()))
    return Check(what, expected, text, "falls", agrees)
