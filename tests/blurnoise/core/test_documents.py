"""Documents made to exhaust their reader: refused in one line, at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from blurnoise._core.checks import shown
from blurnoise._core.files import json_of, read_document, yaml_of


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        pytest.param("a.yaml", "[" * 100_000, "nested too deeply", marks=pytest.mark.slow),
        ("a.yaml", "a: " * 100_000, "mapping values are not allowed here"),
        ("a.yaml", "a: !!int ''", "index out of range"),
        ("a.yaml", "a: " + "1" * 5000, "integer string conversion"),
        ("a.yaml", "x" * (1 << 20) + "x", "larger than 1048576 bytes"),
        ("a.json", "[" * 100_000, "nested too deeply"),
        ("a.json", '{"a": ' * 100_000, "nested too deeply"),
        ("a.json", "1" * 5000, "integer string conversion"),
        ("a.json", " " * (1 << 20) + "1", "larger than 1048576 bytes"),
    ],
)
def test_hostile_documents_are_refused_in_a_line(tmp_path: Path, name: str, text: str, fault: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=fault) as caught:
        read_document(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_file_without_end_is_no_document() -> None:
    with pytest.raises(OSError, match="device"):
        read_document(Path("/dev/zero"))


def test_a_few_aliases_are_fine() -> None:
    assert yaml_of("mean: &half [0.5, 0.5]\nstd: *half\n") == {"mean": [0.5, 0.5], "std": [0.5, 0.5]}
    assert json_of("[NaN, 1]")[1] == 1


def test_values_are_shown_short_whatever_they_hold() -> None:
    bomb: list[object] = ["ha"]
    for _ in range(40):
        bomb = [bomb] * 9
    itself: list[object] = []
    itself.append(itself)
    for value in (bomb, itself, "x" * 10**6, 10**400, {"a": bomb}, ["\n" * 50] * 50):
        text = shown(value)
        assert "\n" not in text
        assert len(text) <= 120
    assert [shown(value) for value in ("1e4", [1], -1.0, None)] == ["'1e4'", "[1]", "-1.0", "None"]
