"""Tables of the page: the models, and the answers for each kind of target.

Texts are plain, never markup.
"""

from __future__ import annotations

from blurnoise_eval.answers.exposure_window import NONE_WORKS, WORKS
from blurnoise_eval.answers.rows import AnswerRow, ModelRow
from blurnoise_eval.plots.style import spread
from blurnoise_eval.report.opening import Cell, TableRow
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.words import answer_lines, counted
from blurnoise_eval.scoring.scores import Score, of_models
from blurnoise_eval.store.columns import UNKNOWN, WithInterval
from blurnoise_eval.system.tables import finite

MAX_SETTINGS = 24  # rows of one target group


def model_rows(data: RunData) -> list[TableRow]:
    """A row per score: its name and meaning, and per model its value, "best" where it is, or why it is missing."""
    kind = "reader" if data.models and all(row.kind == "reader" for row in data.models) else "detector"
    rows = []
    for score in of_models(kind):
        values = [_score_of(data, row, score) for row in data.models]
        known = {value for of in values if (value := finite(of.value)) is not None}
        pick = max if score.better == "higher" else min
        best = pick(known) if score.better and len(known) > 1 else None
        title = f"{score.title}, original pictures" if score.of_pictures else score.title
        rows.append((title, score.meaning, [_model_cell(of, score, best) for of in values]))
    return rows


def _score_of(data: RunData, row: ModelRow, score: Score) -> WithInterval:
    """A model's value of a score: on the original pictures, or of the model as a whole."""
    if score.of_model is not None:
        value = score.of_model(row)
        return value if isinstance(value, WithInterval) else WithInterval(value)
    if score.name in row.scores:
        return row.scores[score.name]
    original = data.clean_scores.get(row.model)
    return UNKNOWN if original is None else original.scores.get(score.name, UNKNOWN)


def _model_cell(of: WithInterval, score: Score, best: float | None) -> Cell:
    value, low, high = map(finite, of)
    if value is None:
        return "", "–", [score.missing]
    text = format(int(value) if score.digits == "d" else value, score.digits)
    unit = " ms" if score.name.endswith("_ms") else ""
    interval = "" if low is None or high is None else f" ({low:.3f}–{high:.3f})"
    return "best" if value == best else "", text + unit + interval, []


def answers(data: RunData, model: str, groups: list[str]) -> tuple[str, list[tuple[str, list[TableRow]]]]:
    """In how many a model's exposures work; and per target group its title and a row per setting, a cell per
    velocity."""
    of_model = [answer for answer in data.answers if answer.model == model]
    parts = []
    for group in groups:
        of = {
            (data.settings.of(a.conditions), a.conditions.velocity_px_s): a
            for a in of_model
            if a.group == group
        }
        rows: list[TableRow] = []
        for at in spread(data.settings.every, MAX_SETTINGS):
            cells = [_answer_cell(of.get((at, velocity))) for velocity in data.axes[1].values]
            rows.append((data.settings.text(at), "", cells))
        if of:
            most = max(of.values(), key=lambda each: each.n_targets)
            clean = finite(most.clean_score)
            known = "" if clean is None else f"; original pictures {clean:.2f}"
            pictures = counted(most.n_pictures, "picture")
            parts.append((f"{group}: n = {most.n_targets} in {pictures}{known}", rows))
    return f"{sum(a.verdict == WORKS for a in of_model)} of {len(of_model)}", parts


def _answer_cell(answer: AnswerRow | None) -> Cell:
    if answer is None:
        return "", "not tested", []
    first, *others = answer_lines(answer)
    return {WORKS: "works", NONE_WORKS: "fails"}.get(answer.verdict, ""), first, others
