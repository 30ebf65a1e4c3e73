"""Assertions about a run for the tests of your own project.

The criterion is the run's question, such as ``Run.open("run", Question(keep=0.8))``; the conditions are its axes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from blurnoise._core.checks import known

if TYPE_CHECKING:
    from blurnoise_eval.run.run import Run


def assert_works(run: Run, *, sure: bool = False, **where: Any) -> None:
    """Raise ``AssertionError`` if no exposure works, for any model, group of targets or condition of a run.

    where: which rows of ``run.answers`` count, by column: ``illuminance_lux=5``, ``model="int8"``, ``group`` as
    answers.csv has it, or several values as a list. sure: fail also where the pictures cannot tell, so that the 95 %
    interval has to lie at or above the criterion; too few pictures for an interval fail always. Raises ``ValueError``
    for a column or a value that the run does not have.

    >>> from blurnoise_eval import Question, Run
    >>> def test_the_detector_keeps_80_percent_at_dusk():
    ...     assert_works(Run.open("run", Question(keep=0.8)), illuminance_lux=[5, 20], velocity_x_px_s=0)
    """
    answers = run.answers
    for name, asked in where.items():
        known("column", name, sorted(answers[0]))
        values = asked if isinstance(asked, (list, tuple)) else [asked]
        for value in values:
            if not any(_equal(row[name], value) for row in answers):
                has = ", ".join(sorted({str(row[name]) for row in answers}))
                raise ValueError(f"{name} = {value!r}: the run has {has}")
        answers = [row for row in answers if any(_equal(row[name], value) for value in values)]
    if not answers:
        raise ValueError(f"{', '.join(where)}: the run has no answer with all of these values")
    failing = [
        row
        for row in answers
        if row["verdict"] not in ("works", "cannot tell")
        or (row["verdict"] == "cannot tell" and (sure or row["best_score_low"] is None))
    ]
    if failing:
        lines = "\n".join(_text(row) for row in failing)
        raise AssertionError(
            f"{failing[0]['criterion']} is not reached in {len(failing)} of {len(answers)}:\n{lines}"
        )


def _equal(held: Any, asked: Any) -> bool:
    if isinstance(held, float) and isinstance(asked, (int, float)):
        return bool(np.isclose(held, asked, rtol=1e-6, atol=0.0))
    return bool(held == asked)


def _text(row: dict[str, Any]) -> str:
    low, high = row["best_score_low"], row["best_score_high"]
    interval = "" if low is None else f" ({low:.2f} to {high:.2f})"
    at = ", ".join(
        f"{name} {row[name]:g}"
        for name in ("illuminance_lux", "velocity_x_px_s", "velocity_y_px_s")
        if row[name]
    )
    best = f"at best {row['best_score']:.2f}{interval} with {1000 * row['best_s']:.3g} ms"
    return f"  {row['model']}, {row['group']}, {at}: {row['verdict']}, {best}"
