"""A scenario: the lights, speeds and targets that an exposure program is for, and what of them is to be good.

Domain: lux, px/s, shares that add up to 1. A value of the program is a mean over the lights, all alike; at one light
over what can happen there, a speed with a kind of target each, by its share.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import in_range, limited, one_of

Objective = Literal["expected", "worst", "tail"]
Array = NDArray[np.float64]
T = TypeVar("T")
LIGHTS_PER_STOP = 2


@dataclass(frozen=True)
class Scenario:
    """Lights, rising; speeds and targets with their shares; what counts at each light.

    objective: "expected", the mean over speeds and targets; "worst", the least of them; "tail", the mean of the worst
    ``tail`` share (conditional value at risk). Raises ``ValueError`` naming the field.
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
        object.__setattr__(self, "speeds_px_s", as_shares("speeds", self.speeds_px_s))
        object.__setattr__(self, "targets", as_shares("targets", self.targets))

    @property
    def cases(self) -> list[tuple[float, str]]:
        """What can happen at a light: K pairs of speed and target."""
        return list(product(self.speeds_px_s, self.targets))

    @property
    def shares(self) -> Array:
        """Of the cases, (K,)."""
        return np.array([self.speeds_px_s[speed] * self.targets[target] for speed, target in self.cases])

    def weights(self, values: Array) -> Array:
        """How much each case's value counts, as ``values`` (K, ...) and adding up to 1 over the cases.

        NaN where any of them is.
        """
        if self.objective == "expected":
            share = 1.0
        else:
            share = self.tail if self.objective == "tail" else float(self.shares.min())
        order = np.argsort(values, axis=0, kind="stable")
        sorted_shares = self.shares[order]
        before = np.cumsum(sorted_shares, axis=0) - sorted_shares
        counted = np.clip(share - before, 0.0, sorted_shares) / share
        weights = np.empty_like(counted)
        np.put_along_axis(weights, order, counted, axis=0)
        return np.where(np.isnan(values).any(axis=0), np.nan, weights)


def half_stops(low_lux: float, high_lux: float) -> tuple[float, ...]:
    """Lights from low to high, both with them, half a stop apart or a little less. Raises ``ValueError``."""
    if not 0 < limited("illuminance_lux", low_lux) <= limited("illuminance_lux", high_lux):
        raise ValueError(f"lux = {low_lux:g}:{high_lux:g}: must be above 0 and rise")
    steps = math.ceil(LIGHTS_PER_STOP * math.log2(high_lux / low_lux) - 1e-9)
    between = (low_lux * (high_lux / low_lux) ** (step / steps) for step in range(1, steps))
    return (low_lux, *between, high_lux) if steps else (low_lux,)


def as_shares(name: str, weights: Mapping[float, float] | Mapping[str, float]) -> dict[float | str, float]:
    """The weights, made to add up to 1; those of 0 are left out. Raises ``ValueError`` naming the argument."""
    total = sum(weights.values())
    if any(not 0 <= weight < math.inf for weight in weights.values()) or not 0 < total < math.inf:
        raise ValueError(f"{name} = {dict(weights)!r}: shares must be 0 or more, and one above 0")
    return {key: weight / total for key, weight in weights.items() if weight > 0}


def named_shares(name: str, text: str) -> dict[str, float]:
    """Parse "a:0.3,b:0.7"; without a share each counts alike.

    Raises ``ValueError`` naming the argument, for an entry given twice and for shares of some entries only, too.
    """
    parts = [part.strip().partition(":") for part in text.split(",")]
    if len({colon for _, colon, _ in parts}) > 1:
        raise ValueError(f"{name} = {text!r}: must have a share for every entry, or for none")
    shares: dict[str, float] = {}
    for key, _, written in parts:
        try:
            share = float(written) if written else 1.0
        except ValueError:
            raise ValueError(f"{name} = {text!r}: must be as 0:0.3,200:0.7, or without shares") from None
        add_share(shares, name, key, share)
    return shares


def add_share(shares: dict[T, float], name: str, key: T, share: float) -> None:
    """Add an entry that is new. Raises ``ValueError`` naming the argument."""
    if key in shares:
        raise ValueError(f"{name}: {key} is given twice; give each once, with its whole share")
    shares[key] = share


def scaled_note(name: str, text: str | None) -> list[str]:
    """That shares were divided by their sum, where they are given and do not add up to 1."""
    total = math.fsum(named_shares(name, text).values()) if text and ":" in text else 1.0
    if math.isclose(total, 1.0, rel_tol=1e-6):
        return []
    return [f"{name}: shares add up to {total:g}; each was divided by that"]


def chosen_targets(text: str | None, groups: Sequence[str]) -> dict[str, float]:
    """Shares of the groups that ``text`` names by any part of their name; None: all alike.

    Raises ``ValueError`` for a word that is found in none of them, or in several.
    """
    if text is None:
        return dict.fromkeys(groups, 1.0)
    found: dict[str, float] = {}
    for word, share in named_shares("targets", text).items():
        fitting = [group for group in groups if group == word] or [g for g in groups if word in g]
        if len(fitting) != 1:
            raise ValueError(f"targets = {word!r}: must be part of the name of one of: {'; '.join(groups)}")
        add_share(found, "targets", fitting[0], share)
    return found
