"""Scores of a run are kept in it, and computed again for another question."""

from __future__ import annotations

from pathlib import Path

import pytest
from blurnoise_eval import Evaluation, evaluate
from blurnoise_eval.report.charts import choices
from blurnoise_eval.report.page import write_report
from blurnoise_eval.report.tables import model_rows
from blurnoise_eval.scoring import scores as table
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.score_tables import run_scores
from plans import plan as swept
from small_sweeps import small_detector, some_pictures


def test_scores_are_computed_once_for_each_question(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the size of targets or not; and again where there is a score that a run scored before has not."""
    run = evaluate(
        small_detector(tmp_path), some_pictures(tmp_path), plan=swept((0.005,), (50.0,), (0.0,)),
        output=tmp_path / "run", refine=False, progress=False,
    )  # fmt: skip

    def computed(by_size: str | None, cluster: str | None = None) -> int:
        told: list[int] = []
        with Store(run.folder, shared=True) as store:
            run_scores(store, cluster, told.append, by_size=by_size)
        return sum(told)

    asked: list[str | None] = [None, None, "ap", "ap"]
    assert [computed(by_size) > 0 for by_size in asked] == [True, False, True, False]
    assert computed("ap", cluster=r"\.(png)") > 0
    made_up = table.Score("made_up", "Made up", of=lambda judged: 0.5, charted=True, of_models=table.BOTH)
    monkeypatch.setattr(table, "SCORES", (*table.SCORES, made_up))
    assert computed(None) > 0
    with Store(run.folder, shared=True) as store:
        assert all("made_up" in row for row in [each.row for each in run_scores(store, None)])
    data = Evaluation(run.folder, progress=False).data
    assert "made_up" in [score.name for score in choices(data)]
    shown = {name: cells for name, _, cells in model_rows(data)}
    assert shown["Made up, original pictures"] == [("", "0.500", [])]
    assert "Made up" in write_report(data, tmp_path / "page").read_text()
