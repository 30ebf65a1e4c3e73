"""Exports: the same rows as CSV, JSON and Parquet, each whole or not at all."""

from __future__ import annotations

import csv
import math
import shutil
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from blurnoise_eval.grid.axes import AUTOMATIC
from blurnoise_eval.store import exports
from blurnoise_eval.store import store as store_module
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


@pytest.mark.parametrize("shards", [1, 3])
@pytest.mark.parametrize("name", ["results", "targets"])
def test_parquet_has_the_rows_of_csv(
    store: Store, tmp_path: Path, name: str, shards: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exports, "_ROWS_PER_SHARD", -(-86 // shards))
    monkeypatch.setattr("blurnoise_eval.store.store._AT_ONCE", 7)
    write_exports(store)
    write_parquet(store)
    expected = as_csv(tmp_path / f"{name}.csv")
    found = pd.read_parquet(tmp_path / f"{name}.parquet")
    assert set(found["shard"].astype(int)) == set(range(shards))
    keys = ["cell_id", "model"] + ["target_id"] * (name == "targets")
    found = found.drop(columns="shard").astype({"model": str}).sort_values(keys).reset_index(drop=True)
    expected = expected.sort_values(keys).reset_index(drop=True)
    assert set(found) == set(expected)
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
    (path,) = (tmp_path / "results.parquet" / "model=m").glob("shard=*/part.parquet")
    table = parquet.read_table(path, partitioning=None)
    kinds = {field.name: str(field.type) for field in table.schema}
    assert kinds["exposure_s"] == "double"
    assert kinds["seed"] == kinds["repeat"] == "int64"
    assert kinds["clean"] == "bool"
    assert kinds["image"] == kinds["moves"] == kinds["error"] == "string"
    assert "model" not in kinds
    rows = table.to_pylist()
    assert {row["exposure_s"] for row in rows if row["clean"]} == {None}  # nothing, and no NaN
    assert AUTOMATIC in {row["exposure_s"] for row in rows}
    assert {row["moves"] for row in rows} == {"all", "targets", "background", None}


def test_parquet_appears_whole_or_stays_what_it_was(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_parquet(store)
    before = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.parquet"))

    def fails(*given: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(exports, "_write_part", fails)
    with pytest.raises(OSError, match="No space"):
        write_parquet(store)
    assert sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.parquet")) == before
    assert not list(tmp_path.glob(".*partial"))
    shutil.rmtree(tmp_path / "results.parquet")
    with pytest.raises(OSError, match="No space"):
        write_parquet(store)
    assert not (tmp_path / "results.parquet").exists()


def test_without_pyarrow_it_says_what_to_install(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow.parquet", None)
    with pytest.raises(ValueError, match=r"pip install 'blurnoise\[parquet\]'"):
        write_parquet(store)


@pytest.mark.parametrize("alone", [True, False])
def test_exports_of_large_runs_are_written_by_a_process_of_their_own(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, alone: bool
) -> None:
    """The same bytes, while the run is read and written to here; where no process can, here."""
    expected = [path.read_bytes() for path in write_exports(store, tmp_path)[:2]]
    store.__exit__(None, None, None)
    monkeypatch.setattr(exports, "MOST_HERE", 10)
    monkeypatch.setattr(exports, "_has_arrow", lambda: False)
    if alone:
        monkeypatch.setattr(exports, "write_exports", lambda *_: pytest.fail("written here"))
    else:
        monkeypatch.setattr(exports, "_ALONE", "raise SystemExit(1)")
    output = tmp_path / "output"
    output.mkdir()
    with exports.exported_meanwhile(tmp_path, output), Store(tmp_path, shared=True) as again:
        again.set_about("kept", [1])
    assert [(output / name).read_bytes() for name in ("results.csv", "targets.csv")] == expected
    assert not list(output.glob(".*"))
    with Store(tmp_path) as again:
        assert again.about("kept") == [1]


@pytest.mark.parametrize("rows_at_once", [1, 3, 20_000])
def test_tables_of_large_runs_hold_the_same_values(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows_at_once: int
) -> None:
    """Written by pyarrow: every number to its last bit, and texts with what CSV must not mistake, wherever a block
    begins; of one kind in a whole column, with one kind of line ends."""
    names = ("results.csv", "targets.csv")
    monkeypatch.setattr(store_module, "_AT_ONCE", rows_at_once)
    write_exports(store)
    before = [(tmp_path / name).read_bytes() for name in names]
    expected = [list(csv.DictReader((tmp_path / name).open(newline="", encoding="utf-8"))) for name in names]
    monkeypatch.setattr(exports, "MOST_HERE", 10)
    write_exports(store)
    for name, rows, bytes_before in zip(names, expected, before, strict=True):
        bytes_now = (tmp_path / name).read_bytes()
        assert bytes_now != bytes_before
        assert b"\r\n" not in bytes_now
        found = list(csv.DictReader((tmp_path / name).open(newline="", encoding="utf-8")))
        assert [{at: _number(value) for at, value in row.items()} for row in found] == [
            {at: _number(value) for at, value in row.items()} for row in rows
        ]
    gains = pd.read_csv(tmp_path / "results.csv")["gain_db"].dropna().unique().tolist()
    assert sorted(gains) == ["0.0", "auto"]


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
