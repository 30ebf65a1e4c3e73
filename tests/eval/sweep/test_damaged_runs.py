"""Runs whose documents are cut, empty or of other software: an error of one line, whoever reads them."""

from __future__ import annotations

import copy
import json
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval import datasets
from blurnoise_eval.deciding.decision import Decision
from blurnoise_eval.evaluation import evaluate
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.maps.nodes import nodes_of
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.merging import merge
from blurnoise_eval.system.files import RUN_FILE
from commands import main

PLAN = SweepPlan({"exposure_s": (0.005,), "illuminance_lux": (50.0,), "velocity_x_px_s": (0.0,)})
KEYS = ("identity", "learnt", "manifest")
CHECKED_ELSEWHERE = {"camera", "contract", "hardware", "versions"}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    every = datasets.rendered_signs()
    run = tmp_path_factory.mktemp("whole") / "run"
    evaluate(pictures=replace(every, pictures=every.pictures[:1]), plan=PLAN, output=run, threads=1)
    return run


def write(run: Path, key: str, value: object) -> None:
    with closing(sqlite3.connect(run / RUN_FILE)) as db, db:
        db.execute("UPDATE about SET value = ? WHERE key = ?", (json.dumps(value), key))


@pytest.mark.parametrize("command", ["report", "merge", "explore", "maps", "program"])
@pytest.mark.parametrize("value", [{}, [], None, {"version": 9}, "run"])
def test_another_manifest_is_a_line(
    whole: Path, command: str, value: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = shutil.copytree(whole, tmp_path / "run")
    write(run, "manifest", value)
    output = tmp_path / ("new.png" if command == "explore" else "new")
    assert main([command, str(run), *(() if command == "report" else ("-o", str(output)))]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len([line for line in said if line.startswith("blurnoise: error: run = ")]) == 1
    assert not output.exists()


def places(value: Any, place: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    yield place
    if isinstance(value, dict) and not CHECKED_ELSEWHERE & set(place):
        for key, inner in value.items():
            yield from places(inner, (*place, key))
    elif isinstance(value, list) and value and not CHECKED_ELSEWHERE & set(place):
        yield from places(value[0], (*place, 0))


def changed(document: Any, place: tuple[Any, ...], value: object) -> Any:
    """The document with a value at the place; without the key where the value is ``...``."""
    if not place:
        return value
    document = copy.deepcopy(document)
    around = document
    for key in place[:-1]:
        around = around[key]
    if value is ...:
        del around[place[-1]]
    else:
        around[place[-1]] = value
    return document


def read_all_ways(run: Path, folder: Path) -> Iterator[Any]:
    yield lambda: Decision(run).data
    yield lambda: merge([run], folder / "merged", "merge")
    yield lambda: Run(run)

    def nodes() -> None:
        with Store(run) as store:
            nodes_of(store)

    yield nodes


def failure(read: Callable[[], object]) -> str:
    """What a reader says of a run; a ``TypeError`` that names no figure is none that anybody should see."""
    try:
        read()
    except ValueError as error:
        return str(error)
    except TypeError as error:
        if ": must" not in str(error):
            raise
        return str(error)
    return ""


@pytest.mark.slow
@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("value", [..., None, 5, []], ids=["missing", "null", "number", "list"])
def test_every_key_may_be_wrong(whole: Path, key: str, value: object, tmp_path: Path) -> None:
    run = shutil.copytree(whole, tmp_path / "run")
    with Store(whole, shared=True) as store:
        document = store.about(key)
    for place in places(document):
        if place or value is not ...:
            write(run, key, changed(document, place, value))
            for number, read in enumerate(read_all_ways(run, tmp_path)):
                shutil.rmtree(tmp_path / "merged", ignore_errors=True)
                assert "\n" not in failure(read), (place, number)
