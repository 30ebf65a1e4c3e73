"""What ends a window, and what holds the best exposure back: lines worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.answers.limits import Limits, Line, of_best, of_window
from made_tables import table
from numpy.typing import NDArray

X_S = (0.001, 0.004, 0.016, 0.064)
AIMED = (0.4, 0.4, 0.4, 0.4)
WHITE = (0.0, 0.0, 0.0, 0.5)
UNKNOWN = (np.nan,) * 4


def line(
    value: tuple[float, ...],
    slower: tuple[float, ...] | None = None,
    *,
    moves: bool = True,
    saturated: tuple[float, ...] = (0.0,) * 4,
    brightness: tuple[float, ...] = AIMED,
) -> Line:
    shown = {"saturated": np.array(saturated)[:, None], "brightness": np.array(brightness)[:, None]}
    of = table(np.array(value)[None, :, None], X_S, [(100.0 * moves, 0.0)], **shown)
    return Line(of, None if slower is None else np.array(slower))


HILL = (0.2, 0.9, 0.95, 0.3)
HELD = (0.2, 0.9, 0.96, 0.97)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (line(HILL, HELD), ("noise", "blur")),
        (line(HILL, HELD, saturated=WHITE), ("noise", "blur")),  # at rest it works, white as it may be
        (line(HILL, HILL, saturated=WHITE), ("noise", "saturation")),
        (line(HILL, HILL), ("noise", None)),
        (line(HILL, moves=False, saturated=WHITE), ("noise", "saturation")),
        (line(HILL, moves=False), ("noise", None)),
        (line(HILL), ("noise", "blur")),  # moves, and nothing saturates
        (line(HILL, saturated=WHITE), ("noise", None)),  # one of the two
        (line(HILL, saturated=UNKNOWN), ("noise", None)),
        (
            line(HILL, HILL, saturated=(0.0, 0.01, 0.9, 0.9)),
            ("noise", "saturation"),
        ),  # white at its best, too
        (line(HILL, HELD, brightness=(0.32, *AIMED[1:])), ("darkness", "blur")),
        (line(HILL, HELD, brightness=(0.34, 0.1, 0.1, 0.1)), ("noise", "blur")),  # where it fails counts
        (line(HILL, HELD, brightness=UNKNOWN), (None, "blur")),
        (line((0.9, 0.9, 0.9, 0.9), HELD), (None, None)),
    ],
)
def test_ends_of_a_window(given: Line, expected: tuple[str | None, str | None]) -> None:
    works = [place for place, value in enumerate(given.of.mean) if value >= 0.8]
    window = X_S[works[0]] * (0.5 if works[0] else 1.0), X_S[works[-1]] * (2.0 if works[-1] < 3 else 1.0)
    found = of_window(given, window, 0.8)
    assert (found.low, found.high) == expected
    assert found.by is None


def test_lamps_are_no_saturation() -> None:
    """Half of the picture is white at the window's best, too."""
    assert of_window(line(HILL, saturated=(0.5, 0.5, 0.5, 0.505)), (0.002, 0.03), 0.8).high == "blur"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (line((0.2, 0.5, 0.4, 0.1), (0.2, 0.6, 0.8, 0.9)), "blur and noise"),
        (line((0.2, 0.6, 0.4, 0.1), (0.2, 0.6, 0.8, 0.9)), "blur and noise"),  # blur keeps from more light
        (line((0.1, 0.3, 0.5, 0.6), (0.1, 0.3, 0.5, 0.6), brightness=(0.1,) * 4), "darkness"),  # as at rest
        (line((0.1, 0.3, 0.5, 0.6), (0.1, 0.3, 0.7, 0.8)), "blur and noise"),
        (line((0.1, 0.3, 0.5, 0.6), (0.1, 0.3, 0.6, 0.61), brightness=(0.1,) * 4), None),
        (line((0.2, 0.5, 0.4, 0.1), (0.2, 0.6, 0.8, 0.9), brightness=(0.1,) * 4), "blur and darkness"),
        (line((0.2, 0.5, 0.1, 0.1), (0.2, 0.7, 0.7, 0.7)), "blur"),
        (line((0.1, 0.5, 0.1, 0.1), (0.6, 0.5, 0.5, 0.5)), "saturation"),
        (line((0.1, 0.2, 0.3, 0.5), moves=False), "noise"),
        (line((0.1, 0.2, 0.3, 0.5), moves=False, brightness=(0.1,) * 4), "darkness"),
        (line((0.1, 0.5, 0.5, 0.1), moves=False, saturated=WHITE), "noise"),
        (line((0.1, 0.4, 0.5, 0.1), moves=False, saturated=WHITE), "noise and saturation"),
        (line((0.1, 0.4, 0.5, 0.1)), "noise and blur"),
        (line((0.5, 0.5, 0.5, 0.5), moves=False), None),
    ],
)
def test_what_holds_the_best_back(given: Line, expected: str | None) -> None:
    found = of_best(given, int(given.of.mean.argmax()))
    assert found.by == expected


@pytest.mark.parametrize("slower", [None, np.array([0.5])])
def test_of_a_single_exposure_nothing_beside_it_tells(slower: NDArray[np.float64] | None) -> None:
    only = Line(table(np.array([[[0.5]]]), (0.01,), [(100.0, 0.0)]), slower)
    assert of_best(only, 0) == Limits()
