"""Exports: the rows of the store as CSV, some at a time, as people read them."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from blurnoise_eval.grid.axes import AUTOMATIC, MOVES, named
from blurnoise_eval.store.queries import write_exports
from blurnoise_eval.store.store import Store
from stored_rows import clean_result, result


def test_csv_has_the_rows_of_the_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In their order, choices by name, "auto" where the camera sets a value, nothing where nothing is known."""
    monkeypatch.setattr("blurnoise_eval.store.store._AT_ONCE", 7)
    with Store(tmp_path, create=True) as store:
        for model in ("m", "a/b c=1.onnx"):
            every = [result(index, model=model, targets=2, moves=float(index % 3)) for index in range(40)]
            every[3] = result(3, model=model, targets=0, exposure_s=AUTOMATIC, gain_db=AUTOMATIC)
            every[4].cell["error"] = 'said "no",\nλ'
            store.add([*every, *(clean_result(50 + index, model=model) for index in range(3))])
        written = write_exports(store)
        held = [list(store.cells()), list(store.targets())]
    for path, rows in zip(written, held, strict=True):
        with path.open(newline="", encoding="utf-8") as file:
            found = list(csv.DictReader(file))
        expected = [
            {
                name: "auto" if value == AUTOMATIC else "" if value is None else str(value)
                for name, value in named(row).items()
            }
            for row in rows
        ]
        assert found == expected
        assert {row["moves"] for row in found} == {"", *MOVES.choices}
