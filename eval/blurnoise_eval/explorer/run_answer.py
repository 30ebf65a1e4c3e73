"""A finished run's answer: the sentence that its report opens with, and how sure it is, as HTML and text."""

from __future__ import annotations

from html import escape
from pathlib import Path

from blurnoise_eval.deciding.decision import Decision
from blurnoise_eval.report.opening import opening

_SURE = "How sure?"


def answer_of(folder: Path) -> tuple[str, str]:
    """(answer as HTML, how sure) of the run in this folder. Raises
    :class:`~blurnoise_eval.store.store.StoreError`."""
    told = opening(Decision(folder, progress=False).data)
    *between, answer = told.sentences
    what, colon, rest = answer.partition(":")
    sure = [
        f"{_SURE} {text[:1].upper()}{text[1:]}." for question, text in told.questions if question == _SURE
    ]
    kind = "" if what.startswith("Use ") else ' class="no"'
    marked = f"<b{kind}>{escape(what)}</b>{colon}{escape(rest)}" if colon else escape(answer)
    return marked, " ".join((*between, *sure))
