"""A metric of pictures: all that tables, figures and maps need to know of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

S = TypeVar("S")
E = TypeVar("E")


@dataclass(frozen=True)
class Metric(Generic[S, E]):
    """A metric: its name in tables, title and unit, what exactly it is, and how it is measured.

    of: from what it is measured on to its estimate, or estimates, which rise with quality. scale: of its axis; a
    share lies between 0 and 1.
    """

    name: str
    title: str
    unit: str
    about: str
    of: Callable[[S], E]
    scale: Literal["linear", "log", "share"] = "linear"

    @property
    def label(self) -> str:
        """Title and unit."""
        return self.title if self.unit == "1" else f"{self.title} / {self.unit}"
