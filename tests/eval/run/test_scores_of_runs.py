"""What a run says: what is enough, the same in every table; who has no answers; the conditions that it met."""

import json
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from blurnoise_eval import Run, SweepPlan, evaluate
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import PictureSet, Target
from blurnoise_eval.plan.question import Question
from blurnoise_eval.report.met_conditions import met_conditions
from blurnoise_eval.run.score_tables import LEAST_AP50, dark_below, models_withheld, run_scores
from blurnoise_eval.run.setup import Setup
from blurnoise_eval.scoring import scores
from blurnoise_eval.scoring.uncertainty import ClusterEstimate
from blurnoise_eval.store.columns import AxisValues, WithInterval
from blurnoise_eval.store.rows import ScoreRow
from blurnoise_eval.store.store import Store
from made_tables import table
from plans import IMX250
from plans import plan as swept
from signs_in_memory import BOX, picture, sign

from blurnoise.training.table import FILE, ExposureTable

PLAN = replace(swept((0.0005, 0.01), (50.0,), (0.0, 900.0), repeats=2), picture_tone="srgb")
GREY = Target("stop sign", "a grey wall", (2.0, 2.0, 12.0, 12.0))


@pytest.fixture(scope="module")
def run(tmp_path_factory, detector):
    """Nine pictures with a sign each, and a target in every one of which the model knows nothing."""
    shown = []
    for place in range(9):
        box = (BOX[0] + place, BOX[1], BOX[2] + place, BOX[3])
        targets = (Target("stop sign", "a stop sign", box), GREY)
        one = picture(f"p{place}.png", partial(sign, right_px=place))
        shown.append(replace(one, targets=targets, image_id=place + 1))
    pictures = PictureSet("folder", "memory", tuple(shown), categories={"stop sign": 1})
    return evaluate(detector, pictures, "imx250", PLAN, output=tmp_path_factory.mktemp("run")).folder


def test_on_pictures_of_ones_own_it_is_what_is_kept(run):
    done = Run.open(run)
    assert done.criterion.text == "keeps 0.9 of its confidence"
    targets = [row for row in done.targets if row["group"] == "a stop sign"]
    untouched = {row["image"]: row["confidence"] for row in targets if row["clean"]}
    assert [answer["group"] for answer in done.answers] == ["a stop sign"] * 2
    measured = []
    for answer in done.answers:
        assert answer["clean_score"] == pytest.approx(np.mean(list(untouched.values())))
        for exposure_s in answer["exposures_s"]:
            at = exposure_s, answer["velocity_x_px_s"]
            here = [row for row in targets if (row["exposure_s"], row["velocity_x_px_s"]) == at]
            seen, known = np.array([(row["confidence"], untouched[row["image"]]) for row in here]).sum(axis=0)
            assert len(here) == 18
            measured.append(seen / known)
        assert answer["best_score"] == max(answer["confidence"])
    slow, fast = np.split(np.array(measured), 2)
    pooled = [np.where(slow < fast, (slow + fast) / 2, own) for own in (slow, fast)]
    assert (slow < fast).any()
    np.testing.assert_allclose([answer["confidence"] for answer in done.answers], pooled)


def test_a_group_that_the_model_does_not_know_is_withheld_and_named(run):
    summary = Run.open(run).summary()
    (withheld,) = summary["withheld"]
    assert (withheld["model"], withheld["group"], withheld["n_targets"]) == ("small", "a grey wall", 18)
    assert withheld["reference"] < 1
    assert any("a grey wall" in warning for warning in Run.open(run).tables.manifest["warnings"])
    by_level = Run.open(run, Question(threshold=0.6)).answers
    assert {answer["group"] for answer in by_level} == {"a stop sign", "a grey wall"}


