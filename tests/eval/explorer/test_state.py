"""States, the queries that name them, and the controls that move them."""

from __future__ import annotations

import math
from dataclasses import replace
from urllib.parse import urlencode

import pytest
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.state import (
    FIGURES,
    STEPS,
    State,
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
IMX250 = Camera.preset("imx250")
MOVED = (
    replace(USUAL, picture="picture-1f", camera="ar0237", model="none", seed=7)
    .put("exposure_s", AUTOMATIC)
    .put("velocity_y_px_s", -12.5)
    .put("gain_db", None)
    .put("moves", 1.0)
    .put("prnu", 0.021)
)


def test_a_query_says_a_state() -> None:
    assert USUAL.query(USUAL) == "exposure-ms=20&lux=2&dx=1000&dy=0&gain=auto"
    for base in (USUAL, replace(MOVED, figures=())):
        for state in (USUAL, MOVED, MOVED.put("moves", None)):
            assert State.of_query(state.query(base), base) == state
    assert State.of_query("", MOVED) == MOVED
    assert replace(MOVED, cell="a1").query(USUAL) == "model=none&cell=a1"


@settings(max_examples=60, deadline=None)
@given(st.floats(1e-4, 1e3), st.floats(0, 1e5), st.floats(-1e4, 1e4), st.floats(0.5, 64))
def test_every_number_survives_the_url(exposure_ms: float, lux: float, dx: float, f_number: float) -> None:
    state = USUAL.put("exposure_s", axis("exposure_s").of_option(exposure_ms))
    state = state.put("illuminance_lux", lux).put("velocity_x_px_s", dx).put("f_number", f_number)
    assert State.of_query(state.query(USUAL), USUAL) == state


def test_texts_are_short_where_they_may_be() -> None:
    exposure = axis("exposure_s")
    assert option_text(exposure, exposure.of_option(45.0)) == "45"
    for each in AXES:
        for value in () if each.choices else (each.of_option(0.73), each.of_option(31.0)):
            assert of_text(each, option_text(each, value)) == value


def test_what_excludes_another_resets_it() -> None:
    driven = MOVED.put("ego_speed_m_s", 20.0)
    assert [driven.at[name] for name in ("velocity_x_px_s", "velocity_y_px_s", "moves")] == [0.0, 0.0, None]
    assert driven.put("velocity_x_px_s", 3.0).at["ego_speed_m_s"] is None
    assert State.of_query("ego-kmh=50", USUAL) == USUAL.put("ego_speed_m_s", 50 / 3.6)  # typed by hand
    assert replace(USUAL, cell="abc").put("illuminance_lux", 3.0).cell == ""


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("exposure-ms=-3", "exposure-ms = '-3': exposure_s = -0.003: must be finite and > 0"),
        ("exposure-ms=1e400", "exposure-ms = '1e400': must be a number, or auto"),
        ("gain=nan", "gain = 'nan': gain_db = nan: must be"),
        ("exposure-ms=own", "exposure-ms = 'own': must be a number, or auto"),
        ("seed=x", "seed = 'x': "),
        ("prnu=1e400", "prnu = '1e400': must be a number"),
        ("lux=", "lux = '': must"),
        ("fog=3", "fog = '3': must be one of"),
        ("moves=nobody", "must be one of all, targets, background"),
    ],
)
def test_a_wrong_query_says_what_is_wrong(query: str, told: str) -> None:
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        State.of_query(f"dx=7&{query}&f-number=4", USUAL)
    assert told in str(error.value)


@pytest.mark.parametrize(
    "value",
    ["own", "auto", "", "nan", "-inf", "1e999", "1e-320", "-0", "0.5", "²", "\0", "\udcff", "9" * 5000, "1_0", " 1 ",
     "a=b=c", "sign-²", "run/x", "../../etc/passwd", "none", "all", "<script>", "a" * 100_000],
    ids=lambda value: repr(value[:20]),
)  # fmt: skip
def test_whatever_a_url_says_it_is_a_state_or_a_line(value: str) -> None:
    """Of every parameter and figure."""
    catalogue = Catalogue()
    names = ["picture", "camera", "model", "cell", "seed", "token", "", *map(key, (*AXES, *FIGURES))]
    for name in names:
        try:
            state = catalogue.start(urlencode([(name, value)], errors="surrogatepass"))
        except (ValueError, TypeError):
            continue
        camera = catalogue.camera(state)
        assert catalogue.start(state.query(catalogue.base)) == state
        assert all(each.text(each.read(state, camera)) for each in controls(camera).values())


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_every_control_stands_where_the_state_is_and_moves_it(name: str) -> None:
    camera, state = PRESETS[name], State()
    for each in controls(camera).values():
        assert each.low < each.high
        value = each.read(state, camera)
        assert value == AUTOMATIC or math.isfinite(value)
        values = [each.value(place) for place in range(each.steps + 1)]
        assert values == sorted(values)
        for place in range(0, each.steps + 1, max(1, STEPS // 5)):
            moved = each.put(state, each.text(values[place]))
            held = each.read(moved, with_figures(camera, moved.figures))
            assert held == pytest.approx(values[place], rel=1e-9)
            assert each.position(held) == pytest.approx(place, abs=0.6)
        assert values[-1] == pytest.approx(each.high, rel=1e-3)


def test_a_logarithmic_control_has_equal_ratios() -> None:
    exposure = controls(IMX250)["exposure_s"]
    assert exposure.value(STEPS / 2) == pytest.approx(math.sqrt(exposure.low * exposure.high), rel=5e-3)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [("illuminance_lux", "", "Light = '': must be a number"), ("prnu", "much", "= 'much': must")],
)
def test_what_is_typed_in_vain_is_refused_by_name(name: str, text: str, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        controls(IMX250)[name].put(State(), text)


def test_every_figure_of_effects_and_stages_has_a_control() -> None:
    of_tables = {figure for entry in (*EFFECTS, *STAGES) for figure in entry.figures}
    assert {name for name in of_tables if isinstance(getattr(IMX250, name, None), float)} <= set(
        controls(IMX250)
    )
    rolling = with_figures(IMX250, [("row_time_s", 1e-5)])
    assert (rolling.row_time_s, rolling.shutter) == (1e-5, "rolling")
    assert with_figures(rolling, [("row_time_s", 0.0)]).shutter == "global"


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
    every = controls(IMX250)
    assert "read_noise_e" not in every  # the axis stands in the figure's place
    assert every[noise.name].logarithmic
    state = every[noise.name].put(State(), "33")
    catalogue = Catalogue()
    assert State.of_query(state.query(catalogue.base), catalogue.base) == state
    assert "read-noise-e=33" in catalogue.command(state)
    assert "read-noise-e=33" in catalogue.script(state)
    assert state.at.exposure(IMX250).camera.read_noise_e == 33.0
