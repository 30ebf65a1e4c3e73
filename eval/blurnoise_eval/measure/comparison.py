"""MeasureComparison of a quantity of real and simulated pictures: the difference, its 95 % interval and a verdict.

Differences are of the real value: relative to the simulated one (from the logarithm of their ratio), or absolute.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from scipy import stats

from blurnoise.metrics.values import Estimate
from blurnoise_eval.system.tables import finite

AGREES, SMALL, DIFFERS, CANNOT_TELL = "agrees", "small", "differs", "cannot tell"
SIGNIFICANT = 0.05  # probability that any of all comparisons differs by chance
HEADS = ("measure", "verdict", "largest difference", "real", "simulated")
_WIDEST = {"relative": 0.5, "absolute": 0.1, "kurtosis": 0.5}
"""Half width of an interval above which it cannot show that two values agree."""
_MOST_TEXTURE = 0.2  # share of the compared variance above which "agrees" would say little about the noise


@dataclass(frozen=True)
class Measure:
    """A quantity of pictures that is compared: its name in files, its title, and the scale of its differences.

    tolerance: a difference whose interval lies within it is small.
    """

    name: str
    title: str
    scale: Literal["relative", "absolute", "kurtosis"] = "relative"
    tolerance: float = 0.0


@dataclass(frozen=True)
class MeasureComparison:
    """A measure of real and simulated pictures of one level of light.

    difference: with its 95 % interval. p_value: the probability of a difference this large by chance, NaN if it is
    unknown; :func:`corrected` takes the number of comparisons into account. texture: share of the compared variance
    that is texture of the scene, which both pictures show.

    >>> brighter = compared(Measure("mean", "mean, DN"), real=103.0, simulated=100.0, error=0.01)
    >>> brighter.verdict, brighter.cells()
    ('differs', ('+3 (+1, +5) %', '103', '100'))
    """

    measure: Measure
    real: float
    simulated: float
    difference: Estimate
    p_value: float
    kind: str = "chart"
    level: str = ""
    texture: float = 0.0

    @property
    def verdict(self) -> str:
        """``AGREES``, ``SMALL``, ``DIFFERS`` or ``CANNOT_TELL``."""
        if not math.isfinite(self.p_value):
            return CANNOT_TELL
        if self.p_value < SIGNIFICANT:
            within = max(-self.difference.low, self.difference.high) <= self.measure.tolerance
            return SMALL if within else DIFFERS
        wide = self.difference.high - self.difference.low > 2 * _WIDEST[self.measure.scale]
        return CANNOT_TELL if wide or self.texture > _MOST_TEXTURE else AGREES

    def row(self) -> dict[str, Any]:
        """Plain values for a file, None for what is unknown."""
        numbers = {
            "real": self.real,
            "simulated": self.simulated,
            "difference": self.difference.value,
            "low": self.difference.low,
            "high": self.difference.high,
            "p_value": self.p_value,
            "texture": self.texture,
        }
        names = {"level": self.level, "kind": self.kind, "measure": self.measure.name}
        return {**names, **{name: finite(value) for name, value in numbers.items()}, "verdict": self.verdict}

    def cells(self) -> tuple[str, str, str]:
        """The difference with its interval, the real and the simulated value, as text."""
        digits = ".4g" if self.measure.scale != "absolute" else ".4f"
        numbers = (f"{self.real:{digits}}", f"{self.simulated:{digits}}")
        if not self.difference.available:
            return ("-", *numbers)
        ends = (self.difference.value, self.difference.low, self.difference.high)
        if self.measure.scale != "relative":
            return ("{:+.3f} ({:+.3f}, {:+.3f})".format(*ends), *numbers)
        if self.difference.value > 1:
            return ("x {:.3g} ({:.3g}, {:.3g})".format(*(1 + share for share in ends)), *numbers)
        return ("{} ({}, {}) %".format(*map(_percent, ends)), *numbers)


def compared(
    measure: Measure,
    real: float,
    simulated: float,
    error: float,
    *,
    freedom: float = math.inf,
    **about: Any,
) -> MeasureComparison:
    """Compare two values. error: standard error of the difference, for a relative one of the logarithm of the ratio.

    freedom: degrees of freedom of ``error`` (Student's t). about: other fields of the comparison.

    >>> compared(Measure("mean", "mean, DN"), real=100.0, simulated=100.0, error=0.01).verdict
    'agrees'
    """
    relative = measure.scale == "relative"
    if math.isnan(error) or (relative and not min(real, simulated) > 0):
        return MeasureComparison(measure, real, simulated, Estimate(math.nan), math.nan, **about)
    apart = math.log(real / simulated) if relative else real - simulated
    half = float(stats.t.ppf(0.975, freedom)) * error
    p_value = 2 * float(stats.t.sf(abs(apart) / error, freedom)) if error else math.nan
    difference = Estimate(apart, apart - half, apart + half)
    if relative:
        low, high = math.expm1(difference.low), math.expm1(difference.high)
        difference = Estimate(real / simulated - 1, low, high)
    return MeasureComparison(measure, real, simulated, difference, p_value, **about)


def corrected(comparisons: Sequence[MeasureComparison]) -> list[MeasureComparison]:
    """The comparisons with probabilities for all together (Holm): in 95 of 100 cases none differs by chance.

    >>> [each.p_value for each in corrected([compared(Measure("x", "x"), 2.0, 2.1, 0.05)] * 2)]  # 0.33 alone
    [0.658..., 0.658...]
    """
    p_values = [(comparison.p_value, index) for index, comparison in enumerate(comparisons)]
    known = sorted(pair for pair in p_values if math.isfinite(pair[0]))
    adjusted, highest = list(comparisons), 0.0
    for passed, (p_value, index) in enumerate(known):
        # Holm: the smallest times the number of comparisons, the next times one less, and never falling.
        highest = max(highest, min(1.0, p_value * (len(known) - passed)))
        adjusted[index] = replace(comparisons[index], p_value=highest)
    return adjusted


def summary(comparisons: Sequence[MeasureComparison]) -> list[tuple[tuple[str, ...], str]]:
    """A row per measure, as ``HEADS``, of the level that differs most; and the verdict about all of its levels.

    >>> agrees = compared(Measure("mean", "mean, DN"), real=100.0, simulated=100.0, error=0.01)
    >>> summary([agrees])[0][0][:2]
    ('mean, DN', 'agrees')
    """
    rows: list[tuple[tuple[str, ...], str]] = []
    for measure in dict.fromkeys(comparison.measure for comparison in comparisons):
        levels = [comparison for comparison in comparisons if comparison.measure == measure]
        known = [level for level in levels if level.difference.available]
        worst = max(known or levels, key=lambda level: abs(level.difference.value))
        differ = sum(level.verdict == DIFFERS for level in levels)
        agree = sum(level.verdict in (AGREES, SMALL) for level in levels)
        verdict = DIFFERS if differ else AGREES if agree else CANNOT_TELL
        count = f"{differ} of {len(levels)} differ" if differ else f"{agree} of {len(levels)} agree"
        text = verdict if max(agree, differ) in (0, len(levels)) else count
        if not differ and any(level.verdict == SMALL for level in levels):
            text += f" within {100 * measure.tolerance:g} %"
        rows.append(((measure.title, text, *worst.cells()), verdict))
    return rows


def _percent(share: float) -> str:
    return f"{100 * share:+.0f}" if abs(share) >= 0.0995 else f"{100 * share:+.2g}"
