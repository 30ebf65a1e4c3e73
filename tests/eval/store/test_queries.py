"""Means over cells, whatever the order in which they were computed, and what gains say of the pictures' light."""

import numpy as np
import pytest
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store
from stored_rows import AT, cell

EV_DB = 6.0206
"""A factor of two of the gain."""


def cells(**columns):
    """A cell of each picture under one condition; columns: values of each picture."""
    each = [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
    at = AT.but(exposure_s=0.01, gain_db=AUTOMATIC)
    return [
        cell(f"cell{number}", image=f"{number:03}", conditions=at, **about)
        for number, about in enumerate(each)
    ]


def stored(folder, rows):
    with Store(folder, create=True) as store:
        for row in rows:
            store.add([row])
    return Store(folder)


def test_means_do_not_depend_on_the_order_of_the_cells(tmp_path):
    """To the last digit: threads and parts of a run add cells in any order."""
    generator = np.random.default_rng(2)
    rows = cells(
        snr_db=generator.normal(20, 8, 60).tolist(),
        brightness=generator.random(60).tolist(),
        applied_exposure_s=generator.uniform(0.001, 0.03, 60).tolist(),
    )
    told = set()
    for number in range(4):
        generator.shuffle(rows)
        with stored(tmp_path / str(number), rows) as store:
            (row,) = queries.condition_counts(store, "m")
            told.add((row.snr_db, row.brightness))
    assert len(told) == 1


def test_the_mean_of_exposures_that_the_camera_set_neither(tmp_path):
    generator = np.random.default_rng(3)
    at = AT.but(exposure_s=AUTOMATIC)
    rows = [
        cell(f"cell{number}", image=f"{number:03}", conditions=at, applied_exposure_s=float(value))
        for number, value in enumerate(generator.uniform(0.001, 0.03, 60))
    ]
    told = set()
    for number in range(4):
        generator.shuffle(rows)
        with stored(tmp_path / str(number), rows) as store:
            told.add(queries.as_set(store, [at])[0]["exposure_s"])
    assert len(told) == 1


@pytest.mark.parametrize(
    ("ev", "spread"),
    [
        ((-1.0, 0.0, 1.0, -0.5, 0.5), 0.5**0.5),
        ((0.0,) * 6, 0.0),
        ((-1.0, 0.0, 1.0, 0.5), None),  # too few
        ((-1.0, 0.0, 1.0, 0.5, 0.5, 9.0), None),  # one of six at the limit of the gain
    ],
)
def test_gains_say_by_how_much_the_light_of_the_pictures_differs(tmp_path, ev, spread):
    gains = [min(24.0 - EV_DB * each, 48.0) if each < 5 else 0.0 for each in ev]
    with stored(tmp_path / "run", cells(applied_gain_db=gains)) as store:
        found = queries.light_spread_ev(store, 48.0)
    assert found == (None if spread is None else pytest.approx(spread, abs=1e-4))
