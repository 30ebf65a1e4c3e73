"""Results survive: whole or not at all, one writer, errors in words, exports as people read them."""

import csv
import subprocess
import sys
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.plan.axes import MOVES
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.store import queries
from blurnoise_eval.store.queries import write_exports
from blurnoise_eval.store.store import Store, StoreError
from stored_rows import clean_result, result, with_cell


def test_cells_and_detections_come_back(tmp_path):
    generator = np.random.default_rng(0)
    boxes = generator.uniform(0, 1e4, (7, 4)).astype(np.float32)
    found = Detections(boxes, generator.random(7, np.float32), generator.integers(0, 1000, 7))
    with Store(tmp_path / "a" / "run", create=True) as store:
        store.add([result(0, detections=found), result(1)])
    with Store(tmp_path / "a" / "run") as store:
        assert store.done(result(0).cell.image) == {"cell0"}
        assert store.done("another") == set()
        again = store.detections("cell0", "m")
        for name in ("boxes_xyxy", "scores", "class_ids"):
            np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
            assert getattr(again, name).dtype == getattr(found, name).dtype
        assert len(store.detections("cell1", "m")) == 0
        with pytest.raises(KeyError):
            store.detections("another", "m")
        with pytest.raises(KeyError):
            store.detections("cell0", "another")
        cells = list(store.cells())
        assert cells[0] == result(0, detections=found).cell
        assert list(store.targets())[1] == result(1).targets[0]


def test_classes_that_do_not_lead_their_box_come_back_as_such(tmp_path):
    """Class 0 among them, which has no negative; what says nothing of it leads."""
    boxes, scores = np.zeros((4, 4), np.float32), np.array([0.9, 0.5, 0.4, 0.1], np.float32)
    ids, leads = np.array([0, 0, 79, 3]), np.array([True, False, False, True])
    with Store(tmp_path / "run", create=True) as store:
        store.add([result(0, detections=Detections(boxes, scores, ids, leads))])
        store.add([result(1, detections=Detections(boxes, scores, ids))])
        several, single = (store.detections(f"cell{number}", "m") for number in (0, 1))
    assert several.class_ids.tolist() == single.class_ids.tolist() == ids.tolist()
    assert several.leading.class_ids.tolist() == [0, 3]
    assert len(single.leading) == 4


def test_cells_are_added_all_or_none(tmp_path):
    broken = result(1)
    broken = replace(broken, cell=replace(broken.cell, blur_px=[1.0]))
    with Store(tmp_path, create=True) as store:
        with pytest.raises(StoreError, match="type 'list' is not supported"):
            store.add([result(0), broken])
        assert list(store.cells()) == list(store.targets()) == []
        store.add([result(0)])
        assert [cell.cell_id for cell in store.cells()] == ["cell0"]


def test_order_of_rows_is_that_of_conditions_not_of_arrival(tmp_path):
    axes = {
        "repeat": (0, 1),
        "illuminance_lux": (5.0, 50.0),
        "exposure_s": (0.01, 0.02),
        "velocity_x_px_s": (-100.0, 0.0),
    }
    axes |= {"velocity_y_px_s": (-7.0, 9.0), "temperature_c": (-20.0, 25.0), "gain_db": (0.0, 6.0)}
    conditions = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    results = [result(index, image="p", **at, targets=2) for index, at in enumerate(conditions)]
    for name, turn in (("up", 1), ("down", -1)):
        with Store(tmp_path / name, create=True) as store:
            store.add(results[::turn])
            assert [cell.cell_id for cell in store.cells()] == [r.cell.cell_id for r in results]
            assert list(store.targets()) == [target for r in results for target in r.targets]


@pytest.mark.slow
def test_second_connection_and_second_process_are_refused(tmp_path):
    code = (
        "import sys; from pathlib import Path; from blurnoise_eval.store.store import Store, StoreError\n"
        "try: Store(Path(sys.argv[1]), create=True)\n"
        "except StoreError as error: print(error)"
    )
    with Store(tmp_path, create=True) as store:
        store.add([result(0)])
        with pytest.raises(StoreError, match="another process is using it"):
            Store(tmp_path)
        told = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True)
        assert "another process is using it" in told.stdout
        assert str(tmp_path) in told.stdout
        store.add([result(1)])  # the first one goes on
    with Store(tmp_path) as store:
        assert len(list(store.cells())) == 2


def test_a_store_that_is_shared_keeps_sweeps_out(tmp_path):
    """And a sweep keeps those out that would share."""
    refused = pytest.raises(StoreError, match="another process")
    with Store(tmp_path, create=True), refused, Store(tmp_path):
        pass
    with Store(tmp_path), Store(tmp_path), refused, Store(tmp_path, create=True):
        pass


def test_the_time_of_a_frame_is_the_median(tmp_path):
    with Store(tmp_path, create=True) as store:
        assert queries.median_simulate_ms(store) is None
        store.add([result(number, simulate_ms=ms) for number, ms in enumerate((9.0, 1.0, 2.0))])
        assert queries.median_simulate_ms(store) == 2.0


def test_targets_as_columns(tmp_path):
    """Of every target the values of its own row and of its cell's; anew once the store has grown."""
    taken = [
        result(number, targets=2, saturated_share=0.1 * number, brightness=0.5 + 0.1 * number)
        for number in range(3)
    ]
    with Store(tmp_path, create=True) as store:
        store.add(taken[:2])
        assert len(queries.target_columns(store, "m").condition) == 4
        store.add(taken[2:])
        columns, rows = queries.target_columns(store, "m"), {}
        cells = {cell.cell_id: cell for cell in store.cells()}
        for row in store.targets():
            rows[row.image, row.repeat, row.target.target_id, row.conditions] = row
        assert len(columns.condition) == len(rows) == 6
        for place, picture in enumerate(columns.picture):
            of = columns.pictures[picture], columns.repeat[place], columns.target_id[place]
            row = rows[*of, columns.conditions[columns.condition[place]]]
            assert columns.groups[columns.group[place]] == row.target.group
            assert columns.confidence[place] == row.target.confidence
            cell = cells[row.cell_id]
            shown = columns.saturated[place], columns.brightness[place]
            assert shown == (cell.saturated_share, cell.brightness)


def test_csv_has_the_rows_of_the_store(tmp_path, monkeypatch):
    """In their order, choices by name, "auto" where the camera sets a value, nothing where nothing is known."""
    monkeypatch.setattr("blurnoise_eval.store.store._AT_ONCE", 7)
    with Store(tmp_path, create=True) as store:
        for model in ("m", "a/b c=1.onnx"):
            every = [result(index, model=model, targets=2, moves=float(index % 3)) for index in range(40)]
            every[3] = result(3, model=model, targets=0, exposure_s=AUTOMATIC, gain_db=AUTOMATIC)
            every[4] = with_cell(every[4], error='said "no",\nλ')
            store.add([*every, *(clean_result(50 + index, model=model) for index in range(3))])
        written = write_exports(store)
        held = [list(store.cells()), list(store.targets())]
    for path, rows in zip(written, held, strict=True):
        with path.open(newline="", encoding="utf-8") as file:
            found = list(csv.DictReader(file))
        expected = [
            {
                name: "auto" if value == AUTOMATIC else "" if value is None else str(value)
                for name, value in row.columns().items()
            }
            for row in rows
        ]
        assert found == expected
        assert {row["moves"] for row in found} == {"", *MOVES.choices}
