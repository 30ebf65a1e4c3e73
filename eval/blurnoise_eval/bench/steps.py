"""Cost of an augmentation beside the training step that it feeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from blurnoise_eval.bench.timing import in_turns_ms, machine, quartiles
from blurnoise_eval.system.threads import limited_threads


def step_cost(
    steps: Mapping[str, Callable[[], object]],
    changes: Mapping[str, Callable[[], object]],
    pictures: int,
    threads: int,
    progress: Callable[[float], object],
    *,
    turns: int = 15,
) -> dict[str, Any]:
    """Median times, ms per picture, of training steps and of augmentations of the same batch, taken in turns.

    steps: one step of each precision, without augmentation; changes: each augmentation of that batch of
    ``pictures``. ``percent_of_step`` is each augmentation's time over each step's. ``progress`` as
    :func:`~blurnoise_eval.bench.timing.in_turns_ms` tells it.
    """
    calls = {("step", name): call for name, call in steps.items()}
    calls |= {("augmentation", name): call for name, call in changes.items()}
    with limited_threads(threads):
        times = in_turns_ms(calls, fewest=turns, most=turns, seconds=0.0, progress=progress)
    medians = {name: quartiles(taken).median / pictures for name, taken in times.items()}
    step_ms = {name: value for (kind, name), value in medians.items() if kind == "step"}
    change_ms = {name: value for (kind, name), value in medians.items() if kind == "augmentation"}
    return {
        "step_ms_per_picture": step_ms,
        "augmentation_ms_per_picture": change_ms,
        "percent_of_step": {
            f"{name}, {precision}": 100 * taken / step
            for name, taken in change_ms.items()
            for precision, step in step_ms.items()
        },
        **machine(threads),
    }
