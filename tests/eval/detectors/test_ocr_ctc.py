from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.detectors.ocr import character_error_rate
from blurnoise_eval.detectors.ocr.recogniser import are_probabilities, characters, decode
from hypothesis import given
from hypothesis import strategies as st

CLASSES = characters("a\nb\nc")  # blank, a, b, c, space
labels = st.lists(st.integers(0, 4), min_size=1, max_size=30)
words = st.text("abcdü ☃", max_size=12)


def sure(path: list[int], probability: float = 0.9) -> np.ndarray:
    rows = np.full((len(path), 5), (1 - probability) / 4, np.float32)
    rows[np.arange(len(path)), path] = probability
    return rows


# --- decoding ---


@given(labels)
def test_decoding_drops_repeats_then_blanks(path: list[int]) -> None:
    """Against the definition, letter by letter."""
    expected, previous = "", 0
    for label in path:
        if label != previous and label != 0:
            expected += " abc "[label]
        previous = label
    reading = decode(sure(path), CLASSES)
    assert reading.text == expected
    assert reading.confidence == pytest.approx(0.9 if expected else 0)


def test_repeats_count_once_and_at_their_first_step() -> None:
    rows = np.concatenate([sure([1], 0.6), sure([1], 0.99), sure([0], 0.99), sure([1], 0.8)])
    reading = decode(rows, CLASSES)
    assert reading.text == "aa"
    assert reading.confidence == pytest.approx(0.7)


# --- dictionary ---


@given(st.lists(st.text(st.characters(exclude_characters="\n\r"), min_size=1, max_size=2), min_size=1))
def test_a_line_feed_alone_ends_a_line(lines: list[str]) -> None:
    """Dictionaries hold U+2028, U+0085 and U+3000, which str.splitlines and str.strip would eat."""
    expected = ["", *lines, " "]
    assert characters("\n".join(lines)) == expected
    assert characters("\n".join(lines) + "\n") == expected


# --- probabilities and logits ---


@pytest.mark.parametrize(
    "rows", [[[0, 0, 0]], [[1.5, -0.5, 0]], [[0.4, 0.4, 0.4]], [[1, 0, 0], [5, 1, 2]], [[-1, -2, -3]]]
)
def test_what_is_no_probability(rows: list[list[float]]) -> None:
    assert not are_probabilities(np.array(rows, np.float32))


# --- character error rate ---


@pytest.mark.parametrize(
    ("read", "truth", "rate"),
    [
        ("STOP", "STOP", 0),
        ("SOP", "STOP", 1 / 4),
        ("stop", "STOP", 1),
        ("STOPSTOP!", "STOP", 5 / 4),
        ("kitten", "sitting", 3 / 7),
        ("TSOP", "STOP", 2 / 4),  # a swap is two errors
        ("", "", 0),
        ("x", "", 1),
    ],
)
def test_known_rates(read: str, truth: str, rate: float) -> None:
    assert character_error_rate(read, truth) == pytest.approx(rate)
