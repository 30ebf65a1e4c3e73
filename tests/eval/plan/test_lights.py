"""Lights and spectra in plans: named lights, the axis of illuminants, a user's own curve, files and identities."""

import json

import pytest
from blurnoise_eval.plan.axes import OWN_SPECTRUM, SPECTRUM, axis
from blurnoise_eval.plan.files import PlanFile, SceneFile
from blurnoise_eval.plan.plan import SweepPlan

from blurnoise import Camera, Curve
from blurnoise.camera.spectra import with_infrared

IMX250 = Camera.preset("imx250")
ASKED = {"exposure_ms": "2,10", "dx": 0, "gain": "0"}


def spectra_by_lux(plan):
    return {at.illuminance_lux: at["illuminant"] for at in plan.conditions()}


def test_each_light_brings_its_lux_and_spectrum():
    plan = SweepPlan.of({**ASKED, "light": "street,dusk"})
    assert plan.values("illuminance_lux") == (1.0, 400.0)
    named = {lux: SPECTRUM.choice(value) for lux, value in spectra_by_lux(plan).items()}
    assert named == {1.0: "led-4000", 400.0: "D65"}
    assert plan.light_at(1.0).name == "street"
    assert plan.light_at(2.0) is None


def test_a_light_reaches_the_exposure():
    (dark, _, *_) = SweepPlan.of({**ASKED, "light": "sodium-street"}).conditions()
    exposure = dark.exposure(IMX250)
    assert (exposure.illuminance_lux, exposure.illuminant) == (20.0, "sodium")


def test_a_given_spectrum_is_in_place_of_the_light_s():
    plan = SweepPlan.of({**ASKED, "light": "street,dusk", "illuminant": "halogen"})
    assert set(spectra_by_lux(plan).values()) == {SPECTRUM.choice_index("halogen")}


def test_without_light_and_illuminant_no_condition_names_a_spectrum():
    """So that ids of cells stay what they were."""
    plan = SweepPlan.of({**ASKED, "lux": "1,400"})
    assert set(spectra_by_lux(plan).values()) == {None}
    assert not {"light", "own_spectrum"} & plan.to_dict().keys()


@pytest.mark.parametrize("name", ["led-4000", "D55", "planck:2856", "planck:3200.5"])
def test_a_spectrum_is_read_as_it_is_typed(name):
    (value,) = SPECTRUM.values(name.upper() if name[0] == "l" else name)
    assert SPECTRUM.typed(value) == name
    assert SPECTRUM.checked((value,)) == (value,)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"light": "street", "lux": 1}, "light, lux: must not be combined"),
        ({"light": "lit-street,sodium-street"}, "same lux"),
        ({"light": 5}, "light = 5: must be names"),
        ({"illuminant": "candle"}, "illuminant = 'candle': must be one of D50"),
        ({"illuminant": "planck:9"}, "illuminant"),
        ({"illuminant": OWN_SPECTRUM}, "illuminant = own: needs a CSV file"),
        ({"illuminant": "a.csv,b.csv"}, "one CSV file at most"),
    ],
)
def test_refused(settings, words):
    with pytest.raises(ValueError, match=words) as error:
        SweepPlan.of({**ASKED, **settings})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("400,-1\n700,2\n", "lamp.csv: illuminant: power at 400 nm = -1: must be >= 0"),
        ("400,1\n300,2\n", "lamp.csv: illuminant: gives no visible light"),
        ("900,1\n1000,1\n", "lamp.csv: illuminant: gives no visible light"),
    ],
)
def test_a_file_without_visible_light_is_refused(tmp_path, rows, words):
    (tmp_path / "lamp.csv").write_text(rows)
    with pytest.raises(ValueError, match=words):
        SweepPlan.of({**ASKED, "illuminant": str(tmp_path / "lamp.csv")})


def test_a_plan_in_python_refuses_other_lux_beside_a_light():
    grid = {"exposure_s": (0.01,), "illuminance_lux": (5.0,)}
    with pytest.raises(ValueError, match="light, illuminance_lux"):
        SweepPlan(grid, light=("street",))


@pytest.mark.parametrize(
    "settings", [{"light": "street,dusk"}, {"illuminant": "D65,planck:2856"}, {"light": "moon"}]
)
def test_a_plan_comes_back_from_its_identity(settings):
    plan = SweepPlan.of({**ASKED, **settings})
    again = SweepPlan.from_dict(json.loads(json.dumps(plan.to_dict())))
    assert again == plan
    assert again.conditions() == plan.conditions()


