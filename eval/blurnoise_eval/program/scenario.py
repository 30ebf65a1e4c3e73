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
        in_range("tail", self.tail, 0.0, 1.0)
        if self.tail == 0:
            raise ValueError("tail = 0: must be > 0; --objective worst is the worst of all")
        lights = tuple(limited("illuminance_lux", light) for light in self.lights_lux)
        if not lights or lights[0] <= 0 or any(a >= b for a, b in pairwise(lights)):
            raise ValueError(f"lights_lux = {self.lights_lux!r}: must be above 0 and rise")
        for speed in self.speeds_px_s:
            limited("speed_px_s", speed)
        object.__setattr__(self, "speeds_px_s", _as_shares("speeds", self.speeds_px_s))
        object.__setattr__(self, "targets", _as_shares("targets", self.targets))

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
    def objective_text(self) -> str:
        """'expected', or 'the worst of them'."""
        words = {"worst": "the worst of them", "tail": f"the worst {self.tail:g} of them on average"}
        return words.get(self.objective, "expected")

    @property
    def text(self) -> str:
        """'0 px/s (0.3), 200 px/s (0.7); large (0.5); medium (0.5); expected'."""
        speeds = ", ".join(f"{speed:.4g} px/s ({share:.2g})" for speed, share in self.speeds_px_s.items())
        targets = "; ".join(f"{target} ({share:.2g})" for target, share in self.targets.items())
        return f"{speeds}; {targets}; {self.objective_text}"


def half_stops(low_lux: float, high_lux: float) -> tuple[float, ...]:
    """Lights from low to high, both included, half a stop apart or a little less. Raises ``ValueError``."""
    if not 0 < limited("illuminance_lux", low_lux) <= limited("illuminance_lux", high_lux):
        raise ValueError(f"lux = {low_lux:g}:{high_lux:g}: must be above 0 and rise")
    steps = math.ceil(LIGHTS_PER_STOP * math.log2(high_lux / low_lux) - 1e-9)
    between = (low_lux * (high_lux / low_lux) ** (step / steps) for step in range(1, steps))
    return (low_lux, *between, high_lux) if steps else (low_lux,)


def _as_shares(name: str, weights: Mapping[T, float]) -> dict[T, float]:
    total = sum(weights.values())
    if any(not 0 <= weight < math.inf for weight in weights.values()) or not 0 < total < math.inf:
        raise ValueError(f"{name} = {dict(weights)!r}: shares must be 0 or more, and one above 0")
    return {key: weight / total for key, weight in weights.items() if weight > 0}


def _read(name: str, text: str, key: Callable[[str], T]) -> tuple[dict[T, float], list[str]]:
    """Shares of "a:0.3,b:0.7", 1 each of "a,b", by ``key`` of what is before the colon; and that they will be divided
    by their sum, if it is not 1. Raises ``ValueError`` naming the argument, also for an entry that is given twice."""
    shares: dict[T, float] = {}
    parts = [part.strip().partition(":") for part in text.split(",")]
    if len({colon for _, colon, _ in parts}) > 1:
        raise ValueError(f"{name} = {text!r}: must have a share for every entry, or for none")
    for word, _, written in parts:
        found = key(word)
        if found in shares:
            raise ValueError(f"{name}: {found} is given twice; give each once, with its whole share")
        shares[found] = _number(name, written or "1")
    total = math.fsum(shares.values()) if ":" in text else 1.0
    scaled = not math.isclose(total, 1.0, rel_tol=1e-6)
    return shares, [f"{name}: shares add up to {total:g}; each was divided by that"] * scaled


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} = {text!r}: must be as 0:0.3,200:0.7, or without shares") from None


def speed_shares(text: str | None, own: Sequence[float]) -> tuple[dict[float, float], list[str]]:
    """Shares by px/s, and notes on them; None: ``own``, all alike. Raises ``ValueError``."""
    if text is None:
        return dict.fromkeys(own, 1.0), []
    return _read("speeds", text, lambda word: _number("speeds", word))


def target_shares(text: str | None, groups: Sequence[str]) -> tuple[dict[str, float], list[str]]:
    """Shares of the groups that ``text`` names by any part of their name, and notes on them; None: all alike.

    Raises ``ValueError`` for a word that is found in none of them, or in several.
    """

    def group_of(word: str) -> str:
        fitting = [group for group in groups if group == word] or [g for g in groups if word in g]
        if len(fitting) != 1:
            raise ValueError(f"targets = {word!r}: must be part of the name of one of: {'; '.join(groups)}")
        return fitting[0]

    return (dict.fromkeys(groups, 1.0), []) if text is None else _read("targets", text, group_of)
