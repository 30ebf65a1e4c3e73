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
    rows = {row["name"]: row["cells"] for row in tables.model_rows(data)}
    assert [cell["text"] for cell in rows["mPC"]] == ["0.780", "0.680"]
    assert [cell["best"] for cell in rows["mPC"]] == [True, False]
    assert [cell["best"] for cell in rows["Latency, median"]] == [False, True]  # less is better
    assert [cell["best"] for cell in rows["False positives per picture, untouched"]] == [True, False]
    assert [cell["best"] for cell in rows["Threads for the latency"]] == [False, False]
    assert rows["AP50, untouched"][1]["text"] is None
    assert "no labelled target" in rows["AP50, untouched"][1]["why"]
    assert not rows["AP50, untouched"][0]["best"]  # nothing to compare with


def test_unlabelled_pictures_of_several_models_are_said_to_be_hard_to_compare(tmp_path: Path) -> None:
    data = made_run(tmp_path, models=TWO, n_examples=0)
    assert not any("different targets" in line for line in findings.warnings(data))
    data.manifest["images"]["labelled"] = False
    assert any("different targets" in line for line in findings.warnings(data))


NONE = (None, None)


@pytest.mark.parametrize(
    ("windows_s", "low", "high", "open_low", "open_high", "expected"),
    [
        ([], [], [], False, False, "no exposure works"),
        ([[0.001, 0.022]], [NONE], [(0.019, 0.0263)], True, False, "≤ 1 (shortest tested) to 22 (19–27) ms"),
        (
            [[0.001, 0.0225]],
            [NONE],
            [(0.0222, 0.0226)],
            True,
            False,
            "≤ 1 (shortest tested) to 22.5 (22–23) ms",
        ),
        (
            [[0.001, 0.02]],
            [NONE],
            [(0.0141, 0.3 * 0.1)],
            True,
            False,
            "≤ 1 (shortest tested) to 20 (14–30) ms",
        ),
        (
            [[0.00123, 0.064]],
            [(0.001, 0.0017)],
            [NONE],
            False,
            True,
            "1.23 (1–1.7) to ≥ 64 (longest tested) ms",
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


def test_what_cannot_be_told_is_said_with_what_it_takes(tmp_path: Path) -> None:
    answer = made_run(tmp_path, n_examples=0).answers[2]
    assert words.verdict_text(answer) == "works"
    untold = answer | {
        "verdict": "cannot tell",
        "n_pictures": 12,
        "effective_pictures": 12.0,
        "pictures_to_tell": 40,
        "pictures_to_tell_mostly": 480,
    }
    assert words.verdict_text(untold) == "cannot tell from 12 pictures; 3.3 to 40 times as many would"
    far = untold | {"pictures_to_tell_mostly": None}
    assert words.needed_text(far) == "at least 3.3 times as many would"
    assert words.needed_text(untold | {"pictures_to_tell": None}) == "very many more would"
    one = untold | {"pictures_to_tell": None, "n_pictures": 1, "effective_pictures": 1.0}
    assert words.needed_text(one) == "at least 7 more would"
    uneven = untold | {"pictures_to_tell": None, "effective_pictures": 4.8}
    assert words.needed_text(uneven) == "at least 8 more would"
    assert words.verdict_text(uneven).startswith("cannot tell from 12 pictures, which count as 4;")


def test_reservations_name_few_pictures_saturation_and_ends_of_the_range(tmp_path: Path) -> None:
    answer = made_run(tmp_path, n_examples=0).answers[2]
    inside = answer | {"recommended_s": EXPOSURES_S[1]}
    assert words.reservations(inside) == []
    few = inside | {
        "few_pictures": True,
        "n_pictures": 12,
        "effective_pictures": 12.0,
        "saturated_at_recommended": 0.31,
    }
    assert words.reservations(few) == ["few: 12 pictures", "31 % of the picture saturated"]
    assert (
        words.reservations(few | {"n_pictures": 24, "effective_pictures": 17.6})[0]
        == "few: 24 pictures, which count as 17"
    )
    shortest = answer | {"recommended_s": EXPOSURES_S[0], "open_low": True}
    assert words.reservations(shortest) == ["the shortest tested: what lies below is not known"]
    assert words.reservations(shortest | {"open_low": False}) == []


def test_what_the_sweep_sets_is_no_assumption(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0, f_numbers=(1.4, 2.8))
    camera = {"f_number": 1.4, "transmission": 1.0}
    sources = {"sources": dict.fromkeys(camera, "assumed: the lens is the user's choice")}
    told = findings.assumptions(replace(data, manifest=data.manifest | {"camera": camera | sources}))
    assert told[1] == (
        "camera: assumed transmission",
        ["transmission = 1; assumed: the lens is the user's choice"],
    )
    still = made_run(tmp_path, n_examples=0)
    own = camera | {"f_number": next(row["f_number"] for row in still.scores if not row["clean"])}
    told = findings.assumptions(replace(still, manifest=still.manifest | {"camera": own | sources}))
    assert told[1][0] == "camera: assumed f number, transmission"


def test_what_light_on_photographs_means_is_told(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)

    def of(kind: str, anchor: str | None) -> tuple[bool, str | None]:
        images = data.manifest["images"] | {"kind": kind}
        run = replace(data, manifest=data.manifest | {"images": images, "grey_anchor": anchor})
        assumed = any("brightness is taken for reflectance" in line for line, _ in findings.assumptions(run))
        return assumed, findings.run_facts(run).get("reflectance")

    assert of("coco", None) == (True, None)
    assert of("rendered", None) == (False, None)
    assumed, told = of("coco", "mean")
    assert not assumed
    assert told is not None
    assert "18 % reflectance is the mean" in told


def test_where_the_swept_box_decides_is_said(tmp_path: Path) -> None:
    data = made_run(tmp_path, models=TWO, n_examples=0)
    assert findings.swept(data) == []
    name = data.scores[-1]["model"]
    alike = [{**row, "detection_rate_swept": row["detection_rate"]} for row in data.scores]
    assert findings.swept(replace(data, scores=alike)) == findings.swept(data)
    own = [place for place, row in enumerate(alike) if row["model"] == name and not row["clean"]]
    for place, (at_rest, swept) in zip(own, ((0.5, 0.58), (0.5, 0.65), (0.1, 0.9)), strict=False):
        alike[place] |= {"detection_rate": at_rest, "detection_rate_swept": swept}
    (line,) = findings.swept(replace(data, scores=alike))
    assert line.startswith(f"{name} is held to boxes at mid-exposure")
    assert " in 2 of " in line
    assert line.endswith(f"{data.settings.condition_text(alike[own[2]])}: 0.10, swept 0.90.")
