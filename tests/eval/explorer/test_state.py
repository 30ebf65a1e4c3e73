"""States, the queries that name them, and the controls that move them."""

import math
from dataclasses import replace
from urllib.parse import urlencode

import pytest
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.state import QUANTITIES, State, controls, text_of, value_of, with_figures
from blurnoise_eval.plan.typed import AUTOMATIC

from blurnoise.camera import PRESETS
from blurnoise.light.effects import EFFECTS
from blurnoise.sensor.stages import STAGES

USUAL = State()
MOVED = (
    replace(USUAL, picture="picture-1f", camera="ar0237", model="none", seed=7)
    .put("exposure_s", AUTOMATIC)
    .put("velocity_y_px_s", -12.5)
    .put("gain_db", None)
    .put("moves", 1.0)
    .put("prnu", 0.021)
)


def test_a_query_says_a_state():
    assert USUAL.query(USUAL) == "exposure-ms=5&lux=5&dx=1000&dy=0&gain=auto"
    for base in (USUAL, replace(MOVED, figures=())):
        for state in (USUAL, MOVED, MOVED.put("moves", None)):
            assert State.of_query(state.query(base), base) == state
    assert State.of_query("", MOVED) == MOVED


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ("exposure-ms=-3", "exposure-ms = '-3': exposure_s = -0.003: must be finite and > 0"),
        ("gain=nan", "gain = 'nan': gain_db = nan: must be"),
        ("lux=", "lux = '': must"),
        ("moves=nobody", "must be one of all, targets, background"),
        ("lux=own", "lux = 'own': illuminance_lux: must be specified"),
    ],
)
def test_a_wrong_query_says_what_is_wrong(query, message):
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        State.of_query(f"dx=7&{query}&f-number=4", USUAL)
    assert message in str(error.value)


def test_what_names_the_setting_itself_names_it_once():
    with pytest.raises(ValueError, match=r"^headlamp = 'hi': must be one of off, low, high$"):
        State.of_query("headlamp=hi", USUAL)


@pytest.mark.parametrize(
    "value",
    ["own", "auto", "", "nan", "-inf", "1e999", "1e-320", "-0", "0.5", "²", "\0", "\udcff", "9" * 5000, "1_0", " 1 ",
     "a=b=c", "sign-²", "run/x", "../../etc/passwd", "none", "all", "<script>", "a" * 100_000],
    ids=lambda value: repr(value[:20]),
)  # fmt: skip
def test_whatever_a_url_says_it_is_a_state_or_a_line(value):
    """Of every parameter and figure."""
    catalogue = Catalogue()
    names = ["picture", "camera", "model", "seed", "repeat", "token", "", *QUANTITIES]
    for name in names:
        try:
            state = catalogue.start(urlencode([(name, value)], errors="surrogatepass"))
        except (ValueError, TypeError):
            continue
        camera = catalogue.camera(state)
        assert catalogue.start(state.query(catalogue.base)) == state
        assert all(text_of(each.axis, each.read(state, camera)) for each in controls(camera).values())


def test_every_number_that_an_effect_or_stage_depends_on_has_a_slider():
    camera = PRESETS["imx250"]
    figures = {name for part in (*EFFECTS, *STAGES) for name in part.figures}
    numbers = {name for name in figures if isinstance(camera.figure(name), float)}
    assert numbers <= {each.axis.into.removeprefix("camera.") for each in controls(camera).values()}


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_every_slider_stands_where_the_state_is_and_moves_it(name):
    camera, state = PRESETS[name], State()
    for control in controls(camera).values():
        assert list(control.values) == sorted(control.values)
        value = control.read(state, camera)
        assert value == AUTOMATIC or math.isfinite(value)
        for position in range(0, len(control.values), max(1, len(control.values) // 5)):
            wanted = value_of(control.axis, control.texts[position])
            moved = state.put(control.axis.name, wanted)
            assert control.read(moved, with_figures(camera, moved.figures)) == wanted
            assert control.values[control.position(wanted)] == wanted


def test_a_logarithmic_slider_has_equal_ratios():
    values = controls(PRESETS["imx250"])["exposure_s"].values
    assert values[100] == pytest.approx((values[0] * values[-1]) ** 0.5, rel=1e-2)


def test_a_later_part_resets_what_it_excludes():
    driven = State.of_query("ego-kmh=36", USUAL)
    assert (driven.at["ego_speed_m_s"], driven.at["velocity_x_px_s"]) == (10.0, 0.0)
    assert State.of_query("ego-kmh=36&dx=50", USUAL) == State.of_query("dx=50", USUAL)


def test_the_spectrum_of_a_file_survives_a_query():
    own = QUANTITIES["illuminant"].choice_index("own")
    state = USUAL.put("illuminant", own)
    assert State.of_query(state.query(USUAL), USUAL).at["illuminant"] == own
    usual = State.of_query(USUAL.query(state), state).at["illuminant"]
    assert text_of(QUANTITIES["illuminant"], usual) == "D55"


def test_a_query_may_name_a_light():
    at = State.of_query("light=sodium-street", State()).at
    assert at["illuminance_lux"] == 20.0
    assert [text_of(QUANTITIES[name], at[name]) for name in ("illuminant", "headlamp")] == ["sodium", "low"]
    with pytest.raises(ValueError, match="light = 'moonlight'"):
        State.of_query("light=moonlight", State())
