"""Refining: further exposures about the ends of windows, by a score whose ends are known in closed form."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.evaluation import Evaluation, evaluate
from blurnoise_eval.grid.axes import AUTOMATIC
from blurnoise_eval.grid.conditions import Cell
from blurnoise_eval.store.store import CellResult, Store
from blurnoise_eval.sweep.merging import merge
from blurnoise_eval.sweep.open import asked
from blurnoise_eval.sweep.refining import STOPS
from blurnoise_eval.sweep.work import Block, Work
from plans import plan as swept_plan
from signs_in_memory import CAMERA, picture, picture_set
from stored_rows import clean_result, result

EXPOSURES_S = (0.001, 0.003, 0.01, 0.03, 0.1)
LIGHTS_LUX, SPEEDS_PX_S = (5.0, 50.0), (0.0, 300.0)
PLAN = swept_plan(EXPOSURES_S, LIGHTS_LUX, SPEEDS_PX_S, gain_db=(AUTOMATIC,))
PICTURES = picture_set(*(picture(f"{number}.png", labels=None) for number in range(24)))
KEPT, STEEP = 0.9, 12.0  # of the logistic curves, per stop


def ends_of(lux: float, speed_px_s: float) -> tuple[float, float]:
    """Where what is kept of the score is 0.9: more light moves the lower end down, speed the upper end."""
    return 0.02 / math.sqrt(lux), 0.057 if speed_px_s == 0 else 5.2 / speed_px_s


def kept_at(exposure_s: float, lux: float, speed_px_s: float) -> float:
    """Logistic in log exposure at either end, where it is 0.9."""
    low_s, high_s = ends_of(lux, speed_px_s)
    odds = math.log(KEPT / (1 - KEPT))
    rise = 1 / (1 + math.exp(-odds - STEEP * math.log2(exposure_s / low_s)))
    return rise / (1 + math.exp(-odds + STEEP * math.log2(exposure_s / high_s)))


@dataclass
class ClosedForm:
    """An engine that computes no picture: every target scores 0.9 of what is kept. after: blocks until it is
    interrupted."""

    after: int | None = None
    cells: int = 0
    blocks: int = 0

    def map(self, work: Work, blocks: Iterable[Block]) -> Iterator[tuple[Block, list[CellResult]]]:
        for block in blocks:
            if self.blocks == self.after:
                raise KeyboardInterrupt
            self.blocks += 1
            self.cells += len(block.cells)
            yield block, [scored(work.models[0].name, cell) for cell in block.cells]


def scored(model: str, cell: Cell) -> CellResult:
    shared = {"cell_id": cell.cell_id, "image": cell.image, "model": model, "repeat": cell.repeat}
    if cell.conditions is None:
        found = clean_result(0, **shared)
        kept = 1.0
    else:
        at = cell.conditions.on(CAMERA)
        found = result(0, **shared, **at, blur_px=0.0)
        kept = kept_at(at["exposure_s"], at["illuminance_lux"], at["velocity_x_px_s"])
    return replace(found, targets=tuple({**row, "confidence": 0.9 * kept} for row in found.targets))


def swept(folder: Path, detector: Detector, engine: ClosedForm | None = None, **options: Any) -> Evaluation:
    options = {"keep": KEPT, "refine": True} | options
    return evaluate(detector, PICTURES, CAMERA, PLAN, folder, engine=engine or ClosedForm(), **options)


@pytest.fixture(scope="module")
def refined(detector, tmp_path_factory):
    return swept(tmp_path_factory.mktemp("run"), detector)


def rows(run: Evaluation) -> list[Any]:
    with Store(run.folder) as store:
        found = [(cell["cell_id"], cell["image"], cell["exposure_s"]) for cell in store.cells()]
        return [sorted(found, key=repr), asked(store)]


def test_every_end_lies_in_its_interval(refined):
    """Seven of the eight ends stand between two tested exposures, 1.6 to 1.7 stops apart; one is below the shortest.
    Straight lines between these miss most of them by more than a quarter of a stop."""
    seen = 0
    for answer in refined.answers:
        (window,) = answer["windows_s"]
        bounds = answer["windows_low_s"][0], answer["windows_high_s"][0]
        true = ends_of(answer["illuminance_lux"], answer["velocity_x_px_s"])
        for end, (low, high), exact in zip(window, bounds, true, strict=True):
            if exact < EXPOSURES_S[0]:
                continue
            seen += 1
            assert low <= exact <= high
            assert abs(math.log2(end / exact)) < STOPS
            x = answer["exposures_s"]
            about = next((a, b) for a, b in pairwise(x) if a <= exact <= b)
            assert math.log2(about[1] / about[0]) < STOPS + 0.03
    assert seen == 8


def test_it_costs_a_few_conditions_of_that_light_and_speed(refined):
    """Less than half of a grid of quarter stops, 27 exposures for each of four lines."""
    with Store(refined.folder) as store:
        more = [at for batch in asked(store) for at in batch.conditions]
    assert len(set(more)) == len(more) == refined.summary["refined"]
    assert 8 * 3 <= len(more) <= 4 * 27 / 2
    assert refined.summary["missing_cells"] == 0
    assert refined.outcome.computed == 24 * (1 + 20 + len(more))
    lines = {(at.illuminance_lux, at["velocity_x_px_s"]) for at in more}
    assert lines == {(lux, speed) for lux in LIGHTS_LUX for speed in SPEEDS_PX_S}


@pytest.mark.slow
@pytest.mark.parametrize("after", [50, 110])
def test_stopped_it_goes_on_with_the_same_cells(refined, detector, tmp_path, after):
    """In the grid, which has 96 blocks, or while it is refined. Asked again it computes nothing."""
    stopped = 0
    while True:
        try:
            run = swept(tmp_path, detector, ClosedForm(after))
            break
        except KeyboardInterrupt:
            stopped += 1
    assert stopped
    assert rows(run) == rows(refined)
    swept(tmp_path, detector, engine := ClosedForm())
    assert engine.cells == 0
    assert rows(run) == rows(refined)


@pytest.mark.slow
def test_a_part_refines_nothing_and_the_merged_run_does(refined, detector, tmp_path):
    for part in ("1/2", "2/2"):
        assert swept(tmp_path / part[0], detector, part=part).summary["refined"] == 0
    merge([tmp_path / "1", tmp_path / "2"], tmp_path / "run")
    assert Evaluation(tmp_path / "run", keep=KEPT).summary["refined"] == 0
    whole = swept(tmp_path / "run", detector)
    assert [set(map(repr, each)) for each in rows(whole)] == [set(map(repr, each)) for each in rows(refined)]
