"""Deciding: what it asks, that it goes on where it was, and that it falls back on the grid."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from blurnoise_eval.answers.recommendation import CLOSE, MOST_COMMON
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.deciding import decision
from blurnoise_eval.deciding.decision import Decision, decided, question_of
from blurnoise_eval.deciding.question import Question
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.evaluation import evaluate
from blurnoise_eval.grid.axes import AUTOMATIC
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.program.problem import inputs_of
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.engines import Answers, ThreadEngine
from blurnoise_eval.sweep.open import asked
from blurnoise_eval.sweep.work import Work
from numpy.typing import NDArray
from signs_in_memory import CAMERA, everything, matched_detector, picture, picture_set, sign

from blurnoise import Camera


def speckled(index: int) -> NDArray[np.uint8]:
    """The sign, each time before another light."""
    return (sign().astype(np.int64) * (12 + index) // 24).astype(np.uint8)


PICTURES = picture_set(*(picture(f"{index}.png", partial(speckled, index)) for index in range(10)))
EXPOSURES_S = tuple(np.geomspace(0.008, 0.032, 5).tolist())
VALUES = {"illuminance_lux": (2.0, 5.0), "velocity_x_px_s": (0.0, 200.0), "velocity_y_px_s": (0.0,)}
GRID = {"exposure_s": EXPOSURES_S, **VALUES, "gain_db": (0.0,)}
QUESTION = Question(GRID)


@dataclass(frozen=True)
class Stopping:
    """An engine that is interrupted after so many blocks."""

    after: int

    def map(self, work: Work, blocks: Iterable[Any]) -> Answers:
        for number, answer in enumerate(ThreadEngine().map(work, blocks)):
            if number == self.after:
                raise KeyboardInterrupt
            yield answer


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return matched_detector(tmp_path_factory.mktemp("model"))


def decide(
    folder: Path,
    detector: Detector,
    grid: Any = GRID,
    pictures: PictureSet = PICTURES,
    camera: Camera = CAMERA,
    most_nodes: int = 12,
    **options: Any,
) -> Decision:
    """From fewer nodes than usual."""
    with mock.patch.object(decision, "MOST_NODES", most_nodes):
        return decided([detector], pictures, camera, SweepPlan(grid), folder, **{"threshold": 0.5} | options)


@pytest.fixture(scope="module")
def done(detector: Detector, tmp_path_factory: pytest.TempPathFactory) -> Decision:
    return decide(tmp_path_factory.mktemp("run"), detector)


def held(folder: Path) -> list[Any]:
    """All rows, and what was asked for, in its order."""
    with Store(folder) as store:
        return [everything(store), asked(store)]


def test_it_answers_on_every_line(done: Decision) -> None:
    lines = {(row["illuminance_lux"], row["velocity_x_px_s"]) for row in done.answers}
    assert lines == {(line.illuminance_lux, line.velocity_px_s[0]) for line in QUESTION.lines}
    for answer in done.answers:
        exposures = np.array(answer["exposures_s"])
        assert (exposures[0], exposures[-1]) == pytest.approx(QUESTION.exposures_s)
        assert np.ptp(np.diff(np.log2(exposures))) < 1e-9
        assert answer["n_pictures"] == 10
        assert -1e-12 <= min(answer["confidence"]) <= max(answer["confidence"]) <= 1 + 1e-12
    assert len({answer["confidence"][0] for answer in done.answers}) > 1


@pytest.mark.slow
def test_it_asks_for_few_conditions_and_says_how_many(done: Decision) -> None:
    assert done.decided is not None
    with Store(done.folder) as store:
        nodes = [at for batch in asked(store) for at in batch.conditions]
        computed = {cell["cell_id"] for cell in store.cells() if not cell["clean"]}
    assert len(set(nodes)) == len(nodes) == done.decided["nodes"]
    assert len(computed) == done.decided["cells"] == 10 * len(nodes)
    assert done.decided["grid_cells"] == 10 * 4 * 5
    assert str(len(nodes)) in done.how()[0]
    page = done.report().read_text("utf-8")
    assert f"{len(nodes)} conditions before " in page
    assert "curves are predicted" in page
    assert done.summary["missing_cells"] == 0


def test_asked_again_it_computes_nothing(done: Decision, detector: Detector) -> None:
    before = held(done.folder)
    again = decide(done.folder, detector)
    assert again.outcome is not None
    assert again.outcome.computed == 0
    assert held(done.folder) == before
    assert again.answers == done.answers


@pytest.mark.slow
@pytest.mark.parametrize("after", [3, 25])
def test_interrupted_it_goes_on_to_the_same_rows(
    done: Decision, detector: Detector, tmp_path: Path, after: int
) -> None:
    with pytest.raises(KeyboardInterrupt):
        decide(tmp_path, detector, engine=Stopping(after))
    with Store(tmp_path) as store:
        cells = sum(not cell["clean"] for cell in store.cells())
        wanted = sum(len(batch.conditions) for batch in asked(store)) * len(PICTURES)
    assert cells < wanted  # noted before it was computed
    again = decide(tmp_path, detector)
    assert held(tmp_path) == held(done.folder)
    assert again.answers == done.answers


@pytest.mark.slow
@pytest.mark.parametrize("gain_db", [0.0, AUTOMATIC])
def test_average_precision_is_a_score_to_decide_by(
    detector: Detector, tmp_path: Path, gain_db: float
) -> None:
    """On the same nodes of the plane; and a program follows where the camera has set the gain."""
    found = decide(tmp_path, detector, GRID | {"gain_db": (gain_db,)}, score="ap50", threshold=0.5)
    assert found.decided is not None
    assert not found.decided["because"]
    lines = {(row["illuminance_lux"], row["velocity_x_px_s"]) for row in found.answers}
    assert len(lines) == len(QUESTION.lines)
    with Store(tmp_path) as store:
        if gain_db == AUTOMATIC:
            assert inputs_of(store, found.criterion).exposures_s == QUESTION.exposures_s
        else:
            with pytest.raises(ValueError, match="a program needs a run with --gain auto"):
                inputs_of(store, found.criterion)


@pytest.mark.slow
def test_a_wider_question_begins_with_what_there_is(
    done: Decision, detector: Detector, tmp_path: Path
) -> None:
    first = decide(tmp_path, detector)
    asked_before = held(tmp_path)[1]
    wider = decide(tmp_path, detector, GRID | {"velocity_x_px_s": (0.0, 200.0, 400.0)})
    assert wider.outcome is not None
    assert first.outcome is not None
    assert held(tmp_path)[1][: len(asked_before)] == asked_before
    assert 0 < wider.outcome.computed < first.outcome.computed
    assert {row["velocity_x_px_s"] for row in wider.answers} == {0.0, 200.0, 400.0}


def test_another_camera_is_another_run(done: Decision, detector: Detector) -> None:
    with pytest.raises(StoreError, match="another camera"):
        decide(done.folder, detector, camera=replace(CAMERA, read_noise_e=9.0))
    upwards = {**GRID, "velocity_x_px_s": (0.0,), "velocity_y_px_s": (0.0, 5.0)}
    with pytest.raises(StoreError, match="another plan"):
        decide(done.folder, detector, upwards)


def test_where_the_plane_does_not_hold_it_is_the_grid(detector: Detector, tmp_path: Path) -> None:
    warm = replace(CAMERA, dark_current_e_s=500.0)
    some = replace(PICTURES, pictures=PICTURES.pictures[:2])
    small = {**GRID, "illuminance_lux": (5.0,)}
    done = decide(tmp_path, detector, small, camera=warm, pictures=some)
    assert done.decided is not None
    assert ["dark current" in reason for reason in done.decided["because"]] == [True]
    assert "A grid of 10 conditions, not a search: dark current" in done.how()[0]
    assert done.data.axes[0].count == 5  # half a stop apart
    assert {len(row["exposures_s"]) for row in done.answers} <= {5, 6}  # and the best one refined
    with Store(tmp_path) as store:
        assert not any(batch.places for batch in asked(store))


def test_bad_questions_make_no_folder(detector: Detector, tmp_path: Path) -> None:
    for wrong in (
        {"keep": 0.9},
        {"score": "ap5"},
        {"cluster": "("},
        {"engine": "rays"},
        {"threshold": 1.5},
    ):
        with pytest.raises(ValueError, match=r"keep|score|cluster|engine|threshold"):
            decide(tmp_path / "run", detector, **wrong)
    assert not (tmp_path / "run").exists()


def test_a_question_of_other_software_is_named(tmp_path: Path) -> None:
    with Store(tmp_path, create=True) as store:
        store.set_about("question", {"exposures_s": [0.01, 0.1]})
        with pytest.raises(StoreError, match=r"made by other software \(question: must have grid"):
            question_of(store)


@pytest.mark.slow
def test_it_decides_for_targets_that_move_alone(detector: Detector, tmp_path: Path) -> None:
    """On the same plane; nothing else moves in any condition, and without labels it is refused."""
    question = {**GRID, "moves": (1.0,)}
    told = decide(tmp_path / "run", detector, question)
    assert told.decided is not None
    assert not told.decided["because"]
    assert {row["moves"] for row in told.answers} == {"targets"}
    with Store(told.folder) as store:
        cells = list(store.cells())
    assert {cell["moves"] for cell in cells if not cell["clean"]} == {1.0}
    assert max(cell["invented_share"] or 0.0 for cell in cells) > 0.0
    unlabelled = picture_set(picture("a", sign, None))
    with pytest.raises(ValueError, match="needs to know where targets are"):
        decide(tmp_path / "none", detector, question, pictures=unlabelled)
    assert not (tmp_path / "none").exists()


def test_a_grid_that_is_cheaper_is_computed(detector: Detector, tmp_path: Path, capsys: Any) -> None:
    """Twelve conditions, where a search may ask for more: the answers are the sweep's, and it is said first."""
    tested = (0.008, 0.016, 0.032)
    question = {**GRID, "exposure_s": tested}
    run = decide(tmp_path / "run", detector, question, most_nodes=72, progress=True)
    first = capsys.readouterr().err.splitlines()[0]
    assert first.startswith("decide: it has 12 conditions, a search would ask for up to ")
    assert run.decided is not None
    assert (run.decided["nodes"], len(run.decided["because"])) == (12, 1)
    plan = SweepPlan(question)
    swept = evaluate(detector, PICTURES, CAMERA, plan, tmp_path / "sweep", threshold=0.5, threads=1)
    assert run.data.recommendations == swept.data.recommendations
    assert [answer["exposures_s"] for answer in run.answers] == [
        each["exposures_s"] for each in swept.answers
    ]


