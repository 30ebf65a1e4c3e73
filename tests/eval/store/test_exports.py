"""Exports: the same rows as CSV and Parquet, each whole or not at all."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from blurnoise_eval.grid.axes import AUTOMATIC
from blurnoise_eval.store.exports import write_exports, write_parquet
from blurnoise_eval.store.store import Store
from stored_rows import clean_result, result

parquet = pytest.importorskip("pyarrow.parquet")
MODELS = ("m", "a/b c=1.onnx")


@pytest.fixture
def store(tmp_path: Path) -> Any:
    with Store(tmp_path, create=True) as opened:
        for model in MODELS:
            every = [result(index, model=model, targets=2, moves=float(index % 3)) for index in range(40)]
            every[3] = result(3, model=model, targets=0, exposure_s=AUTOMATIC, gain_db=AUTOMATIC)
            every[4].cell["error"] = 'said "no",\nλ'
            every[5].targets[0]["truth"] = ""
            opened.add([*every, *(clean_result(50 + index, model=model) for index in range(3))])
        yield opened


def as_csv(path: Path) -> pd.DataFrame:
    table = pd.read_csv(path, keep_default_na=False, na_values={})
    numbers = [name for name in table if name not in TEXT]
    return table.assign(**{
        name: [math.nan if each == "" else math.inf if each == "auto" else float(each) for each in table[name]]
        for name in numbers if table[name].dtype == object or table[name].dtype == "str"
    })  # fmt: skip


TEXT = {"cell_id", "model", "camera", "image", "moves", "error", "example", "group", "label", "truth", "text"}


@pytest.mark.parametrize("name", ["results", "targets"])
def test_parquet_has_the_rows_of_csv(
    store: Store, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("blurnoise_eval.store.store._AT_ONCE", 7)
    write_exports(store)
    write_parquet(store)
    expected, found = as_csv(tmp_path / f"{name}.csv"), pd.read_parquet(tmp_path / f"{name}.parquet")
    assert list(found) == list(expected)
    assert len(found) == len(expected) > 0
    for column in expected:
        if column in TEXT:  # no text is null, an empty one is empty
            assert found[column].fillna("").tolist() == expected[column].tolist(), column
        else:
            pd.testing.assert_series_equal(
                found[column].astype(float), expected[column].astype(float), check_names=False
            )


def test_types_of_parquet_are_those_of_what_is_held(store: Store, tmp_path: Path) -> None:
    write_parquet(store)
    table = parquet.read_table(tmp_path / "results.parquet")
    kinds = {field.name: str(field.type) for field in table.schema}
    assert kinds["exposure_s"] == "double"
    assert kinds["seed"] == kinds["repeat"] == "int64"
    assert kinds["clean"] == "bool"
    assert kinds["image"] == kinds["moves"] == kinds["error"] == kinds["model"] == "string"
    rows = table.to_pylist()
    assert {row["exposure_s"] for row in rows if row["clean"]} == {None}  # nothing, and no NaN
    assert AUTOMATIC in {row["exposure_s"] for row in rows}
    assert {row["moves"] for row in rows} == {"all", "targets", "background", None}


def test_without_pyarrow_it_says_what_to_install(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow.parquet", None)
    with pytest.raises(ValueError, match=r"pip install 'blurnoise\[parquet\]'"):
        write_parquet(store)
