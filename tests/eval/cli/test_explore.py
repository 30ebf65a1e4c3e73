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


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--at", "lux=1,2"], "lux = '1,2': must be a number"),
        (["--at", "picture=sign-99"], "picture = 'sign-99': is not here"),
        (["--cell", "abc"], "cell: goes with a run"),
        (["--camera", "nikon"], "nikon"),
        (["--at", "prnu=much"], "prnu = 'much': must be a number"),
        (["--at", "colour=3"], "colour = '3': must be one of"),
        (["--at", "f_number=-1"], "f_number = -1"),
        (["nowhere.png"], "nowhere.png"),
        (["."], "results.sqlite"),
        (["--at", "seed=-1"], "seed"),
        (["--at", "dx=100&ego-kmh=50"], "ego_speed_m_s = 13.8"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(
    words: list[str], told: str, tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["explore", *words, "-o", "seen.png"]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("option", "now"), [("--lux", "lux=..."), ("--sign", "picture=sign-N")])
def test_options_of_before_are_named(option: str, now: str, capsys: Output) -> None:
    with pytest.raises(SystemExit):
        main(["explore", option, "5"])
    assert f"{option} is now --at '{now}'" in capsys.readouterr().err
