"""Tables of columns, made of the records whose fields they are: ``<!-- columns of: results.csv -->`` becomes one."""

from __future__ import annotations

import re
from typing import Any

from blurnoise_eval.answers.rows import AnswerRow, CurveRow, ModelRow, RecommendationRow
from blurnoise_eval.store.columns import columns_of
from blurnoise_eval.store.rows import CellRow, ScoreRow, TargetRow

ROWS = {
    "results.csv": CellRow,
    "targets.csv": TargetRow,
    "scores.csv": ScoreRow,
    "curves.csv": CurveRow,
    "answers.csv": AnswerRow,
    "recommendations.csv": RecommendationRow,
    "models.csv": ModelRow,
}
_ASKED = re.compile(r"^<!-- columns of: (\S+) -->$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with its tables of columns."""
    return _ASKED.sub(lambda asked: table(asked[1]), markdown)


def table(file: str) -> str:
    """The columns of a file, as Markdown; lists are in summary.json alone."""
    lines = [f"| column of `{file}` | meaning |", "|---|---|"]
    columns = (column for column in columns_of(ROWS[file]) if column.kind)
    return "\n".join([*lines, *(f"| `{column.name}` | {column.meaning} |" for column in columns)])
