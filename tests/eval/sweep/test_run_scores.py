"""Scores of a run: the same whether one process computes them or two, or one of the two fails."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from blurnoise_eval import evaluate
from blurnoise_eval.datasets import PictureSet
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
            store.set_about("scores", None)
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
