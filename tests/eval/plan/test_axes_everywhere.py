"""Over random grids of all axes: ids, rows, tables, curves and files hold every cell once, none overwritten."""

import json
import math
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import stored_rows
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import endurances, endurances_across
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.monotone import is_uniform, pooled
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.plan.axes import AXES, CORE, EGO, HEADLAMP, MOVES, NAMES, OWN_SPECTRUM, SETTING, VELOCITY
from blurnoise_eval.plan.axes import axis as axis_of
from blurnoise_eval.plan.conditions import Cell, Conditions
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.store import queries
from blurnoise_eval.store.columns import ORIGINAL, AxisValues
from blurnoise_eval.store.queries import write_exports
from blurnoise_eval.store.store import Store
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from made_tables import tables
from plans import IMX250

MOST = 48  # conditions of a grid


@st.composite
def grids(draw):
    """Values on the needed axes and any others; some differ by less than a file's name shows."""
    grid = {}
    for axis in AXES:
        if axis.name not in CORE and draw(st.booleans()):
            continue
        if axis.choices:
            named = [name for name in axis.choices if name != OWN_SPECTRUM]  # which needs a curve
            places = st.integers(0, len(named) - 1).map(float)
            if axis.prefix:
                places |= st.sampled_from([axis.least_number, 2856.0])
            grid[axis.name] = draw(st.lists(places, min_size=1, max_size=3, unique=True))
            continue
        low = axis.low + 0.001 if axis.positive else axis.low
        high = IMX250.sensor.gain_max_db if axis.name == "gain_db" else axis.high
        value = st.floats(max(low, -500.0), min(high, 500.0), allow_subnormal=False).map(
            lambda v: round(v, 3)
        )
        values = draw(st.lists(value, min_size=1, max_size=3, unique=True))
        if draw(st.booleans()):
            values.append(values[0] * (1 + 1e-9))
        own = axis.own(IMX250)
        if draw(st.booleans()) and not math.isnan(own):
            values.append(own)
        grid[axis.name] = [value for value in values if low <= value <= high] or [
            min(max(low, 1.0), axis.high)
        ]
    if EGO.name in grid:  # whose camera moves all in its own way
        grid = {name: values for name, values in grid.items() if name not in (*VELOCITY, MOVES.name)}
        grid |= {name: [0.0] for name in VELOCITY if name in CORE}
    if any(grid.get(HEADLAMP.name, ())):  # whose light is a multiple of that which is there
        grid["illuminance_lux"] = [max(lux, 0.001) for lux in grid["illuminance_lux"]]
    longest_s = max(grid["exposure_s"])
    for name in VELOCITY:  # no farther than a picture may move during an exposure
        if name in grid:
            grid[name] = [v for v in grid[name] if abs(v) * longest_s < 1e5] or [0.0]
    assume(math.prod(len(set(values)) for values in grid.values()) <= MOST)
    return grid


def result(cell, score):
    """A finished cell, as a sweep leaves it, told from all others by its score."""
    at = cell.conditions
    conditions = ORIGINAL if at is None else AxisValues.of(at.on(IMX250))
    found = Detections(np.array([[0, 0, 9, 9]]), np.array([score]), np.array([0]))
    about = {"image": cell.image, "repeat": cell.repeat, "blur_px": at and at.blur_px}
    return stored_rows.cell(
        cell.cell_id, [stored_rows.answer(confidence=score)], found, conditions=conditions, **about
    )


def filled(folder, plan):
    """A run of one picture whose every cell has a score of its own; scores by condition."""
    conditions: list[Conditions | None] = [None, *plan.conditions()]
    scores = {at: (place + 1) / 64 for place, at in enumerate(conditions)}  # exact in single precision
    store = Store(folder, create=True)
    store.add([result(Cell("p", 0, at, 1), score) for at, score in scores.items()])
    model = {"name": "m", "kind": "detector", "file": "m.onnx", "sha256": "0", "unknown_labels": []}
    model["contract"] = {"classes": ["stop sign"]}
    images = {"kind": "coco", "source": "p", "count": 1, "labelled": True, "notes": []}
    manifest = {"title": "m", "models": [model], "camera": IMX250.to_dict(), "images": images}
    store.set_about("manifest", manifest)
    identity = {"model": [model], "camera": manifest["camera"], "pictures": "", "choice of targets": ""}
    store.set_about("identity", {**identity, "plan": plan.to_dict()})
    (folder / "coco").mkdir()
    truth = {"images": [{"id": 1, "file_name": "p"}], "annotations": []}
    truth["categories"] = [{"id": 1, "name": "stop sign"}]
    (folder / "coco" / "instances.json").write_text(json.dumps(truth))
    return store, scores


some = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])


@given(grids())
@some
def test_ids_tell_cells_apart(grid):
    plan = SweepPlan(grid, repeats=2)
    conditions = plan.conditions()
    assert len(conditions) == math.prod(len(plan.values(name)) for name in plan.grid)
    cells = [Cell(image, repeat, at, 3) for image in "pq" for repeat in (0, 1) for at in (None, *conditions)]
    assert len({cell.cell_id for cell in cells}) == len(cells)
    assert plan.example_conditions() <= set(conditions)
    assert SweepPlan(json.loads(json.dumps(plan.to_dict()))["grid"]).conditions() == conditions


@pytest.mark.slow
@given(grids())
@some
def test_rows_read_back_and_conditions_stay_apart(grid):
    with tempfile.TemporaryDirectory() as folder:
        store, scores = filled(Path(folder), SweepPlan(grid))
        with store:
            expected = {
                Cell("p", 0, at, 1).cell_id: result(Cell("p", 0, at, 1), s) for at, s in scores.items()
            }
            assert {row.cell_id: row for row in store.cells()} == {i: of.cell for i, of in expected.items()}
            rows = queries.condition_counts(store, "m")
            assert [row.n_pictures for row in rows] == [1] * len(scores)
            answers = [queries.answers_at(store, "m", row.conditions).scores.tolist() for row in rows]
            assert Counter(score for (score,) in answers) == Counter(scores.values())
            write_exports(store)
            header = (Path(folder) / "results.csv").read_text().splitlines()[0].split(",")
            assert [name for name in header if name in NAMES] == list(NAMES)


@pytest.mark.slow
@given(grids())
@some
def test_every_cell_is_in_one_table_and_in_one_curve_over_each_axis(grid):
    plan = SweepPlan(grid)
    with tempfile.TemporaryDirectory() as folder:
        store, scores = filled(Path(folder), plan)
        with store:
            exposed_rows = [row for row in store.targets() if not row.conditions.original]
            as_set = queries.as_set(store, [row.conditions for row in exposed_rows])
            shown = {"saturated_share": None, "brightness": None}
            rows = zip(exposed_rows, as_set, strict=True)
            found = list(tables({**row.stored(), **at, **shown} for row, at in rows))
    exposed = Counter(score for at, score in scores.items() if at is not None)
    assert len({(each.model, each.group) for each in found}) == len(found)
    assert Counter(value for each in found for value in each.mean.tolist()) == exposed
    settings = [setting for each in found for setting in each.split(SETTING)]
    assert len(settings) == math.prod(max(1, len(plan.values(name))) for name in SETTING)
    told = [answer for each in found for answer in answers(each, Criterion(0.5, kept=False))]
    over_speeds = Counter(
        value for each in settings for value in (pooled(each) if is_uniform(each) else each).mean.tolist()
    )
    assert Counter(value for answer in told for value in answer.confidence) == over_speeds
    assert len({answer.conditions for answer in told}) == len(told)

    curves = [curve for each in found for curve in endurances(each, Criterion(0.5, kept=False))]
    curves += [curve for each in found for curve in endurances_across(each, Criterion(0.5, kept=False))]
    for axis in ("exposure_s", *SETTING):
        over = [curve for curve in curves if curve.axis == axis]
        several = len(plan.values(axis)) > 1 and axis_of(axis).fails
        assert Counter(value for curve in over for value in curve.confidence) == (exposed if several else {})
        assert all(curve.x == plan.values(axis) and curve.conditions[axis] is None for curve in over)
        assert len({curve.conditions for curve in over}) == len(over)