def test_the_lights_are_part_of_the_identity():
    day, street = (SweepPlan.of({**ASKED, **each}).to_dict() for each in ({"lux": 1}, {"light": "street"}))
    assert day != street
    assert street["light"][0]["illuminant"] == "led-4000"


def test_a_plan_file_names_lights_and_options_override_them(tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text("light: [street, daylight]\nilluminant: sodium\nexposure_ms: 5\n")
    plan = PlanFile.read(path).plan
    assert [light.name for light in plan.light] == ["street", "daylight"]
    assert PlanFile.read(path, {"lux": "7"}).plan.values("illuminance_lux") == (7.0,)
    assert [light.name for light in PlanFile.read(path, {"light": "dusk"}).plan.light] == ["dusk"]


def test_the_template_of_a_plan_has_both(tmp_path):
    assert {"# light:", "# illuminant:"} <= set(PlanFile.document().splitlines())


def test_an_own_spectrum_travels_with_the_plan(tmp_path):
    path = tmp_path / "lamp.csv"
    path.write_text("nm,power\n400,1\n550,3\n700,2\n")
    plan = SweepPlan.of({**ASKED, "lux": 5, "illuminant": f"D65,{path}"})
    assert plan.own_spectrum.values == (1.0, 3.0, 2.0)
    path.unlink()
    again = SweepPlan.from_dict(json.loads(json.dumps(plan.to_dict())))
    own = [at for at in again.conditions() if at["illuminant"] == SPECTRUM.choice_index(OWN_SPECTRUM)]
    exposure = own[0].exposure(IMX250, spectrum=again.own_spectrum)
    assert exposure.illuminant == plan.own_spectrum
    with pytest.raises(ValueError, match="illuminant = own: needs"):
        own[0].exposure(IMX250)


def test_an_infrared_lamp_travels_with_the_plan():
    """Beside the lux and spectrum of each condition, for a camera that sees it."""
    plan = SweepPlan.of({**ASKED, "lux": "1,5", "illuminant": "D65", "infrared": "850:0.1"})
    again = SweepPlan.from_dict(json.loads(json.dumps(plan.to_dict())))
    camera = IMX250.with_figures(infrared_cut_nm=0.0, quantum_efficiency=Curve((400.0, 1000.0), (0.5, 0.5)))
    for at in again.conditions():
        lit = at.exposure(camera, infrared=again.infrared).illuminant
        assert lit == with_infrared("D65", at.illuminance_lux, "850:0.1")
    with pytest.raises(ValueError, match="imx250 sees nothing from 700 nm on"):
        again.conditions()[0].exposure(IMX250, infrared=again.infrared)
    assert "infrared" not in SweepPlan.of(ASKED).to_dict()


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ({"infrared": "850"}, "infrared = '850': must be NM:IRRADIANCE"),
        ({"infrared": "850:1", "headlamp": "low"}, "infrared, headlamp: must not be combined"),
        ({"lux": 5, "illuminant": "led-850"}, "illuminant = 'led-850': is infrared, which lux do not count"),
    ],
)
def test_infrared_that_no_plan_can_have(asked, why):
    with pytest.raises(ValueError, match=why):
        SweepPlan.of({**ASKED, **asked})


def test_a_scene_has_one_light():
    assert SceneFile.of({"light": "street"}).at()["illuminant"] == SPECTRUM.choice_index("led-4000")
    assert SceneFile.of({}).at().get("illuminant") is None
    with pytest.raises(ValueError, match=r"^light: must be one value"):
        SceneFile.of({"light": "street,dusk"}).at()
    with pytest.raises(ValueError, match=r"^lux: must be one value"):
        SceneFile.of({"lux": "1,2"}).at()


def test_the_spectra_a_search_spans_are_those_of_the_lights():
    plan = SweepPlan.of({**ASKED, "light": "street,lit-street"})
    assert plan.spanned["illuminant"] == (axis("illuminant").choice_index("led-4000"),)
    assert "illuminant" not in plan.grid


def test_no_name_is_no_light():
    with pytest.raises(ValueError, match="light = '': must be names"):
        SweepPlan.of({"light": ""})
