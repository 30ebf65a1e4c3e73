"""A criterion: what of a detector's performance is enough.

Domain: levels are shares, above 0 and up to 1.
"""

from __future__ import annotations

from dataclasses import dataclass

from blurnoise._core.checks import in_range


@dataclass(frozen=True)
class Criterion:
    """Enough is ``level`` of a score or, where it is ``kept``, that share of what the same model reaches with the
    same targets in the untouched pictures.

    score: a name in :data:`~blurnoise_eval.scoring.registry.SCORES`. Raises ``ValueError`` for a level outside 0-1.
    """

    level: float
    kept: bool
    score: str = "target_confidence"

    def __post_init__(self) -> None:
        in_range("level", self.level, 0.0, 1.0)
