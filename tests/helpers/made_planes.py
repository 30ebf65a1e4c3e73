"""Planes made by hand: of maps, a grid of lights, exposures and speeds; of programs, two kinds of target."""

import math
from itertools import product

import numpy as np
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.deciding.surface import Predicted
from blurnoise_eval.maps.nodes import nodes_at
from blurnoise_eval.program.problem import Inputs, Problem
from blurnoise_eval.program.scenario import Limits, Metering, Scenario, half_stops
from made_tables import on_plane, table
from plans import IMX250, OWN

from blurnoise.camera import PRESETS

KEEP = Criterion(0.9, True)


def row(exposure_s, lux, dx=0.0, dy=0.0, **others):
    """A condition as the store has it, its gain 0 dB unless stated."""
    at = {"exposure_s": exposure_s, "illuminance_lux": lux, "velocity_x_px_s": dx, "velocity_y_px_s": dy}
    return {"clean": 0, **at, **OWN, "applied_gain_db": 0.0, **others}


def plane(
    exposures_s=(0.001, 0.003, 0.01, 0.03, 0.09),
    lights_lux=(1.0, 7.0, 50.0, 360.0),
    speeds=(0.0, 170.0, 600.0),
):
    """A grid, no two conditions of which are one experiment."""
    return nodes_at([row(*at) for at in product(exposures_s, lights_lux, speeds)], IMX250, ())


def exact(values):
    """Values of which sums over a few clusters are exact: of 24 binary places."""
    return np.round(values * 2**24) / 2**24


def scores_at(nodes, values, clusters=12):
    """A table at the nodes with mean :func:`exact` ``values`` (N,), from which clusters depart, each in its way."""
    own = exact(0.1 * np.random.default_rng(0).normal(size=(clusters, len(values))))
    own[-1] = -own[:-1].sum(axis=0)
    sums = np.nan_to_num(exact(values) + own)
    counts = np.broadcast_to(np.isfinite(values).astype(float), sums.shape)
    return table(sums[..., None], np.arange(len(nodes)), counts=counts[..., None], group="signs")


PICTURES = 24
LIMITS = Limits()
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
