"""One door: what Python evaluates and what ``blurnoise sweep`` writes are the same."""

import json
from dataclasses import dataclass, replace

import commands
import pandas as pd
import pytest
from band_readers import band_reader
from blurnoise_eval import Run, SweepPlan, datasets, evaluate, expose
from blurnoise_eval.default_camera import default_camera
from blurnoise_eval.plan.question import Question
from blurnoise_eval.report.run import TABLES
from blurnoise_eval.run import latency
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.run.evaluation import usual_pictures, usual_plan
from blurnoise_eval.run.strategy import Step
from blurnoise_eval.store.store import StoreError
from blurnoise_models.detector import STOP_SIGN
from plans import plan as swept
from signs_in_memory import some_pictures

from blurnoise import Camera

PLAN = swept((0.002, 0.01), (50.0,), (0.0, 400.0), gain_db=(0.0,))
OPTIONS = "--exposure-ms 2,10 --lux 50 --dx 0,400 --gain 0 --camera imx250 --no-refine --threads 1 --json"


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    some_pictures(folder)
    return datasets.image_folder(folder)


@pytest.fixture(scope="module")
def done(tmp_path_factory, detector, pictures):
    folder = tmp_path_factory.mktemp("run")
    return evaluate(detector.path, pictures, "imx250", PLAN, output=folder, strategy="grid")


def timeless(rows):
    return [{k: v for k, v in row.items() if not k.endswith("_ms") and "latency" not in k} for row in rows]


@pytest.mark.slow
def test_python_and_the_command_find_the_same(done, detector, pictures, tmp_path, capsys):
    command = ["sweep", "--model", str(detector.path), "--images", pictures.source, *OPTIONS.split()]
    assert commands.main([*command, "-o", str(tmp_path)]) == 0
    told = json.loads(capsys.readouterr().out)
    by_command = Run.open(tmp_path)
    for name in ("cells", "targets", "scores", "curves", "models", "answers"):
        ours, theirs = getattr(done, name), getattr(by_command, name)
        assert len(pd.DataFrame(ours)) == len(ours) > 0, name
        assert timeless(ours) == timeless(theirs), name
    assert told["answers"] == json.loads(json.dumps(done.answers))
    assert [entry["image"] for entry in done.skipped] == ["empty.png"]
    assert done.report() == done.folder / "report.html"
    assert {path.name for path in tmp_path.rglob("*")} == {path.name for path in done.folder.rglob("*")}
    assert list((done.folder / "figures").glob("*.png"))
    assert all((done.folder / name).is_file() for name in TABLES)
    cells = pd.read_csv(done.folder / "results.csv")
    assert list(cells["cell_id"]) == [cell["cell_id"] for cell in done.cells]
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (done.folder, tmp_path)]
    assert summaries[0].keys() == summaries[1].keys()


def test_a_run_opens_again_and_goes_on(done, detector, pictures, monkeypatch):
    monkeypatch.setattr(latency, "latency", lambda *_: pytest.fail("is known"))
    again = evaluate(
        [detector], pictures, "imx250", PLAN, Question(threshold=0.2), done.folder, strategy="grid"
    )
    assert (again.outcome.computed, again.outcome.resumed) == (0, 10)
    opened = Run.open(done.folder, Question(threshold=0.2))
    assert opened.outcome is None
    assert "wall_s" not in opened.summary()
    assert opened.answers == again.answers
    with pytest.raises(StoreError, match="another plan"):
        evaluate(detector, pictures, "imx250", replace(PLAN, seed=1), output=done.folder)
    with pytest.raises(StoreError, match="holds no"):
        Run.open(done.folder / "nowhere")


def test_not_told_it_is_the_default_sweep(monkeypatch, tmp_path):
    seen = []

    def watched(*arguments, store, **_):
        seen.append((*arguments, store.about("identity")))  # in the store, of which nothing stays
        raise KeyboardInterrupt

    monkeypatch.setattr("blurnoise_eval.run.evaluation.compute", watched)
    assert commands.main(["sweep", "-o", str(tmp_path / "command")]) == 130
    with pytest.raises(KeyboardInterrupt):
        evaluate(output=tmp_path / "python")
    by_command, by_python = seen
    assert [each.path for each in by_command[0]] == [each.path for each in by_python[0]] == [STOP_SIGN]
    assert by_command[1] == by_python[1] == default_camera(colour=True)
    assert [each.identity for each in by_command[2]] == [each.identity for each in by_python[2]]
    assert by_command[3] == by_python[3] == usual_plan().for_rendered()
    assert by_command[-1] == by_python[-1]
    assert by_command[-1]["plan"]


def test_one_picture_is_exposed_as_its_cell_was(done, pictures):
    """The numbers of a cell, from its picture, conditions and seed."""
    row = next(row for row in done.cells if not row["clean"] and row["velocity_x_px_s"])
    picture = next(each for each in pictures if each.name == row["image"])
    at = {name: row[name] for name in PLAN.grid}
    seen = expose(picture, "imx250", seed=row["seed"], picture_tone="typical", **at)
    assert (seen.snr_db, seen.brightness) == (row["snr_db"], row["brightness"])
    assert seen.image.shape == picture.load().shape
    with pytest.raises(ValueError, match="axis = 'exposure_ms': must be one of exposure_s"):
        expose(picture, "imx250", exposure_ms=5)
    with pytest.raises(ValueError, match="illuminance_lux: must be specified"):
        expose(picture.load(), "imx250", exposure_s=0.005)


