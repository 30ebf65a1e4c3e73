"""What is printed: text of any origin as it stands, whatever a terminal or rich would make of it."""

import warnings

import pytest
from blurnoise_eval.system import progress
from blurnoise_eval.system.progress import ProgressBar, duration_text
from blurnoise_eval.system.terminal import paragraph, plain, plain_warnings, say, shortened, table_lines
from rich.cells import cell_len

Output = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Schild 止まれ [/] é", "Schild 止まれ [/] é"),
        ("red \x1b[31m\x07.png", "red ?[31m?.png"),
        ("\x9b2J", "?2J"),
        ("one\ntwo\rthree\u2028four", "one two three four"),
        ("left\u202eright", "left?right"),
        ("lone \udcff", "lone ?"),
    ],
)
def test_text_is_one_line_that_steers_nothing(text, shown, capsys):
    assert plain(text) == shown
    say(text, text)
    assert capsys.readouterr() == (f"{shown}\n{shown}\n", "")
    say(text, error=True)
    assert capsys.readouterr() == ("", f"{shown}\n")


def test_warnings_are_a_plain_line():
    before = warnings.formatwarning
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with plain_warnings():
            warnings.warn("model \x1b[31m\nsays", RuntimeWarning, stacklevel=1)
            warnings.warn("Glyph 27490 (X) missing from font(s) DejaVu Sans.", UserWarning, stacklevel=1)
            lines = [warnings.formatwarning(each.message, each.category, "", 1) for each in told]  # type: ignore[arg-type]
    assert lines == ["blurnoise: warning: model ?[31m says\n"]
    assert warnings.formatwarning is before


@pytest.mark.parametrize("columns", [24, 40, 80, None])
def test_tables_fit_and_lose_nothing(columns):
    heads = ["model", "P", "AUC\nexposure", "how"]
    rows = [["止標識" * 5, "0.5", "12.5 (9.1–20.0)", "left out " * 9], ["b" * 30, "10", "≥ 5 px/s", ""]]
    lines = table_lines(heads, rows, [False, True, True, False], columns)
    assert max(map(cell_len, lines)) <= (columns or 200)
    found, given = (
        sorted("".join("".join(each).split()).replace("-", ""))
        for each in (lines, [*heads, *rows[0], *rows[1]])
    )
    assert found == given
    assert columns or len(lines) == 2 + 1 + 2, "a row is a line where there is no terminal"


@pytest.mark.parametrize("columns", [None, 40])
def test_paragraphs_keep_words_and_the_spaces_between(columns):
    text = f"Which gain?      46 dB at 0.5 lux, 14 dB at 50 lux, of a/{'long/' * 30}path"
    lines = paragraph(text, columns, 2, 6)
    assert lines[0].startswith("  Which gain?      46")
    assert all(line.startswith(" " * 6) for line in lines[1:])
    assert "".join("".join(lines).split()) == "".join(text.split())
    assert any("long/" * 30 in line for line in lines) == (columns is None), "not broken, to be copied"
    assert columns is None or max(map(len, lines)) <= columns


def test_a_long_text_keeps_its_begin_and_its_end():
    assert shortened("a" * 20 + "b" * 980) == "a" * 20 + "b" * 980
    assert shortened("a" * 600 + "b" * 600) == f"{'a' * 500} ... {'b' * 500}"


# --- progress ---


@pytest.fixture
def now(monkeypatch):
    """The clock, s."""
    clock = [100.0]
    monkeypatch.setattr(progress, "monotonic", lambda: clock[0])
    return clock


def test_a_log_says_how_far_it_is_and_when_it_ends(now, capsys):
    with ProgressBar("draw \x1b", 100) as advance:
        for _ in range(100):
            now[0] += 4.0
            advance(1)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "draw ?: 3 of 100, 3 %, 0.25/s, 6 min left"
    assert lines[-1] == "draw ?: 100 of 100, took 7 min"
    assert len(lines) == 2 + 6  # after 12 s, then each minute, and the end


def test_durations_have_the_unit_that_fits():
    texts = {0: "0 s", 89: "89 s", 720: "12 min", 12_000: "3 h 20 min"}
    assert {seconds: duration_text(seconds) for seconds in texts} == texts
