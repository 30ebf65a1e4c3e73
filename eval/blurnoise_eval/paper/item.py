"""Items of the rerun: what the paper says, what is found here, by which rule the two agree.

A verdict is one of ``VERDICTS``. "not judged" stands where nothing can be held to the paper: figures to look at, and
the chain that is not the paper's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

from blurnoise.metrics.estimate import Estimate
from blurnoise_eval.paper.measurement import Measurement, Measurements

AGREES, DIFFERS, NOT_RUN, NOT_JUDGED = "agrees", "differs", "not run", "not judged"
VERDICTS = (AGREES, DIFFERS, NOT_RUN, NOT_JUDGED)


@dataclass(frozen=True)
class Check:
    """One statement of the paper beside what is found.

    agrees: whether ``found`` keeps the rule; None where it is not judged. chain: the chain it was found in, where
    pictures go to a network.
    """

    what: str
    expected: str
    found: str
    rule: str
    agrees: bool | None
    chain: str = ""

    @property
    def verdict(self) -> str:
        """What becomes of it."""
        return NOT_JUDGED if self.agrees is None else AGREES if self.agrees else DIFFERS


@dataclass(frozen=True)
class Line:
    """A line of a figure; NaN where a number is withheld. dashed: a closed form, or the chain beside."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False
    colour: int | None = None
    """Its place among the figure's colours; None: the next one."""


@dataclass(frozen=True)
class Figure:
    """What an item shows: lines, and what the paper says as ranges or places of x.

    quoted: (low, high, what) of x; low equals high for one place. level: what y, a share, is held to.
    """

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    quoted: tuple[tuple[float, float, str], ...] = ()
    logarithmic: bool = True
    points: bool = False
    """Without lines from point to point."""
    level: float | None = None


@dataclass(frozen=True)
class Found:
    """What an item comes to."""

    checks: tuple[Check, ...]
    figures: tuple[Figure, ...] = ()


@dataclass(frozen=True)
class Item:
    """An entry of the rerun. place: figure, table or equation of the paper. needs: what is measured for it."""

    name: str
    title: str
    place: str
    setting: str
    of: Callable[[Measurements], Found]
    needs: tuple[Measurement, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """An item with what was found, or why it was not run."""

    item: Item
    found: Found | None
    why_not: str = ""

    def rows(self) -> list[dict[str, str]]:
        """The item's rows of paper.csv."""
        shared = {"place": self.item.place, "setting": self.item.setting}
        if self.found is None:
            blank = {"expected": "", "found": self.why_not, "rule": "", "verdict": NOT_RUN, "chain": ""}
            return [{"item": self.item.name, "what": self.item.title, **blank, **shared}]
        return [
            {
                "item": self.item.name,
                "what": check.what,
                "expected": check.expected,
                "found": check.found,
                "rule": check.rule,
                "verdict": check.verdict,
                "chain": check.chain,
                **shared,
            }
            for check in self.found.checks
        ]


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
