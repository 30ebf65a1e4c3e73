"""Scores of a run: the same whether one process computes them or two, or one of the two fails."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from blurnoise_eval import Evaluation, evaluate
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.report.charts import choices
from blurnoise_eval.report.page import write_report
from blurnoise_eval.report.tables import model_rows
from blurnoise_eval.scoring import scores as table
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run_scores
from plans import plan as swept
from small_sweeps import small_detector, some_pictures


@pytest.mark.slow
@pytest.mark.parametrize("other", ["answers", "fails"])
def test_two_processes_score_as_one(other: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = some_pictures(tmp_path)
    shown = PictureSet(shown.kind, shown.source, shown.pictures[:2])
    plan = swept((0.005, 0.02), (50.0,), (0.0, 300.0))
    run = evaluate(
        small_detector(tmp_path), shown, plan=plan, output=tmp_path / "run", refine=False, progress=False
    )

    def scores() -> tuple[run_scores.RunScores, int]:
        told: list[int] = []
        with Store(run.folder, shared=True) as store:
            store.set_about("scores, ap", None)
            return run_scores.run_scores(store, ["small"], None, told.append, by_size="ap"), sum(told)

    alone = scores()
    assert alone[1] == 5
    monkeypatch.setattr(run_scores, "_ALONE_UP_TO", 0)
    monkeypatch.setattr(run_scores, "usable_cores", lambda: 2)
    if other == "fails":
        monkeypatch.setattr(sys, "executable", "/bin/false")
    asked: list[int] = []
    whole = run_scores.scored
    monkeypatch.setattr(
        run_scores,
        "scored",
        lambda store, some, *how: asked.append(len(list(some))) or whole(store, some, *how),
    )
    assert repr(scores()) == repr(alone)
    assert asked == ([3] if other == "answers" else [3, 2])


def test_scores_are_computed_once_for_each_question(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the size of targets or not; and again where there is a score that a run scored before has not."""
    run = evaluate(
        small_detector(tmp_path), some_pictures(tmp_path), plan=swept((0.005,), (50.0,), (0.0,)),
        output=tmp_path / "run", refine=False, progress=False,
    )  # fmt: skip

    def computed(by_size: str | None) -> int:
        told: list[int] = []
        with Store(run.folder, shared=True) as store:
            run_scores.run_scores(store, ["small"], None, told.append, by_size=by_size)
        return sum(told)

    asked: list[str | None] = [None, "ap", "ap50", "ap", None]
    assert [computed(by_size) > 0 for by_size in asked] == [True, True, True, False, False]
    made_up = table.Score("made_up", "Made up", of=lambda judged: 0.5, charted=True, of_models=table.BOTH)
    monkeypatch.setattr(table, "SCORES", (*table.SCORES, made_up))
    assert computed(None) > 0
    with Store(run.folder, shared=True) as store:
        assert all("made_up" in row for row in run_scores.run_scores(store, ["small"], None).rows)
    data = Evaluation(run.folder, progress=False).data
    assert "made_up" in [score.name for score in choices(data)]
    shown = {name: cells for name, _, cells in model_rows(data)}
    assert shown["Made up, original pictures"] == [("", "0.500", [])]
    assert "Made up" in write_report(data, tmp_path / "page").read_text()
