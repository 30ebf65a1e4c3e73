"""States, and the URLs that say them."""

from __future__ import annotations

from dataclasses import fields, replace
from urllib.parse import urlencode

import pytest
from blurnoise_eval.explorer.controls import controls
from blurnoise_eval.explorer.shelf import Shelf, held
from blurnoise_eval.explorer.state import State, figure, key, of_text, option_text, with_figures
from blurnoise_eval.explorer.told import command, python
from blurnoise_eval.grid.axes import AUTOMATIC, AXES, axis
from blurnoise_models.detector import STOP_SIGN
from hypothesis import given, settings
from hypothesis import strategies as st

from blurnoise import Camera

USUAL = State()
MOVED = (
    replace(USUAL, picture="picture-1f", camera="ar0237", model="none", seed=7, along="speed")
    .put("exposure_s", AUTOMATIC)
    .put("velocity_y_px_s", -12.5)
    .put("moves", 1.0)
    .put_figure("prnu", 0.021)
)


def test_a_url_says_a_state_and_leaves_out_what_is_usual() -> None:
    assert USUAL.query() == ""
    assert State.of_query("") == (USUAL, ())
    assert State.of_query(MOVED.query()) == (MOVED, ())
    assert "exposure-ms=auto" in MOVED.query()
    assert "lux" not in MOVED.query()


@settings(max_examples=60, deadline=None)
@given(st.floats(1e-4, 1e3), st.floats(0, 1e5), st.floats(-1e4, 1e4), st.floats(0.5, 64))
def test_every_number_survives_the_url(exposure_ms: float, lux: float, dx: float, f_number: float) -> None:
    state = USUAL.put("exposure_s", axis("exposure_s").of_option(exposure_ms))
    state = state.put("illuminance_lux", lux).put("velocity_x_px_s", dx).put("f_number", f_number)
    assert State.of_query(state.query()) == (state, ())


def test_what_does_not_go_together_gives_way() -> None:
    driven = MOVED.put("ego_speed_m_s", 20.0)
    assert (driven.at["velocity_x_px_s"], driven.at["velocity_y_px_s"], driven.at["moves"]) == (
        0.0,
        0.0,
        None,
    )
    assert driven.put("velocity_x_px_s", 3.0).at["ego_speed_m_s"] is None
    assert State.of_query("ego-kmh=50") == (USUAL.put("ego_speed_m_s", 50 / 3.6), ())  # typed by hand
    assert replace(USUAL, cell="abc").put("illuminance_lux", 3.0).cell == ""


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("exposure-ms=-3", "exposure-ms = '-3': must be > 0 and <= 3600000 ms, or auto"),
        ("exposure-ms=1e400", "exposure-ms = '1e400': must be > 0 and <= 3600000 ms, or auto"),
        ("gain=nan", "gain = 'nan': must be >= "),
        ("lux=bright", "lux = 'bright': must be >= 0 and <= 1000000000 lux"),
        ("threshold=0.5", "threshold = '0.5': must be one of"),
        ("exposure-ms=own", "exposure-ms = 'own': must be > 0"),
        ("lux=own", "lux = 'own': must be >= 0"),
        ("seed=x", "seed = 'x': must be an integer"),
        ("figure=prnu=1e400", "NAME=NUMBER"),
        ("figure=prnu", "NAME=NUMBER"),
        ("fog=3", "fog = '3': must be one of"),
        ("moves=nobody", "must be one of all, targets, background"),
    ],
)
def test_a_wrong_url_says_what_is_wrong_and_the_rest_stands(query: str, told: str) -> None:
    state, (line,) = State.of_query(f"dx=7&{query}&f-number=4")
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
    camera = with_figures(Camera.preset("imx250"), [figure("row_time_s=1e-5"), figure("bit_depth=10")])
    assert (camera.row_time_s, camera.shutter, camera.bit_depth) == (1e-5, "rolling", 10)
    assert with_figures(camera, [("row_time_s", 0.0)]).shutter == "global"
    with pytest.raises(ValueError, match=r"figure = 'name': must be one of"):
        with_figures(camera, [("name", 1.0)])


_HOSTILE = (
    "own", "auto", "", "nan", "inf", "-inf", "1e999", "1e308", "1e-320", "-0", "1", "-1", "0.5", "²", "١٢", "\0",
    "\udcff", "9" * 5000, "1_0", " 1 ", "1,2", "None", "True", "[]", "{}", "%", "a=b=c", "sign-0", "sign-²", "sign-١",
    "sign-99999999999999999999", "run", "run/", "run/x", "given-picture", "../../etc/passwd", "/dev/zero", "none",
    "picture-00", "built-in", "all", "targets", "speed", "direction", "<script>", "a" * 100_000,
)  # fmt: skip


@pytest.fixture(scope="module")
def shelf() -> Shelf:
    return Shelf(STOP_SIGN)


@pytest.mark.parametrize("value", _HOSTILE, ids=lambda value: repr(value[:20]))
def test_whatever_a_url_says_there_is_a_state_that_can_be_seen(value: str, shelf: Shelf) -> None:
    """Every parameter and figure, one by one and all at once."""
    names = [*(each.name for each in fields(State) if each.name not in ("at", "figures")), *map(key, AXES)]
    asked = [(name, value) for name in (*names, "figure", "token", "wild", "")]
    asked += [("figure", f"{each.name}={value}") for each in fields(Camera)]
    for query in ([one] for one in asked), [asked]:
        for told in query:
            read, _ = State.of_query(urlencode(told, errors="surrogatepass"))
            state, _ = held(shelf, read, USUAL)
            camera = shelf.camera(state)
            assert State.of_query(state.query()) == (state, ())
            assert all(each.text(each.read(state, camera)) for each in controls(camera))
            assert command(state, shelf.files(state))
            assert python(state, shelf.files(state))
