"""A search over the plane: what it asks, and that it goes on where it was."""

import math
from dataclasses import dataclass, replace
from functools import partial
from unittest import mock

import numpy as np
import pytest
from blurnoise_eval.answers.recommendation import CLOSE, MOST_COMMON
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.program.problem import inputs_of
from blurnoise_eval.run import plane_search
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.search_space import SearchSpace
from blurnoise_eval.store.store import Store
from signs_in_memory import CAMERA, everything, matched_detector, picture, picture_set, sign


def speckled(index):
    return (sign().astype(np.int64) * (12 + index) // 24).astype(np.uint8)


PICTURES = picture_set(*(picture(f"{index}.png", partial(speckled, index)) for index in range(10)))
EXPOSURES_S = tuple(np.geomspace(0.008, 0.032, 5).tolist())
VALUES = {"illuminance_lux": (2.0, 5.0), "velocity_x_px_s": (0.0, 200.0), "velocity_y_px_s": (0.0,)}
GRID = {"exposure_s": EXPOSURES_S, **VALUES, "gain_db": (0.0,)}
QUESTION = SearchSpace(GRID)
HALF = Question(threshold=0.5)


@dataclass(frozen=True)
class Stopping:
    after: int

    def map(self, work, blocks):
        for number, answer in enumerate(ThreadEngine().map(work, blocks)):
            if number == self.after:
                raise KeyboardInterrupt
            yield answer


@pytest.fixture(scope="module")
def detector(tmp_path_factory):
    return matched_detector(tmp_path_factory.mktemp("model"))


def decide(
    folder, detector, grid=GRID, pictures=PICTURES, camera=CAMERA, most_nodes=12, question=HALF, **options
):
    with mock.patch.multiple(plane_search, MOST_NODES=most_nodes, SHARE=2.0):  # the grid is small
        options = {"strategy": "search", "engine": ThreadEngine(), **options}
        return evaluate([detector], pictures, camera, SweepPlan(grid), question, folder, **options)


@pytest.fixture(scope="module")
def done(detector, tmp_path_factory):
    return decide(tmp_path_factory.mktemp("run"), detector)


def held(folder):
    with Store(folder) as store:
        return [everything(store), Run.open(folder).setup.batches]


def test_it_answers_on_every_line(done):
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
@pytest.mark.parametrize("after", [3, 25])
def test_interrupted_it_goes_on_to_the_same_rows(done, detector, tmp_path, after):
    with pytest.raises(KeyboardInterrupt):
        decide(tmp_path, detector, engine=Stopping(after))
    with Store(tmp_path) as store:
        cells = sum(not cell.conditions.original for cell in store.cells())
        wanted = sum(len(batch.conditions) for batch in Run.open(tmp_path).setup.batches) * len(PICTURES)
    assert cells < wanted  # noted before it was computed
    again = decide(tmp_path, detector)
    assert held(tmp_path) == held(done.folder)
    assert again.answers == done.answers


def test_the_exposure_to_use_is_measured_under_every_light_and_speed(done):
    """Or one within a fifth of a stop of it: what is kept there is no prediction alone."""
    (whole,) = [row for row in done.tables.recommendations if row.scope == "all"]
    common = [at for batch in done.setup.batches if not batch.places for at in batch.conditions]
    measured = {at.exposure_s for at in common}
    assert 0 < len(measured) <= MOST_COMMON
    assert min(abs(math.log2(whole.exposure_s / each)) for each in measured) <= CLOSE
    assert len(common) == len(measured) * len(QUESTION.lines)


def test_nothing_is_searched_for_a_model_without_answers(detector, tmp_path):
    """Its contract may be wrong: the first nodes say so, and no more are asked."""
    elsewhere = picture_set(
        *(replace(each, targets=tuple(replace(one, box_xyxy=(0.0, 0.0, 4.0, 4.0)) for one in each.targets or ()))
          for each in PICTURES)
    )  # fmt: skip
    told = decide(tmp_path, detector, pictures=elsewhere, question=Question(threshold=0.0))
    assert list(told.tables.manifest["withheld_models"]) == [detector.name]
    assert len(told.setup.batches) == 1
    with pytest.raises(ValueError, match=f"{detector.name}: no exposure is recommended, because the AP50"):
        inputs_of(told)
