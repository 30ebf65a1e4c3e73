"""Items that need no simulation, against the paper's numbers."""

from __future__ import annotations

import math

import pytest
import torch
from blurnoise_eval.paper import formulas
from blurnoise_eval.paper.item import Check, Figure, Parts
from blurnoise_eval.paper.measurement import Measurements

NONE = Measurements(None, None)  # type: ignore[arg-type]


def checks(found: Parts) -> list[Check]:
    return [part for part in found if not isinstance(part, Figure)]


def verdicts(found: Parts) -> list[bool | None]:
    return [check.agrees for check in checks(found)]


def test_every_row_of_table_2() -> None:
    found = list(formulas.table_2(NONE))
    assert [check.found for check in checks(iter(found))] == [
        "3.9380 px",
        "1.9691 px",
        "0.9845 px",
        "1.9691 px",
        "3.9374 px",
        "9.8435 px",
        "19.6751 px",
        "39.3502 px",
        "19.6869 px",
    ]
    assert verdicts(iter(found)) == [True] * 9


def test_quanta_of_white() -> None:
    (check,) = checks(formulas.quanta(NONE))
    assert check.found == "982.1 e- x 5.88 = 5774.6"
    assert check.agrees


def test_frequencies_of_signs() -> None:
    found = list(formulas.frequencies(NONE))
    assert [check.found for check in checks(iter(found))] == [
        "0.039-0.121 cycles/px",
        "0.080-0.232 cycles/px",
        "0.139-0.348 cycles/px",
    ]
    assert verdicts(iter(found)) == [True] * 3


def test_frequency_of_steps_is_that_of_edges_of_one_direction() -> None:
    line = torch.zeros(40)
    line[10:20] = 1
    line[28:] = 1
    assert formulas.edge_frequencies(line.expand(3, 4, 40)).tolist() == [1 / 18]  # rises at 9.5 and 27.5 px


def test_a_grating_has_the_frequency_of_its_period() -> None:
    x = torch.arange(120, dtype=torch.float64)
    grating = (100 + 50 * torch.cos(2 * math.pi * (x / 12.5 - 0.3))).expand(3, 9, 120)
    found = formulas.edge_frequencies(grating)
    torch.testing.assert_close(found, torch.full_like(found, 1 / 12.5), rtol=0.01, atol=0)
    assert len(found) == 16  # between 9 rises, and between 9 falls


def test_another_number_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    row = formulas.TABLE_2[3]
    monkeypatch.setattr(formulas, "TABLE_2", (row, row._replace(printed_px=row.printed_px + 0.006)))
    assert verdicts(formulas.table_2(NONE)) == [True, False]
    monkeypatch.setattr(formulas, "QUANTA", formulas.QUANTA * 1.002)
    assert verdicts(formulas.quanta(NONE)) == [False]
    monkeypatch.setattr(formulas, "FREQUENCIES", {100: (0.03, 0.1), 50: (0.08, 0.31), 32: (0.125, 0.3)})
    assert verdicts(formulas.frequencies(NONE)) == [False, False, True]
