"""What a report says in words and tables, whatever the run: tests/data/report_words.txt, and exact texts."""

import re
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.plan.axes import LIGHT, SETTING_AXES
from blurnoise_eval.report import findings, settings, tables, words
from blurnoise_eval.report.opening import opening, table_rows
from blurnoise_eval.report.run import RunData
from blurnoise_eval.scoring.scores import of_models
from blurnoise_eval.store.columns import UNKNOWN, WithInterval
from made_runs import THRESHOLD, made_run

from blurnoise._core import usual
from blurnoise.light.lights import lights_of

GOLDEN = Path(__file__).parents[2] / "data" / "report_words.txt"
SIGN: dict[str, Any] = {"groups": {"sign": 0.95}}
ONE: dict[str, Any] = {**SIGN, "lights_lux": (200.0,), "speeds": (600.0,)}
BRIGHT: dict[str, Any] = {**SIGN, "lights_lux": (200.0, 2000.0)}
TWO = ("yolox-nano", "fastestdet")
Change = Callable[[RunData], RunData]


def kept(data):
    """The same numbers, as shares that are kept."""
    criterion = Criterion(THRESHOLD, kept=True)
    answers = [replace(answer, criterion=criterion.text) for answer in data.answers]
    return replace(data, answers=answers, manifest=data.manifest | {"criterion": criterion.row()})


def told(**facts):
    return lambda data: replace(data, manifest=data.manifest | facts)


def ranked(data):
    models = []
    for row, mpc, behind in zip(data.models, (0.30, 0.41, 0.40), (0.11, None, 0.01), strict=True):
        deficit = UNKNOWN if behind is None else WithInterval(behind, behind - 0.02, behind + 0.02)
        models.append(replace(row, mpc=WithInterval(mpc), mpc_deficit=deficit))
    scores = {**models[1].scores, "ap50": UNKNOWN, "false_positives_per_image": WithInterval(0.5)}
    models[1] = replace(models[1], p=UNKNOWN, scores=scores)
    return replace(data, models=models)


def saturating(data):
    averages = [
        replace(curve, values=tuple(0.99 if each == 0.016 else 0.5 for each in curve.exposures_s))
        for curve in data.averages
    ]
    return replace(data, averages=averages)


def of_each_light(data):
    """As where the camera sets the exposure: what is tested under one light is not under another."""
    return replace(data, recommendations=[row for row in data.recommendations if row.scope != "all"])


def unsettled(data):
    """A rival is as good: at all lights for one exposure, at one of them for one each."""
    rows = [
        replace(row, settled=False, rival_s=0.016, rival_gain_95=0.05, pictures_to_settle=66)
        if row.scope == "all" or row.conditions["illuminance_lux"] == 200.0
        else row
        for row in data.recommendations
    ]
    return replace(data, recommendations=rows)


