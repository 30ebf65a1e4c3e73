"""Exports, each read back as a camera would."""

from __future__ import annotations

import csv
import json
import math
from itertools import pairwise
from pathlib import Path

import pytest
from blurnoise_eval.program import export
from blurnoise_eval.program.optimise import Program, optimise
from blurnoise_eval.program.stages import STOCK, Stages
from made_planes import METERING, made_problem

LIGHTS = made_problem().lights_lux
NODES_OF_7 = Stages(
    tuple(1e-3 * 1.5**k for k in range(8)), tuple(1.3**k for k in range(8))
)  # as many as a program can have


@pytest.fixture(scope="module")
def program() -> Program:
    return optimise(made_problem())


@pytest.fixture(scope="module")
def folder(program: Program, tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("program")
    export.write(program, where, "run")
    return where


def test_the_table_reads_back(program: Program, folder: Path) -> None:
    with (folder / "program.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["illuminance_lux"]) for row in rows] == list(LIGHTS)
    assert [float(row["exposure_s"]) for row in rows] == list(program.schedule.exposures_s)
    assert [float(row["gain_db"]) for row in rows] == list(program.schedule.gains_db)
    assert [float(row["value"]) for row in rows] == list(program.schedule.values)


def test_the_document_reads_back(program: Program, folder: Path) -> None:
    told = json.loads((folder / "program.json").read_text())
    assert told["model"] == "made"
    assert told["value"] == program.schedule.value
    assert told["regret_95"] == program.regret_95
    assert [node["exposure_s"] for node in told["nodes"]] == list(program.schedule.exposures_s)
    names = [rival["name"] for rival in told["rivals"]]
    assert names[:3] == ["best fixed time", *(f"{name}, to 33.3 ms" for name in STOCK)]


def test_libcamera_takes_the_same_exposures(program: Program, folder: Path) -> None:
    """Two lists of one length, two or more, us; divided up they give the program's exposures to a us."""
    mode = json.loads((folder / "libcamera.json").read_text())["rpi.agc"]["exposure_modes"]["custom"]
    assert len(mode["shutter"]) == len(mode["gain"]) >= 2
    read = Stages(tuple(1e-6 * time for time in mode["shutter"]), tuple(mode["gain"]))
    for light, time_s in zip(LIGHTS, program.schedule.exposures_s, strict=True):
        assert read.divided(METERING.total_s(light))[0] == pytest.approx(time_s, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("stages", [*STOCK.values(), NODES_OF_7])
def test_an_ae_route_obeys_its_rules(stages: Stages) -> None:
    nodes = export.ae_route(stages)
    assert 2 <= len(nodes) <= export.MOST_NODES
    assert all(isinstance(part, int) for node in nodes for part in node.values())
    assert all(node["int_time"] > 0 and node["sys_gain"] >= 1024 for node in nodes)
    for before, after in pairwise(nodes):
        assert math.prod(before.values()) < math.prod(after.values())
        risen = [name for name in before if after[name] > before[name]]
        same = [name for name in before if after[name] == before[name]]
        assert len(risen) == len(same) == 1


def test_an_ae_route_takes_the_same_exposures(program: Program, folder: Path) -> None:
    """Between two nodes the component that differs takes up what is asked for."""
    route = json.loads((folder / "ae_route.json").read_text())
    nodes = [(1e-6 * node["int_time"], node["sys_gain"] / 1024) for node in route["route_node"]]
    assert route["total_num"] == len(nodes)
    for light, time_s in zip(LIGHTS, program.schedule.exposures_s, strict=True):
        total = METERING.total_s(light)
        (low, high) = next(
            (pair for pair in pairwise(nodes) if math.prod(pair[1]) >= total), (nodes[-1], nodes[-1])
        )
        taken = high[0] if low[0] == high[0] else min(high[0], total / low[1])
        assert taken == pytest.approx(time_s, rel=1e-3, abs=1e-6)
