"""Numbers as they are typed: lists, ranges with their ends, and the number that is meant."""

from __future__ import annotations

import pytest
from blurnoise_eval.grid.axes import axis, numbers


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("5", [5]),
        ("-2.5,1e3", [-2.5, 1000]),
        ("1:10:3", [1, 4, 7, 10]),
        ("0:1:0.1", [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]),
        ("10:0:-5", [10, 5, 0]),
        ("2:250", [2, 3, 10, 30, 100, 250]),
        ("0:1000", [0, 10, 30, 100, 300, 1000]),
        ("0.5:5", [0.5, 1, 3, 5]),
    ],
)
def test_lists(text: str, expected: list[float]) -> None:
    assert numbers(text) == pytest.approx(expected)


@pytest.mark.parametrize(
    "text",
    ["", "a", "1,", "2:1", "-1:2", "1:inf", "nan:1", "1:1", ":", "1:2:0", "1:2:-1", "1:2:3:4", "0:1:1e-9", "nan:1:1"],
)  # fmt: skip
def test_bad_lists(text: str) -> None:
    with pytest.raises(ValueError, match="must be numbers as 1,5,10, start:stop:step"):
        numbers(text)


def test_ms_are_the_nearest_numbers_of_s() -> None:
    assert axis("exposure_s").values("9,13,36,43") == (0.009, 0.013, 0.036, 0.043)