@pytest.mark.parametrize(
    ("targets", "clean", "withheld"),
    [
        (5, 0.1, True),
        (2, 0.3, False),
        (12, 0.1, False),
        (285, 0.004, True),
        (3000, 0.02, True),
        (3000, 0.06, False),
    ],
)
def test_more_pictures_make_no_group_known(targets, clean, withheld):
    """285 targets of 0.004 each make more than 1 in sum, and the model finds none of them."""
    of = {"n_targets": targets, "clean": clean, "reference": clean * targets}
    kept = table(np.ones((1, 1, 1)), [0.01], kept=True, **of)
    assert kept.reference_too_low == withheld
    assert not replace(kept, kept=False).reference_too_low


def test_ap_of_a_run_is_that_of_its_scores(run):
    """What is kept of AP50 is the quotient of two rows of scores.csv, on average over speeds, which are pooled."""
    done = Run.open(run, Question(score="ap50"))
    untouched, *exposed = done.scores
    every = [answer for answer in done.answers if answer["group"] == "all"]
    for exposure_s in {row["exposure_s"] for row in exposed}:
        rows = [row["ap50"] / untouched["ap50"] for row in exposed if row["exposure_s"] == exposure_s]
        kept = [each["confidence"][each["exposures_s"].index(exposure_s)] for each in every]
        assert sum(kept) == pytest.approx(sum(rows))
    assert [(each["clean_score"], each["n_targets"]) for each in every] == [(untouched["ap50"], 18)] * 2


def constant_by_size(evaluated, size):
    """0.123 wherever there are targets, on which no cluster has an influence."""
    found = evaluated.average(size)
    if found.value is None:
        return found
    return ClusterEstimate(0.123, np.zeros_like(found.influence))


@pytest.mark.parametrize(
    "constant",
    [{"of_targets": lambda rows: np.full(len(rows.condition), 0.123)}, {"by_size": constant_by_size}],
    ids=["of targets", "by size"],
)
@pytest.mark.parametrize(
    ("question", "expected"), [(Question(threshold=0.1), 0.123), (Question(keep=0.9), 1.0)]
)
def test_a_new_score_answers_under_its_own_name(run, monkeypatch, constant, question, expected):
    """0.123 everywhere is 0.123 in every answer, as a level and as a share of itself."""
    made_up = scores.Score("made_up", "Made up", **constant, criterion=("made up", "made up"))
    monkeypatch.setattr(scores, "SCORES", (*scores.SCORES, made_up))
    done = Run.open(run, replace(question, score="made_up"))
    assert done.answers
    values = [value for answer in done.answers for value in answer["confidence"]]
    assert values == pytest.approx([expected] * len(values))
    assert [row["made_up"] for row in done.scores] == pytest.approx([0.123] * len(done.scores))


def test_a_score_by_size_without_influence_is_refused(run, monkeypatch):
    """Its answers would have no interval, and were left out as if there were no targets."""
    half = scores.Score(
        "half", "Half", by_size=lambda evaluated, size: ClusterEstimate(0.5), criterion=("half", "half")
    )
    monkeypatch.setattr(scores, "SCORES", (*scores.SCORES, half))
    with pytest.raises(ValueError, match=r"^score 'half': by_size must return the influence of each cluster"):
        _ = Run.open(run, Question(score="half")).answers


def test_dark_is_half_of_what_auto_exposure_aims_at():
    """9 % is 0.332 by sRGB's own formula, 0.09 through a straight curve; to a level of 8 bits."""
    assert dark_below(IMX250) == pytest.approx(1.055 * 0.09 ** (1 / 2.4) - 0.055, abs=1 / 255)
    assert dark_below(IMX250.with_figures(tone=((0.0, 0.0), (1.0, 1.0)))) == pytest.approx(0.09, abs=1 / 255)


def score_row(ap50=None, saturated_share=None, **at):
    """A model's row under the conditions ``at``; without any, of the original pictures."""
    scores = {"ap50": WithInterval(ap50)}
    return ScoreRow("m", AxisValues.of(at), None, 1, 1, 0, saturated_share=saturated_share, scores=scores)


