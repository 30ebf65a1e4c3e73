"""The comparison of trainings, with matched filters that suit the signs more or less for networks."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
from blurnoise_eval.bench import training, training_view
from blurnoise_eval.bench.compared import (
    Interval,
    measures,
    moving_px,
    resting_log_s,
)
from blurnoise_eval.bench.training import QUICK, Bench, Difference, Model, Part
from blurnoise_eval.cli import main
from blurnoise_eval.cli.bench import HELD_OUT_SEED
from blurnoise_eval.datasets import Picture, PictureSet, Target, write_picture
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep import work
from blurnoise_models import arms, matched_filter
from onnx import helper
from plans import plan as swept

from blurnoise import charts
from blurnoise.optics.colour import srgb_from_linear

Output = pytest.CaptureFixture[str]
SIDE_PX = 128
FIT, MISFIT = (64, 40, 28), (64, 42, 30)  # px, of the filters; the signs have 40 and 28


def filters(folder: Path, arm: str, sizes: list[tuple[int, int, int]]) -> list[Model]:
    folder.mkdir(parents=True, exist_ok=True)
    return [
        Model(
            arm, seed, matched_filter.build(folder / f"{arm}-{seed}.onnx", sizes_px=of_seed, input_px=SIDE_PX)
        )
        for seed, of_seed in enumerate(sizes)
    ]


def sign(size_px: int) -> Picture:
    """A drawn sign in the middle of a grey picture."""
    extent = {"height_px": SIDE_PX, "width_px": SIDE_PX}
    coded = srgb_from_linear(charts.stop_sign(size_px, **extent))[0].mul(255).round().byte()
    box = tuple(charts.stop_sign_box(size_px, **extent))
    return Picture(f"{size_px}", (Target("stop sign", "s", box),), lambda: coded.permute(1, 2, 0).numpy(), "")


def signs() -> PictureSet:
    """Two signs, and a picture without any."""
    grey = Picture("grey", (), lambda: np.full((SIDE_PX, SIDE_PX, 3), 118, np.uint8), "")
    return PictureSet("rendered", "here", (sign(40), sign(28), grey))


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> list[Model]:
    folder = tmp_path_factory.mktemp("models")
    rival = filters(folder, "none", [MISFIT, (64, 43, 30)])
    same = filters(folder, "kornia", [FIT, FIT])
    return [*rival, *same, *filters(folder, "exposure", [FIT, FIT])]


@pytest.fixture(scope="module")
def judged(models: list[Model], tmp_path_factory: pytest.TempPathFactory) -> tuple[Bench, Path, Part, int]:
    folder, part, done = tmp_path_factory.mktemp("proof"), Part("scenes", signs(), QUICK), []
    bench = training.measure(models, [part], folder, progress=done.append)
    return bench, folder, part, sum(done)


Judged = tuple[Bench, Path, Part, int]


def difference(bench: Bench, name: str, rival: str) -> Difference:
    return next(d for d in bench.differences if (d.measure.name, d.rival) == (name, rival))


def test_every_network_sees_everything(judged: Judged, models: list[Model]) -> None:
    bench, _, part, done = judged
    cells, judged = 3 * (1 + 8), 6 * (1 + 8)
    assert done == training.steps(models, [part]) == cells + judged  # a cell is simulated once for all
    assert len(bench.rows) == 6 * (1 + 8)
    assert bench.arms == ["none", "kornia", "exposure"]
    assert bench.sets["scenes"] | {"plan": None} == {
        "source": "here", "pictures": 3, "targets": 2, "unread": [], "plan": None,
    }  # fmt: skip
    clean = [row for row in bench.rows if row.at is None and row.arm == "exposure"]
    expected = np.mean([matched_filter.expected_confidence(size) for size in (40, 28)])
    assert [row.confidence for row in clean] == pytest.approx([expected] * 2, abs=0.01)
    assert [row.precision.ap50 for row in clean] == pytest.approx([1, 1])
    assert [row.false_positives for row in clean] == [0, 0]


def test_rows_are_what_the_store_holds(judged: Judged) -> None:
    bench, folder, _, _ = judged
    with Store(folder / "runs" / "scenes") as store:
        targets = [target for target in store.targets() if target["model"] == "none-1"]
    for row in bench.rows:
        if (row.arm, row.seed) == ("none", 1) and row.at is not None:
            held = [
                target["confidence"]
                for target in targets
                if (target["exposure_s"], target["illuminance_lux"], target["velocity_x_px_s"])
                == (row.at.exposure_s, row.at.illuminance_lux, row.at["velocity_x_px_s"])
            ]
            assert row.confidence == pytest.approx(np.mean(held))


def test_the_better_network_wins_and_equals_do_not(judged: Judged) -> None:
    bench, *_ = judged
    for name in ("confidence, clean", "confidence, all conditions"):
        assert difference(bench, name, "none").outcome == "better"
        assert difference(bench, name, "kornia").estimate == (0, 0, 0)
        assert difference(bench, name, "kornia").outcome == "undecided"
        gap = difference(bench, name, "none").estimate.value
        means = [bench.summary("scenes", name, arm).value for arm in ("exposure", "none")]
        assert gap == pytest.approx(means[0] - means[1])  # type: ignore[operator]


def test_summaries_are_means_of_rows(judged: Judged) -> None:
    bench, *_ = judged
    rows = [row for row in bench.rows if row.arm == "none"]
    seen = [row.precision.ap50 for row in rows if row.at is not None]
    assert bench.summary("scenes", "AP50, all conditions (mPC)", "none").value == pytest.approx(np.mean(seen))
    blur = [
        [
            row.confidence
            for row in rows
            if row.at and (row.at.exposure_s, row.at.illuminance_lux) == (0.02, 50)
        ][i::2]
        for i in (0, 1)
    ]  # at rest, then at 1500 px/s, of each seed
    over = bench.summary("scenes", "confidence over blur", "none").value
    assert over == pytest.approx(np.mean(blur))  # two points: their mean
    failure = bench.failure("scenes", "blur where confidence fails / px", "exposure")
    assert failure is not None
    assert failure.longest_px == pytest.approx(30)
    assert 0 < failure.at_px < 30  # type: ignore[operator]


def test_stopped_comparison_goes_on(
    judged: Judged, models: list[Model], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, folder, part, _ = judged
    monkeypatch.setattr(work.Worker, "compute", None)  # nothing is left to compute
    again = training.measure(models, [part], folder)
    assert again.rows == bench.rows
    assert again.verdicts() == bench.verdicts()
    with pytest.raises(StoreError, match="another plan"):
        training.measure(models, [replace(part, plan=replace(QUICK, seed=1))], folder)


def test_false_positives_count_from_the_threshold_on() -> None:
    box = (10.0, 20.0, 30.0, 60.0)
    found = training.Detections(
        np.array([box, (100, 100, 140, 140), (0, 0, 9, 9), box]), np.array([0.9, 0.5, 0.4, 0.7]), np.zeros(4)
    )
    nothing = training.Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0))
    weights = np.array([[1.0, 1.0], [2.0, 0.0], [0.0, 2.0]])
    scores = training._scores([found, nothing], [[box], [box]], 0, weights)
    assert scores["false_positives"].tolist() == [1, 2, 0]  # the second of the sign, and the one elsewhere
    assert scores["confidence"] == pytest.approx([0.45, 0.9, 0])


def test_measures_by_hand() -> None:
    """One arm, one draw, scores that are chosen per condition."""
    plan = swept((1e-3, 10e-3, 20e-3), (10.0, 50.0), (0.0, 500.0, 2000.0))
    conditions = Part("p", signs(), plan).conditions
    assert list(moving_px(conditions).values()) == pytest.approx([0, 10, 40])
    assert list(resting_log_s(conditions, 10.0).values()) == pytest.approx([-3, -2, np.log10(0.02)])
    ap50 = np.array(
        [0.8 if at is None else (0.0 if at.blur_px > 20 else 0.4 + 10 * at.exposure_s) for at in conditions]
    )
    scores = {
        "ap50": ap50[None, None],
        "confidence": ap50[None, None],
        "false_positives": 5 * ap50[None, None],
    }
    found = {asked.name: float(asked.of(scores)[0, 0]) for asked in measures(conditions)}
    assert found["AP50, clean (P)"] == 0.8
    assert found["AP50, all conditions (mPC)"] == pytest.approx(ap50[1:].mean())
    assert found["rPC = mPC / P"] == pytest.approx(ap50[1:].mean() / 0.8)
    assert found["AP50 over blur"] == pytest.approx((10 * 0.6 + 30 * 0.3) / 40)
    share = np.log10(2)  # of a decade, from 10 to 20 ms
    assert found["AP50 at rest, 10 lux"] == pytest.approx((1 * 0.455 + share * 0.55) / (1 + share))
    assert found["blur where AP50 fails / px"] == pytest.approx(10 + 30 * (0.1 / 0.6))
    assert found["false positives, all conditions"] == pytest.approx(5 * ap50[1:].mean())
    scores["ap50"] = scores["ap50"] * 0
    assert np.isnan(next(m for m in measures(conditions) if m.name.startswith("rPC")).of(scores)).all()


def test_verdict_follows_the_intervals(judged: Judged) -> None:
    def told(estimates: dict[str, Interval]) -> str:
        found = [
            Difference("scenes", asked, "none", estimates.get(str(asked.verdict), Interval(0.0, -0.1, 0.1)))
            for asked in measures(judged[2].conditions)
        ]
        return replace(judged[0], differences=found).verdicts()[0]

    up, down = Interval(0.2, 0.1, 0.3), Interval(-0.2, -0.3, -0.1)
    text = told({"all conditions": up, "clean pictures": down, "false positives": down})
    assert "(3 pictures, 2 signs)" in text
    better, worse, rest = text.split(";")
    assert "better than none in all conditions (+0.20, +0.10 to +0.30) and false positives (-0.20" in better
    assert "worse than none in clean pictures (-0.20, -0.30 to -0.10)" in worse
    assert "does not differ from none by more than chance in motion at 20 ms and 50 lux" in rest
    assert "better" not in told({}) + told({"clean pictures": down})
    assert told({}).count(";") == 0


def test_bench_is_written_whole(judged: Judged, tmp_path: Path) -> None:
    bench, *_ = judged
    training.write(bench, tmp_path)
    charts = training_view.write(bench, tmp_path)
    assert [path.name for path in charts] == ["training.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "training.csv", "training.json", "training.md", "training.png",
    ]  # fmt: skip
    with (tmp_path / "training.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["ap50"]) for row in rows] == [row.precision.ap50 for row in bench.rows]
    assert {row["arm"] for row in rows} == {"none", "kornia", "exposure"}
    document = json.loads((tmp_path / "training.json").read_text())
    assert document["verdicts"] == bench.verdicts()
    assert len(document["differences"]) == len(bench.differences)
    text = (tmp_path / "training.md").read_text()
    assert all(verdict in text for verdict in bench.verdicts())
    assert text.count("\n| ") >= len(measures(judged[2].conditions))
    picture = cv2.imread(str(charts[0]))
    assert picture.shape[0] > 800
    assert picture.std() > 10


def test_labels_stand_apart() -> None:
    for values in ([1.0, 1.0, 1.0], [0.5, 0.1, 0.52], [0.0, 0.0, 0.0], [0.3]):
        heights = training_view.apart(values)
        assert all(abs(b - a) > 0.05 for a, b in zip(sorted(heights), sorted(heights)[1:], strict=False))
        assert max(heights) <= 1
        assert np.argsort(heights, kind="stable").tolist() == np.argsort(values, kind="stable").tolist()
    assert training_view.apart([0.9, 0.1]) == [0.9, 0.1]


def test_arms_need_the_same_seeds(models: list[Model], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="same seeds in each arm"):
        training.measure(models[:-1], [Part("scenes", signs(), QUICK)], tmp_path)
    with pytest.raises(ValueError, match="same seeds in each arm"):
        training.measure([], [Part("scenes", signs(), QUICK)], tmp_path)


def test_pictures_need_a_sign(models: list[Model], tmp_path: Path) -> None:
    empty = PictureSet("rendered", "nowhere", signs().pictures[2:])
    plan = swept((20e-3,), (50.0,), (0.0,))
    with pytest.raises(ValueError, match=r"scenes = 'nowhere': no picture that can be read has a stop sign"):
        training.measure(models[:1], [Part("scenes", empty, plan)], tmp_path)


def test_model_must_know_the_sign(models: list[Model], tmp_path: Path) -> None:
    graph = onnx.load(str(models[0].path))
    contract = json.loads(next(entry.value for entry in graph.metadata_props))
    helper.set_model_props(graph, {"blurnoise.contract": json.dumps({**contract, "classes": ["yield"]})})
    onnx.save(graph, str(tmp_path / "none-0.onnx"))
    with pytest.raises(ValueError, match="does not know 'stop sign'"):
        training.measure([Model("none", 0, tmp_path / "none-0.onnx")], [Part("p", signs(), QUICK)], tmp_path)


def stand_in(wanted: list[arms.Recipe], scenes: Path, *, processes: int, progress: Any) -> None:
    """In place of training: filters that suit the signs in the arm on trial alone."""
    for recipe in wanted:
        recipe.path.parent.mkdir(parents=True, exist_ok=True)
        fit = FIT if recipe.arm == "exposure" else MISFIT
        matched_filter.build(recipe.path, sizes_px=fit, input_px=SIDE_PX)
        graph = onnx.load(str(recipe.path))
        entry = graph.metadata_props.add()
        entry.key, entry.value = "blurnoise.training", json.dumps(recipe.facts)
        onnx.save(graph, str(recipe.path))
        progress(recipe.pictures)


def drawn_signs(folder: Path, seed: int, count: int) -> Path:
    """In place of held-out scenes: rendered signs and a grey picture."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = signs().pictures
    for picture in pictures:
        write_picture(folder / f"{picture.name}.png", picture.load())
    boxes = [(i, target.box_xyxy) for i, picture in enumerate(pictures) for target in picture.targets or ()]
    document = {
        "images": [{"id": i, "file_name": f"{picture.name}.png"} for i, picture in enumerate(pictures)],
        "annotations": [
            {"id": n, "image_id": i, "category_id": 1, "bbox": [x0, y0, x1 - x0, y1 - y0], "iscrowd": 0}
            for n, (i, (x0, y0, x1, y1)) in enumerate(boxes)
        ],
        "categories": [{"id": 1, "name": "stop sign"}],
    }
    (folder / "instances.json").write_text(json.dumps(document))
    return folder / "instances.json"


