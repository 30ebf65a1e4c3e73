"""Tables of AP by size of targets, and of models: means and intervals are those of the score and its jackknife."""

import numpy as np
import pytest
from blurnoise_eval.answers.curves import ScoreCurve
from blurnoise_eval.answers.model_rows import model_rows
from blurnoise_eval.answers.per_condition import Scored
from blurnoise_eval.answers.rows import AnswerRow, CurveRow, ModelRow, RecommendationRow
from blurnoise_eval.answers.table import tables_by_size
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.scoring.uncertainty import ClusterEstimate, left_out
from blurnoise_eval.store.columns import ORIGINAL, AxisValues, columns_of
from blurnoise_eval.store.rows import CellRow, ScoreRow, TargetRow
from plans import OWN

PICTURES = 12
GENERATOR = np.random.default_rng(2)


def estimate(value):
    return left_out(np.concatenate([[value], value + 0.01 * GENERATOR.normal(size=PICTURES)]))


def sized(exposure_s, speed, large, **pictures):
    at = {"exposure_s": exposure_s, "illuminance_lux": 50.0, "velocity_x_px_s": speed, "velocity_y_px_s": 0.0}
    row = ScoreRow("m", AxisValues.of({**at, **OWN}), None, 1, 9, 0, **pictures)
    nothing = dict.fromkeys(("all", "small", "medium"), ClusterEstimate(None))
    return Scored(row, large, {**nothing, "large": large}, {"all": 9, "small": 0, "medium": 4, "large": 5})


CLEAN = estimate(0.5)
CONDITIONS = {
    (0.01, 0.0): estimate(0.4),
    (0.01, 90.0): estimate(0.2),
    (0.02, 0.0): estimate(0.6),
    (0.02, 90.0): estimate(0.1),
}


@pytest.mark.parametrize("kept", [False, True])
def test_values_and_intervals_are_the_scores_own(kept):
    exposed = [sized(*at, found, saturated_share=at[0], brightness=0.3) for at, found in CONDITIONS.items()]
    (table,) = tables_by_size([sized(None, 0.0, CLEAN), *exposed[::-1]], kept)
    assert (table.group, table.n_targets, table.clean) == ("large", 5, 0.5)
    assert table.reference == pytest.approx(2.5)
    assert table.most == (2.0 if kept else 1.0)
    at = list(zip(table.conditions["exposure_s"].tolist(), table.speeds_px_s.tolist(), strict=True))
    assert at == [(0.01, 0.0), (0.02, 0.0), (0.01, 90.0), (0.02, 90.0)]
    assert table.saturated[2:] == pytest.approx([0.01, 0.02])
    assert table.brightness[0] == 0.3
    for (exposure_s, speed), own in CONDITIONS.items():
        (line,) = table.take([at.index((exposure_s, speed))]).along("exposure_s")
        assert line.mean[0] == pytest.approx(own.value / (0.5 if kept else 1.0))
        curve = ScoreCurve.over("exposure_s", line)
        ends = curve.interval()
        away = own.influence
        if kept:
            away = (away - own.value / 0.5 * CLEAN.influence) / 0.5
        expected = uncertainty.of_level(line.mean[0], away, table.most)
        assert (ends.low[0], ends.high[0]) == pytest.approx((float(expected.low), float(expected.high)))


def rows_of(clean, exposed):
    """Of models whose AP in the clean and in the exposed pictures is a mean over pictures, (pictures, models)."""
    models = [{"name": f"m{place}", "kind": "detector"} for place in range(clean.shape[1])]
    every = []
    for place, model in enumerate(models):
        for values, is_clean in ((clean, True), (exposed, False)):
            own = values[:, place]
            at = ORIGINAL if is_clean else AxisValues.of({"illuminance_lux": 0.0, "exposure_s": 0.01})
            row = ScoreRow(model["name"], at, None, 1, 1, 0)
            every.append(Scored(row, ClusterEstimate(float(own.mean()), own - own.mean()), {}, {}))
    return model_rows(models, every, [], (), True)


@pytest.mark.slow
def test_of_many_models_alike_hardly_ever_one_is_behind():
    """16 models of one quality, 400 samples: one of them surely less than the best in at most 5 %, give or take 2
    standard deviations (2.2 %). Corrected for the 15 comparisons with the best alone, though the same pictures
    choose it, it was 14 %."""
    generator = np.random.default_rng(0)
    wrong = 0
    for _ in range(400):
        values = 0.5 + 0.1 * generator.normal(size=(20, 1)) + 0.05 * generator.normal(size=(20, 16))
        wrong += any((row.mpc_deficit.low or 0.0) > 0 for row in rows_of(values, values))
    assert wrong / 400 <= 0.05 + 0.022


@pytest.mark.parametrize("row", [CellRow, TargetRow, AnswerRow, CurveRow, RecommendationRow, ModelRow])
def test_every_column_says_what_it_means(row):
    """In the guide's tables of columns, which are made of the records."""
    columns = columns_of(row)
    assert len({column.name for column in columns}) == len(columns) > 10
    assert all(column.meaning for column in columns)