@pytest.mark.parametrize(
    ("ap50", "kind", "labelled", "withheld"),
    [
        (LEAST_AP50 - 0.001, "detector", True, True),
        (LEAST_AP50, "detector", True, False),
        (None, "detector", True, False),
        (0.0, "reader", True, False),
        (0.0, "detector", False, False),
    ],
)
def test_a_detector_of_no_precision_is_withheld(ap50, kind, labelled, withheld):
    manifest = {"models": [{"name": "m", "kind": kind}], "images": {"labelled": labelled}}
    rows = [score_row(0.9, exposure_s=0.01), score_row(ap50)]
    assert list(models_withheld(manifest, rows)) == (["m"] if withheld else [])


@pytest.mark.parametrize(
    ("note", "question"),
    [
        ("1 box left out", "Is the contract right"),
        ("doubtful labels: shares?", "Are the labels right? shares?"),
    ],
)
def test_doubtful_labels_are_asked_for_before_the_contract(note, question):
    manifest = {"models": [{"name": "m", "kind": "detector"}], "images": {"labelled": True, "notes": [note]}}
    assert question in models_withheld(manifest, [score_row(0.0)])["m"]


def test_scores_are_computed_once_for_each_question(run):

    def computed(score, cluster=None):
        done = []
        with Store(run) as store:
            run_scores(store, Setup.read(store), Criterion(0.5, True, score, cluster), done.append)
        return sum(done)

    computed("target_confidence")
    scores = ("detection_rate", "ap50", "ap50")
    assert [computed(score) > 0 for score in scores] == [False, True, False]
    assert computed("ap50", cluster=r"\.(png)") > 0


# --- what a run leaves for training ---


def test_conditions_are_left_for_training_with_saturation_and_what_is_recommended(tmp_path):
    """Those for each light at each speed, at the gain that they are for; not what a light's or all average says."""
    plan = swept((0.002, 0.01), (5.0, 50.0), (0.0, 400.0), gain_db=(6.0, 12.0))
    every = [score_row(saturated_share=0.25, **at.on(IMX250)) for at in plan.conditions()]
    rows = 2 * [score_row(), *every]  # of two models
    told = [
        SimpleNamespace(
            scope=scope,
            conditions=rows[1].conditions.but(illuminance_lux=lux, gain_db=gain_db),
            speed=speed,
            exposure_s=exposure_s,
        )
        for scope, lux, gain_db, speed, exposure_s in (
            ("condition", 5.0, 12.0, 400.0, 0.002),
            ("condition", 50.0, None, 0.0, 0.01),
            ("light", 50.0, None, 400.0, 0.002),
        )
    ]
    found = met_conditions(rows, {"camera": IMX250.to_dict(), "plan": plan.to_dict()}, told)
    (tmp_path / FILE).write_text(json.dumps(found, allow_nan=False))
    read, held = ExposureTable.of_run(tmp_path), found["conditions"]
    assert (read.cameras, len(read.rows)) == ((IMX250,), 13)  # three have an exposure that is recommended
    assert [each["saturated"] for each in held] == [0.25] * 16
    axes = ("illuminance_lux", "velocity_x_px_s", "gain_db", "exposure_s")
    chosen = {tuple(each[name] for name in axes) for each in held if each["recommended"]}
    assert chosen == {(5.0, 400.0, 12.0, 0.002), (50.0, 0.0, 6.0, 0.01), (50.0, 0.0, 12.0, 0.01)}


def test_a_vehicle_that_stands_there_for_its_headlamps_can_be_trained_for(tmp_path):
    """One that drives cannot."""
    plan = SweepPlan.of(
        {"lux": 1, "headlamp": "low", "exposure_ms": 10, "dx": 0, "vehicle": {"height_m": 1.3}}
    )
    for speed, refused in ((0.0, False), (10.0, True)):
        rows = [score_row(**{**at.on(IMX250), "ego_speed_m_s": speed}) for at in plan.conditions()]
        found = met_conditions(rows, {"camera": IMX250.to_dict(), "plan": plan.to_dict()})
        (tmp_path / FILE).write_text(json.dumps(found, allow_nan=False))
        if refused:
            with pytest.raises(ValueError, match="ego"):
                ExposureTable.of_run(tmp_path)
        else:
            assert ExposureTable.of_run(tmp_path).rows[0].headlamp == "low"
