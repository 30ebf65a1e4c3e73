"""Settings are told apart by what varies; words, tables and the terminal say that and nothing else."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.grid.axes import AXES, SETTING_AXES, axis
from blurnoise_eval.report import figures, findings, tables, words
from blurnoise_eval.report.charts import views
from blurnoise_eval.report.opening import opening
from blurnoise_eval.report.page import write_report
from blurnoise_eval.report.settings import Settings, axis_label, word
from made_runs import made_run
from read_pages import Page


def test_the_light_alone_names_the_settings_of_a_usual_run(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)
    assert [axis.name for axis in data.settings.axes] == ["illuminance_lux"]
    assert data.settings.every == ((10.0,), (200.0,))
    assert data.settings.held == "25 °C · f/1.4 · defocus 0 px · gain 0 dB · all moves · 0 km/h"
    row = next(row for row in data.scores if row["exposure_s"] == 0.004 and row["velocity_x_px_s"] == 600)
    assert data.settings.condition_text(row) == "4 ms · 10 lux · 600 px/s · blur 2.4 px"
    assert data.settings.condition_text(data.scores[0]) == "original picture"
    assert "over 2 lights, 2 speeds and 2 kinds of target," in opening(data).sentences[0]


def test_what_else_varies_is_named_everywhere(tmp_path: Path) -> None:
    data = made_run(tmp_path, f_numbers=(1.4, 2.8), temperatures_c=(25.0, 85.0), n_examples=0)
    settings = data.settings
    assert [axis.name for axis in settings.axes] == ["illuminance_lux", "temperature_c", "f_number"]
    assert len(settings.every) == 2 * 2 * 2
    assert settings.text(settings.every[-1]) == "200 lux · 85 °C · f/2.8"
    assert settings.held == "defocus 0 px · gain 0 dB · all moves · 0 km/h"
    assert findings.run_facts(data)["held"] == settings.held
    row = data.scores[-1]
    assert settings.condition_text(row) == "64 ms · 200 lux · 600 px/s · 85 °C · f/2.8 · blur 38.4 px"
    assert (
        "over 2 lights, 2 temperatures, 2 f-numbers, 2 speeds and 2 kinds of target,"
        in opening(data).sentences[0]
    )
    _, ((title, rows),) = tables.answers(data, data.model_names[0], ["stop sign 100 px"])
    assert title == "stop sign 100 px: n = 12 in 24 pictures; original pictures 0.95"
    assert [text for text, _, _ in rows] == [settings.text(at) for at in settings.every]
    for at, (_, _, cells) in zip(settings.every, rows, strict=True):
        own = [a for a in data.answers if a["group"] == "stop sign 100 px" and settings.of(a) == at]
        assert [[text, *lines] for _, text, lines in cells] == [words.answer_lines(a) for a in own]


def test_no_rows_have_no_settings() -> None:
    settings = Settings([])
    assert (settings.every, settings.held) == ((), "")


def test_every_setting_axis_has_words_of_its_own() -> None:
    assert len(SETTING_AXES) == len(AXES) - 3  # exposure and two velocities
    assert len({word(axis) for axis in SETTING_AXES}) == len(SETTING_AXES)
    assert [axis_label(axis(name)) for name in ("f_number", "velocity_x_px_s", "gain_db")] == [
        "f-number",
        "Motion to the right / (px/s)",
        "Gain / dB",
    ]


def test_many_settings_are_capped_in_tables(tmp_path: Path) -> None:
    f_numbers = tuple(1.4 + k / 10 for k in range(20))
    data = made_run(tmp_path, {"sign": 0.9}, f_numbers=f_numbers, speeds=(0.0,), n_examples=0)
    _, ((_, rows),) = tables.answers(data, data.model_names[0], ["sign"])
    shown = [text for text, _, _ in rows]
    assert len(shown) == tables.MAX_SETTINGS < len(data.settings.every) == 40
    assert [shown[0], shown[-1]] == [data.settings.text(data.settings.every[place]) for place in (0, -1)]


def test_further_axes_have_selects_figures_and_facts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "figures_of", lambda *_: {})
    data = made_run(tmp_path, f_numbers=(1.4, 2.8), speeds=(0.0, 200.0, 600.0), n_examples=2)
    assert "confidence_f_number.png" in {view.file for view in views(data)}
    parsed = Page(path := write_report(data, tmp_path))
    text = path.read_text(encoding="utf-8")
    selects = re.findall(r'<select id="([a-z-]+)"', text)
    assert selects == ["measure", "group", "view", "exposure", "speed", "light", "f-number", "up"]
    assert "10 lux · f/2.8" in parsed.text
    assert "held 25 °C · defocus 0 px · gain 0 dB" in parsed.text
    numbers = parsed.numbers
    assert [each["word"] for each in numbers["views"]] == ["exposure", "blur", "speed", "light", "f-number"]
    assert [each["word"] for each in numbers["axes"]] == ["exposure", "speed", "light", "f-number"]
    assert {name: numbers["axes"][3][name] for name in ("title", "texts", "x", "count")} == {
        "title": "f-number", "texts": ["f/1.4", "f/2.8"], "x": [1.4, 2.8], "count": 2,
    }  # fmt: skip
    assert numbers["views"][4]["ticks"] == [[1.4, "1.4"], [2.8, "2.8"]]


def test_nothing_can_be_chosen_where_nothing_varies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "figures_of", lambda *_: {})
    shape: dict[str, Any] = {"exposures_s": (0.005,), "lights_lux": (50.0,), "speeds": (0.0,)}
    text = write_report(made_run(tmp_path, **shape), tmp_path).read_text(encoding="utf-8")
    assert not re.search('id="(exposure|speed|light|temperature|f-number|gain|defocus)"', text)
