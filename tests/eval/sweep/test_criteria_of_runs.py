"""What is enough in a run: by default, as asked for, and the same in every table that says it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval import Evaluation, evaluate
from blurnoise_eval.datasets import PictureSet, Target
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.score_tables import alarm_confidence, dark_below
from made_tables import table
from numpy.typing import NDArray
from plans import plan as swept
from signs_in_memory import BOX, matched_detector, picture, sign

from blurnoise import Camera

PLAN = swept((0.0005, 0.01), (50.0,), (0.0, 900.0), repeats=2)
GREY = Target("stop sign", "a grey wall", (2.0, 2.0, 12.0, 12.0))


def moved(by: int) -> NDArray[np.uint8]:
    return np.roll(sign(), by, axis=1)


def labelled() -> PictureSet:
    """Nine pictures with a sign each, and a target in every one of which the model knows nothing."""
    shown = []
    for place in range(9):
        box = (BOX[0] + place, BOX[1], BOX[2] + place, BOX[3])
        targets = (Target("stop sign", "a stop sign", box), GREY)
        shown.append(
            replace(picture(f"p{place}", partial(moved, place)), targets=targets, image_id=place + 1)
        )
    return PictureSet("folder", "memory", tuple(shown), categories={"stop sign": 1})


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    model = matched_detector(tmp_path_factory.mktemp("model"))
    return evaluate(model, labelled(), "imx250", PLAN, folder, threads=1).folder


def test_on_pictures_of_ones_own_it_is_what_is_kept(run: Path) -> None:
    done = Evaluation(run)
    assert done.criterion.text == "keeps 0.9 of its confidence"
    targets = [row for row in done.targets if row["group"] == "a stop sign"]
    untouched = {row["image"]: row["confidence"] for row in targets if row["clean"]}
    assert len(done.answers) == 2
    measured = []
    for answer in done.answers:
        assert answer["group"] == "a stop sign"
        assert answer["clean_value"] == pytest.approx(np.mean(list(untouched.values())))
        for exposure_s in answer["exposures_s"]:
            own = [
                (row["confidence"], untouched[row["image"]])
                for row in targets
                if row["exposure_s"] == exposure_s and row["velocity_x_px_s"] == answer["velocity_x_px_s"]
            ]
            seen, known = np.array(own).sum(axis=0)
            assert len(own) == 18
            measured.append(seen / known)
        assert answer["best_value"] == max(answer["confidence"])
    slow, fast = np.split(np.array(measured), 2)
    pooled = [np.where(slow < fast, (slow + fast) / 2, own) for own in (slow, fast)]
    assert (slow < fast).any()
    np.testing.assert_allclose([answer["confidence"] for answer in done.answers], pooled)


def test_a_group_that_the_model_does_not_know_is_withheld_and_named(run: Path) -> None:
    summary = Evaluation(run).summary
    (withheld,) = summary["withheld"]
    assert (withheld["model"], withheld["group"], withheld["n_targets"]) == ("small", "a grey wall", 18)
    assert withheld["reference"] < 1
    assert any("a grey wall" in warning for warning in Evaluation(run).data.manifest["warnings"])
    groups = {answer["group"] for answer in Evaluation(run, 0.6).answers}
    assert groups == {"a stop sign", "a grey wall"}  # an absolute threshold can be asked of any


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
def test_more_pictures_make_no_group_known(targets: int, clean: float, withheld: bool) -> None:
    """285 targets of 0.004 each make more than 1 in sum, and the model finds none of them."""
    of: dict[str, Any] = {"n_targets": targets, "clean": clean, "reference": clean * targets}
    kept = table(np.ones((1, 1, 1)), [0.01], kept=True, **of)
    assert kept.knows_too_little == withheld
    assert not replace(kept, kept=False).knows_too_little  # an absolute threshold can be asked of any


def test_ap_of_a_run_is_that_of_its_scores(run: Path) -> None:
    """What is kept of AP50 is the quotient of two rows of scores.csv, on average over speeds, which are pooled."""
    done = Evaluation(run, score="ap50")
    untouched, *exposed = done.scores
    every = [answer for answer in done.answers if answer["group"] == "all"]
    for exposure_s in {row["exposure_s"] for row in exposed}:
        rows = [row["ap50"] / untouched["ap50"] for row in exposed if row["exposure_s"] == exposure_s]
        kept = [each["confidence"][each["exposures_s"].index(exposure_s)] for each in every]
        assert sum(kept) == pytest.approx(sum(rows))
    assert {answer["clean_value"] for answer in every} == {untouched["ap50"]}
    assert [answer["n_targets"] for answer in done.answers if answer["group"] == "all"] == [18, 18]
    again = Evaluation(run, score="ap50")  # kept in the store
    assert again.answers == done.answers
    assert Evaluation(run).scores == done.scores


def test_recall_is_that_at_the_rate_of_alarms(run: Path) -> None:
    with Store(run) as store:
        beyond = alarm_confidence(store, "small", 0.2)
    done = Evaluation(run, 0.5, score="recall@0.2")
    own = [row for row in done.targets if row["group"] == "a stop sign" and not row["clean"]]
    for answer in done.answers:
        if answer["group"] == "a stop sign":
            for exposure_s, recall in zip(answer["exposures_s"], answer["confidence"], strict=True):
                at = (exposure_s, answer["velocity_x_px_s"])
                here = [row for row in own if (row["exposure_s"], row["velocity_x_px_s"]) == at]
                assert recall == np.mean([row["confidence"] > beyond for row in here])


def test_recall_needs_labels(tmp_path: Path) -> None:
    own = PictureSet("folder", "memory", (picture("a", labels=None),))
    model = matched_detector(tmp_path)
    with pytest.raises(ValueError, match=r"^score = 'recall@0.1': needs pictures with labels"):
        evaluate(model, own, plan=PLAN, output=tmp_path / "run", score="recall@0.1")
    assert not (tmp_path / "run").exists()
    done = evaluate(model, own, plan=PLAN, output=tmp_path / "run")
    with pytest.raises(ValueError, match="needs pictures with labels"):
        Evaluation(done.folder, score="recall@0.1")


def test_dark_is_half_of_what_auto_exposure_aims_at() -> None:
    """9 % is 0.332 by sRGB's own formula, 0.09 through a straight curve; to a level of 8 bits."""
    camera = Camera.preset("imx250")
    assert dark_below(camera) == pytest.approx(1.055 * 0.09 ** (1 / 2.4) - 0.055, abs=1 / 255)
    assert dark_below(replace(camera, tone=((0.0, 0.0), (1.0, 1.0)))) == pytest.approx(0.09, abs=1 / 255)
