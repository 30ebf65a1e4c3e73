"""Numbers as they are typed: ranges with their ends, and the number that is meant."""

from __future__ import annotations

import pytest
from blurnoise_eval.grid.axes import axis
from blurnoise_eval.grid.values import numbers


@pytest.mark.parametrize(
    ("text", "count"), [("0.1:0.3:0.1", 3), ("0:0.7:0.1", 8), ("1:2:0.4", 3), ("5:1:-2", 3)]
)
def test_a_range_has_its_end_where_steps_meet_it(text: str, count: int) -> None:
    assert len(numbers(text)) == count


def test_ms_are_the_nearest_numbers_of_s() -> None:
    assert axis("exposure_s").values("9,13,36,43") == (0.009, 0.013, 0.036, 0.043)
