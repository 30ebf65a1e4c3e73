"""Tables and paragraphs at every width: no line longer, no number broken, nothing lost."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence

import pytest
from blurnoise_eval.system.layout import PROSE, paragraph, rule, table
from rich.cells import cell_len

WIDTHS = (24, 40, 60, 80, 100, 160)
LETTERS = "abcdefghijklmnop_-0123456789éßЖ止標識"
WORDS = ("left", "out,", "below", "0.3", "DN", "RMS", "(the", "camera's", "own)", "≥", "µm", "nothing")


def made_table(seed: int) -> tuple[list[str], list[list[str]], list[bool]]:
    """Models of names of 5 to 60 letters, or settings, then numbers with intervals; the last column may be prose."""
    chance = random.Random(seed)  # a test's
    heads = [
        "model",
        *chance.sample(["P", "mPC", "AUC\nexposure", "works up to", "ms", "use", "gain"], 4 + seed % 4),
    ]
    right = [False, *[chance.random() < 0.8 for _ in heads[1:]]]
    rows = [
        ["".join(chance.choices(LETTERS, k=chance.randint(5, 60))), *(_number(chance) for _ in heads[1:])]
        for _ in range(chance.randint(1, 4))
    ]
    if seed % 3 == 0:
        heads, right = [*heads, "how"], [*right, False]
        rows = [[*row, " ".join(chance.choices(WORDS, k=chance.randint(0, 30)))] for row in rows]
    return heads, rows, right


def _number(chance: random.Random) -> str:
    value = 10 ** chance.uniform(-3, 4)
    return chance.choice(
        [f"{value:.3g}", f"{value:.2f} ({value / 2:.2f}–{2 * value:.2f})", f"≥ {value:.0f} px/s", ""]
    )


def flat(parts: Sequence[Sequence[str]]) -> list[str]:
    return [line for part in parts for line in part]


@pytest.mark.parametrize("width", WIDTHS)
def test_tables_fit_and_lose_nothing(width: int) -> None:
    for seed in range(60):
        heads, rows, right = made_table(seed)
        top, *bodies = table(heads, rows, right, width)
        lines = flat([top, *bodies])
        assert max(map(cell_len, lines)) <= width, seed
        assert "…" not in "".join(lines)
        for row, body in zip(rows, bodies, strict=True):
            told = re.sub(r"\s", "", "".join(body))
            assert row[0] in told if cell_len(row[0]) <= width else row[0][:8] in told
            for cell, numbers in zip(row[1:], right[1:], strict=True):
                for word in cell.split():
                    assert any(word in line.split() for line in body), (seed, word, body)
                if numbers and cell_len(cell) <= width - 2:
                    assert any(cell in line for line in body), (seed, cell, body)
        heading = " ".join(top) or " ".join(flat(bodies))
        assert [
            word
            for head in heads[1:]
            for word in head.split()
            if word not in heading and any(row[heads.index(head)] for row in rows)
        ] == []


def test_without_a_terminal_a_row_is_a_line() -> None:
    heads, rows, right = made_table(3)
    top, *bodies = table(heads, rows, right, None)
    assert [len(body) for body in bodies] == [1] * len(rows)
    for row, (line,) in zip(rows, bodies, strict=True):
        assert [cell for cell in row if cell not in line] == []
    assert len(rule([top, *bodies])) == max(map(cell_len, flat([top, *bodies])))


def test_columns_stand_below_each_other_as_long_as_they_can() -> None:
    heads, right = ["model", "P", "AUC\nexposure"], [False, True, True]
    rows = [["止標識", "0.5", "12.5 (9.1–20.0)"], ["b" * 30, "10", "-"]]
    assert table(heads, rows, right, 80) == [
        [" " * 49 + "AUC", f"{'model':30}    P         exposure"],
        [f"止標識{' ' * 24}  0.5  12.5 (9.1–20.0)"],
        [f"{'b' * 30}   10                -"],
    ]
    assert table(heads, rows, right, 40) == [
        ["model", "                   AUC", "    P         exposure"],
        ["止標識", "  0.5  12.5 (9.1–20.0)"],
        ["b" * 30, "   10                -"],
    ]
    assert table(heads, rows[:1], right, 20) == [
        [],
        ["止標識", "  P 0.5  AUC", "  exposure", "  12.5 (9.1–20.0)"],
    ]


def test_prose_is_wrapped_before_a_row_becomes_a_record() -> None:
    top, body = table(["figure", "source"], [["well", " ".join(["word"] * 20)]], [False, False], 40)
    assert top == ["figure  source"]
    assert body[:2] == ["well    word word word word word word", "        word word word word word word"]


@pytest.mark.parametrize("width", [None, *WIDTHS])
def test_paragraphs_keep_words_and_the_spaces_between(width: int | None) -> None:
    text = (
        "Which gain?      46 dB at 0.5 lux, 14 dB at 50 lux, of a/"
        + "long/" * 30
        + "path, and 止標識 0.87 (0.81–0.92)"
    )
    lines = paragraph(text, width, 2, 6)
    assert lines[0].startswith("  Which gain?      46")
    assert all(line.startswith(" " * 6) for line in lines[1:])
    assert re.sub(r"\s", "", "".join(lines)) == re.sub(r"\s", "", text)
    assert not any(line.endswith(" ") for line in lines)
    if width is None:
        assert any("long/" * 30 in line for line in lines)
    longest = max(cell_len(line) for line in lines if width or "long" not in line)
    assert longest <= (width or PROSE)
