"""What a report says in words and tables: which model holds best, what is missing, what limits the answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from blurnoise_eval.report import findings, tables, words
from made_runs import EXPOSURES_S, made_run

TWO = ("yolox-nano", "fastestdet")


def test_the_table_of_models_marks_the_best_and_explains_gaps(tmp_path: Path) -> None:
    data = made_run(tmp_path, models=TWO, n_examples=0)
    data.models[1].update(ap50=None, p=None, false_positives_per_image=0.5)
    rows = {name: cells for name, _, cells in tables.model_rows(data)}
    assert [text for _, text, _ in rows["mPC"]] == ["0.780", "0.680"]
    best = {name: [kind == "best" for kind, _, _ in cells] for name, cells in rows.items()}
    assert best["mPC"] == [True, False]
    assert best["Latency, median"] == [False, True]  # less is better
    assert best["False positives per picture, original pictures"] == [True, False]
    assert best["Threads for the latency"] == [False, False]
    assert rows["AP50, original pictures"][1] == ("", "–", ["no labelled target that the model knows"])
    assert not best["AP50, original pictures"][0]  # nothing to compare with


NONE = (None, None)


@pytest.mark.parametrize(
    ("windows_s", "low", "high", "open_low", "open_high", "expected"),
    [
        ([[0.001, 0.022]], [NONE], [(0.019, 0.0263)], True, False, "≤ 1 to 22 (19–27) ms"),
        (
            [[0.001, 0.0225]],
            [NONE],
            [(0.0222, 0.0226)],
            True,
            False,
            "≤ 1 to 22.5 (22–23) ms",
        ),
        (
            [[0.001, 0.02]],
            [NONE],
            [(0.0141, 0.3 * 0.1)],
            True,
            False,
            "≤ 1 to 20 (14–30) ms",
        ),
        (
            [[0.00123, 0.064]],
            [(0.001, 0.0017)],
            [NONE],
            False,
            True,
            "1.23 (1–1.7) to ≥ 64 ms",
        ),
        ([[0.004, 0.02]], [(None, 0.006)], [(0.015, None)], False, False, "4 (< 6) to 20 (> 15) ms"),
        ([[0.002, 0.003], [0.01, 0.012]], [NONE] * 2, [NONE] * 2, False, False, "2 to 3, and 10 to 12 ms"),
        ([[0.004, 0.004]], [NONE], [NONE], False, False, "4 ms"),
    ],
)
def test_window_text(
    windows_s: list[list[float]],
    low: list[tuple[float | None, float | None]],
    high: list[tuple[float | None, float | None]],
    open_low: bool,
    open_high: bool,
    expected: str,
) -> None:
    answer = {
        "windows_s": windows_s,
        "windows_low_s": low,
        "windows_high_s": high,
        "open_low": open_low,
        "open_high": open_high,
        "exposures_s": EXPOSURES_S,
    }
    assert words.window_text(answer) == expected


@pytest.mark.parametrize(
    ("value", "low", "high", "expected"),
    [
        (0.896, 0.8961, 0.8969, "0.90 (0.89–0.90)"),
        (0.9, 0.9, 0.9, "0.90 (0.90–0.90)"),
        (0.5, 0, 1, "0.50 (0.00–1.00)"),
    ],
)
def test_intervals_hold_their_value(value: float, low: float, high: float, expected: str) -> None:
    assert words.value_text(value, low, high) == expected


def test_an_answer_is_told_with_its_reservations(tmp_path: Path) -> None:
    answer = made_run(tmp_path, n_examples=0).answers[2]
    first, window, *others = words.answer_lines(answer)
    assert first.startswith("64 ms → 0.")
    assert window == words.window_text(answer)
    assert others == ["loses at most 0.012"]
    few = answer | {"few_pictures": True, "n_pictures": 24, "effective_pictures": 17.6}
    few |= {"saturated_at_recommended": 0.31}
    assert words.answer_lines(few)[3:] == [
        "few: 24 pictures, which count as 17",
        "31 % of the picture saturated",
    ]
    none = answer | {"verdict": "no exposure works", "limited_by": "blur and noise"}
    best = words.value_text(answer["best_value"], answer["best_low"], answer["best_high"])
    expected = f"best 64 ms: {best}, limited by motion blur and noise"
    assert words.answer_lines(none) == ["no exposure works", expected]


@pytest.mark.parametrize(
    ("n", "effective", "wanted", "expected"),
    [
        (12, 12.0, 40, "from 12 pictures; 3.3 times as many would in half of such cases"),
        (12, 12.0, None, "from 12 pictures; very many more would"),
        (1, 1.0, None, "from 1 picture; at least 7 more would"),
        (12, 4.8, None, "from 12 pictures, which count as 4; at least 8 more would"),
    ],
)
def test_what_cannot_be_told_is_said_with_what_it_takes(
    tmp_path: Path, n: int, effective: float, wanted: int | None, expected: str
) -> None:
    answer = made_run(tmp_path, n_examples=0).answers[2]
    untold = answer | {"verdict": "cannot tell", "n_pictures": n, "effective_pictures": effective}
    untold["pictures_to_tell"] = wanted
    assert words.answer_lines(untold)[0] == f"cannot tell {expected}"


def test_what_the_sweep_sets_is_no_assumption(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0, f_numbers=(1.4, 2.8))
    camera = {"f_number": 1.4, "transmission": 1.0}
    sources = {"sources": dict.fromkeys(camera, "assumed: the lens is the user's choice")}
    told = findings.assumptions(replace(data, manifest=data.manifest | {"camera": camera | sources}))
    assert told[1] == "camera: assumed transmission"
    still = made_run(tmp_path, n_examples=0)
    own = camera | {"f_number": next(row["f_number"] for row in still.scores if not row["clean"])}
    told = findings.assumptions(replace(still, manifest=still.manifest | {"camera": own | sources}))
    assert told[1] == "camera: assumed f number, transmission"


def test_what_light_on_photographs_means_is_told(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)

    def of(kind: str, anchor: str | None) -> tuple[bool, str | None]:
        images = data.manifest["images"] | {"kind": kind}
        run = replace(data, manifest=data.manifest | {"images": images, "grey_anchor": anchor})
        assumed = any("brightness is taken for reflectance" in line for line in findings.assumptions(run))
        return assumed, findings.run_facts(run).get("reflectance")

    assert of("coco", None) == (True, None)
    assert of("rendered", None) == (False, None)
    assumed, told = of("coco", "mean")
    assert not assumed
    assert told is not None
    assert "18 % reflectance is the mean" in told
