"""What a grid shows on the plane, and what is predicted of it on lines."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.deciding.question import FLOOR, Line, Question, lattice
from blurnoise_eval.deciding.surface import USUAL, predicted_table
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep.run_folder import open_run
from blurnoise_eval.sweep.score_tables import score_tables
from made_tables import answers, table
from numpy.typing import NDArray
from signs_in_memory import CAMERA, PLAN, TWO, matched_detector

CRITERION = Criterion(0.6, kept=False)


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep at 3 exposures, 2 lights, and at rest or in 3 directions: (333.3, 0), (0, -77.1), (333.3, -77.1)."""
    folder = tmp_path_factory.mktemp("run")
    model = matched_detector(folder)
    with Store(folder, create=True) as store:
        open_run(store, [model], CAMERA, TWO, PLAN, {})
        sweep.run([model], CAMERA, TWO, PLAN, store)
    return folder


def test_every_direction_has_a_plane_and_rest_is_in_each(grid: Path) -> None:
    with Store(grid) as store:
        planes = [plane for each in score_tables(store, CRITERION, None) for plane in each.on_plane()]
    groups = {(each.model, each.group) for each in planes}
    for model, group in groups:
        alike = [each for each in planes if (each.model, each.group) == (model, group)]
        oblique = np.array((333.3, -77.1)) / math.hypot(333.3, 77.1)
        expected = sorted([(0.0, 1.0), (1.0, 0.0), tuple(oblique.tolist())])
        assert np.allclose(sorted(each.direction for each in alike), expected, atol=1e-6)
        for each in alike:
            # 3 exposures under 2 lights, at rest and moving; what moves by less than half a pixel is at rest
            speed = {(0.0, 1.0): 77.1, (1.0, 0.0): 333.3}.get(each.direction, math.hypot(333.3, 77.1))
            still = 2 * sum(speed * exposure_s < 0.5 for exposure_s in PLAN.values("exposure_s"))
            assert len(each.places) == 2 * 3 * 2 - still
            assert len({tuple(place) for place in each.places.tolist()}) == len(each.places)


def test_what_stands_at_a_place_is_what_was_measured_there(grid: Path) -> None:
    with Store(grid) as store:
        every = list(score_tables(store, CRITERION, None))
    for measured in every:
        means = {tuple(measured.at(place).values()): measured.mean[place] for place in range(len(measured))}
        for plane in measured.on_plane():
            for index, (u, w) in enumerate(plane.places.tolist()):
                at = plane.at(index)
                line = Line(at["illuminance_lux"], (at["velocity_x_px_s"], at["velocity_y_px_s"]))
                assert (u, w) == pytest.approx(line.places(at["exposure_s"]))
                if w > FLOOR:  # there others may stand with it
                    assert plane.mean[index] == pytest.approx(means[tuple(at.values())])


def test_one_experiment_under_two_conditions_is_one_place() -> None:
    """4 lux for 10 ms and 2 lux for 20 ms, 100 px/s and 50 px/s: 0.04 lux s and 1 px."""
    sums = np.array([[[0.2, 0.0], [0.0, 0.4]], [[0.6, 0.0], [0.0, 0.8]]])
    made = table(sums, [0.01, 0.02], [(100.0, 0.0), (50.0, 0.0)], counts=(sums > 0).astype(float))
    made.conditions["illuminance_lux"][:2], made.conditions["illuminance_lux"][2:] = 4.0, 2.0
    (seen,) = made.on_plane()
    assert seen.places == pytest.approx(np.array([[math.log2(0.04), 0.0]]))
    assert seen.sums == pytest.approx(np.array([[0.3], [0.7]]))
    assert seen.counts.tolist() == [[1.0], [1.0]]


def test_darkness_has_no_place() -> None:
    assert list(table(np.ones((2, 1, 1)), [0.01], at={"illuminance_lux": 0.0}).on_plane()) == []


QUESTION = Question(
    {
        "exposure_s": (0.002, 0.064),
        "illuminance_lux": (3.0, 40.0),
        "velocity_x_px_s": (0.0, 300.0),
        "velocity_y_px_s": (0.0,),
    }
)


def truth(places: NDArray[np.float64], cluster: int) -> NDArray[np.float64]:
    """A score that rises with light and falls with motion, in each cluster at another light."""
    u, w = places[..., 0], places[..., 1]
    return np.asarray(0.9 / (1 + np.exp(-1.5 * (u + 3 + 0.1 * cluster))) / (1 + np.exp(1.2 * (w - 3))))


def plane(clusters: int = 24, **changed: Any) -> ScoreTable:
    """At the lattice of the question, by exposures of 10 ms."""
    places = lattice(QUESTION.lines, QUESTION.exposures_s)
    sums = np.array([truth(places, cluster) for cluster in range(clusters)])
    made = table(np.zeros((clusters, len(places), 1)), np.full(len(places), 0.01), clean=0.9, reference=21.6)
    made.conditions["illuminance_lux"][:] = 2.0 ** places[:, 0] / 0.01
    made.conditions["velocity_x_px_s"][:] = 2.0 ** places[:, 1] / 0.01
    return replace(made, **{"sums": sums, "saturated": np.where(places[:, 0] > 0, 0.5, 0.0)} | changed)


@pytest.mark.filterwarnings("error")
def test_one_cluster_has_no_standard_error() -> None:
    assert np.isnan(plane(clusters=1).standard_error).all()
    assert np.isfinite(plane(clusters=2).standard_error).all()


def test_lines_through_a_smooth_plane_are_the_truth() -> None:
    found = predicted_table(plane(), QUESTION, USUAL)
    expected = np.mean([truth(found.places, cluster) for cluster in range(24)], axis=0)
    # half-stop nodes of a plane that bends over about a stop; the prototype found 0.005-0.008 RMS
    assert np.abs(found.mean - expected).max() < 0.02
    lines = list(found.along("exposure_s"))
    assert [line.at(0)["illuminance_lux"] for line in lines] == [3.0, 3.0, 40.0, 40.0]
    for line in lines:
        off = np.abs(line.mean - np.mean([truth(line.places, cluster) for cluster in range(24)], axis=0))
        assert line.prediction_cov is not None
        cov = line.prediction_cov(np.arange(len(line)))
        assert cov.shape == (len(line), len(line))
        assert (off <= 4 * np.sqrt(np.diag(cov)) + 1e-3).all()
    assert [answer.n_pictures for answer in answers(found, CRITERION)] == [24] * 4
    bright = lines[2].saturated
    assert bright[0] == 0
    assert bright[-1] == pytest.approx(0.5)


def test_no_score_is_below_0_or_above_what_there_is() -> None:
    steep = plane()
    cliff = np.where(steep.places[:, 0] > -3, 1.0, 0.0) + np.zeros_like(steep.sums)
    found = predicted_table(replace(steep, sums=cliff), QUESTION, USUAL)
    assert found.mean.min() >= -1e-12
    assert found.mean.max() <= 1 + 1e-12


def test_where_the_model_knows_too_little_nothing_is_predicted() -> None:
    nothing = replace(plane(), kept=True, counts=np.zeros_like(plane().counts), reference=0.0, clean=0.0)
    found = predicted_table(nothing, QUESTION, USUAL)
    assert (len(found), found.reference, found.kept) == (0, 0.0, True)
