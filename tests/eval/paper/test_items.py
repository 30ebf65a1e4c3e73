"""Items held to measurements that are made up, whose verdicts are known."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.detectors.ocr import Reading
from blurnoise_eval.paper import chart_items, network_items, table
from blurnoise_eval.paper.item import Item, Outcome, Parts
from blurnoise_eval.paper.measurement import CHAINS, Charts, Measurements, NotRun, Saturation, Signs

from blurnoise.metrics.values import Estimate

WITHHELD = Estimate(math.nan)
SIC = partial(chart_items.peaks, "sic_square", "SIC", "bits/px")
NEQ = partial(chart_items.peaks, "neq_integral", "NEQ", "quanta/px")


def measured(made: Callable[[Any], Any]) -> Measurements:
    """Measurements that are made up instead."""

    class MadeUp(Measurements):
        def __getitem__(self, of: Any) -> Any:
            return made(of)

    return MadeUp(None, None)  # type: ignore[arg-type]


def charts(value: Callable[[str, float, float], Estimate]) -> Measurements:
    """Charts of which ``value`` tells the metric at ms and px/s."""

    def made(of: Charts) -> dict[tuple[str, float, float], Estimate]:
        names = ("mtf50_x", "patch_snr_dark", "patch_snr_bright", "edge_snr_db", "sic_square", "neq_integral")
        return {
            (name, ms, v): value(name, ms, v)
            for name in names
            for ms in of.exposures_ms
            for v in of.speeds_px_s
        }

    return measured(made)


def signs(confidence: Callable[[int, float, float], float]) -> Measurements:
    """Signs whose confidence is that of size, ms and px/s, in both chains."""

    def made(of: Signs) -> dict[tuple[int, float, float], float]:
        return {
            (size, ms, dx): confidence(size, ms, dx)
            for size in of.sizes_px
            for ms in of.exposures_ms
            for dx in of.speeds_px_s
        }

    return measured(made)


def run(item: Callable[..., Parts], measured: Measurements) -> Outcome:
    judged = next((each.judged for each in table.ITEMS if each.of is item), None)
    return Item("made", "Made up", "Figure 1", "", item, judged).run(measured)


def verdicts(found: Outcome) -> list[bool | None]:
    return [check.agrees for check in found.checks]


def of_paper(found: Outcome) -> list[bool | None]:
    assert {check.agrees for check in found.checks if check.chain == "camera"} == {None}
    return [check.agrees for check in found.checks if check.chain == "paper"]


def flat(slope: float, speed_slope: float = -1e-4, clips_ms: float = 25.0) -> Callable[..., Estimate]:
    def value(name: str, ms: float, v: float) -> Estimate:
        return (
            WITHHELD
            if ms > clips_ms
            else Estimate(0.27 * (1 + slope * (ms - 15)) + speed_slope * v, 0.0, 0.0)
        )

    return value


def test_mtf50_over_exposure() -> None:
    assert verdicts(run(chart_items.mtf50_over_exposure, charts(flat(0.0)))) == [True, True, True]
    assert verdicts(run(chart_items.mtf50_over_exposure, charts(flat(0.002)))) == [False, True, True]
    assert verdicts(run(chart_items.mtf50_over_exposure, charts(flat(0.0, 1e-4)))) == [True, True, False]
    assert verdicts(run(chart_items.mtf50_over_exposure, charts(flat(0.0, clips_ms=99)))) == [
        True,
        False,
        True,
    ]
    assert verdicts(run(chart_items.mtf50_over_exposure, charts(flat(0.0, clips_ms=15)))) == [
        False,
        True,
        True,
    ]


@pytest.mark.parametrize("item", [chart_items.mtf50_over_exposure, NEQ, network_items.maps])
def test_what_is_withheld_everywhere_is_not_run(item: Callable[..., Parts]) -> None:
    (check,) = run(item, charts(lambda *_: WITHHELD)).checks
    assert check.verdict == "not run"
    assert re.search(r"withheld at (every exposure at 0 px/s|all but 0 of 48 conditions)", check.found)


def test_closed_form_of_the_camera() -> None:
    """At rest pixel and disc, fast the motion alone: MTF50 at 0.603355 / length."""
    assert chart_items.mtf50(0.0) == pytest.approx(0.26815, abs=1e-4)
    assert chart_items.mtf50(60.0) == pytest.approx(0.603355 / 60, rel=2e-3)


@pytest.mark.parametrize(("off", "agrees"), [(0.005, True), (0.02, False)])
def test_mtf50_over_speed(off: float, agrees: bool) -> None:
    found = run(
        chart_items.mtf50_over_speed,
        charts(lambda name, ms, v: Estimate(chart_items.mtf50(1e-3 * ms * v) * (1 + off))),
    )
    assert verdicts(found) == [True, agrees, None]
    assert found.checks[2].found == "told"


@pytest.mark.parametrize(("low", "agrees"), [(0.98, True), (1.004, True), (1.01, False)])
def test_mtf50_may_miss_the_closed_form_within_its_interval(low: float, agrees: bool) -> None:
    """Widened for seven speeds, 2.69 / 1.96 times: one of seven intervals of 95 % misses in three runs of ten."""

    def value(name: str, ms: float, v: float) -> Estimate:
        closed = chart_items.mtf50(1e-3 * ms * v)
        return Estimate(1.02 * closed, low * closed, 1.05 * closed)

    assert verdicts(run(chart_items.mtf50_over_speed, charts(value)))[1] == agrees


@pytest.mark.parametrize(("rise", "agrees"), [(0.01, True), (0.03, False)])
def test_patch_snr(rise: float, agrees: bool) -> None:
    found = run(chart_items.patch_snr, charts(lambda name, ms, v: Estimate(13 * (1 + rise * v / 1000))))
    assert verdicts(found) == [agrees, None]


@pytest.mark.parametrize(("spread_db", "agrees"), [(0.4, True), (0.6, False)])
def test_edge_snr(spread_db: float, agrees: bool) -> None:
    def value(name: str, ms: float, v: float) -> Estimate:
        return Estimate(20 + ms + spread_db * v / 1000) if ms < 25 else WITHHELD

    assert verdicts(run(chart_items.edge_snr, charts(value))) == [agrees]


@pytest.mark.parametrize(("exponent", "agrees"), [(1.0, True), (0.98, False)])
def test_clipping(exponent: float, agrees: bool) -> None:
    def made(of: Saturation) -> dict[float, float]:
        return {lux: 1215 / lux**exponent for lux in of.lights_lux}

    assert verdicts(run(chart_items.clipping, measured(made))) == [agrees]


def test_capacity_and_quanta() -> None:
    def value(name: str, ms: float, v: float, late: float = 0.0, peak: float = 24.0) -> Estimate:
        place = peak / (1 + v / 200) + late * v
        return Estimate(2 / (1 + v / 200) - abs(ms - place) / 100) if ms < 27 else WITHHELD

    for item in (SIC, NEQ):
        assert verdicts(run(item, charts(value))) == [True, True]
        assert verdicts(run(item, charts(lambda name, ms, v: value(name, ms, v, late=0.02)))) == [True, False]
        assert verdicts(run(item, charts(lambda name, ms, v: value(name, ms, v, peak=12.0)))) == [False, True]
        assert verdicts(run(item, charts(lambda name, ms, v: value(name, ms, 0)))) == [True, False]


def test_detection_is_held_to_the_order_of_sizes() -> None:
    def found_from(first: dict[int, float], lost: dict[int, float]) -> Outcome:
        return run(
            network_items.detection,
            signs(lambda size, ms, dx: float(first[size] <= ms <= 70 and dx < lost[size])),
        )

    paper = {100: 1.0, 50: 2.0, 32: 5.0}, {100: 2000.0, 50: 600.0, 32: 200.0}
    found = found_from(*paper)
    assert of_paper(found) == [True, True, None]
    assert found.checks[0].found == "1 ms (100 px), 2 ms (50 px), 5 ms (32 px)"
    assert found.checks[1].found == "none to 1000 (100 px), 600 px/s (50 px), 200 px/s (32 px)"
    assert found.checks[2].found == "70 ms (100 px), 70 ms (50 px), 70 ms (32 px)"
    assert of_paper(found_from({100: 5.0, 50: 2.0, 32: 1.0}, paper[1])) == [False, True, None]
    assert of_paper(found_from(paper[0], {100: 200.0, 50: 600.0, 32: 600.0})) == [True, False, None]
    assert of_paper(found_from({100: 1.0, 50: 1.0, 32: 1.0}, paper[1])) == [False, True, None]


def test_detection_of_what_is_never_found() -> None:
    found = run(network_items.detection, signs(lambda size, ms, dx: float(size > 40 and dx < 15 * size)))
    assert of_paper(found) == [True, True, None]
    assert "none (32 px)" in found.checks[0].found
    assert "0 px/s (32 px)" in found.checks[1].found


def test_reading() -> None:
    ends = network_items.READ_TO_MS
    first = {32: 4.0, 50: 2.0, 100: 1.0}

    def reads(factor: float, later: float) -> Callable[[int, float, float], float]:
        return lambda size, ms, dx: float(first[size] * later <= ms <= factor * ends[size, dx])

    assert of_paper(run(network_items.reading, signs(reads(1.0, 1.0)))) == [True] * 9
    assert of_paper(run(network_items.reading, signs(reads(0.6, 1.0))))[3:] == [False] * 6
    assert of_paper(run(network_items.reading, signs(reads(1.0, 2.1))))[:3] == [False] * 3
    assert of_paper(run(network_items.reading, signs(lambda *at: 0.0))) == [False] * 9


def test_reading_over_speed() -> None:
    def reads(fails: float, last: float) -> Measurements:
        return signs(lambda size, ms, dx: float(dx < fails if size == 32 else dx <= last))

    for fails, last, agree in (
        (100.0, 350.0, [True, True]),
        (200.0, 500.0, [True, True]),
        (350.0, 100.0, [False, False]),
        (9e9, -1.0, [False, False]),
    ):
        assert of_paper(run(network_items.reading_over_speed, reads(fails, last))) == agree


def test_maps_rank_by_metrics() -> None:
    def made(best: str) -> Measurements:
        def either(of: Charts | Signs) -> Any:
            if isinstance(of, Signs):
                return {(32, ms, dx): ms + dx for ms in of.exposures_ms for dx in of.speeds_px_s}
            return {
                (name, ms, v): Estimate(ms + v if best in name else ms - v)
                for name in ("mtf50_x", "patch_snr_bright", "sic_square", "neq_integral")
                for ms in of.exposures_ms
                for v in of.speeds_px_s
            }

        return measured(either)

    def judged(best: str) -> list[bool | None]:
        return [
            check.agrees for check in run(network_items.maps, made(best)).checks if check.chain == "camera"
        ]

    assert judged("q") == [True]  # sic_square and neq_integral
    assert judged("sic") == [False]
    assert judged("mtf") == [False]


def test_without_a_reader_text_is_not_run() -> None:
    item = network_items.READ_AT_30_MS["paper"]
    with pytest.raises(NotRun, match="blurnoise\\[ocr\\]"):
        item.measure(Measurements(None, None))  # type: ignore[arg-type]


class Reads:
    """A reader that reads STOP in all but every third picture."""

    name, path, sha256, non_finite_values_here = "reads", Path("reads.onnx"), "", 0

    def __init__(self) -> None:
        self.seen = 0

    def read(self, image: Any, boxes_xyxy: Any) -> list[Reading]:
        self.seen += 1
        return [Reading("STEP" if self.seen % 3 == 0 else "STOP", 0.9)] * len(boxes_xyxy)


def test_a_reading_counts_where_every_noise_field_does() -> None:
    item = Signs("paper", True, (32,), (5, 20), (0.0,))
    found = item.measure(Measurements(None, Reads(), repeats=1))  # type: ignore[arg-type]
    assert found == {(32, 5.0, 0.0): 0.0, (32, 20.0, 0.0): 0.0}  # of eight fields each, some are read wrong


def test_both_chains_are_measured() -> None:
    assert [network_items.READ_AT_30_MS[chain].chain for chain in CHAINS] == ["paper", "camera"]
