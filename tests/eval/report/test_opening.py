"""The opening answers, whatever the run: which exposure, which gain, how fast, how sure."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.report import RunData, tables
from blurnoise_eval.report.frontier import exposure_for_all, gain_at, rows_that_decide
from blurnoise_eval.report.opening import leader, opening
from blurnoise_eval.scoring.criterion import Criterion
from made_runs import THRESHOLD, made_run

ONE: dict[str, Any] = {"groups": {"sign": 0.95}, "lights_lux": (200.0,), "speeds": (600.0,)}
TWO = ("yolox-nano", "fastestdet")


def _kept(data: RunData) -> RunData:
    """The same numbers, as shares that are kept."""
    criterion = Criterion(THRESHOLD, kept=True)
    answers = [answer | {"criterion": criterion.text} for answer in data.answers]
    return replace(data, answers=answers, manifest=data.manifest | {"criterion": criterion.row()})


def _questions(data: RunData) -> dict[str, str]:
    return dict(opening(data).questions)


def test_one_combination_is_answered_with_its_interval(tmp_path: Path) -> None:
    data = _kept(made_run(tmp_path, n_examples=0, **ONE))
    assert opening(data).sentences == ("Use 4 ms: it keeps 0.88 (0.82–0.92) of its confidence.",)
    weak = _kept(made_run(tmp_path, n_examples=0, **ONE | {"groups": {"sign": 0.5}}))
    assert opening(weak).sentences == (
        "No tested exposure keeps 0.6 of its confidence. "
        "Best is 4 ms: keeps 0.47 (0.41–0.51) of its confidence, limited by motion blur and noise.",
    )
    assert _questions(weak)["Which exposure?"] == "none"
    assert "Which gain?" not in _questions(weak)
    few = _kept(made_run(tmp_path, n_examples=0, interval=False, **ONE))
    assert opening(few).sentences == (
        "Best is 4 ms: keeps 0.88 of its confidence. "
        "5 pictures cannot tell whether any exposure keeps 0.6 of its confidence; ~35 more would.",
    )


def test_of_many_combinations_the_exposure_that_serves_most_comes_first(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)
    (sentence,) = opening(data).sentences
    assert sentence == (
        "Use 4 ms: it reaches mean confidence 0.40 on average, and surely at least 0.6 in 2 of 8 combinations of "
        "target, light and speed; other exposures do in 1 more and no exposure does in 5."
    )
    assert _questions(data) == {
        "Which exposure?": "64 ms at 10 lux, 4 ms at 200 lux",
        "Which gain?": "6 dB at every light",
        "How fast?": "up to 600 px/s, the fastest tested, for stop sign 100 px at 200 lux (2.4 px of blur at 4 ms); "
        "in 2 of 4 combinations of target and light at no tested speed, limited by motion blur and noise (in 3 of 5)",
        "How sure?": "24 pictures, 95 % intervals; all 8 verdicts are sure; "
        "the exposures to use lose at most 0.012 against the best tested",
    }


def test_without_any_that_works_the_best_is_answered_and_what_limits(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.5, "mark": 0.4}, n_examples=0)
    assert opening(data).sentences == (
        "No tested exposure reaches mean confidence 0.6 in any of 8 combinations of target, light and speed. "
        "Best is 16 ms: reaches mean confidence 0.27 on average, limited by noise (in 4 of 8).",
    )
    assert _questions(data)["How fast?"] == "at no tested speed does an exposure suffice"
    rows = opening(data).rows  # both lights are one row: not four times "no exposure works"
    assert [(row.group, len(row.settings)) for row in rows] == [("sign", 2), ("mark", 2)]
    notes = tables.deciding(data, rows, 9)[0]["notes"]
    assert notes == ["at 0 to 600 px/s; best at 200 lux, 0 px/s, limited by noise"]


def test_what_cannot_be_told_brings_how_many_more_pictures_would(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0, interval=False)
    assert "5 pictures are too few to tell whether any exposure" in opening(data).sentences[0]
    told = _questions(data)
    assert told["How sure?"] == (
        "5 pictures (few), 95 % intervals; 0 of 8 verdicts are sure; ~35 more pictures would tell all"
    )
    assert told["How fast?"] == (
        "at no tested speed does an exposure surely suffice; for these pictures alone one does up to 600 px/s"
    )
    wanted = [12, 20, 45, 45, 45, 45, 300, None]
    more = [a | {"pictures_to_tell": n} for a, n in zip(data.answers, wanted, strict=True)]
    assert _questions(replace(data, answers=more))["How sure?"].endswith(
        "~7 more pictures would tell one more, ~40 half of the rest, ~295 all but 1"
    )


def test_a_run_without_answers_says_why(tmp_path: Path) -> None:
    data = made_run(tmp_path, {}, n_examples=0)
    assert "hold no targets" in opening(data).sentences[0]
    assert opening(data).questions == ()
    assert tables.deciding(data, opening(data).rows, 9) == []
    withheld = data.manifest | {"withheld": [{"model": "m", "group": "g", "n_targets": 3, "reference": 0.1}]}
    assert "too little in the untouched pictures" in opening(replace(data, manifest=withheld)).sentences[0]


def test_only_one_exposure_or_speed_is_still_an_answer(tmp_path: Path) -> None:
    shape: dict[str, Any] = {"exposures_s": (0.005,), "lights_lux": (50.0,), "speeds": (0.0,)}
    told = _questions(made_run(tmp_path, {"sign": 0.95}, n_examples=0, **shape))
    assert (told["Which exposure?"], told["How fast?"]) == ("5 ms", "at rest, the only speed tested")


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ({"lights_lux": (10.0, 200.0), "speeds": (0.0,)}, "in 1 of 2 lights"),
        ({"lights_lux": (200.0,), "speeds": (0.0, 3000.0)}, "in 1 of 2 speeds"),
        ({"lights_lux": (200.0,), "speeds": (0.0,), "f_numbers": (1.4, 8.0)}, "in 1 of 2 f-numbers"),
    ],
)
def test_what_differs_in_one_thing_is_no_combination(
    tmp_path: Path, shape: dict[str, Any], said: str
) -> None:
    data = made_run(tmp_path, {"sign": 0.95}, exposures_s=(0.001, 0.004), n_examples=0, **shape)
    assert said in opening(data).sentences[0]
    assert "combination" not in f"{opening(data)}"


def _at_gains(data: RunData, worth: dict[float, float]) -> RunData:
    """The same numbers at several gains, each times its worth; without intervals below the threshold."""

    def at(answer: dict[str, Any], gain_db: float) -> dict[str, Any]:
        names = ("confidence", "low", "high")
        return answer | {"gain_db": gain_db} | {n: [worth[gain_db] * v for v in answer[n]] for n in names}

    scores = [
        row | ({} if row["clean"] else {"gain_db": gain_db, "applied_gain_db": gain_db})
        for gain_db in worth
        for row in data.scores
        if gain_db == min(worth) or not row["clean"]
    ]
    return replace(data, answers=[at(a, gain) for gain in worth for a in data.answers], scores=scores)


def test_of_several_gains_the_best_is_the_answer(tmp_path: Path) -> None:
    data = _at_gains(made_run(tmp_path, {"sign": 0.95}, n_examples=0), {0.0: 0.5, 12.0: 1.0, 24.0: 0.9})
    told = _questions(data)
    assert told["Which gain?"] == "12 dB at every light (the best of 3 tested)"
    assert told["Which exposure?"] == "64 ms at 10 lux, 4 ms at 200 lux"
    assert "combinations of light and speed" in opening(data).sentences[0]
    assert {row.shown["gain_db"] for row in opening(data).rows} == {12.0}
    alike = _at_gains(made_run(tmp_path, {"sign": 0.95}, n_examples=0), {12.0: 1.0, 0.0: 1.0})
    assert _questions(alike)["Which gain?"].startswith("0 dB at every light")  # of equals the smallest


def test_pictures_of_unequal_weight_are_said_where_they_make_few(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)
    few = [a | {"effective_pictures": 6.9, "few_pictures": True} for a in data.answers]
    uneven = replace(data, answers=few)
    assert _questions(uneven)["How sure?"].startswith("24 pictures, which count as 6 (few), 95 % intervals;")
    shown = tables.deciding(uneven, opening(uneven).rows, 9)
    assert shown[0]["pictures"] == "24 pictures, which count as 6 (few)"
    nearly = replace(data, answers=[a | {"effective_pictures": 20.5} for a in data.answers])
    assert _questions(nearly)["How sure?"].startswith("24 pictures, 95 % intervals;")


def test_one_picture_is_one(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0, interval=False)
    one = [a | {"n_pictures": 1, "effective_pictures": 1.0} for a in data.answers]
    assert "1 picture is too few to tell" in opening(replace(data, answers=one)).sentences[0]


def _standing(value: float, behind: float | None, low: float | None, wanted: int | None) -> dict[str, Any]:
    ends = {"best_low": value - 0.05, "best_high": value + 0.05, "behind_low": low, "behind_high": 0.2}
    own = {"best_value": value, "behind": behind, "pictures_to_tell_behind": wanted}
    return ends | own | {"standing_pictures": 24}


def test_several_models_are_told_apart_where_they_can_be(tmp_path: Path) -> None:
    data = _kept(made_run(tmp_path, models=(*TWO, "nanodet"), n_examples=0))
    for row, standing in zip(
        data.models,
        (
            _standing(0.71, 0.02, -0.01, 60),
            _standing(0.73, None, None, None),
            _standing(0.5, 0.23, 0.1, None),
        ),
        strict=True,
    ):
        row |= standing
    assert leader(data) == opening(data).model == "fastestdet"
    assert opening(data).sentences[0] == (
        "fastestdet keeps 0.73 (0.68–0.78) of its confidence of 0.60 in untouched pictures at the best exposures, on "
        "average; yolox-nano 0.71 (0.66–0.76) of 0.70, too close to tell (~36 more pictures would); nanodet 0.50 "
        "(0.45–0.55) of 0.50, surely less (0.23, at least 0.10)."
    )
    assert all(row.shown["model"] == "fastestdet" for row in opening(data).rows)


def test_models_whose_standing_is_unknown_are_counted(tmp_path: Path) -> None:
    data = made_run(tmp_path, models=TWO, n_examples=0)
    assert leader(data) == "yolox-nano"
    assert opening(data).sentences[0] == (
        "Some exposure reaches mean confidence 0.6 in: yolox-nano 3 of 8, fastestdet 3 of 8."
    )


def test_a_row_goes_up_to_the_fastest_speed_with_an_exposure_for_all_slower(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.95}, speeds=(0.0, 600.0, 3000.0), n_examples=0)
    dark, bright = rows_that_decide(data, data.answers)
    assert (dark.top, dark.exposure_s, dark.fastest) == (0.0, 0.064, False)
    assert (bright.top, bright.exposure_s, bright.for_all) == (600.0, 0.004, True)
    assert bright.value == data.answers[4]["confidence"][1]
    assert [answer["velocity_x_px_s"] for answer in bright.others] == [3000.0]
    (told,) = tables.deciding(data, [bright], 9)
    assert (told["to"], told["use"], told["gain"], told["value"]) == (
        "600 px/s",
        "4 ms",
        "6 dB",
        "0.88 (0.82–0.92)",
    )
    assert told["notes"] == [
        "works 1.35 (1.2–1.5) to 15.5 (14–17) ms: noise below, motion blur above",
        "faster: no exposure works, limited by motion blur and noise",
    ]


def test_a_slower_speed_that_is_not_sure_is_not_hidden(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.95}, lights_lux=(200.0,), n_examples=0)
    answers = [data.answers[0] | {"verdict": "cannot tell", "pictures_to_tell": 50}, data.answers[1]]
    (row,) = rows_that_decide(data, answers)
    assert (row.top, row.slower) == (600.0, (0.0,))
    assert "not sure at 0 px/s" in tables.deciding(data, [row], 9)[0]["notes"]


def test_of_one_speed_the_worst_direction_decides(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.95}, lights_lux=(200.0,), speeds=(-600.0, 600.0), n_examples=0)
    fine, worse = data.answers
    assert rows_that_decide(data, [fine, worse | {"verdict": "no exposure works"}])[0].top is None
    worse = worse | {"confidence_at_recommended": 0.61}
    assert rows_that_decide(data, [fine, worse])[0].shown["velocity_x_px_s"] == 600.0


def test_many_rows_are_capped(tmp_path: Path) -> None:
    groups = {f"class {i}": 0.95 for i in range(9)}
    data = made_run(tmp_path, groups, lights_lux=(1.0, 10.0, 100.0, 1000.0), n_examples=0)
    rows = opening(data).rows
    shown = tables.deciding(data, rows, 12)
    assert len(rows) > 12 >= len(shown) > 6
    assert {row["setting"] for row in shown} >= {"1 lux", "1000 lux"}
    assert list(dict.fromkeys(row["group"] for row in shown)) == list(groups)[:4]  # in their order


def test_near_the_best_mean_the_recommended_exposure_serves_all(tmp_path: Path) -> None:
    answer = made_run(tmp_path, n_examples=0, **ONE).answers[0]
    flat = answer | {
        "confidence": [0.91, 0.90, 0.89, 0.2],
        "low": [0.9, 0.88, 0.87, 0.1],
        "recommended_s": 0.004,
    }
    assert exposure_for_all([flat], THRESHOLD) == (0.004, 1, 1)
    assert exposure_for_all([flat | {"recommended_s": 0.064}], THRESHOLD) == (0.001, 1, 1)
    assert exposure_for_all([flat | {"low": [0.5, 0.5, 0.7, 0.1]}], THRESHOLD) == (0.016, 1, 1)
    assert exposure_for_all([], THRESHOLD) is None


def test_the_gain_is_that_applied_and_none_beyond_what_was_tested(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)
    for row in data.scores:
        if not row["clean"] and row["illuminance_lux"] == 200.0:
            row["applied_gain_db"] = {0.001: 24.0, 0.004: 12.0}.get(row["exposure_s"], 0.0)
    assert gain_at(data, (200.0,), 0.001) == 24.0
    assert gain_at(data, (200.0,), 0.002) == pytest.approx(18.0)
    assert gain_at(data, (200.0,), 0.1) is None
    assert gain_at(data, (10.0,), 0.001) == 6.0
    assert _questions(data)["Which gain?"] == "6 dB at 10 lux, 12 dB at 200 lux"


def test_a_gain_that_ends_falls_as_the_light_grows_and_stays_at_0(tmp_path: Path) -> None:
    """18 dB are gone after 0.9 decades, wherever the next tested exposure lies; a straight line has 0.6 dB left."""
    data = made_run(tmp_path, n_examples=0)
    at = {**next(row for row in data.scores if not row["clean"]), "applied_gain_db": None}
    data.manifest["searched"] = ["by a search"]
    gains = {0.177: 18.0, 2.83: 0.0, 8.0: 0.0}
    data.manifest["taken"] = [
        {**at, "illuminance_lux": 100.0, "exposure_s": lux_s / 100, "applied_gain_db": gain}
        for lux_s, gain in gains.items()
    ]
    (lux, *_) = sorted({row["illuminance_lux"] for row in data.answers})
    assert gain_at(data, (lux,), 0.177 / lux) == pytest.approx(18.0)
    assert gain_at(data, (lux,), 0.354 / lux) == pytest.approx(18.0 - 20 * math.log10(2))
    assert gain_at(data, (lux,), 2.5 / lux) == 0.0
    assert gain_at(data, (lux,), 5.0 / lux) == 0.0


def test_gains_of_a_search_follow_light_times_exposure(tmp_path: Path) -> None:
    """Of conditions in other lights: 10 lux for 1 ms are 200 lux for 50 us; to half a stop beyond them."""
    data = made_run(tmp_path, n_examples=0)
    at = {**next(row for row in data.scores if not row["clean"]), "applied_gain_db": None}
    data.manifest["searched"] = ["by a search"]
    data.manifest["taken"] = [
        {**at, "illuminance_lux": 10.0, "exposure_s": 0.001, "applied_gain_db": 30.0},
        {**at, "illuminance_lux": 40.0, "exposure_s": 0.001, "applied_gain_db": 18.0},
    ]
    lit = {row["illuminance_lux"] for row in data.answers}
    (lux, *_) = sorted(lit)
    assert gain_at(data, (lux,), 0.01 / lux) == pytest.approx(30.0)
    assert gain_at(data, (lux,), 0.02 / lux) == pytest.approx(24.0)
    assert gain_at(data, (lux,), 0.04 * 1.4 / lux) == pytest.approx(18.0)
    assert gain_at(data, (lux,), 0.04 * 1.5 / lux) is None


def test_where_each_light_has_its_own_exposure_none_is_proposed_for_all(tmp_path: Path) -> None:
    """As where the camera sets it: what is tested under one light is not under another."""
    data = made_run(tmp_path, {"sign": 0.95}, exposures_s=(0.016,), lights_lux=(200.0,), n_examples=0)
    bright = [
        a | {"exposures_s": [0.0123], "best_s": 0.0123, "recommended_s": 0.0123} for a in data.answers[:1]
    ]
    dark = [a | {"illuminance_lux": 10.0} for a in data.answers[:1]]
    data = replace(data, answers=dark + bright)
    assert opening(data).sentences == (
        "With the exposure that is best for each it reaches mean confidence 0.95 on average, and surely at least 0.6 "
        "in all 2 combinations of light and speed.",
    )
    assert dict(opening(data).questions)["Which exposure?"] == "16 ms at 10 lux, 12.3 ms at 200 lux"
