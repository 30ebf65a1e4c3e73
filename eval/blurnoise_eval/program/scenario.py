"""A scenario: the lights, speeds and targets that an exposure program is for, and what of them is to be good.

Domain: lux, px/s, shares that add up to 1. A value of the program is a mean over the lights, all alike; at one light
over the cases, a speed with a kind of target each, by its share.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import in_range, limited, one_of

Objective = Literal["expected", "worst", "tail"]
Array = NDArray[np.float64]
T = TypeVar("T", float, str)
LIGHTS_PER_STOP = 2


@dataclass(frozen=True)
class Scenario:
    """Lights, rising; speeds and targets with their shares, which are made to add up to 1; what counts at each light.

    objective: "expected", the mean over the cases; "worst", the least of them; "tail", the mean of the worst ``tail``
    share (conditional value at risk). Raises ``ValueError`` naming the field.
    """

    lights_lux: tuple[float, ...]
    speeds_px_s: Mapping[float, float]
    targets: Mapping[str, float]
    objective: Objective = "expected"
    tail: float = 0.2

    def __post_init__(self) -> None:
        one_of("objective", self.objective, get_args(Objective))
        in_range("tail", self.tail, 0.0, 1.0, above=True)
        lights = tuple(limited("illuminance_lux", light) for light in self.lights_lux)
        if not lights or lights[0] <= 0 or any(a >= b for a, b in pairwise(lights)):
            raise ValueError(f"lights_lux = {self.lights_lux!r}: must be above 0 and rise")
        for speed in self.speeds_px_s:
            limited("speed_px_s", speed)
        for field, name in (("speeds_px_s", "speeds"), ("targets", "targets")):
            weights = getattr(self, field)
            total = sum(weights.values())
            if any(not 0 <= weight < math.inf for weight in weights.values()) or not 0 < total < math.inf:
                raise ValueError(f"{name} = {dict(weights)!r}: shares must be 0 or more, and one above 0")
            shares = {key: weight / total for key, weight in weights.items() if weight > 0}
            object.__setattr__(self, field, shares)

    @property
    def cases(self) -> list[tuple[float, str]]:
        """K pairs of speed and target."""
        return list(product(self.speeds_px_s, self.targets))

    @property
    def shares(self) -> Array:
        """Of the cases, (K,)."""
        return np.outer(list(self.speeds_px_s.values()), list(self.targets.values())).ravel()

    def weights(self, values: Array) -> Array:
        """How much each case's value counts, as ``values`` (K, ...) and adding up to 1 over the cases.

        NaN where any of them is.
        """
        counted = {"expected": 1.0, "worst": float(self.shares.min()), "tail": self.tail}[self.objective]
        order = np.argsort(values, axis=0, kind="stable")
        sorted_shares = self.shares[order]
        before = np.cumsum(sorted_shares, axis=0) - sorted_shares
        weights = np.empty_like(sorted_shares)
        own = np.clip(counted - before, 0.0, sorted_shares) / counted
        np.put_along_axis(weights, order, own, axis=0)
        return np.where(np.isnan(values).any(axis=0), np.nan, weights)

    @property
    def text(self) -> str:
        """'0 px/s (0.3), 200 px/s (0.7); large (0.5); medium (0.5); expected'."""
        speeds = ", ".join(f"{speed:.4g} px/s ({share:.2g})" for speed, share in self.speeds_px_s.items())
        targets = "; ".join(f"{target} ({share:.2g})" for target, share in self.targets.items())
        words = {"worst": "the worst of them", "tail": f"the worst {self.tail:g} of them on average"}
        return f"{speeds}; {targets}; {words.get(self.objective, 'expected')}"


def half_stops(low_lux: float, high_lux: float) -> tuple[float, ...]:
    """Lights from low to high, both included, half a stop apart or a little less. Raises ``ValueError``."""
    if not 0 < limited("illuminance_lux", low_lux) <= limited("illuminance_lux", high_lux):
        raise ValueError(f"lux = {low_lux:g}:{high_lux:g}: must be above 0 and rise")
    steps = math.ceil(LIGHTS_PER_STOP * math.log2(high_lux / low_lux) - 1e-9)
    between = (low_lux * (high_lux / low_lux) ** (step / steps) for step in range(1, steps))
    return (low_lux, *between, high_lux) if steps else (low_lux,)


def speed_shares(text: str | None, own: Sequence[float]) -> dict[float, float]:
    """Shares by px/s of "0:0.3,200:0.7"; None: ``own``, all alike. Raises ``ValueError``."""
    return _shares("speeds", text, own, lambda word: _number("speeds", word))


def target_shares(text: str | None, groups: Sequence[str]) -> dict[str, float]:
    """Shares of the groups that ``text`` names by any part of their name; None: all alike.

    Raises ``ValueError`` for a word that is found in none of them, or in several.
    """

    def group_of(word: str) -> str:
        fitting = [group for group in groups if group == word] or [g for g in groups if word in g]
        if len(fitting) != 1:
            raise ValueError(f"targets = {word!r}: must be part of the name of one of: {'; '.join(groups)}")
        return fitting[0]

    return _shares("targets", text, groups, group_of)


def _shares(name: str, text: str | None, own: Sequence[T], key: Callable[[str], T]) -> dict[T, float]:
    if text is None:
        return dict.fromkeys(own, 1.0)
    parts = [part.strip().partition(":") for part in text.split(",")]
    if len({colon for _, colon, _ in parts}) > 1:
        raise ValueError(f"{name} = {text!r}: must have a share for every entry, or for none")
    shares = {key(word): _number(name, share or "1") for word, _, share in parts}
    if len(shares) < len(parts):
        raise ValueError(f"{name} = {text!r}: must have each entry once, with its whole share")
    return shares


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} = {text!r}: must be as 0:0.3,200:0.7, or without shares") from None
