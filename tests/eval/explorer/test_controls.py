"""Controls follow the tables: a new axis is a new slider, and does what it says."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from blurnoise_eval.explorer import state as states
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.controls import STEPS, control, controls
from blurnoise_eval.explorer.snippets import command, python
from blurnoise_eval.explorer.state import State, with_figures
from blurnoise_eval.grid import axes, conditions
from blurnoise_eval.grid.axes import AUTOMATIC, axis

from blurnoise import Camera
from blurnoise.light.effects import EFFECTS
from blurnoise.optics.camera import PRESETS
from blurnoise.sensor.stages import STAGES

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
    assert "read_noise_made_up=33.0" in python(catalogue, state)
    assert state.at.exposure(IMX250).camera.read_noise_e == 33.0
    assert (
        sum(name.startswith("read_noise") for name in controls(IMX250)) == 1
    )  # the axis, in the figure's place
