"""Named lights of a run: its rows, files and first lines, and what a spectrum changes in them."""

import csv
import json

import pytest
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.plan.axes import LIGHT, SPECTRUM, axis
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.report.lights import lights_of_run
from blurnoise_eval.report.settings import TestedSettings
from blurnoise_eval.run.run import Run
from blurnoise_eval.store.columns import AxisValues
from signs_in_memory import CAMERA, matched_detector, picture, picture_set

GRID = {"exposure_s": (0.002, 0.02), "gain_db": (0.0,)}


def swept(folder, **plan):
    signs = picture_set(picture("a"), picture("b"))
    grid = {**GRID, **plan.pop("grid", {})}
    run = evaluate(
        [matched_detector(folder)],
        signs,
        CAMERA,
        SweepPlan(grid, **plan),
        output=folder / "run",
        progress=False,
    )
    run.report()


def rows(folder, name):
    with (folder / "run" / name).open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def lit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lights")
    swept(folder, light=("street", "sodium-street"))
    return folder


def test_rows_have_the_lights_lux_and_spectrum(lit):
    for name in ("results.csv", "scores.csv", "answers.csv"):
        found = {
            (row["illuminance_lux"], row["illuminant"])
            for row in rows(lit, name)
            if row.get("clean") != "True"
        }
        assert {(float(lux), of) for lux, of in found} == {(1.0, "led-4000"), (20.0, "sodium")}, name


def test_the_page_and_its_captions_name_the_lights(lit):
    page = (lit / "run" / "report.html").read_text()
    assert "street: 1 lux, led-4000, low beam" in page
    assert "1 lux street" in page
    assert "combinations of light and spectrum" not in page


def test_the_run_opens_with_its_lights(lit):
    plan = Run.open(lit / "run").plan
    assert [light.name for light in plan.light] == ["street", "sodium-street"]


def test_a_run_of_other_lights_is_another_run(lit):
    with pytest.raises(ValueError, match="plan"):
        swept(lit, grid={"illuminance_lux": (1.0, 20.0)})


def test_training_reads_the_spectrum_of_a_run(lit):
    document = json.loads((lit / "run" / "conditions.json").read_text())
    assert {each["illuminant"] for each in document["conditions"]} == {"led-4000", "sodium"}


def test_two_spectra_at_one_lux_are_two_answers(tmp_path):
    """Rows differ, as sodium gives a grey camera fewer electrons at equal lux than daylight."""
    swept(tmp_path, grid={"illuminance_lux": (3.0,), "illuminant": ("D55", "low-pressure-sodium")})
    found = rows(tmp_path, "answers.csv")
    assert {row["illuminant"] for row in found} == {"D55", "low-pressure-sodium"}
    snr = {
        row["illuminant"]: float(row["snr_db"])
        for row in rows(tmp_path, "results.csv")
        if row["clean"] == "False"
    }
    assert snr["D55"] - snr["low-pressure-sodium"] > 0.5


def at(lux, spectrum):
    stated = {LIGHT.name: lux, SPECTRUM.name: SPECTRUM.choice_index(spectrum)}
    return AxisValues.of(Conditions(exposure_s=0.01, **stated).on(CAMERA))


def test_a_spectrum_that_goes_with_the_light_is_no_setting_of_its_own():
    of = TestedSettings([at(1.0, "led-4000"), at(400.0, "D65")])
    assert of.axes == (LIGHT,)
    assert of.value_text(LIGHT, 1.0) == "1 lux, led-4000 light"


def test_a_spectrum_that_varies_at_one_lux_is_a_setting():
    of = TestedSettings([at(1.0, "led-4000"), at(1.0, "D65"), at(400.0, "D65")])
    assert of.axes == (LIGHT, axis("illuminant"))


def test_a_spectrum_of_a_file_has_its_word_in_the_name_of_a_light():
    street = {"name": "street", "lux": 1.0, "illuminant": "led-4000", "headlamp": "low", "source": ""}
    grid = {SPECTRUM.name: [SPECTRUM.choice_index("own")]}
    assert (
        str(lights_of_run({"plan": {"light": [street], "grid": grid}})[1.0]) == "street: 1 lux, own, low beam"
    )
