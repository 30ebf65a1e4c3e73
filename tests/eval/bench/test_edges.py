"""The bench of deceitful edges: none is a plain wrong number, honest ones are left alone, and it says where not."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from blurnoise_eval.bench import edges, edges_view
from blurnoise_eval.bench.edge_cases import CASES, Case, Draw, Setting, usual
from blurnoise_eval.bench.edges import CAUGHT, SPARED, Bench, Extent, judged

WRONG = [case for case in CASES if case.deceives and not case.silent]
HONEST = [case for case in CASES if not case.deceives]
HELD_OUT = range(1000, 1100)
"""Seeds that no threshold was chosen by."""


@pytest.mark.parametrize("case", WRONG, ids=lambda case: case.name)
def test_no_plain_wrong_number(case: Case) -> None:
    row = judged(case, range(2))
    assert row.caught == 1, row


@pytest.mark.slow
def test_honest_edges_are_left_alone() -> None:
    for case in HONEST:
        row = judged(case, range(1))
        assert row.caught == 0, row


@pytest.mark.slow
@pytest.mark.parametrize("case", WRONG, ids=lambda case: case.name)
def test_no_plain_wrong_number_on_held_out_seeds(case: Case) -> None:
    row = judged(case, HELD_OUT)
    assert row.caught >= CAUGHT, row


@pytest.mark.slow
@pytest.mark.parametrize("case", HONEST, ids=lambda case: case.name)
def test_honest_edges_are_left_alone_on_held_out_seeds(case: Case) -> None:
    row = judged(case, HELD_OUT)
    assert row.caught <= SPARED, row


@pytest.mark.slow
def test_cases_deceive_by_more_than_3_percent_or_cannot_be_measured() -> None:
    """What a case does is wrong, not only odd; denoising and the sums of errors of a bar come out near the truth."""
    near = {"non-local means", "bright bar 2 px wide"}
    for case in WRONG:
        error = judged(case, range(2)).error
        assert case.name in near or not abs(error) < 0.03, (case.name, error)


def test_plain_wrong_is_beyond_the_interval_and_without_a_flag() -> None:
    """A strong symmetric tone curve passes for an edge that is sharper; against its own truth an edge is right."""
    case = next(case for case in CASES if case.name == "S-shaped tone curve, noise after")
    row = judged(case, range(6), "any")
    assert 0 < row.wrong <= 1 - row.caught + 1e-9, row
    draw = Draw.of(1)
    at = usual(draw)
    picture = at.noisy(at.edge(), draw)
    assert not edges._plain_wrong(picture, at.mtf50)
    assert edges._plain_wrong(picture, 1.1 * at.mtf50)
    assert not edges._plain_wrong(torch.zeros_like(picture), at.mtf50)  # withheld


def test_a_picture_hangs_on_its_seed_alone() -> None:
    for case in CASES[::7]:
        first, again, other = (
            case.make(usual(draw), draw) for draw in (Draw.of(3, 1), Draw.of(3, 1), Draw.of(3, 2))
        )
        assert torch.equal(first, again)
        assert not torch.equal(first, other)


def test_rows_moved_by_nothing_are_the_edge() -> None:
    at = Setting(offset_px=(0.3, -0.4), height_px=31, width_px=42)
    torch.testing.assert_close(at.edge_by_rows([0.0] * 31), at.edge(), rtol=0, atol=1e-12)


def test_bench_is_written_and_says_where_it_loses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = (WRONG[0], HONEST[0])
    monkeypatch.setattr(edges, "CASES", few)
    monkeypatch.setattr(edges, "NOISES", edges.NOISES[:2])
    told: list[float] = []
    bench = edges.measure(Extent(pictures=2, noisy=12), threads=1, progress=told.append)
    assert sum(told) == edges.steps(bench.extent)
    edges.write(bench, tmp_path)
    edges_view.write(bench, tmp_path)
    document = json.loads((tmp_path / "edges.json").read_text())
    assert [row["case"] for row in document["rows"]] == 2 * [case.name for case in few]
    assert (tmp_path / "edges.png").stat().st_size > 1000
    assert len(edges_view.tables(bench)) == 2
    white, filtered = bench.noises
    assert not white.neq_0_flagged
    assert filtered.neq_0_flagged == 1
    assert filtered.neq_0 == pytest.approx(1, rel=0.3)
    usual_rows = [row for row in bench.rows if row.setting == "usual"]
    worse = [replace(usual_rows[0], flagged=0.5), replace(usual_rows[1], flagged=0.1)]
    assert len(Bench(worse, [], bench.extent).losses()) == 2
    assert not Bench(usual_rows, [], bench.extent).losses()


def test_noise_of_a_kind_has_variance_1() -> None:
    """The mean over 40 fields of 60 x 60: known to 1 % where white, to 6 % where correlated over 28 px."""
    for _, sigma_px in edges.NOISES:
        fields = [edges._field(Draw.of(seed), (60, 60), sigma_px) for seed in range(40)]
        assert np.mean([float(field.square().mean()) for field in fields]) == pytest.approx(1, abs=0.2)
    assert math.isnan(edges._power_at_0(0.0))
    assert edges._power_at_0(1.5) == pytest.approx(4 * math.pi * 1.5**2, rel=0.01)
