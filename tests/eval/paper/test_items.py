"""Items held to measurements that are made up, whose verdicts are known, and to the paper's numbers."""

import csv
import math
import re

import numpy as np
import pytest
import read_pages
from blurnoise_eval.paper import items, page
from blurnoise_eval.paper.item import Check, Figure, Item, near
from blurnoise_eval.paper.measurement import Measurements, NotRun
from blurnoise_eval.quality.measure import TILT_DEG
from scipy.optimize import brentq

from blurnoise.blur import convolution
from blurnoise.camera import Camera
from blurnoise.metrics.values import Estimate

WITHHELD = Estimate(math.nan)
ITEM = {item.name: item for item in items.ITEMS}
METRICS = ("mtf50_x", "patch_snr_dark", "patch_snr_bright", "edge_snr_db", "sic_square", "neq_integral")
AGREES = {"agrees": True, "differs": False}


def measured(value):
    """Measurements that are made up: ``value`` of a metric, or of a sign's size in px, at ms and px/s."""

    class MadeUp(Measurements):
        def __getitem__(self, of):
            names = METRICS if of.chain is None else [f"{size} px" for size in of.sizes_px]
            found = {}
            for name in names:
                for ms in of.exposures_ms:
                    for dx in of.speeds_px_s:
                        at = value(name if of.chain is None else int(name.split()[0]), ms, dx)
                        found[name, float(ms), dx] = at if isinstance(at, Estimate) else Estimate(at)
            return found

    return MadeUp(None, None)  # type: ignore[arg-type]


def rows(name, value=lambda *at: WITHHELD):
    """The rows of an item, of the judged chain where there are two; those of the other are not judged."""
    item = ITEM[name]
    found = item.run(measured(value)).rows
    assert {row["verdict"] for row in found if row["chain"] not in ("", item.judged)} <= {"not judged"}
    return [row for row in found if row["chain"] in ("", item.judged)]


def verdicts(name, value=lambda *at: WITHHELD):
    return [AGREES.get(row["verdict"]) for row in rows(name, value)]


def test_every_item_has_its_place_in_the_paper_and_is_chosen_by_name():
    assert len(ITEM) == len(items.ITEMS) == 13
    assert all(re.match(r"(Table|Figures?|eq\.|section) \d", each.place) for each in items.ITEMS)
    assert items.chosen([]) == items.ITEMS
    assert [each.name for each in items.chosen(["sic", "table-2"])] == ["table-2", "sic"]
    with pytest.raises(ValueError, match="only = 'sharpness': must be one of table-2, "):
        items.chosen(["sharpness"])


def test_formulas_give_the_papers_numbers():
    blurs_px = ["3.9380", "1.9691", "0.9845", "1.9691", "3.9374", "9.8435", "19.6751", "39.3502", "19.6869"]
    assert [row["found"] for row in rows("table-2")] == [f"{blur} px" for blur in blurs_px]
    assert [row["found"] for row in rows("quanta")] == ["5774.6 quanta"]
    assert all(row["verdict"] == "agrees" for name in ("table-2", "quanta") for row in rows(name))


def test_other_numbers_differ(monkeypatch):
    blur, *rest = items.TABLE_2[3]
    monkeypatch.setattr(items, "TABLE_2", ((blur, *rest), (blur + 0.006, *rest)))
    assert verdicts("table-2") == [True, False]
    monkeypatch.setattr(items, "QUANTA", items.QUANTA * 1.002)
    assert verdicts("quanta") == [False]


@pytest.mark.slow
def test_mtf50_over_speed_is_that_of_the_closed_form():
    """Within 1 %, or its 95 % interval widened as Bonferroni does for seven speeds."""
    found = Measurements(None, None)[items.OVER_SPEED]  # type: ignore[arg-type]
    assert closed_mtf50(60.0) == pytest.approx(0.603355 / 60, rel=2e-3)  # the motion alone
    estimates = [found["mtf50_x", 30.0, speed] for speed in items.OVER_SPEED.speeds_px_s]
    truth = [closed_mtf50(30e-3 * speed) for speed in items.OVER_SPEED.speeds_px_s]
    assert near("", "", estimates, truth, "", 0.01).agrees
    assert not near("", "", estimates, [1.05 * each for each in truth], "", 0.01).agrees


def closed_mtf50(length_px):
    """MTF50, cycles/px, of the lin2024 camera across an edge at the charts' angle from vertical, moved along x.

    The chart's pixel, the areas of the camera's disc in the pixels, and uniform motion.
    """
    areas = convolution.disc(Camera.preset("lin2024").lens.defocus_radius_px)
    place = np.arange(len(areas)) - len(areas) // 2

    def above_half(f):
        fx, fy = f * math.cos(math.radians(TILT_DEG)), f * math.sin(math.radians(TILT_DEG))
        disc = (areas * np.cos(2 * math.pi * (place * fx + place[:, None] * fy))).sum()
        return float(np.sinc(fx) * np.sinc(fy) * disc * np.sinc(fx * length_px)) - 0.5

    return float(brentq(above_half, 1e-4, min(0.4, 0.9 / max(length_px, 1e-9))))


@pytest.mark.parametrize(
    ("value", "low", "agrees"),
    [(1.005, math.nan, True), (1.02, 0.98, True), (1.02, 1.004, True), (1.02, 1.01, False)],
)
def test_a_number_may_miss_within_its_interval(value, low, agrees):
    """Widened for seven numbers, 2.69 / 1.96 times: one of seven intervals of 95 % misses in three runs of ten."""
    assert near("", "", [Estimate(10 * value, 10 * low, 10.5)] * 7, [10.0] * 7, "", 0.01).agrees == agrees


# --- the paper's chain, pixel by pixel ---


# --- what is written of items ---


NONE = Measurements(None, None)  # type: ignore[arg-type]


def made(name, *agree):
    def parts(measured):
        for place, each in enumerate(agree):
            yield Check(f"{name} {place}", "1 <px>", "2 px", "equal", each)
        lines = {"a line": {1.0: 0.2, 10.0: 0.4}}
        yield Figure("Drawn", "Exposure / ms", "Found", lines, [(2.0, 2.0, "one place"), (3.0, 5.0, "range")])
        if not agree:
            raise NotRun("needs a thing")

    return Item(name, f"Title of {name}", "Figure 1", "a setting", parts).run(NONE)


def test_page_and_table(tmp_path):
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
