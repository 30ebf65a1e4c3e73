"""What is written of items, and its verdicts."""

from __future__ import annotations

import csv
from pathlib import Path

import read_pages
from blurnoise_eval.paper import items, page
from blurnoise_eval.paper.item import Check, Figure, Item, Outcome, Parts
from blurnoise_eval.paper.measurement import Measurements, NotRun

NONE = Measurements(None, None)  # type: ignore[arg-type]


def made(name: str, *agree: bool | None) -> Outcome:
    def parts(measured: Measurements) -> Parts:
        for place, each in enumerate(agree):
            yield Check(f"{name} {place}", "1 <px>", "2 px", "equal", each)
        lines = {"a line": {1.0: 0.2, 10.0: 0.4}}
        yield Figure("Drawn", "Exposure / ms", "Found", lines, [(2.0, 2.0, "one place"), (3.0, 5.0, "range")])
        if not agree:
            raise NotRun("needs a thing")

    return Item(name, f"Title of {name}", "Figure 1", "a setting", parts).run(NONE)


def test_summary() -> None:
    good, bad, missing = made("a", True, None), made("b", False), made("c")
    assert page.summary([good]) == "1 of 1 statements of the paper agree."
    text = "1 of 2 statements of the paper agree; differ: 1; items not run: 1."
    assert page.summary([good, bad, missing]) == text


def test_page_and_table(tmp_path: Path) -> None:
    page.write([made("a", True, False, None), made("b")], "<b>0</b> fields", tmp_path)
    rows = list(csv.DictReader((tmp_path / "paper.csv").open(newline="")))
    assert [(row["item"], row["expected"], row["found"], row["rule"], row["verdict"]) for row in rows] == [
        ("a", "1 <px>", "2 px", "equal", "agrees"),
        ("a", "1 <px>", "2 px", "equal", "differs"),
        ("a", "1 <px>", "2 px", "equal", "not judged"),
        ("b", "", "needs a thing", "", "not run"),
    ]
    shown = read_pages.Page(tmp_path / "paper.html")
    assert "1 of 2 statements of the paper agree; differ: 1; items not run: 1." in shown.text
    assert "<b>0</b> fields" in shown.text
    assert all(why in shown.text for why in items.NOT_COMPARED.values())
    assert all(address.startswith("data:image/png") or address == "paper.csv" for address in shown.addresses)
    assert shown.tags.count("img") == 1
    assert not shown.scripts
