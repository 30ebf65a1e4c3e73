"""Opto-electronic conversion function of a camera, from the fields of a grey scale: what light a number stands for.

Domain: digital numbers of a picture; light in any unit, 0 for none. Source of the term: ISO 14524.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.files import read_text

FEWEST_FIELDS = 3
"""Two make a straight line."""


@dataclass(frozen=True)
class Oecf:
    """numbers and light of the fields, both rising; straight in between."""

    numbers: tuple[float, ...]
    light: tuple[float, ...]

    def __post_init__(self) -> None:
        for name, values in (("numbers", self.numbers), ("light", self.light)):
            finite = all(math.isfinite(value) and value >= 0 for value in values)
            rising = all(a < b for a, b in pairwise(values))
            if not (finite and rising and len(values) >= FEWEST_FIELDS):
                raise ValueError(f"oecf: {name} must be {FEWEST_FIELDS} or more, from 0 on and rising")

    @classmethod
    def read(cls, path: Path) -> Oecf:
        """From a CSV file: a line per field, digital number and light; a first line may name the columns.

        Raises ``OSError``, and ``ValueError`` for other content.
        """
        fields = []
        for number, line in enumerate(read_text(path).split("\n"), 1):
            try:
                at, light = (float(cell) for cell in line.split(","))
                fields.append((at, light))
            except ValueError:
                if number > 1 and line.strip():
                    raise ValueError(
                        f"oecf: line {number} of {path} must be two numbers with a comma, got {line!r}"
                    ) from None
        if not fields:
            raise ValueError(f"oecf: {path} holds no line of two numbers with a comma")
        numbers, light_of = zip(*sorted(fields), strict=True)
        return cls(numbers, light_of)

    def light_of(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Light as a share of the scale, 0 to 1; what lies beyond its ends stands at them, as if clipped."""
        least, most = self.light[0], self.light[-1]
        return (np.interp(numbers, self.numbers, self.light) - least) / (most - least)
