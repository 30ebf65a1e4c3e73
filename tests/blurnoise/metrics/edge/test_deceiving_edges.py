"""Deceiving edges are withheld or flagged, honest ones are left alone."""

from __future__ import annotations

import edge_cases
import pytest
import torch
from edge_cases import CASES, CAUGHT, SPARED, Case, Draw, Setting, judged, usual

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
    assert not edge_cases._plain_wrong(picture, at.mtf50)
    assert edge_cases._plain_wrong(picture, 1.1 * at.mtf50)
    assert not edge_cases._plain_wrong(torch.zeros_like(picture), at.mtf50)  # withheld


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
