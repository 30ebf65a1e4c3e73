"""Plans that say two things, or what cannot be computed: one line each, before anything is computed."""

from __future__ import annotations

import hashlib
from typing import Any

import pytest
from blurnoise_eval.grid.conditions import Conditions, Part, SweepPlan
from blurnoise_eval.grid.objects import Crossing, Objects

from blurnoise.motion.ego import Vehicle

AT: Any = {"exposure_s": (0.01,), "illuminance_lux": (5.0,)}


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
    ({"exposure_s": ("auto", 0.01)}, "exposure_s: must be auto alone"),
    ({"exposure_s": ("auto",), "gain_db": (0.0,)}, "exposure_s: auto sets"),
    ({"exposure_s": ("auto",), "velocity_x_px_s": (9e6,)}, "9e\\+06 times exposure_s"),
    ({"ego_speed_m_s": (20.0,), "velocity_x_px_s": (100.0,)}, "goes without velocity_x_px_s"),
    ({"ego_speed_m_s": (20.0,), "velocity_y_px_s": (0.0, 3.0)}, "goes without velocity_y_px_s"),
    ({"ego_speed_m_s": (20.0,), "moves": (0.0, 1.0)}, "goes without moves"),
]
FIELDS: list[tuple[Any, str]] = [
    ({"repeats": 0}, "repeats = 0"),
    *(({"seed": seed}, "seed = ") for seed in (10**400, -1, 1.5, "1", None)),
    ({"ego": Vehicle()}, "ego: goes with ego_speed_m_s"),
    ({"objects": Objects(speeds={"car": 2.0})}, "speeds: of objects; goes with moves"),
    ({"objects": Objects(crossings={"car": Crossing(36.0, width_m=4.0)})}, "crossings: of objects"),
    ({"trajectory": "sine:40,50", "objects": Objects(boxes="half")}, "boxes = 'half': of straight"),
    *(
        ({"trajectory": text}, text.partition(":")[0])
        for text in ("shake", "shake:x", "shake:1,2", "sine:3", "sine:3,80,1,1", "shake:-2", "sine:3,0")
    ),
]


@pytest.mark.parametrize(
    ("grid", "fields", "words"),
    [*((grid, {}, words) for grid, words in GRIDS), *(({}, fields, words) for fields, words in FIELDS)],
)
def test_refused(grid: dict[str, Any], fields: dict[str, Any], words: str) -> None:
    with pytest.raises((TypeError, ValueError, OSError), match=words) as error:
        SweepPlan({**AT, **grid}, **fields)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("missing", AT)
def test_what_no_camera_has_must_be_stated(missing: str) -> None:
    stated = {name: values for name, values in AT.items() if name != missing}
    with pytest.raises(ValueError, match=missing):
        SweepPlan(stated)
    with pytest.raises(ValueError, match=missing):
        Conditions(**{name: values[0] for name, values in stated.items()})


@pytest.mark.parametrize("text", ["0/4", "5/4", "1", "a/b", "1/0", "-1/2"])
def test_parts_that_are_none(text: str) -> None:
    with pytest.raises(ValueError, match="must be K/N"):
        Part.parse(text)


def test_parts_have_every_picture_once_and_depend_on_its_name_alone() -> None:
    names = [f"{number}.png" for number in range(400)]
    parts = [[name for name in names if Part(number, 4).has(name)] for number in (1, 2, 3, 4)]
    assert sorted(name for part in parts for name in part) == sorted(names)
    assert min(map(len, parts)) > 70  # binomial, n = 400, p = 1/4: 100 - 3.5 sd of 8.7
    assert Part.parse("2/4").has("3.png") == ("3.png" in parts[1])
    # the hash of a name never changes: machines of any version agree on the parts
    digest = hashlib.blake2b(b"3.png", digest_size=8).digest()
    assert Part(int.from_bytes(digest, "little") % 4 + 1, 4).has("3.png")