@pytest.mark.parametrize(
    ("changes", "error", "named"),
    [
        ({"models": []}, ValueError, "at least one"),
        ({"question": 0.9}, TypeError, "question = 0.9: must be a Question"),
        ({"models": [7]}, TypeError, "models.*must be"),
        ({"plan": {}}, TypeError, "plan.*must be"),
        ({"strategy": "guess"}, ValueError, "strategy = 'guess': must be one of 'grid', 'refine', 'search'"),
    ],
)
def test_bad_input_leaves_no_folder(changes, error, named, pictures, tmp_path):
    given = {"models": None, "pictures": pictures, "plan": PLAN, "output": tmp_path / "run", **changes}
    with pytest.raises(error, match=named):
        evaluate(**given)
    assert not (tmp_path / "run").exists()


def test_readers_get_texts_and_no_detectors_beside_them(detector, tmp_path):
    reader = band_reader(tmp_path / "rec.onnx")
    with pytest.raises(ValueError, match="not both"):
        evaluate([reader, detector], output=tmp_path / "run")
    done = evaluate(reader, plan=swept((0.01,), (50.0,)), output=tmp_path / "read")
    assert {row["truth"] for row in done.targets} == {"STOP"}
    assert usual_pictures([detector]).source.startswith("stop signs")


def test_a_part_is_not_searched(pictures, tmp_path):
    half = replace(datasets.rendered_signs((50,), count=6)).part("1/2")
    with pytest.raises(ValueError, match="part = '1/2': cannot be combined with a search"):
        evaluate(pictures=half, plan=PLAN, output=tmp_path / "run", strategy="search")


@dataclass(frozen=True)
class Brightest:
    """A strategy of one's own: the shortest exposure, then the longest if the model finds little in it."""

    plan: SweepPlan
    camera: Camera
    search_space = None

    def steps(self, run):
        low, high = self.plan.values("exposure_s")
        for exposure_s in (low, high):
            only = tuple(at for at in self.plan.conditions() if at.exposure_s == exposure_s)
            yield Step("dark", replace(self.plan, only=only))
            if max(row["target_confidence"] or 0.0 for row in run.cells if not row["clean"]) > 0.5:
                return


def test_a_strategy_of_ones_own_reads_what_was_computed(tmp_path):
    """It may read the run's rows before the next step; what it leaves out is missing from the grid."""
    signs = datasets.rendered_signs((50,), count=1)
    for lux, n_exposures in ((1e-3, 2), (2000.0, 1)):
        plan = swept((0.002, 0.01), (lux,))
        run = evaluate(
            pictures=signs, camera="imx250", plan=plan, output=tmp_path / str(lux), strategy=Brightest
        )
        assert len({row["exposure_s"] for row in run.cells if not row["clean"]}) == n_exposures
        assert run.summary()["missing_cells"] == 2 - n_exposures


@pytest.mark.parametrize(("exposures_s", "lux"), [((0.01,), 50.0), ((0.001, 0.002), 1e-3)])
def test_where_nothing_is_better_there_is_no_first_answer(tmp_path, capsys, exposures_s, lux):
    """Of one exposure, and where nothing is found."""
    signs, plan = datasets.rendered_signs((80,), count=2), swept(exposures_s, (lux,), (0.0,), gain_db=(0.0,))
    how = {"strategy": "grid", "engine": ThreadEngine(1), "progress": True}
    evaluate(None, signs, "imx250", plan, output=tmp_path, **how)
    assert "so far" not in capsys.readouterr().err


def test_the_first_answer_is_the_best_exposure_of_each_light_in_one_picture(tmp_path, capsys):
    signs, lights_lux = datasets.rendered_signs((80,), count=3), (1.0, 50.0)
    plan = swept((0.002, 0.01, 0.03), lights_lux, (0.0, 400.0), gain_db=(0.0,))
    how = {"strategy": "grid", "engine": ThreadEngine(1), "progress": True}
    done = evaluate(None, signs, "imx250", plan, output=tmp_path, **how)
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("so far")]
    cells = pd.DataFrame(done.cells)
    cells = cells[(cells.image == cells.image.min()) & ~cells.clean.astype(bool)]
    means = cells.groupby(["illuminance_lux", "exposure_s"]).target_confidence.mean()
    best_s = [means[lux].idxmax() for lux in lights_lux]
    assert best_s[0] != best_s[1]
    for line, lux, exposure_s in zip(lines, lights_lux, best_s, strict=True):
        assert f"{cells.image.iloc[0]} alone: at {lux:g} lux {1e3 * exposure_s:g} ms serves" in line
        assert f"(mean confidence {means[lux].max():.2f})" in line
