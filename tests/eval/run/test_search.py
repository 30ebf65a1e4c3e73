"""A search over a grid's conditions: that it finds what the grid finds, from fewer, by scores in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.answers.settling import SETTLED
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.report.opening import opening
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.search import Search, search
from blurnoise_eval.run.setup import Batch
from blurnoise_eval.run.tables import strategy_sentences
from made_scores import MadeScores
from plans import plan as planned
from signs_in_memory import CAMERA, picture, picture_set

PICTURES = picture_set(*(picture(f"{number}.png", labels=None) for number in range(9)))
EXPOSURES_S = 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2
PLAN = planned(EXPOSURES_S, (1.0, 20.0, 400.0), (0.0, 500.0, 1000.0), gain_db=(AUTOMATIC,))
GRID = 7 * 3 * 3


def smooth(at):
    """Noise at less than 3 mlx s, blur beyond 8 px, and white beyond 2 lx s, a cliff."""
    light = at["exposure_s"] * at["illuminance_lux"]
    blur_px = at["exposure_s"] * at["velocity_x_px_s"]
    noise, blur = 1 / (1 + (0.003 / light) ** 1.5), 1 / (1 + (blur_px / 8) ** 2)
    return noise * blur / (1 + (light / 2) ** 8)


def sheared(at):
    """As a rolling shutter has it: a third is lost at 1000 px/s, whatever the exposure."""
    return smooth(at) * (1 - at["velocity_x_px_s"] / 3000)


def decided(folder, detector, kept=smooth, engine=None, strategy="search", plan=PLAN):
    engine = engine or MadeScores(PICTURES, CAMERA, kept)
    return evaluate(
        detector, PICTURES, CAMERA, plan, Question(keep=0.9), folder, strategy=strategy, engine=engine
    )


@pytest.fixture(scope="module")
def searched(detector, tmp_path_factory):
    return decided(tmp_path_factory.mktemp("run"), detector)


@pytest.fixture(scope="module")
def of_sheared(detector, tmp_path_factory):
    return decided(tmp_path_factory.mktemp("run"), detector, sheared)


def best(kept, lights, speeds, exposures=EXPOSURES_S):
    """The most that one of the exposures keeps on average, by default of those of the grid."""
    means = [
        np.mean(
            [
                kept({"exposure_s": s, "illuminance_lux": lux, "velocity_x_px_s": v})
                for lux in lights
                for v in speeds
            ]
        )
        for s in exposures
    ]
    return max(means)


def worst_loss(run, kept):
    losses = []
    for row in run.tables.recommendations:
        lux, speed = row.conditions["illuminance_lux"], row.speed
        lights = PLAN.values("illuminance_lux") if lux is None else [lux]
        speeds = PLAN.values("velocity_x_px_s") if speed is None else [speed]
        named = best(kept, lights, speeds, [row.exposure_s])
        losses.append(best(kept, lights, speeds) - named)
    assert len(losses) == 1 + 3 + 9
    return max(losses)


def test_no_exposure_of_the_grid_keeps_much_more(searched):
    assert worst_loss(searched, smooth) <= SETTLED
    assert searched.setup.chosen <= 0.6 * GRID


@pytest.mark.slow
def test_nor_where_the_same_blur_in_px_is_not_the_same_picture(of_sheared):
    assert worst_loss(of_sheared, sheared) <= SETTLED
    assert of_sheared.setup.chosen <= 0.75 * GRID


def speckled(at):
    """A plateau on which no exposure is much better than another, so that much has to be tested."""
    return 0.8 + 0.03 * np.sin(1e4 * (at["exposure_s"] + at["illuminance_lux"] + at["velocity_x_px_s"]))


@pytest.mark.slow
@pytest.mark.parametrize("kept", [smooth, sheared, speckled])
def test_a_small_grid_is_searched_to_its_end(detector, tmp_path, kept):
    """Exposures between those of the grid take no condition from it: one exposure is known for everything, and no
    other promises more."""
    plan = planned((1e-3, 4e-3, 16e-3), (5.0, 50.0, 500.0), (0.0, 300.0), gain_db=(AUTOMATIC,))
    run = decided(tmp_path, detector, kept, plan=plan)
    scopes = [row.scope for row in run.tables.recommendations]
    assert scopes.count("all") == 1
    assert not Search(plan, CAMERA)._next(run)


@pytest.mark.slow
def test_it_is_a_part_of_the_sweep_which_goes_on_in_its_folder(searched, detector, tmp_path):
    decided(tmp_path, detector)
    assert searched.tables.manifest["missing_cells"] == 0
    engine = MadeScores(PICTURES, CAMERA, smooth)
    run = decided(tmp_path, detector, engine=engine, strategy="grid")
    of_grid = set(PLAN.conditions())
    assert engine.conditions.keys() | set(search_conditions(searched)) >= of_grid
    assert not engine.conditions.keys() & set(search_conditions(searched))
    assert run.strategy_sentences() == []
    assert run.tables.manifest["missing_cells"] == 0


def search_conditions(run):
    return [at for batch in run.setup.batches for at in batch.conditions]


@pytest.mark.slow
def test_it_uses_what_a_sweep_has_computed(detector, tmp_path):
    decided(tmp_path, detector, strategy="grid")
    engine = MadeScores(PICTURES, CAMERA, smooth)
    run = decided(tmp_path, detector, engine=engine)
    assert engine.cells == 0
    assert run.setup.chosen == GRID
    assert run.tables.manifest["missing_cells"] == 0


@pytest.mark.slow
def test_stopped_it_goes_on_to_the_same_conditions(searched, detector, tmp_path):
    class Stopping(MadeScores):
        def map(self, work, blocks):
            for answer in super().map(work, blocks):
                if self.cells > 15 * len(PICTURES):
                    raise KeyboardInterrupt
                yield answer

    with pytest.raises(KeyboardInterrupt):
        decided(tmp_path, detector, engine=Stopping(PICTURES, CAMERA, smooth))
    stopped = Run.open(tmp_path)
    most = max(row.untested_gain or 0.0 for row in stopped.tables.recommendations)
    assert most > SETTLED
    assert None in {row.settled for row in stopped.tables.recommendations}
    unfinished = f"The search has not finished. An exposure that was not tested may score {most:.2f} more"
    assert stopped.strategy_sentences()[1].startswith(unfinished)
    again = decided(tmp_path, detector)
    assert again.setup.batches == searched.setup.batches
    assert again.answers == searched.answers


def test_it_says_what_it_has_left_out(searched):
    first, second = searched.strategy_sentences()
    n = searched.setup.chosen
    of_sweep = f"A sweep computes the {GRID} of the grid, and more when it refines."
    assert first == f"{n} conditions with 9 pictures: {9 * n} cells. {of_sweep}"
    assert second == "No exposure that was not tested promises more than 0.03 above those to use."


def test_it_says_that_all_of_the_grid_was_needed(searched):
    setup = replace(searched.setup, batches=(Batch(9, (), tuple(PLAN.conditions())),))
    assert strategy_sentences(setup)[1] == "All of the grid was needed."


@pytest.mark.parametrize(
    ("exposures_s", "because"),
    [((AUTOMATIC,), "the camera sets the exposure itself"), ((0.01,), "there is one exposure")],
)
def test_without_exposures_to_choose_from_it_is_the_grid(exposures_s, because):
    chosen = search(SweepPlan({**PLAN.grid, "exposure_s": exposures_s}), CAMERA)
    assert list(chosen.search_space.because) == [because]


def test_a_large_grid_on_the_plane_is_searched_there():
    """It needs 80 conditions at most, however many lights there are; a small grid is no such one."""
    lights, speeds = np.geomspace(1, 1000, 10), np.linspace(0, 1000, 6)
    large = planned(PLAN.values("exposure_s"), lights, speeds, gain_db=(AUTOMATIC,))
    assert type(search(large, CAMERA)).__name__ == "PlaneSearch"
    assert isinstance(search(PLAN, CAMERA), Search)


def test_what_was_not_tested_is_part_of_the_verdict(searched):
    """Of all conditions together one exposure alone was tested, and still it is settled: by the search."""
    rows = searched.tables.recommendations
    promised = [row.untested_gain for row in rows if row.untested_gain is not None]
    assert len(promised) > len(rows) / 2
    assert max(promised) <= SETTLED
    assert all(row.settled for row in rows)
    assert any(row.rival_s is None for row in rows)
    assert "and by the search none that was not tested" in opening(searched.tables, "run").sentences[0]


def test_before_a_program_it_asks_for_the_whole_grid(searched):
    assert "Compute the whole grid with 'blurnoise sweep' and -o" in str(opening(searched.tables, "run"))
