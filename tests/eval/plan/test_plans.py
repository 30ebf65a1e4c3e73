"""Plans and their numbers: checked where they are made, limits of the simulator, conditions by their axes."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.plan.axes import AXES, EGO, OWN_SPECTRUM, VELOCITY, axis
from blurnoise_eval.plan.conditions import Cell, Conditions, with_lens
from blurnoise_eval.plan.objects import ObjectSettings
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.typed import AUTOMATIC, number, numbers
from plans import IMX250, plan
from plans import plan as swept
from signs_in_memory import CAMERA, PLAN, TWO, matched_detector, rows_of

from blurnoise import Exposure
from blurnoise._core.checks import LIMITS
from blurnoise.camera import Camera
from blurnoise.camera.spectra import ILLUMINANTS
from blurnoise.motion.ego import Vehicle, View
from blurnoise.scene.exposure import HEADLAMP, MOVES

AT = Conditions(exposure_s=0.01, illuminance_lux=50, velocity_x_px_s=300.0, velocity_y_px_s=-400.0)


@pytest.mark.parametrize("n_lights", [1, 4, 12])
def test_examples_reach_from_no_blur_to_much_and_over_lights(n_lights):
    made = plan([0.001 * n for n in range(1, 9)], range(1, 1 + n_lights), (0, 200, -500))
    chosen, every = made.example_conditions(), made.conditions()
    assert len(chosen) == 12
    assert chosen <= set(every)
    assert {at["velocity_x_px_s"] for at in chosen} == {-500, 0, 200}
    assert max(at.blur_px for at in chosen) == max(at.blur_px for at in every)
    assert len({at.illuminance_lux for at in chosen}) >= min(3, n_lights)
    assert plan((0.01,), (5.0,)).example_conditions() == set(plan((0.01,), (5.0,)).conditions())


def test_ids_of_the_first_four_axes_stay_what_they_were():
    """Ids of runs on disk: a sweep that goes on must find its cells."""
    assert repr(AT) == (
        "Conditions(exposure_s=0.01, illuminance_lux=50.0, velocity_x_px_s=300.0, velocity_y_px_s=-400.0)"
    )
    assert Cell("p", 1, AT, 7).cell_id == "4a3433078e037d717cdc"
    assert Cell("p", 1, None, 7).cell_id == "434b2ce75f2a45f35bdc"
    still = Conditions(exposure_s=0.01, illuminance_lux=50, velocity_x_px_s=-0.0)
    assert repr(still).endswith("velocity_x_px_s=0.0, velocity_y_px_s=0.0)")
    assert repr(Conditions(**{**AT, "gain_db": 6.0})) == repr(AT)[:-1] + ", gain_db=6.0)"


@pytest.mark.parametrize(("place", "kmh"), [(1, 50.0), (2, 100.0)])
def test_default_speeds_are_those_of_a_sign_that_a_vehicle_passes(place, kmh):
    """5 m beside and 12.5 m ahead, by a pinhole of 1280 px over 60 degrees; to 2 %, as the defaults are round."""
    camera = Camera.preset("ar0132c")
    view = View(camera.sensor.width_px, camera.sensor.height_px, camera.lens.hfov_deg, "rectilinear")
    middle_px = (camera.sensor.width_px - 1) / 2, (camera.sensor.height_px - 1) / 2
    pixel = np.array([[middle_px[0] + view.focal_px * 5 / 12.5], [middle_px[1]]])
    flow_px_s = view.flow_px_s(pixel, np.array([math.hypot(5, 12.5)]), Vehicle().driving(kmh / 3.6))
    dx = axis("velocity_x_px_s")
    assert dx.default[place] == pytest.approx(float(flow_px_s[0, 0]), rel=0.02)
    assert dx.default_names[place] == f"{kmh:g} km/h"


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: axis.name)
def test_every_axis_reaches_the_simulator_and_the_columns(axis):
    """A value of its own on one axis, seen where ``into`` says, and nothing else is other than without it."""
    last = [name for name in axis.choices if name != OWN_SPECTRUM][-1:]
    value = float(axis.choices.index(last[0])) if last else min(3.0, (axis.low + 3 * axis.high) / 4)
    at = AT if axis is not EGO else Conditions(**{**AT, **dict.fromkeys(VELOCITY, 0.0)})
    with_it = Conditions(**{**at, axis.name: value})
    assert with_it.on(IMX250) == {**at.on(IMX250), axis.name: value}
    plain, exposure = at.exposure(IMX250, 11), with_it.exposure(IMX250, 11)
    assert exposure.seed == 11
    place, _, part = axis.into.partition(".")
    if place == "camera":
        changed = {part: value} | ({"diffraction_wavelength_um": 0.55} if part == "f_number" else {})
        expected = replace(plain, camera=IMX250.with_figures(**changed))
    elif part:
        vector = list(plain.velocity_px_s)
        vector[int(part)] = value
        expected = replace(plain, velocity_px_s=(vector[0], vector[1]))
    else:
        expected = replace(plain, **{place: last[0] if last else value})
    assert exposure == expected
    assert exposure != plain


def test_the_camera_s_own_stands_where_nothing_is_stated():
    camera = IMX250.with_figures(f_number=5.6, defocus_radius_px=1.5)
    at = AT.on(camera)
    assert (at["f_number"], at["defocus_radius_px"], at["temperature_c"], at["gain_db"]) == (5.6, 1.5, 25, 0)
    exposure = AT.exposure(camera)
    assert exposure.camera is camera
    assert (exposure.temperature_c, exposure.gain_db, exposure.velocity_px_s) == (25.0, 0.0, (300.0, -400.0))


def test_an_f_number_of_a_sweep_scales_a_measured_t_number():
    measured = IMX250.with_figures(f_number=2.0, t_number=2.2)
    assert with_lens(measured, f_number=4.0).lens.t_number == 4.4


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: axis.name)
def test_the_axes_limits_are_the_simulators(axis):
    name = axis.into.removeprefix("camera.").partition(".")[0]
    if axis.choices:
        known = {"moves": MOVES, "illuminant": (*ILLUMINANTS, OWN_SPECTRUM), "headlamp": HEADLAMP}[axis.name]
        assert axis.choices == known
        assert (axis.low, axis.high) == (0, LIMITS["kelvin"].high if axis.prefix else len(known) - 1)
        assert not axis.prefix or axis.least_number == LIMITS["kelvin"].low
    elif name in LIMITS:  # a figure of the camera may have its range on the field itself
        assert (axis.low, axis.high) == LIMITS[name][:2]
        return
    for end in (axis.low, axis.high):
        if axis.into.startswith("camera."):
            IMX250.with_figures(**{name: end})
        else:
            value: Any = axis.choice(end) if axis.choices else end
            Exposure(IMX250, 0.01, 50.0, **{name: value})


NEEDED: Any = {"exposure_s": (0.01,), "illuminance_lux": (5.0,)}


GRIDS: list[tuple[Any, str]] = [
    ({"exposure_s": (0.0,)}, "exposure_s = 0.0: must be finite and > 0"),
    ({"exposure_s": (float("nan"),)}, "exposure_s = nan"),
    ({"exposure_s": ()}, "exposure_s: must hold at least one"),
    ({"illuminance_lux": (-1.0,)}, "illuminance_lux = -1.0"),
    ({"velocity_x_px_s": (float("inf"),)}, "velocity_x_px_s = inf"),
    (
        {"velocity_y_px_s": (-2e6, 0.0), "exposure_s": (0.1,)},
        "velocity_y_px_s: 2e\\+06 times exposure_s = 200000.0",
    ),
    ({"temperature_c": (float("nan"),)}, "temperature_c = nan"),
    ({"f_number": (0.0, 2.0)}, "f_number = 0.0"),
    ({"moves": ("wheels",)}, "moves = 'wheels': must be one of all, targets, background"),
    ({"iso": (100.0,)}, "axis = 'iso': must be one of exposure_s, .*gain_db"),
    ({"exposure_s": ("auto", 0.01)}, "exposure_s: must be auto or times"),
    ({"exposure_s": ("auto",), "gain_db": (0.0,)}, "exposure_s = auto: "),
    ({"exposure_s": ("auto",), "velocity_x_px_s": (9e6,)}, "9e\\+06 times exposure_s"),
    ({"ego_speed_m_s": (20.0,), "velocity_x_px_s": (100.0,)}, "excludes velocity_x_px_s"),
    ({"ego_speed_m_s": (20.0,), "velocity_y_px_s": (0.0, 3.0)}, "excludes velocity_y_px_s"),
    ({"ego_speed_m_s": (20.0,), "moves": (0.0, 1.0)}, "excludes moves"),
]
FIELDS: list[tuple[Any, str]] = [
    ({"repeats": 0}, "repeats = 0"),
    *(({"seed": seed}, "seed = ") for seed in (10**400, -1, 1.5, "1", None)),
    ({"vehicle": Vehicle()}, "vehicle: needs ego_speed_m_s"),
    ({"objects": ObjectSettings(speeds={"car": 2.0})}, "speeds: .* moves = targets"),
    *(
        ({"trajectory": text}, text.partition(":")[0])
        for text in ("shake", "shake:x", "shake:1,2", "sine:3", "sine:3,80,1,1", "shake:-2", "sine:3,0")
    ),
]


@pytest.mark.parametrize(
    ("grid", "fields", "words"),
    [*((grid, {}, words) for grid, words in GRIDS), *(({}, fields, words) for fields, words in FIELDS)],
)
def test_refused(grid, fields, words):
    with pytest.raises((TypeError, ValueError, OSError), match=words) as error:
        SweepPlan({**NEEDED, **grid}, **fields)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("missing", NEEDED)
def test_what_no_camera_has_must_be_stated(missing):
    stated = {name: values for name, values in NEEDED.items() if name != missing}
    with pytest.raises(ValueError, match=missing):
        SweepPlan(stated)
    with pytest.raises(ValueError, match=missing):
        Conditions(**{name: values[0] for name, values in stated.items()})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("5", [5]),
        ("-2.5,1e3", [-2.5, 1000]),
        ("1:10:3", [1, 4, 7, 10]),
        ("0:1:0.1", [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]),
        ("10:0:-5", [10, 5, 0]),
        ("2:250", [2, 3, 10, 30, 100, 250]),
        ("0:1000", [0, 10, 30, 100, 300, 1000]),
        ("0.5:5", [0.5, 1, 3, 5]),
    ],
)
def test_lists(text, expected):
    assert numbers(text) == pytest.approx(expected)


@pytest.mark.parametrize(
    "text",
    ["", "a", "1,", "2:1", "-1:2", "1:inf", "nan:1", "1:1", ":", "1:2:0", "1:2:-1", "1:2:3:4", "0:1:1e-9", "nan:1:1"],
)  # fmt: skip
def test_bad_lists(text):
    with pytest.raises(ValueError, match=r"must be numbers .* start:stop:step"):
        numbers(text)


def test_an_integer_beyond_floats_is_no_number():
    with pytest.raises(ValueError, match="must be a number"):
        number(10**400)


def test_ms_are_the_nearest_numbers_of_s():
    assert axis("exposure_s").values("9,13,36,43") == (0.009, 0.013, 0.036, 0.043)


NODES = tuple(
    Conditions(exposure_s=s, illuminance_lux=lux, velocity_x_px_s=v)
    for s, lux, v in ((0.03, 3.0, 333.3), (0.002, 333.3, 0.0), (0.0123, 3.0, 333.3))
)


def searched(*nodes, **further):
    return SweepPlan({}, only=nodes, direction=(1.0, 0.0), **further)


def test_its_rows_are_those_of_the_grid(tmp_path):
    """Cell by cell, whatever else either computes; but for the pictures that are kept of them."""
    models = [matched_detector(tmp_path)]
    chosen = rows_of(tmp_path / "nodes", models, CAMERA, TWO, searched(*NODES, repeats=2, examples=False))
    grid = rows_of(tmp_path / "grid", models, CAMERA, TWO, swept(**_axes(PLAN), repeats=2, examples=False))
    ids = {cell["cell_id"] for cell in chosen[0]}
    assert len(ids) == 2 * (1 + 2 * len(NODES))
    assert chosen[0] == [cell for cell in grid[0] if cell["cell_id"] in ids]
    assert chosen[1] == [target for target in grid[1] if target["cell_id"] in ids]
    assert len(chosen[0]) < len(grid[0])


def test_what_makes_a_run_is_all_but_the_nodes():
    alike = searched(*NODES, examples=False), searched()
    assert alike[0].to_dict() == alike[1].to_dict()
    gain = {"gain_db": (AUTOMATIC,)}
    others: list[dict[str, Any]] = [{"repeats": 2}, {"seed": 1}, {"grid": gain}, {"direction": (0.0, 1.0)}]
    others.append({"grey_anchor": "mean"})
    assert all(replace(alike[1], **other).to_dict() != alike[0].to_dict() for other in others)


def _axes(plan):
    names = {"exposures_s": "exposure_s", "lights_lux": "illuminance_lux"}
    names |= {"right_px_s": "velocity_x_px_s", "down_px_s": "velocity_y_px_s"}
    return {name: plan.values(axis) for name, axis in names.items()}