def test_the_exposure_to_use_is_measured_under_every_light_and_speed(done: Decision) -> None:
    """Or one within a fifth of a stop of it: what is kept there is no prediction alone."""
    (whole,) = [row for row in done.data.recommendations if row["scope"] == "all"]
    with Store(done.folder) as store:
        common = [at for batch in asked(store) if not batch.places for at in batch.conditions]
    measured = {at.exposure_s for at in common}
    assert 0 < len(measured) <= MOST_COMMON
    assert min(abs(math.log2(whole["exposure_s"] / each)) for each in measured) <= CLOSE
    assert len(common) == len(measured) * len(QUESTION.lines)


def test_nothing_is_searched_for_a_model_without_answers(
    detector: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its contract may be wrong: the first nodes say so, and no more are asked."""
    elsewhere = picture_set(
        *(replace(each, targets=tuple(replace(one, box_xyxy=(0.0, 0.0, 4.0, 4.0)) for one in each.targets or ()))
          for each in PICTURES)
    )  # fmt: skip
    told = decide(tmp_path, detector, pictures=elsewhere, threshold=0.0)
    assert list(told.data.manifest["withheld_models"]) == [detector.name]
    with Store(tmp_path) as store:
        assert len(asked(store)) == 1
        with pytest.raises(
            ValueError, match=f"{detector.name}: no exposure is recommended, because its AP50"
        ):
            inputs_of(store, told.criterion)
