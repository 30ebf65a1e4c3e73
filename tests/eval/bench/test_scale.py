"""Runs of copies: as many rows as are asked for, each picture's own, which a report takes for a run's."""

import pytest
from blurnoise_eval import Run
from blurnoise_eval.bench import scale


@pytest.mark.slow
def test_copies_are_a_run_with_twelve_detections_a_cell(tmp_path):
    cells = scale.made_run(tmp_path, 3, pictures=1)
    assert cells == 3 * 85
    run = Run.open(tmp_path, progress=False)
    assert len(run.cells) == len({row["cell_id"] for row in run.cells}) == cells
    assert {row["n_detections"] for row in run.cells} == {scale.DETECTIONS}
    assert len(run.targets) == 3 * cells
    name, *others = run.pictures
    assert others == [f"{name} copy 1", f"{name} copy 2"]
    # Labels and answers of all copies are scored: three pictures of the same score, not one.
    (clean,) = [row for row in run.scores if row["clean"]]
    assert clean["n_pictures"] == 3
    assert clean["ap50"] > 0.5
    assert clean["false_positives_per_image"] < 3


@pytest.mark.slow
def test_sizes_have_bytes_time_memory_and_growth(monkeypatch):
    monkeypatch.setattr(scale, "_reported", lambda run, output: next(reported))
    reported = iter([(1.0, 2e8), (8.0, 4e8)])
    first, second = scale.scale(quick=True).rows
    assert (first.cells, second.cells) == (170, 680)
    assert (first.exponent, second.exponent) == (None, 1.5)  # 8 times as long for 4 times as many
    assert (first.report_mb, second.report_mb) == (200, 400)
    assert 500 < second.bytes_per_cell < first.bytes_per_cell < 3000
