"""``blurnoise explore`` without its page: what it writes, and what it refuses."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.datasets import read_picture, write_picture
from commands import Output, main, pixels


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    found = importlib.util.find_spec

    def without(name: str, *rest: str) -> object:
        return None if name == "nicegui" else found(name, *rest)

    monkeypatch.setattr(importlib.util, "find_spec", without)
    assert main(["explore"]) == 2
    told = capsys.readouterr().err
    assert 'pip install "blurnoise[explore]"' in told
    assert told.count("\n") == 1


def test_a_picture_is_written_as_simulate_writes_it(tmp_path: Path, capsys: Output) -> None:
    write_picture(tmp_path / "a.png", pixels((40, 60, 3)))
    at = ["--exposure-ms", "12", "--lux", "30", "--dx", "400", "--camera", "imx249", "--seed", "3"]
    assert main(["simulate", str(tmp_path / "a.png"), "-o", str(tmp_path / "s.png"), *at]) == 0
    capsys.readouterr()
    query = "exposure-ms=12&lux=30&dx=400&gain=0&seed=3&camera=imx249"
    words = ["explore", str(tmp_path / "a.png"), "-o", str(tmp_path / "e.png"), "--model", "none"]
    assert main([*words, "--at", query, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["blur_px"] == pytest.approx(4.8)
    assert "confidence" not in told
    assert np.array_equal(read_picture(tmp_path / "e.png"), read_picture(tmp_path / "s.png"))
