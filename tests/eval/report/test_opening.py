"""The opening answers, whatever the run: which exposure, what it keeps, how sure, what limits, what to do next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.grid.axes import EGO_SPEED
from blurnoise_eval.report.opening import opening, ranked, table_rows
from blurnoise_eval.report.run import RunData
from made_runs import THRESHOLD, made_run

ONE: dict[str, Any] = {"groups": {"sign": 0.95}, "lights_lux": (200.0,), "speeds": (600.0,)}
TWO = ("yolox-nano", "fastestdet")


def _kept(data: RunData) -> RunData:
    """The same numbers, as shares that are kept."""
    criterion = Criterion(THRESHOLD, kept=True)
    answers = [answer | {"criterion": criterion.text} for answer in data.answers]
    return replace(data, answers=answers, manifest=data.manifest | {"criterion": criterion.row()})


def _notes(data: RunData) -> dict[str, str]:
    return dict(opening(data).notes)


def test_one_condition_is_answered_with_its_interval(tmp_path: Path) -> None:
    data = _kept(made_run(tmp_path, n_examples=0, **ONE))
    (sentence,) = opening(data).sentences
    assert sentence.startswith("Use 4 ms: it keeps 0.88 (")
    assert sentence.endswith(" of its confidence, surely at least 0.6.")
    weak = _kept(made_run(tmp_path, n_examples=0, **ONE | {"groups": {"sign": 0.5}}))
    assert opening(weak).sentences[0].startswith("Best is 4 ms: it keeps 0.47 (")
    assert opening(weak).sentences[0].endswith("surely less than 0.6.")
    assert _notes(weak)["Limits"] == "motion blur and noise."
    few = _kept(made_run(tmp_path, n_examples=0, interval=False, **ONE))
    assert opening(few).sentences == (
        "Best is 4 ms: it keeps 0.88 of its confidence; whether that is at least 0.6 cannot be told. "
        "5 pictures are too few for an interval.",
    )
    assert _notes(few)["Surer"] == "more pictures (5 pictures leave 1 of 1 open)."


def test_eight_pictures_of_unequal_weight_have_no_interval_and_it_is_said(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0, interval=False)
    answers = [answer | {"n_pictures": 8} for answer in data.answers]
    (sentence,) = opening(replace(data, answers=answers)).sentences
    assert "8 pictures, of unequal weight, are too few for an interval." in sentence


def test_use_is_said_only_where_half_of_the_conditions_are_sure(tmp_path: Path) -> None:
    bright = made_run(tmp_path, {"sign": 0.95}, lights_lux=(200.0, 2000.0), n_examples=0)
    assert opening(bright).sentences[0].startswith("Use 4 ms: it reaches mean confidence 0.9")
    assert (
        "on average over 2 lights and 2 speeds, and surely at least 0.6 in all 4"
        in opening(bright).sentences[0]
    )
    dim = made_run(tmp_path, {"sign": 0.95}, lights_lux=(10.0, 20.0), n_examples=0)
    (sentence,) = opening(dim).sentences
    assert sentence.startswith("Best single exposure: 16 ms. It reaches mean confidence 0.")
    assert "surely at least 0.6 in only 1 of 4" in sentence
    assert "; one exposure for each light would reach 0." in sentence
    assert "It falls short most at 10 lux, 600 px/s: 0.28." in sentence


def test_an_exposure_that_keeps_more_but_saturates_is_named(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.95}, lights_lux=(200.0, 2000.0), n_examples=0)
    assert "saturates too much" not in opening(data).sentences[0]
    brighter = [
        row | {"values": [0.99 if each == 0.016 else 0.5 for each in row["exposures_s"]]}
        for row in data.averages
    ]
    (sentence,) = opening(replace(data, averages=brighter)).sentences
    assert sentence.endswith(" 16 ms reaches 0.99, but saturates too much.")


def test_the_table_is_light_by_speed(tmp_path: Path) -> None:
    told = opening(made_run(tmp_path, {"sign": 0.95}, n_examples=0))
    assert told.heads == ("light", "any speed", "at rest", "600 px/s")
    assert [name for name, _, _ in told.rows] == ["10 lux", "200 lux"]
    (_, _, dim), (_, _, bright) = told.rows
    assert [text for _, text, _ in bright] == ["4 ms 0.90 sure", "64 ms 0.95 sure", "4 ms 0.88 sure"]
    assert [text.partition(" ms")[0] for _, text, _ in dim][1:] == ["64", "16"]
    assert told.legend == "sure: reaches at least 0.6 (95 %); no: surely less; ?: cannot tell"


def test_limits_say_where(tmp_path: Path) -> None:
    assert _notes(made_run(tmp_path, {"sign": 0.95}, n_examples=0))["Limits"] == (
        "motion blur and noise at 10 lux and 600 px/s."
    )
    bright = made_run(tmp_path, {"sign": 0.95}, lights_lux=(200.0,), n_examples=0)
    assert _notes(bright)["Limits"] == "shorter exposures fail by noise and longer ones by motion blur."


def test_a_run_without_answers_says_why(tmp_path: Path) -> None:
    data = made_run(tmp_path, {}, n_examples=0)
    assert "hold no targets" in opening(data).sentences[0]
    assert opening(data).rows == ()
    assert "no cell has been computed" in opening(replace(data, scores=[])).sentences[0]
    held = {"withheld": [{"model": "m", "group": "g", "n_targets": 3, "reference": 0.1}]}
    nothing = replace(data, manifest=data.manifest | held)
    assert "almost nothing in the original pictures" in opening(nothing).sentences[0]
    doubted = replace(data, manifest=data.manifest | {"withheld_models": {"m": "AP50 is 0.00."}})
    assert opening(doubted).sentences == ("m: AP50 is 0.00.",)


def test_a_camera_that_drives_is_not_called_at_rest_at_0_km_h(tmp_path: Path) -> None:
    """It may turn."""
    data = made_run(tmp_path, {"sign": 0.95}, n_examples=0)
    assert "at rest" in " ".join(table_rows(opening(data), 9, 9)[0])
    data.__dict__["speed"] = EGO_SPEED
    heads = " ".join(table_rows(opening(data), 9, 9)[0])
    assert "at rest" not in heads
    assert "0 km/h" in heads


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ({"lights_lux": (10.0, 200.0), "speeds": (0.0,)}, "over 2 lights"),
        ({"lights_lux": (200.0,), "speeds": (0.0, 3000.0)}, "over 2 speeds"),
        ({"lights_lux": (200.0,), "speeds": (0.0,), "f_numbers": (1.4, 8.0)}, "over 2 f-numbers"),
        (
            {"groups": {"a": 0.9, "b": 0.8}, "lights_lux": (10.0, 200.0)},
            "2 lights, 2 speeds and 2 kinds of target",
        ),
    ],
)
def test_what_is_averaged_over_is_said(tmp_path: Path, shape: dict[str, Any], said: str) -> None:
    data = made_run(
        tmp_path, **{"groups": {"sign": 0.95}, "exposures_s": (0.001, 0.004), "n_examples": 0} | shape
    )
    assert said in opening(data).sentences[0]


def test_only_one_exposure_at_rest_is_still_an_answer(tmp_path: Path) -> None:
    shape: dict[str, Any] = {"exposures_s": (0.005,), "lights_lux": (50.0,), "speeds": (0.0,)}
    told = opening(made_run(tmp_path, {"sign": 0.95}, n_examples=0, **shape))
    assert told.sentences[0].startswith("Best is 5 ms: it reaches mean confidence 0.60 (")
    assert told.heads == ("light", "at rest")


def test_models_are_ranked_by_mpc_with_the_paired_difference(tmp_path: Path) -> None:
    data = made_run(tmp_path, models=(*TWO, "nanodet"), n_examples=0)
    for row, mpc, behind in zip(data.models, (0.30, 0.41, 0.40), (0.11, None, 0.01), strict=True):
        low, high = (None, None) if behind is None else (behind - 0.02, behind + 0.02)
        row |= {"mpc": mpc, "mpc_behind": behind, "mpc_behind_low": low, "mpc_behind_high": high}
    told = opening(data)
    assert ranked(data) == ["fastestdet", "nanodet", "yolox-nano"]
    assert told.model == "fastestdet"
    assert told.sentences[0] == (
        "Best is fastestdet: mPC 0.410 (mean AP); nanodet 0.010 (-0.010 to 0.030) less, which may be chance; "
        "yolox-nano 0.110 (0.090 to 0.130) less."
    )
    leads = [sentence.partition(":")[0] for sentence in told.sentences[1:]]
    assert leads == ["fastestdet", "nanodet", "yolox-nano"]


def test_without_labels_no_model_is_called_the_best(tmp_path: Path) -> None:
    data = made_run(tmp_path, models=TWO, n_examples=0)
    data.manifest["images"]["labelled"] = False
    assert ranked(data) == list(TWO)
    assert opening(data).sentences[0] == (
        "The models cannot be ranked: without labels, each is compared with its own detections."
    )


def test_where_each_light_has_its_own_exposures_none_is_proposed_for_all(tmp_path: Path) -> None:
    """As where the camera sets it: what is tested under one light is not under another."""
    data = made_run(tmp_path, {"sign": 0.95}, n_examples=0)
    rows = [row for row in data.recommendations if row["scope"] != "all"]
    told = opening(replace(data, recommendations=rows))
    assert told.sentences[0].startswith(
        "No exposure was tested in all lights. With the best of each it reaches"
    )
    assert len(told.rows) == 2


def test_an_end_of_the_tested_range_asks_for_more(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.95}, exposures_s=(0.008, 0.064), speeds=(600.0,), n_examples=0)
    assert _notes(data)["Surer"] == "shorter exposures (8 ms is the shortest tested)."


def test_many_rows_and_speeds_are_spread_and_counted(tmp_path: Path) -> None:
    lights, speeds = tuple(float(2**k) for k in range(12)), (0.0, 100.0, 200.0, 400.0, 800.0)
    told = opening(made_run(tmp_path, {"sign": 0.95}, lights_lux=lights, speeds=speeds, n_examples=0))
    heads, rows, hidden = table_rows(told, 8, 3)
    assert heads == ["light", "any speed", "at rest", "200 px/s", "800 px/s"]
    assert [rows[0][0], rows[-1][0]] == ["1 lux", "2048 lux"]
    assert len(rows) == 8
    assert hidden == 12 * 6 - 8 * 4
