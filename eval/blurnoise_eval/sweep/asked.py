"""What a search has asked of a run, batch after batch, as the run's store keeps it.

A batch is noted before it is computed, so that a run that was killed is asked the same again. Places are those of
the plane, (log2 lux s, log2 px), as the search named them; conditions are what was computed for them.
"""

from __future__ import annotations

from dataclasses import dataclass

from blurnoise_eval.grid.conditions import Conditions
from blurnoise_eval.store.store import Store

Place = tuple[float, float]
_KEY = "asked"


@dataclass(frozen=True)
class Batch:
    """Nodes asked at a time, and of how many pictures, the first of the run's order, every node is asked since."""

    n_pictures: int
    places: tuple[Place, ...] = ()
    conditions: tuple[Conditions, ...] = ()


def asked(store: Store) -> tuple[Batch, ...]:
    """Every batch in order; none where no search has asked."""
    return tuple(
        Batch(
            each["n_pictures"],
            tuple((u, w) for u, w in each["places"]),
            tuple(Conditions(**at) for at in each["conditions"]),
        )
        for each in store.about(_KEY) or ()
    )


def ask(store: Store, batch: Batch) -> None:
    """Note one batch more."""
    noted = {**vars(batch), "conditions": [at.stated for at in batch.conditions]}
    store.set_about(_KEY, [*(store.about(_KEY) or ()), noted])
