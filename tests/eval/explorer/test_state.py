"""States, and the queries that say them."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from urllib.parse import urlencode

import pytest
from blurnoise_eval.explorer import state as states
from blurnoise_eval.explorer.catalogue import Catalogue, command, python
from blurnoise_eval.explorer.state import (
    STEPS,
    State,
    control,
    controls,
    key,
    of_text,
    option_text,
    with_figures,
)
from blurnoise_eval.grid import axes, conditions
from blurnoise_eval.grid.axes import AUTOMATIC, AXES, axis
from hypothesis import given, settings
from hypothesis import strategies as st

from blurnoise import Camera
from blurnoise.light.effects import EFFECTS
from blurnoise.optics.camera import PRESETS
from blurnoise.sensor.stages import STAGES

USUAL = State()
MOVED = (
    replace(USUAL, picture="picture-1f", camera="ar0237", model="none", seed=7, along="gain_db")
    .put("exposure_s", AUTOMATIC)
    .put("velocity_y_px_s", -12.5)
    .put("gain_db", None)
    .put("moves", 1.0)
    .put_figure("prnu", 0.021)
)


def test_a_query_says_a_state() -> None:
    assert USUAL.query(USUAL) == "exposure-ms=20&lux=2&dx=1000&dy=0&gain=auto"
    for base in (USUAL, MOVED):
        for state in (USUAL, MOVED, MOVED.put("moves", None)):
            assert State.of_query(state.query(base), replace(base, figures=())) in (
                (state, ()),
                (replace(state, along=base.along), ()),
            )
    assert State.of_query("", MOVED) == (MOVED, ())
    assert replace(MOVED, cell="a1").query(USUAL) == "model=none&along=gain_db&cell=a1"


@settings(max_examples=60, deadline=None)
@given(st.floats(1e-4, 1e3), st.floats(0, 1e5), st.floats(-1e4, 1e4), st.floats(0.5, 64))
def test_every_number_survives_the_url(exposure_ms: float, lux: float, dx: float, f_number: float) -> None:
    state = USUAL.put("exposure_s", axis("exposure_s").of_option(exposure_ms))
    state = state.put("illuminance_lux", lux).put("velocity_x_px_s", dx).put("f_number", f_number)
    assert State.of_query(state.query(USUAL), USUAL) == (state, ())


def test_what_excludes_another_resets_it() -> None:
    driven = MOVED.put("ego_speed_m_s", 20.0)
    assert [driven.at[name] for name in ("velocity_x_px_s", "velocity_y_px_s", "moves")] == [0.0, 0.0, None]
    assert driven.put("velocity_x_px_s", 3.0).at["ego_speed_m_s"] is None
    assert State.of_query("ego-kmh=50", USUAL) == (USUAL.put("ego_speed_m_s", 50 / 3.6), ())  # typed by hand
    assert replace(USUAL, cell="abc").put("illuminance_lux", 3.0).cell == ""


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("exposure-ms=-3", "exposure-ms = '-3': exposure_s = -0.003: must be finite and > 0"),
        ("exposure-ms=1e400", "exposure-ms = '1e400': must be a number, or auto"),
        ("gain=nan", "gain = 'nan': gain_db = nan: must be"),
        ("lux=bright", "lux = 'bright': must be a number"),
        ("exposure-ms=own", "exposure-ms = 'own': must be a number, or auto"),
        ("seed=x", "seed = 'x': "),
        ("prnu=1e400", "prnu = '1e400': must be a number"),
        ("lux=", "lux = '': must"),
        ("dx=8", "dx = '8': is given twice"),
        ("fog=3", "fog = '3': must be one of"),
        ("moves=nobody", "must be one of all, targets, background"),
    ],
)
def test_a_wrong_query_says_what_is_wrong_and_the_rest_stands(query: str, told: str) -> None:
    state, (line,) = State.of_query(f"dx=7&{query}&f-number=4", USUAL)
    assert told in line
    assert "\n" not in line
    assert state == USUAL.put("velocity_x_px_s", 7.0).put("f_number", 4.0)


def test_texts_are_short_where_they_may_be() -> None:
    exposure = axis("exposure_s")
    assert option_text(exposure, exposure.of_option(45.0)) == "45"
    assert option_text(axis("moves"), 2.0) == "background"
    for each in AXES:
        for value in () if each.choices else (each.of_option(0.73), each.of_option(31.0)):
            assert of_text(each, option_text(each, value)) == value


def test_figures_replace_the_cameras_own() -> None:
    camera = with_figures(Camera.preset("imx250"), [("row_time_s", 1e-5), ("bit_depth", 10.0)])
    assert (camera.row_time_s, camera.shutter, camera.bit_depth) == (1e-5, "rolling", 10)
    assert with_figures(camera, [("row_time_s", 0.0)]).shutter == "global"


_HOSTILE = (
    "own", "auto", "", "nan", "-inf", "1e999", "1e308", "1e-320", "-0", "1", "-1", "0.5", "²", "١٢", "\0",
    "\udcff", "9" * 5000, "1_0", " 1 ", "1,2", "None", "[]", "%", "a=b=c", "sign-0", "sign-²", "sign-١",
    "sign-99999999999999999999", "run", "run/", "run/x", "given", "../../etc/passwd", "/dev/zero", "none",
    "built-in", "all", "targets", "<script>", "a" * 100_000,
)  # fmt: skip


@pytest.fixture(scope="module")
def catalogue() -> Catalogue:
    return Catalogue()


@pytest.mark.parametrize("value", _HOSTILE, ids=lambda value: repr(value[:20]))
def test_whatever_a_url_says_there_is_a_state_that_can_be_shown(value: str, catalogue: Catalogue) -> None:
    """Every parameter and figure, one by one and all at once."""
    names = [*(each.name for each in fields(State) if each.name not in ("at", "figures")), *map(key, AXES)]
    names += [*(each.name for each in fields(Camera)), "token", "wild", ""]
    asked = [(name, value) for name in names]
    for query in (*([one] for one in asked), asked):
        state, _ = catalogue.resolved(urlencode(query, errors="surrogatepass"))
        camera = catalogue.camera(state)
        assert catalogue.resolved(state.query(catalogue.base)) == (state, ())
        assert all(each.text(each.read(state, camera)) for each in controls(camera).values())
        assert command(catalogue, state)
        assert python(catalogue, state)


IMX250 = Camera.preset("imx250")


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_every_control_stands_where_the_state_is_and_moves_it(name: str) -> None:
    camera, state = PRESETS[name], State()
    for each in controls(camera).values():
        assert each.low < each.high
        value = each.read(state, camera)
        assert value == AUTOMATIC or math.isfinite(value)
        for place in each.places(5):
            moved = each.put(state, place)
            assert each.read(moved, with_figures(camera, moved.figures)) == pytest.approx(place, rel=1e-9)


def test_positions_are_values() -> None:
    for each in controls(IMX250).values():
        if not each.choices:
            assert each.value(0) == pytest.approx(each.low, rel=1e-3, abs=1e-9)
            assert each.value(STEPS) == pytest.approx(each.high, rel=1e-3)
            values = [each.value(place) for place in range(STEPS + 1)]
            assert values == sorted(values)
            assert each.position(values[77]) == pytest.approx(77, abs=0.6)


def test_a_value_that_is_typed_is_the_options_or_refused_by_name() -> None:
    every, state = controls(IMX250), State()
    for name, text, value in (
        ("exposure_s", "12.5", 12.5),
        ("gain_db", "auto", AUTOMATIC),
        ("moves", "targets", 1.0),
    ):
        assert every[name].read(every[name].put(state, text), IMX250) == value
    for name, text, told in (
        ("illuminance_lux", "", "Light = '': must be a number"),
        ("prnu", "much", "= 'much': must"),
    ):
        with pytest.raises(ValueError, match=told):
            every[name].put(state, text)


def test_effects_and_stages_bring_their_figures() -> None:
    named = set(controls(IMX250))
    of_tables = {figure for entry in (*EFFECTS, *STAGES) for figure in entry.figures}
    assert {name for name in of_tables if isinstance(getattr(IMX250, name, None), float)} <= named


def test_a_made_up_axis_appears_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the page's controls, in the URL, in command and script, and in what is exposed."""
    noise = replace(
        axis("f_number"), name="read_noise_made_up", into="camera.read_noise_e", option="--read-noise-e",
        title="Read noise, made up", unit="e-", low=0.0, high=1e3, own=lambda camera: camera.read_noise_e,
    )  # fmt: skip
    table = (*axes.AXES, noise)
    monkeypatch.setattr(axes, "AXES", table)
    monkeypatch.setattr(conditions, "AXES", table)
    monkeypatch.setattr(conditions, "NAMES", (*axes.NAMES, noise.name))
    monkeypatch.setitem(conditions._PLACE, noise.name, len(axes.NAMES))
    assert states.axes.AXES is table
    made = control("read_noise_made_up", IMX250)
    assert (made.title, made.unit, made.logarithmic) == ("Read noise, made up", "e-", True)
    assert made.read(State(), IMX250) == IMX250.read_noise_e
    state = made.put(State(), 33.0)
    catalogue = Catalogue()
    assert State.of_query(state.query(catalogue.base), catalogue.base) == (state, ())
    assert "read-noise-e=33" in command(catalogue, state)
    assert "read-noise-e=33" in python(catalogue, state)
    assert state.at.exposure(IMX250).camera.read_noise_e == 33.0
    assert (
        sum(name.startswith("read_noise") for name in controls(IMX250)) == 1
    )  # the axis, in the figure's place
