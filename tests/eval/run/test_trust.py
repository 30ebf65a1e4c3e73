"""Which runs are one's own, and what is opened of those that are not."""

import os
import shutil
import subprocess
import sys

import pytest
from blurnoise_eval.datasets import image_folder, write_picture
from blurnoise_eval.plan.question import Question
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.run.merging import merge
from blurnoise_eval.run.run import Run
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.system import signing
from plans import plan
from signs_in_memory import CAMERA, sign

PLAN = plan((0.01,), (50.0,), (0.0, 300.0))


@pytest.fixture(scope="module")
def parts(tmp_path_factory, detector):
    """Runs of one picture each, of a folder of two."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "pictures").mkdir()
    for name in ("a.png", "b.png"):
        write_picture(folder / "pictures" / name, sign())
    pictures = image_folder(folder / "pictures")
    question = Question(cluster=r"^(\w)")
    for part in ("1/2", "2/2"):
        evaluate(detector, pictures.part(part), CAMERA, PLAN, question, folder / part[0], progress=False)
    return folder / "1", folder / "2"


def test_a_signature_is_of_one_account_and_one_text(tmp_path, monkeypatch):
    mine = signing.signed("text")
    assert signing.is_own("text", mine)
    assert not signing.is_own("other text", mine)
    assert not signing.is_own("text", None)
    monkeypatch.setenv("BLURNOISE_STATE", str(tmp_path / "state"))
    assert not signing.is_own("text", mine)
    assert signing.is_own("text", signing.signed("text"))
    assert (tmp_path / "state" / "secret").stat().st_mode & 0o77 == 0
    monkeypatch.setenv("BLURNOISE_STATE", os.devnull)
    assert signing.signed("text") is None


def test_a_run_is_trusted_where_this_account_computed_it(parts, tmp_path, monkeypatch):
    """Elsewhere it searches for no pattern, unless asked to."""
    own = Run.open(parts[0], progress=False)
    merge(parts, tmp_path / "merged")
    monkeypatch.setenv("BLURNOISE_STATE", str(tmp_path / "another"))
    with pytest.raises(ValueError, match=r"cluster = .* is of a run that is not your own"):
        _ = Run.open(parts[0], progress=False).answers
    trusted = Run.open(parts[0], trust=True, progress=False)
    assert trusted.criterion == own.criterion
    merge(parts, tmp_path / "of others")
    for folder in (tmp_path / "merged", tmp_path / "of others"):
        with Run.open(folder) as run:
            assert not run.trusted


def test_a_changed_document_is_nobodys(parts, tmp_path):
    folder = shutil.copytree(parts[0], tmp_path / "run")
    with Store(folder, create=True, own=False) as store:
        store.set_about("wall_s", 7.0)
    with Run.open(folder) as run:
        assert not run.trusted


def test_scores_are_kept_in_runs_of_ones_own_alone(parts, tmp_path, monkeypatch):
    for account, kept in ((os.environ["BLURNOISE_STATE"], True), (str(tmp_path / "another"), False)):
        monkeypatch.setenv("BLURNOISE_STATE", account)
        folder = shutil.copytree(parts[0], tmp_path / str(kept))
        before = (folder / "results.sqlite").read_bytes()
        _ = Run.open(folder, Question(cluster="."), progress=False).tables
        assert (before != (folder / "results.sqlite").read_bytes()) is kept


def test_a_run_on_a_disk_that_is_read_only(parts, tmp_path, monkeypatch):
    """Is read, and nothing is written beside it; one that was killed says what to do."""
    folder = shutil.copytree(parts[0], tmp_path / "run")
    code = (
        "import os, sys; from pathlib import Path; from blurnoise_eval.store.store import Store\n"
        "store = Store(Path(sys.argv[1]), create=True); store.set_about('wall_s', 7.0); os._exit(0)"
    )
    subprocess.run([sys.executable, "-c", code, str(folder)], check=True)
    with Run.open(folder) as run:  # where it can be written what was killed is read, too
        assert run.setup.wall_s == 7.0
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(StoreError, match="its folder is read-only; copy the folder"), Run.open(folder):
        pass
    before = sorted(parts[0].iterdir())
    with Run.open(parts[0]) as run:
        assert run.setup.wall_s > 0
    assert sorted(parts[0].iterdir()) == before