WITHHELD = [{"model": "m", "group": "g", "n_targets": 3, "reference": 0.1}]
ASSUMED = {
    "f_number": 1.4,
    "transmission": 1.0,
    "sources": dict.fromkeys(("f_number", "transmission"), "assumed: x"),
}
PHOTOS = {"kind": "coco", "count": 3, "labelled": True, "notes": []}
LIGHTS = [asdict(light) for light in lights_of(usual.LIGHTS)]
AXES_OF_FILE = (
    "illuminance_lux", "temperature_c", "f_number", "defocus_radius_px", "gain_db", "moves", "ego_speed_m_s",
)  # fmt: skip
CASES: dict[str, tuple[dict[str, Any], Change]] = {
    "as usual": ({}, told()),
    "one condition, kept": (ONE, kept),
    "one condition, weak, kept": (ONE | {"groups": {"sign": 0.5}}, kept),
    "one condition, five pictures": (ONE | {"interval": False}, kept),
    "half of the conditions are sure": (BRIGHT, told()),
    "one of four is": (SIGN | {"lights_lux": (10.0, 20.0)}, told()),
    "more is kept where it saturates": (BRIGHT, saturating),
    "shorter exposures and longer ones fail": (SIGN | {"lights_lux": (200.0,)}, told()),
    "named lights": (SIGN | {"lights_lux": LIGHT.default}, told(plan={"light": LIGHTS})),
    "an exposure that is not settled": (BRIGHT, unsettled),
    "lights that are not all settled": ({}, unsettled),
    "pictures without targets": (ONE, lambda data: told(images=PHOTOS | {"count": 30})(unsettled(data))),
    "no targets": ({"groups": {}}, told()),
    "no cell": ({"groups": {}}, lambda data: replace(data, scores=[])),
    "targets that the model does not know": ({"groups": {}}, told(withheld=WITHHELD)),
    "a model without answers": ({"groups": {}}, told(withheld_models={"m": "AP50 is 0.00."})),
    "one exposure at rest": (
        SIGN | {"exposures_s": (0.005,), "lights_lux": (50.0,), "speeds": (0.0,)},
        told(),
    ),
    "models by mPC": ({"models": (*TWO, "nanodet")}, ranked),
    "models without labels": ({"models": TWO}, told(images=PHOTOS | {"labelled": False})),
    "no exposure in all lights": (SIGN, of_each_light),
    "ends of the tested range": (SIGN | {"exposures_s": (0.008, 0.064), "speeds": (600.0,)}, told()),
    "further axes": (SIGN | {"f_numbers": (1.4, 2.8), "temperatures_c": (25.0, 85.0)}, told(camera=ASSUMED)),
    "photographs": ({"kind": "reader"}, told(camera=ASSUMED, images=PHOTOS)),
    "photographs anchored to grey": ({}, told(images=PHOTOS, grey_anchor="mean")),
}


def text_of(name, folder):
    """What is said of a case: opening, table of models, a group's answers, facts and assumptions."""
    shape, change = CASES[name]
    data = change(made_run(folder, n_examples=0, **shape))
    shown = opening(data)
    lines = [f"== {name}", *shown.sentences, *(f"{title}: {text}" for title, text in shown.notes)]
    heads, rows, _ = table_rows(shown, 9, 9) if shown.rows else ([], [], 0)
    lines += [" | ".join(row) for row in ([shown.caption], heads, *rows) if row]
    for other in shown.further:
        heads, rows, _ = table_rows(other, 9, 9)
        lines += [" | ".join(row) for row in ([f"{other.model}:"], heads, *rows)]
    lines.append(shown.legend)
    scored = {score for row in (*data.models, *data.scores) for score in row.scores}
    of_kind = of_models(shape.get("kind", "detector"))
    shown_rows = (
        zip(of_kind, tables.model_rows(data), strict=True) if shape.keys() & {"models", "kind"} else ()
    )
    for score, (title, _, cells) in shown_rows:
        if score.of_model is None and score.name not in scored:
            continue  # of a new score made-up runs have no value
        lines.append(
            f"{title}: {' | '.join(' '.join([kind, text, *more]).strip() for kind, text, more in cells)}"
        )
    _, groups = tables.answers(data, data.model_names[0], data.largest_groups(1))
    for title, rows_of in groups:
        lines.append(title)
        lines += [
            f"  {at}: {' | '.join('; '.join([text, *more]) for _, text, more in cells)}"
            for at, _, cells in rows_of
        ]
    facts = findings.run_facts(data)
    lines += [f"{key}: {facts[key]}" for key in ("held", "reflectance") if facts.get(key)]
    return "\n".join([*lines, *findings.assumptions(data), ""])


@pytest.fixture
def _axes_of_the_file(monkeypatch):
    """Newer axes would stand in each of its parts."""
    of_file = [axis for axis in SETTING_AXES if axis.name in AXES_OF_FILE]
    monkeypatch.setattr(settings, "SETTING_AXES", tuple(of_file))


