"""Headlamps in runs: pictures as ``take`` takes them, whole and cut, and what the first screen says."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval import datasets, evaluate
from blurnoise_eval.datasets import outlines
from blurnoise_eval.measure import charts
from blurnoise_eval.plan.conditions import Cell, Conditions
from blurnoise_eval.plan.lit_targets import LitTargets
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.report.findings import run_facts
from blurnoise_eval.run.exposing import PictureScene, check_plan, frames
from blurnoise_eval.run.headlit_scenes import HeadlitFacts
from blurnoise_eval.run.run import Run
from blurnoise_eval.store.store import Store, StoreError
from commands import main
from plans import plan
from signs_in_memory import BOX, CAMERA, matched_detector, picture, picture_set, sign

from blurnoise import Exposure, Scene, TakeOptions, take
from blurnoise.light.headlamps import Headlamps
from blurnoise.light.headlit import Outline, headlit

AT = {"exposure_s": 0.01, "illuminance_lux": 1.0}


def lit_plan(headlamp=("low",), lux=(1.0,), exposures_s=(0.01,), **settings):
    return replace(plan(exposures_s, lux, headlamp=headlamp), **settings)


def framed(scene, at, camera=CAMERA):
    (frame,) = frames(scene, [Cell("p", 0, Conditions(**at), 3)], camera)
    return frame.image


def test_a_cell_is_the_picture_that_take_takes():
    made, image, shown = lit_plan(), sign(), picture("a")
    seen = framed(PictureScene(image, made, shown), {**AT, "headlamp": 1.0})
    plain = Scene.of_picture(image)
    found = headlit(plain.light, [Outline("stop sign", BOX)], made.lit.view(CAMERA, None), Headlamps("low"))
    scene = replace(plain, headlamp_lux={"low": found.plane()})
    exposure = Exposure(CAMERA, 0.01, 1.0, seed=3, headlamp="low")
    assert np.array_equal(seen, take(scene, exposure, TakeOptions(("8 bit",))).images()[0])


def test_headlamps_off_are_bits_as_without():
    on, off = PictureScene(sign(), lit_plan(("off", "low")), picture("a")), PictureScene(sign())
    assert np.array_equal(framed(on, {**AT, "headlamp": 0.0}), framed(off, AT))


def test_planes_are_made_once_and_only_where_needed(monkeypatch):
    made = []
    monkeypatch.setattr(
        "blurnoise_eval.run.headlit_scenes.headlit",
        lambda *given: made.append(given[-1].beam) or headlit(*given),
    )
    scene = PictureScene(sign(), lit_plan(("off", "low", "high")), picture("a"))
    cells = [
        Cell("p", 0, Conditions(**{**AT, "exposure_s": exposure_s, "headlamp": headlamp}), 3)
        for headlamp in (0.0, 1.0, 2.0)
        for exposure_s in (0.01, 0.02)
    ]
    assert len([*frames(scene, cells[:2], CAMERA)]) == 2
    assert made == []
    assert len([*frames(scene, cells, CAMERA)]) == 6
    assert made == ["low", "high"]


def test_moving_targets_carry_their_light():
    """Blurred by so little that it does not show, the layers give the picture of the whole."""
    made = lit_plan()
    made = replace(made, grid={**made.grid, "moves": (0.0, 1.0), "velocity_x_px_s": (0.0, 0.001)})
    shown = datasets.rendered_signs([60.0], count=1).pictures[0]
    scene = PictureScene(shown.load(), made, shown)
    bright = {**AT, "illuminance_lux": 100.0, "headlamp": 2.0}
    whole = framed(scene, bright).astype(int)
    moved = framed(scene, {**bright, "moves": 1.0, "velocity_x_px_s": 0.001}).astype(int)
    assert np.abs(whole - moved).mean() < 1.0
    (found,) = scene.headlit.of(scene.light.light, CAMERA, "high").targets
    (layer,) = scene._cut_scene(Exposure(CAMERA, 0.01, 100.0, headlamp="high", moves="targets"))[0]._targets
    rows = found.lux(layer.place_px[1], len(layer.alpha))
    assert layer.headlamp_lux["high"][0, :, 3].numpy() == pytest.approx(rows, rel=1e-5)


def test_rendered_targets_are_outlined_and_boxes_are_not():
    shown = datasets.rendered_signs([60.0], count=1).pictures[0]
    (own,) = outlines(shown, shown.load().shape[:2])
    assert own.outlined
    assert own.alpha.max() == 1
    assert 0.7 < own.alpha.mean() < 0.9  # an octagon's share of its box, .83
    (box,) = outlines(picture("a"), (54, 64))
    assert box == Outline("stop sign", BOX)


def test_crowds_receive_no_light():
    shown = picture("a")
    crowd = replace(shown, targets=(replace(shown.targets[0], crowd=True),))
    assert outlines(crowd, (54, 64)) == [None]


def test_headlamps_need_labels():
    unlabelled = picture_set(picture("a", labels=None))
    message = "headlamp: needs labels, by which targets are known; or distance_m with --object"
    with pytest.raises(ValueError, match=message):
        check_plan(lit_plan(), CAMERA, unlabelled)


def test_headlamps_of_a_named_light_do_without_labels(tmp_path):
    unlabelled = picture_set(picture("a", labels=None))
    made = SweepPlan.of({"light": "street", "exposure_ms": "10", "dx": "0"})
    check_plan(made, CAMERA, unlabelled)
    done = evaluate(
        matched_detector(tmp_path), unlabelled, CAMERA, made, output=tmp_path / "run", strategy="grid"
    )
    lines = done.tables.manifest["light"]
    assert lines[0].startswith("street: 1 lux (led-4000), low beam")
    assert lines[-1] == "Without labels headlamps light nothing: no distance of a target is known."


def test_facts_come_back_from_their_text():
    scene = PictureScene(sign(), lit_plan(), picture("a"))
    facts = scene.headlit.facts(scene.light.light, CAMERA)
    again = HeadlitFacts.read(facts.text)
    assert again.background == pytest.approx(facts.background, abs=1e-5)
    assert again.targets == facts.targets
    assert len(facts.targets) == 1
    assert facts.targets[0].label == "stop sign"


@pytest.mark.parametrize(
    "text",
    ["", "{}", "[1]", "[0.1, 0, [[1, 2]]]", '[0.1, 0, [["s", 0, -3, 1, 1, 0, 0, 0]]]', '[NaN, 0, []]',
     '[0.1, 0, [["s", 0, 3, 1, 0, 0, 0, 0]]]', '[0.1, 0, [[5, 0, 3, 1, 1, 0, 0, 0]]]', "[" * 5000],
)  # fmt: skip
def test_facts_of_anybody_are_refused_in_one_line(text):
    with pytest.raises(ValueError, match="is no list of targets in headlamps"):
        HeadlitFacts.read(text)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lit")
    made = lit_plan(("off", "low"), (1.0, 20.0), (0.005, 0.02), lit=LitTargets(distance_m=50.0))
    pictures = picture_set(picture("a"), picture("b", labels=("stop sign", "pizza")))
    return evaluate(matched_detector(folder), pictures, CAMERA, made, output=folder / "run", strategy="grid")


def test_a_line_for_each_light_in_lux_and_candela(run):
    lines = run.tables.manifest["light"]
    heads = [line.split(". ")[0] for line in lines[:4]]
    assert heads == ["1 lux", "1 lux, low beam", "20 lux", "20 lux, low beam"]
    assert "stop sign, median 50 m, 1." in lines[1]
    assert "by sheeting III), background" in lines[1]
    assert "if lit)" in lines[1]
    assert "1 of 3 targets have no known size and receive no headlight" in " ".join(lines)
    assert "2 of 3 targets have no outline: the whole box shines; 17 % of an octagon's box" in " ".join(lines)
    assert lines[-1] == "Headlamp light is known to a factor of 2."


def test_the_line_s_luminances_are_those_of_the_light(run):
    scene = PictureScene(sign(), run.plan, picture("a"))
    (target,) = scene.headlit.of(scene.light.light, CAMERA, "low").targets
    lux = 1.0 + target.illuminance_lux
    white = target.white * lux / math.pi + target.luminance_cd_m2
    (line,) = [line for line in run.tables.manifest["light"] if line.startswith("1 lux, low beam")]
    assert float(line.split("white ")[1].split()[0]) == pytest.approx(white, rel=0.01)


def test_page_and_summary_have_the_lines(run):
    page = run.report().read_text()
    assert "Headlamp light is known to a factor of 2." in page
    summary = json.loads((run.folder / "summary.json").read_text())
    assert summary["light"] == run.tables.manifest["light"]
    with (run.folder / "results.csv").open() as file:
        assert {row["headlamp"] for row in csv.DictReader(file)} == {"", "off", "low"}


def test_page_says_the_luminance_of_white_beside_every_lux(run):
    facts = run_facts(run.tables)
    assert facts["luminance of a white surface"] == "0.318 cd/m2 at 1 lux, 6.37 cd/m2 at 20 lux"


def test_charts_have_no_targets_for_headlamps():
    with pytest.raises(ValueError, match="headlamp: must be off, as a chart has no targets"):
        charts.check(CAMERA, lit_plan())


def test_a_run_is_read_with_what_the_plan_states(run):
    again = Run.open(run.folder)
    assert again.plan.lit == LitTargets(distance_m=50.0)
    assert again.plan == run.plan


def test_a_damaged_note_names_the_run(run, tmp_path):
    import shutil

    shutil.copytree(run.folder, tmp_path / "run")
    with Store(tmp_path / "run", create=True) as store, store._transaction() as db:
        db.execute("UPDATE pictures SET headlit = '[1]'")
    with pytest.raises(StoreError, match=r"pictures\.headlit: is no list of targets in headlamps"):
        _ = Run.open(tmp_path / "run", trust=True).tables


def test_nearer_and_cut_off_targets_are_counted(tmp_path):
    near = picture_set(picture("a"), picture("b"))
    done = evaluate(
        matched_detector(tmp_path), near, CAMERA, lit_plan(), output=tmp_path / "run", strategy="grid"
    )
    text = " ".join(done.tables.manifest["light"])
    assert "2 of 2 targets are nearer than 8 m: lit as at 8 m." in text


def test_night_answers_about_signs_say_that_they_are_matt(tmp_path):
    for lux, expected in ((1.0, ["Signs are taken for matt; see --headlamp low."]), (400.0, [])):
        folder = tmp_path / f"{lux}"
        done = evaluate(
            matched_detector(tmp_path), picture_set(picture("a")), CAMERA, plan((0.01,), (lux,)), output=folder,
            strategy="grid",
        )  # fmt: skip
        assert done.tables.manifest["light"] == expected


def test_named_speeds_that_the_distance_contradicts_are_said(tmp_path):
    made = replace(plan((0.01,), (1.0,), (500.0,), headlamp=("low",)), lit=LitTargets(distance_m=50.0))
    pictures = picture_set(picture("a"))
    done = evaluate(
        matched_detector(tmp_path), pictures, CAMERA, made, output=tmp_path / "run", strategy="grid"
    )
    (line,) = [line for line in done.tables.manifest["light"] if "px/s at" in line]
    focal_px = CAMERA.field.focal_px[0] * CAMERA.field.per_sensor_px((54, 64))
    assert line.startswith("500 px/s at 50 km/h and 50 m means ")
    assert float(line.split("means ")[1].split()[0]) == pytest.approx(
        500 * 50**2 / (focal_px * 50 / 3.6), rel=0.01
    )


def simulated(tmp_path, capsys, *words):
    datasets.write_picture(tmp_path / "p.png", sign())
    given = ["simulate", str(tmp_path / "p.png"), "-o", str(tmp_path / "o.png"), "--lux", "1", *words]
    code = main(given)
    return code, capsys.readouterr()


OBJECT = [
    "--object",
    ",".join(str(round(each)) for each in (BOX[0], BOX[1], BOX[2] - BOX[0], BOX[3] - BOX[1])),
]


def test_simulate_lights_its_object(tmp_path, capsys):
    words = [*OBJECT, "--headlamp", "low", "--distance-m", "50", "--sheeting", "III", "--json"]
    code, out = simulated(tmp_path, capsys, *words)
    facts = json.loads(out.out)
    assert code == 0
    assert facts["target_distance_m"] == pytest.approx(50.0)
    lit = Headlamps("low").onto(0.0, 1.5, 50.0)
    assert facts["headlamp_lux"] == pytest.approx(
        float(lit.illuminance_lux), rel=0.05
    )  # in the picture's middle
    assert facts["returned_cd_m2"] > 1
    bright = datasets.decode(tmp_path / "o.png").mean()
    simulated(tmp_path, capsys, *OBJECT)
    assert bright > datasets.decode(tmp_path / "o.png").mean() + 1


def test_simulate_takes_a_named_light_without_an_object(tmp_path, capsys):
    datasets.write_picture(tmp_path / "p.png", sign())
    words = [
        "simulate",
        str(tmp_path / "p.png"),
        "-o",
        str(tmp_path / "o.png"),
        "--light",
        "street",
        "--json",
    ]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["headlamps"].startswith("light nothing")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--headlamp", "low"],
            "headlamp: needs labels, by which targets are known; or distance_m with --object",
        ),
        ([*OBJECT, "--headlamp", "low"], "or distance_m with --object"),
        ([*OBJECT, "--distance-m", "50"], "--distance-m: needs --headlamp, low or high"),
        ([*OBJECT, "--headlamp", "hi"], "headlamp = 'hi': must be one of off, low, high"),
    ],
)
def test_simulate_says_what_is_missing(tmp_path, capsys, words, message):
    code, out = simulated(tmp_path, capsys, *words)
    assert code == 2
    assert message in " ".join(out.err.split())


def test_simulate_meters_headlamps(tmp_path, capsys):
    words = [*OBJECT, "--exposure-ms", "auto", "--json"]
    _, dark = simulated(tmp_path, capsys, *words)
    _, lit = simulated(
        tmp_path, capsys, *words, "--headlamp", "high", "--distance-m", "40", "--sheeting", "XI"
    )
    assert json.loads(lit.out)["exposure_ms"] < json.loads(dark.out)["exposure_ms"] / 2
