"""A finished run's answer: the sentence that its report opens with, what limits and what would make it surer."""

from __future__ import annotations

from html import escape
from pathlib import Path

from blurnoise_eval.deciding.decision import Decision
from blurnoise_eval.report.opening import opening
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.run_surfaces import asked_enough


def answer_of(folder: Path) -> tuple[str, str]:
    """(answer as HTML, the rest as text) of the run in this folder. Raises
    :class:`~blurnoise_eval.store.store.StoreError`."""
    with Store(folder, shared=True) as store:
        enough = asked_enough(store)
    told = opening(Decision(folder, **enough, progress=False).data)
    answer, *others = told.sentences
    what, colon, rest = answer.partition(":")
    kind = "" if what.startswith("Use ") else ' class="no"'
    marked = f"<b{kind}>{escape(what)}</b>{colon}{escape(rest)}" if colon else escape(answer)
    return marked, " ".join((*others, *(f"{title}: {text}" for title, text in told.notes)))
