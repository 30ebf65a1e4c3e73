"""The table, what is written of it, and its verdicts."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
import read_pages
from blurnoise_eval.paper import page, table
from blurnoise_eval.paper.item import Check, Figure, Item, Line, Outcome, Parts
from blurnoise_eval.paper.measurement import Measurements, NotRun

NONE = Measurements(None, None)  # type: ignore[arg-type]


def item(name: str, *agree: bool | None) -> Item:
    checks = tuple(
        Check(f"{name} {place}", "1 <px>", "2 px", "equal", each) for place, each in enumerate(agree)
    )
    drawn = Figure("Drawn", "Exposure / ms", "Found", (Line("a line", (1.0, 10.0), (0.2, float("nan"))),))
    return Item(name, f"Title of {name}", "Figure 1", "a setting", lambda measured: iter([*checks, drawn]))


def missing(measured: Measurements) -> Parts:
    raise NotRun("needs a thing")


def run(*items: Item) -> list[Outcome]:
    return [each.run(NONE) for each in items]


def test_every_item_says_where_in_the_paper() -> None:
    assert len({each.name for each in table.ITEMS}) == len(table.ITEMS)
    for each in table.ITEMS:
        assert re.match(r"(Table|Figures?|eq\.|section) \d", each.place), each.name


def test_items_are_chosen_by_name() -> None:
    assert table.chosen([]) == table.ITEMS
    assert [each.name for each in table.chosen(["sic", "table-2"])] == ["table-2", "sic"]
    with pytest.raises(ValueError, match="only = 'sharpness': must be one of table-2, "):
        table.chosen(["sharpness"])


def test_verdicts() -> None:
    good, bad = run(item("a", True, None), item("b", True)), run(item("c", False))
    assert page.summary(good) == "2 of 2 statements of the paper agree."
    assert not page.differs(good)
    assert page.summary([*good, *bad]) == "2 of 3 statements of the paper agree; 1 differs."
    assert page.differs([*good, *bad])


def test_what_is_not_run_neither_agrees_nor_differs() -> None:
    outcomes = run(item("a", True), item("b", True)._replace(of=missing))
    assert [row["verdict"] for row in page.rows_of(outcomes)] == ["agrees", "not run"]
    assert page.rows_of(outcomes)[1]["found"] == "needs a thing"
    assert page.summary(outcomes) == "1 of 1 statements of the paper agree; 1 item was not run."
    assert not page.differs(outcomes)


def test_page_and_table(tmp_path: Path) -> None:
    outcomes = run(item("a", True, False), item("b")._replace(of=missing))
    written = page.write(outcomes, {"seed": "<b>0</b>"}, tmp_path)
    with (tmp_path / "paper.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["item"], row["expected"], row["found"], row["rule"], row["verdict"]) for row in rows] == [
        ("a", "1 <px>", "2 px", "equal", "agrees"),
        ("a", "1 <px>", "2 px", "equal", "differs"),
        ("b", "", "needs a thing", "", "not run"),
    ]
    shown = read_pages.Page(written)
    assert "1 of 2 statements of the paper agree; 1 differs; 1 item was not run." in shown.text
    assert "Figure 1, a 1: 2 px, not 1 <px>" in shown.text
    assert "<b>0</b>" in shown.text
    assert "What cannot be compared" in shown.text
    for _, why in table.NOT_COMPARED:
        assert why in shown.text
    assert all(address.startswith("data:image/png") or address == "paper.csv" for address in shown.addresses)
    assert shown.tags.count("img") == 1 + 10
    assert not shown.scripts