@pytest.mark.slow
def test_command(tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    import blurnoise_models.scenes
    import blurnoise_models.training

    pools: list[int] = []
    monkeypatch.setattr(blurnoise_models.scenes, "write_coco", drawn_signs)
    monkeypatch.setattr(
        blurnoise_models.training, "pool", lambda folder, count, progress: pools.append(count)
    )
    monkeypatch.setattr(arms, "train_all", stand_in)
    monkeypatch.setattr(training, "QUICK", swept((10e-3, 20e-3), (50.0,), (0.0, 1500.0), examples=False))
    photographs = drawn_signs(tmp_path / "photographs", 0, 3)
    folder = tmp_path / "new" / "proof"
    command = [
        "bench",
        "training",
        "--quick",
        "--seeds",
        "1",
        "--scenes",
        "7",
        "--threads",
        "1",
        "-o",
        str(folder),
    ]
    command += ["--coco", str(photographs)]
    assert main(command) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert pools == [7]
    assert "On scenes (3 pictures, 2 signs) training with exposure" in shown
    assert "On photographs (3 pictures, 2 signs) training with exposure" in shown
    assert sorted(path.name for path in (folder / "models").iterdir()) == [
        "exposure-0.onnx", "kornia-0.onnx", "none-0.onnx",
    ]  # fmt: skip
    assert {"training.md", "training.png", "training-photographs.png"} <= {
        path.name for path in folder.iterdir()
    }
    document = json.loads((folder / "training.json").read_text())
    assert document["models"][0]["training"] == {"arm": "none", "seed": 0, "scenes": 7, "pictures": 480}

    def no_training(*_: object, **__: object) -> None:
        raise AssertionError("everything is trained")

    monkeypatch.setattr(arms, "train_all", no_training)
    assert main([*command, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["rows"] == document["rows"]
    assert main([*command, "--pictures", "960"]) == 2
    assert "was trained with" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--seeds", "0"], "seeds = 0: must be >= 1"),
        (["--pictures", "16"], "pictures = 16: must be >= 320"),
        (["--scenes", "0"], "scenes = 0: must be >= 1"),
        (["--images", "photos"], "images: goes with --coco"),
        (["--coco", "missing.json"], "missing.json"),
    ],
)
def test_bad_options_cost_no_training(
    tmp_path: Path, capsys: Output, options: list[str], message: str
) -> None:
    assert main(["bench", "training", "--quick", "-o", str(tmp_path / "proof"), *options]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "proof").exists()


def test_held_out_scenes_are_not_those_of_training() -> None:
    from blurnoise_models.training import POOL_SEED

    assert HELD_OUT_SEED != POOL_SEED
