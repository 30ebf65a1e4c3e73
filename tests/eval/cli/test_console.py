"""What a sweep prints first: plain, nothing cut at any width, the same facts as the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.cli.console import print_opening
from made_runs import made_run
from rich.cells import cell_len

Output = pytest.CaptureFixture[str]
WIDE = {
    "groups": {f"objects of a rather long name, number {i} (32-96 px)": 0.95 - i / 20 for i in range(9)},
    "lights_lux": (0.5, 5.0, 50.0, 5000.0),
    "speeds": (0.0, 300.0, 1000.0, 3000.0),
    "models": ("a_model_of_one_very_long_name_v2_int8", "b", "c"),
}


@pytest.mark.parametrize(
    "shape",
    [{}, {"interval": False}, {"kind": "reader"}, {"groups": {}}, WIDE, WIDE | {"f_numbers": (1.4, 2.8)}],
    ids=["one model", "few pictures", "reader", "no targets", "three models", "a further axis"],
)
def test_the_first_screen_fits_and_has_no_colour(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch, shape: dict[str, Any]
) -> None:
    data = made_run(tmp_path, n_examples=0, **shape)
    for wide in (40, 60, 80, 100, 160):
        monkeypatch.setenv("COLUMNS", str(wide))
        print_opening(data)
        lines = capsys.readouterr().out.splitlines()
        assert lines
        assert max(map(cell_len, lines)) <= wide
        assert not any("\x1b" in line or "…" in line for line in lines)
        assert wide < 80 or len(lines) <= (20 if data.manifest["models"][1:] == [] else 40)
