"""Scores of a run's conditions: columns, intervals over clusters, readers, and a new score."""

import numpy as np
import pytest
from blurnoise_eval.answers import criterion
from blurnoise_eval.answers.per_condition import conditions_of, numbered, scored
from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.scoring import scores as table
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.scoring.evaluated import Evaluated, Truth
from blurnoise_eval.store import queries
from blurnoise_eval.store.columns import CONDITIONS, ORIGINAL, AxisValues
from blurnoise_eval.store.rows import MEANS
from blurnoise_eval.store.store import Store
from stored_rows import answer
from stored_rows import cell as stored

AT = {"exposure_s": 0.01, "illuminance_lux": 5.0, "velocity_x_px_s": 1.0, "velocity_y_px_s": 0.0}
NOTHING = Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0))


def score_rows(folder, results, truth=None, cluster=None, moves=lambda row: (None, None)):
    """The scores of model m; of the results, or of what is there."""
    with Store(folder, create=True) as store:
        store.add(results)
        clusters = numbered(queries.pictures_seen(store), cluster)
        return list(scored(store, conditions_of(store, ["m"], clusters), lambda _: truth, moves, clusters))


def cell(image, found=NOTHING, rows=None, repeat=0, **more):
    clean = more.pop("clean", False)
    about = {"image": image, "repeat": repeat, "conditions": ORIGINAL if clean else AxisValues.of(AT)}
    targets = [answer(number, **row) for number, row in enumerate(rows or [])]
    return stored(f"{image} {repeat} {clean}", targets, found, **about, **more)


def truth_of(names):
    shared = {"category_id": 13, "bbox": [0, 0, 9, 9], "area": 81, "iscrowd": 0}
    annotations = [{**shared, "id": place, "image_id": place} for place in range(1, 1 + len(names))]
    categories = [{"id": 13, "name": "stop sign"}]
    ids = {name: place for place, name in enumerate(names, start=1)}
    return Truth({"annotations": annotations, "categories": categories}, ids, {0: 13})


RIGHT = Detections(np.array([[0, 0, 9, 9]]), np.array([0.8]), np.array([0]))


def test_rows_of_a_run(tmp_path):
    truth = Truth(truth_of(["p"]).coco, {"p": 1, "q": 2}, {0: 13})
    results = [cell("p", RIGHT, [{"confidence": 0.8}], clean=True), cell("q", clean=True)]
    results += [cell("p", error="it threw"), cell("q", RIGHT)]
    moved = []

    def moves(row):
        moved.append(row.exposure_s)
        return None, None

    first, second = score_rows(tmp_path, results, truth, moves=moves)
    clean, exposed = first.row.columns(), second.row.columns()
    assert moved == [0.01]
    shared = ("model", *CONDITIONS, "blur_px", "n_pictures", "n_targets", "errors", *MEANS)
    columns = [f"{score.name}{end}" for score in table.of_conditions() for end in ("", "_low", "_high")]
    assert tuple(clean) == tuple(exposed) == (*shared, *columns)
    assert all(clean[name] is None for name in columns if name.endswith(("_low", "_high")))  # of two pictures
    assert (clean["clean"], clean["n_pictures"], clean["n_targets"], clean["errors"]) == (True, 2, 1, 0)
    assert (clean["ap"], clean["target_confidence"], clean["detection_rate"]) == pytest.approx((1, 0.8, 1))
    assert (clean["false_positives_per_image"], clean["exact_match"]) == (0, None)
    assert {name: exposed[name] for name in AT} == AT
    assert (exposed["ap"], exposed["errors"], exposed["false_positives_per_image"]) == (0, 1, 0.5)
    assert exposed["target_confidence"] is None
    assert first.performance.value == pytest.approx(1)


def test_scores_have_intervals_over_clusters(tmp_path):
    rng = np.random.default_rng(3)
    names = [f"{place}.jpg" for place in range(10)]
    confidence = {name: rng.uniform(size=rng.integers(1, 5)).round(3) for name in names}
    found = {name: RIGHT if place % 3 else NOTHING for place, name in enumerate(names)}
    truth = truth_of(names)
    values = {name: [{"confidence": float(value)} for value in confidence[name]] for name in names}
    results = [cell(name, found[name], values[name], repeat) for repeat in range(2) for name in names]
    ((measured, whole, *_),) = score_rows(tmp_path, results, truth)
    row = measured.columns()
    sums, counts = [np.array([f(confidence[name]) for name in names]) for f in (np.sum, len)]
    expected = uncertainty.of_level(sums.sum() / counts.sum(), uncertainty.influence(sums, counts))
    np.testing.assert_allclose((row["target_confidence_low"], row["target_confidence_high"]), expected)

    def ap(some):
        return Evaluated({}, truth, Answers.of([(name, 0, found[name]) for name in some])).average().value

    without = [ap([each for each in names if each != name]) for name in names]
    assert whole.value == row["ap"] == pytest.approx(ap(names), abs=1e-6)
    expected = uncertainty.left_out([ap(names), *without]).influence
    np.testing.assert_allclose(whole.influence, expected, atol=1e-4)
    assert 0 <= row["ap_low"] < row["ap"] < row["ap_high"] <= 1
    assert row["detection_rate_low"] < row["detection_rate"] < row["detection_rate_high"]
    assert row["exact_match_low"] is row["calibration_error_low"] is None
    ((few, *_),) = score_rows(tmp_path, [], truth, r"(\d)\.jpg$")
    assert few.scores["ap"] == measured.scores["ap"]  # the pattern tells every picture apart
    ((one, *_),) = score_rows(tmp_path, [], truth, "jpg")
    assert one.scores["ap"] == (row["ap"], None, None)  # one cluster


def test_a_new_score_is_one_entry(tmp_path, monkeypatch):
    """With its function it has columns and, with a name as a criterion, is what ``--score`` takes."""
    alarms = table.Score("alarms", "Alarms", table.DETECTOR, lambda judged: 7.0, "lower", "count")
    half = {"of_targets": lambda rows: rows.confidence / 2, "criterion": ("half", "half")}
    doubled = table.Score("half", "Half", table.DETECTOR, **half)
    monkeypatch.setattr(table, "SCORES", (*table.SCORES, alarms, doubled))
    ((row, *_),) = score_rows(tmp_path, [cell("p", rows=[{"confidence": 0.8}], clean=True)])
    assert (row.scores["alarms"].value, row.scores["half"].value) == (7.0, 0.4)
    assert "half" in criterion.names("detector")
    assert "alarms" not in criterion.names("detector")
    assert criterion.Criterion(0.9, kept=True, score="half").text == "keeps 0.9 of its half"


def test_a_criterion_needs_a_form_for_each_size():
    """``--score`` answered for recall under the name of such a score: 1.00 for one that is 0.123 everywhere."""
    with pytest.raises(ValueError, match=r"score 'made_up': criterion = .*: must have of_targets or by_size"):
        table.Score("made_up", "Made up", of=lambda judged: 0.123, criterion=("made up", "made up"))
