"""A run that is opened again answers what its sweep was asked; options replace parts of that question."""

import json

import matched_filter
import pytest
from blurnoise_eval import Detector, Run, datasets, evaluate
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.cli import main
from blurnoise_eval.plan.question import Question
from blurnoise_eval.report import page
from blurnoise_eval.run.merging import merge
from plans import plan

PLAN = plan((0.002, 0.01), (50.0,), (0.0, 400.0), gain_db=(0.0,))
ASKED = Question(keep=0.7, score="detection_rate", cluster=r"\d$")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A sweep of nine rendered pictures."""
    folder = tmp_path_factory.mktemp("asked")
    model = Detector(matched_filter.build(folder / "small.onnx", sizes_px=(100, 50, 32)))
    signs = datasets.rendered_signs((50, 32), count=9)
    evaluate(model, signs, "imx250", PLAN, ASKED, folder / "run", strategy="grid")
    return folder / "run"


@pytest.mark.parametrize(
    ("options", "level", "kept", "score", "cluster"),
    [
        ([], 0.7, True, "detection_rate", r"\d$"),
        (["--threshold", "0.5"], 0.5, False, "detection_rate", r"\d$"),
        (["--score", "target_confidence", "--cluster", ".*"], 0.7, True, "target_confidence", ".*"),
    ],
)
def test_a_report_asks_what_the_sweep_asked(
    run, tmp_path, monkeypatch, capsys, options, level, kept, score, cluster
):
    monkeypatch.setattr(page, "write_report", lambda data, folder, progress, run: folder)
    assert main(["report", str(run), "-o", str(tmp_path), "--json", *options]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["criterion"].items() >= {"level": level, "kept": kept, "score": score}.items()
    assert (told["threshold"], told["cluster"]) == (level, cluster)


def test_python_and_a_merged_run_ask_the_same(run, tmp_path):
    opened = Run.open(run)
    merge([run], tmp_path / "merged")
    assert Run.open(tmp_path / "merged").criterion == opened.criterion
    assert opened.criterion == Criterion(0.7, kept=True, score="detection_rate", cluster=r"\d$")
