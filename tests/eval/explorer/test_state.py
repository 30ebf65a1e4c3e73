"""States, the queries that name them, and the controls that move them."""

import math
from dataclasses import replace
from urllib.parse import urlencode

import pytest
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.state import FIGURES, STEPS, State, controls, key, with_figures
from blurnoise_eval.grid.axes import AUTOMATIC, AXES

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
    assert USUAL.query(USUAL) == "exposure-ms=20&lux=2&dx=1000&dy=0&gain=auto"
    for base in (USUAL, replace(MOVED, figures=())):
        for state in (USUAL, MOVED, MOVED.put("moves", None)):
            assert State.of_query(state.query(base), base) == state
    assert State.of_query("", MOVED) == MOVED
    assert replace(MOVED, cell="a1").query(USUAL) == "model=none&cell=a1"


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("exposure-ms=-3", "exposure-ms = '-3': exposure_s = -0.003: must be finite and > 0"),
        ("gain=nan", "gain = 'nan': gain_db = nan: must be"),
        ("lux=", "lux = '': must"),
        ("moves=nobody", "must be one of all, targets, background"),
        (
            "cell=a1&read_noise_e=3",
            "has its own picture, camera and conditions; remove dx, f-number, read_noise_e",
        ),
    ],
)
def test_a_wrong_query_says_what_is_wrong(query, told):
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        State.of_query(f"dx=7&{query}&f-number=4", USUAL)
    assert told in str(error.value)


@pytest.mark.parametrize(
    "value",
    ["own", "auto", "", "nan", "-inf", "1e999", "1e-320", "-0", "0.5", "²", "\0", "\udcff", "9" * 5000, "1_0", " 1 ",
     "a=b=c", "sign-²", "run/x", "../../etc/passwd", "none", "all", "<script>", "a" * 100_000],
    ids=lambda value: repr(value[:20]),
)  # fmt: skip
def test_whatever_a_url_says_it_is_a_state_or_a_line(value):
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


def test_every_number_that_an_effect_or_stage_depends_on_has_a_slider():
    camera = PRESETS["imx250"]
    figures = {name for part in (*EFFECTS, *STAGES) for name in part.figures}
    numbers = {name for name in figures if isinstance(camera.figure(name), float)}
    assert numbers <= {each.axis.into.removeprefix("camera.") for each in controls(camera).values()}


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_every_control_stands_where_the_state_is_and_moves_it(name):
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
