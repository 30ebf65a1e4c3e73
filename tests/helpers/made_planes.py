"""Planes made by hand, of two kinds of target, for programs of exposure."""

import math

import numpy as np
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.program.problem import Inputs, Problem
from blurnoise_eval.program.scenario import ExposureLimits, Metering, Scenario, half_stops
from blurnoise_eval.run.surface import Predicted
from made_tables import on_plane

from blurnoise.camera import PRESETS

PICTURES = 24
LIMITS = ExposureLimits()
METERING = Metering(PRESETS["imx250"], 0.2)
SPEEDS = {0.0: 0.3, 200.0: 0.5, 800.0: 0.2}


def made_planes(pictures=PICTURES):
    """Nodes a stop apart from 2^-11 to 2^3 lux s and from 0.5 to 64 px; each picture is lost elsewhere."""
    generator = np.random.default_rng(5)
    places = np.array([(u, w) for u in np.arange(-11.0, 4) for w in np.arange(-1.0, 7)])
    references = generator.gamma(3, 1, (pictures, 1))
    found = {}
    for name, dark, blur in (("large", -7.0, 4.0), ("small", -6.0, 3.0)):
        at_dark = generator.normal(dark, 0.6, (pictures, 1))
        at_blur = generator.normal(blur, 0.5, (pictures, 1))
        kept = 1 / (1 + np.exp(-1.2 * (places[:, 0] - at_dark))) / (1 + 4.0 ** (places[:, 1] - at_blur))
        plane = on_plane(places, kept * references, np.repeat(references, len(places), 1))
        found[name] = Predicted(plane)
    return found


def made_problem(limits=LIMITS, **more):
    """A scenario on :func:`made_planes`."""
    of = {
        "lights_lux": half_stops(2.0, 300.0),
        "speeds_px_s": SPEEDS,
        "targets": {"large": 1.0, "small": 1.0},
    }
    inputs = Inputs(
        model="made",
        criterion=Criterion(0.9, kept=True),
        planes=made_planes(),
        metering=METERING,
        scenario=Scenario(half_stops(2.0, 300.0), dict.fromkeys(SPEEDS, 1.0), {"large": 1.0, "small": 1.0}),
        exposures_s=(0.0, math.inf),
        recommended_s=0.005,
    )
    return Problem(inputs, Scenario(**{**of, **more}), limits)