@pytest.mark.usefixtures("_axes_of_the_file")
@pytest.mark.parametrize("name", CASES)
def test_every_case_is_told(tmp_path, name):
    """On a change that is meant: read the difference, delete the case's part of the file, and run the test again."""
    found = text_of(name, tmp_path)
    parts = {
        part.partition("\n")[0]: part for part in re.split(r"\n+(?=== )", GOLDEN.read_text(encoding="utf-8"))
    }
    if f"== {name}" not in parts:
        GOLDEN.write_text("\n\n".join(map(str.strip, [*parts.values(), found])) + "\n", encoding="utf-8")
        pytest.fail(f"{GOLDEN.name} had no such part, which has been written")
    assert found.strip().splitlines() == parts[f"== {name}"].strip().splitlines()


NONE = (None, None)


@pytest.mark.parametrize(
    ("windows_s", "low", "high", "opens", "expected"),
    [
        ([[0.001, 0.022]], [NONE], [(0.019, 0.0263)], (True, False), "≤ 1 to 22 (19–27) ms"),
        ([[0.001, 0.0225]], [NONE], [(0.0222, 0.0226)], (True, False), "≤ 1 to 22.5 (22–23) ms"),
        ([[0.001, 0.02]], [NONE], [(0.0141, 0.3 * 0.1)], (True, False), "≤ 1 to 20 (14–30) ms"),
        ([[0.00123, 0.064]], [(0.001, 0.0017)], [NONE], (False, True), "1.23 (1–1.7) to ≥ 64 ms"),
        ([[0.004, 0.02]], [(None, 0.006)], [(0.015, None)], (False, False), "4 (< 6) to 20 (> 15) ms"),
        ([[0.002, 0.003], [0.01, 0.012]], [NONE] * 2, [NONE] * 2, (False, False), "2 to 3, and 10 to 12 ms"),
        ([[0.004, 0.004]], [NONE], [NONE], (False, False), "4 ms"),
    ],
)
def test_window_text(windows_s, low, high, opens, expected):
    made = {"windows_s": windows_s, "windows_low_s": low, "windows_high_s": high}
    made |= dict(zip(("window_from_open", "window_to_open"), opens, strict=True))
    assert words.window_text(SimpleNamespace(**made)) == expected


def test_intervals_hold_their_value():
    assert words.value_text(WithInterval(0.896, 0.8961, 0.8969)) == "0.90 (0.89–0.90)"
    assert words.value_text(WithInterval(0.9, 0.9, 0.9)) == "0.90 (0.90–0.90)"
    assert words.value_text(WithInterval(0.5, 0, 1)) == "0.50 (0.00–1.00)"


@pytest.mark.slow
def test_many_rows_speeds_and_settings_are_spread_and_counted(tmp_path):
    lights, speeds = tuple(float(2**k) for k in range(12)), (0.0, 100.0, 200.0, 400.0, 800.0)
    shown = opening(made_run(tmp_path, **SIGN, lights_lux=lights, speeds=speeds, n_examples=0))
    heads, rows, hidden = table_rows(shown, 8, 3)
    assert heads == ["light", "any speed", "at rest", "200 px/s", "800 px/s"]
    assert [rows[0][0], rows[-1][0]] == ["1 lux", "2048 lux"]
    assert (len(rows), hidden) == (8, 12 * 6 - 8 * 4)
    f_numbers = tuple(1.4 + k / 10 for k in range(20))
    data = made_run(tmp_path, **SIGN, f_numbers=f_numbers, speeds=(0.0,), n_examples=0)
    _, ((_, settings),) = tables.answers(data, data.model_names[0], ["sign"])
    assert len(settings) == tables.MAX_SETTINGS < len(data.settings.every) == 40
    ends = [data.settings.text(data.settings.every[place]) for place in (0, -1)]
    assert [settings[0][0], settings[-1][0]] == ends
