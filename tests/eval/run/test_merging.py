"""Merging: the runs of parts are the run of the whole, every cell once; what cannot be one run is refused."""

from dataclasses import replace

import pandas as pd
import pytest
from blurnoise_eval import datasets
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.report.run import write_tables
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.run.merging import merge
from blurnoise_eval.run.run import Run
from blurnoise_eval.store.queries import write_exports
from blurnoise_eval.store.store import Store, StoreError

PLAN = SweepPlan({"exposure_s": (0.005, 0.05), "illuminance_lux": (50.0,), "velocity_x_px_s": (0.0, 400.0)})
TIMES = {"simulate_ms", "infer_ms", "example", "latency_ms", "latency_p95_ms"}


def signs(count=6):
    every = datasets.rendered_signs()
    return replace(every, pictures=every.pictures[:count])


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    tables(evaluate(pictures=signs(), plan=PLAN, output=folder / "whole", strategy="grid"))
    for part in ("1/2", "2/2"):
        evaluate(pictures=signs().part(part), plan=PLAN, output=folder / part[0])
    return folder


def tables(run):
    with Store(run.folder) as store:
        write_exports(store)
    write_tables(run.tables, run.folder)


def table(folder, name):
    read = pd.read_csv(folder / name)
    return read[[column for column in read if column not in TIMES]]


@pytest.mark.parametrize(
    "order", ["12", pytest.param("21", marks=pytest.mark.slow), pytest.param("1212", marks=pytest.mark.slow)]
)
def test_run_of_parts_is_that_of_the_whole(runs, order, tmp_path):
    done = merge([runs / part for part in order], tmp_path / "run")
    assert done == (30, 6)
    tables(Run.open(tmp_path / "run"))
    for name in ("results.csv", "targets.csv", "scores.csv", "answers.csv", "curves.csv", "models.csv"):
        found, expected = table(tmp_path / "run", name), table(runs / "whole", name)
        pd.testing.assert_frame_equal(found, expected, check_exact=False, rtol=1e-12)
    with Store(tmp_path / "run") as merged, Store(runs / "whole") as whole:
        assert merged.about("identity") == whole.about("identity")
        shown = [cell.example for cell in merged.cells() if cell.example]
    assert shown
    assert all((tmp_path / "run" / name).is_file() for name in shown)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"plan": replace(PLAN, seed=1)}, "differs from .* in plan.seed"),
        ({"plan": replace(PLAN, repeats=2)}, "in plan.repeats"),
        ({"camera": "ar0237"}, "in camera"),
        ({"pictures": signs(5).part("2/2")}, "in pictures"),
        ({"pictures": signs().part("3/3")}, "in number of parts"),
        ({"pictures": signs()}, "in number of parts"),
    ],
)
def test_runs_that_are_no_parts_of_one_sweep_are_refused(runs, changes, named, tmp_path):
    usual = {"pictures": signs().part("2/2"), "plan": PLAN, "strategy": "grid"}
    evaluate(**{**usual, "output": tmp_path / "other", **changes})
    with pytest.raises(StoreError, match=f"{named}.*only parts of one sweep can be merged"):
        merge([runs / "1", tmp_path / "other"], tmp_path / "run")
    assert not (tmp_path / "run").exists()
    assert not list(tmp_path.glob(".*"))


def test_merged_again_it_goes_on(runs, tmp_path):
    """With one part more, with the same parts, and with itself among them: the same run; not beside other files."""
    assert merge([runs / "1"], tmp_path / "run").pictures < 6
    assert Run.open(tmp_path / "run").setup.identity["part"] == "1/2"
    for parts in (["2"], ["1", "2"], ["1", "2", "2"]):
        assert merge([tmp_path / "run", *(runs / part for part in parts)], tmp_path / "run") == (30, 6)
        merged = Run.open(tmp_path / "run")
        assert merged.setup.identity == Run.open(runs / "whole").setup.identity
        with merged.store as store:
            assert merged.setup.missing_cells(store) == 0
    wall_s = sum(Run.open(runs / part).setup.wall_s for part in "12")
    assert merged.setup.wall_s == pytest.approx(wall_s)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").write_text("mine")
    with pytest.raises(StoreError, match="is not empty"):
        merge([runs / "1", runs / "2"], tmp_path / "other")
