"""The first answer of a sweep, while it computes: which exposure serves best at each light, in one picture."""

from __future__ import annotations

from blurnoise_eval.plan.axes import EXPOSURE, LIGHT
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.terminal import say

_PICTURES = 8  # of which one is expected to have targets: each time, all rows so far are read


class FirstAnswer:
    """Prints the lines of :func:`so_far` once, to standard error, if there are some after the first pictures."""

    def __init__(self, store: Store, model: str) -> None:
        self._store, self._model, self._cells, self._waits = store, model, 0, True

    def after(self, plan: SweepPlan, cells: int) -> None:
        """When so many further cells of a plan are done."""
        if not self._waits:
            return
        self._cells += cells
        if lines := so_far(self._store, plan, self._model):
            self._waits = False
            say(*lines, error=True)
        self._waits &= self._cells < _PICTURES * plan.cells_per_picture


def so_far(store: Store, plan: SweepPlan, model: str) -> list[str]:
    """A line for each light, as soon as a picture with targets has all of its cells; until then none.

    Nor of one exposure, which nothing is better than, or of lights in which nothing is found.

    >>> import tempfile
    >>> from pathlib import Path
    >>> with Store(Path(tempfile.mkdtemp()), create=True) as store:  # without a cell
    ...     so_far(store, SweepPlan({"exposure_s": (0.01,), "illuminance_lux": (50.0,)}), "m")
    []
    """
    lines: dict[float, str] = {}
    several = len(plan.values(EXPOSURE.name)) > 1
    image = queries.complete_picture(store, model, plan.cells_per_picture) if several else None
    for lux, exposure_s, mean in queries.mean_confidences(store, model, image) if image else ():
        if mean < 0.005:  # 0.00, as printed
            continue
        named = plan.light_at(lux)
        where = LIGHT.text(lux) + (f" ({named.name})" if named else "")
        best = f"{EXPOSURE.text(exposure_s)} serves {model} best (mean confidence {mean:.2f})"
        lines.setdefault(lux, f"so far, in {image} alone: at {where} {best}")
    return list(lines.values())
