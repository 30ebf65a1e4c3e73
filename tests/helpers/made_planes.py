"""Planes of a made population, for exposure programs: two kinds of target, the small ones lost sooner."""

import numpy as np
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.deciding.predicted import Predicted
from blurnoise_eval.program.limits import Limits
from blurnoise_eval.program.metering import Metering
from blurnoise_eval.program.optimise import Problem
from blurnoise_eval.program.response import Response
from blurnoise_eval.program.scenario import Scenario, half_stops

from blurnoise.optics.camera import PRESETS

PICTURES = 24
LIMITS = Limits()
METERING = Metering(PRESETS["imx250"], 0.2)
SPEEDS = {0.0: 0.3, 200.0: 0.5, 800.0: 0.2}


def made_planes(pictures: int = PICTURES) -> dict[str, Predicted]:
    """Nodes a stop apart from 2^-11 to 2^3 lux s and from 0.5 to 64 px; each picture is lost elsewhere."""
    generator = np.random.default_rng(5)
    places = np.array([(u, w) for u in np.arange(-11.0, 4) for w in np.arange(-1.0, 7)])
    clusters = [f"{place}.png" for place in range(pictures)]
    references = generator.gamma(3, 1, (pictures, 1))
    found = {}
    for name, dark, blur in (("large", -7.0, 4.0), ("small", -6.0, 3.0)):
        at_dark = generator.normal(dark, 0.6, (pictures, 1))
        at_blur = generator.normal(blur, 0.5, (pictures, 1))
        kept = 1 / (1 + np.exp(-1.2 * (places[:, 0] - at_dark))) / (1 + 4.0 ** (places[:, 1] - at_blur))
        found[name] = Predicted(places, clusters, kept * references, np.repeat(references, len(places), 1))
    return found


def made_response(
    lights_lux: tuple[float, ...] = half_stops(2.0, 300.0), pictures: int = PICTURES, **more: object
) -> Response:
    """A scenario on :func:`made_planes`."""
    of = {"lights_lux": lights_lux, "speeds_px_s": SPEEDS, "targets": {"large": 1.0, "small": 1.0}}
    return Response(Scenario(**{**of, **more}), made_planes(pictures))  # type: ignore[arg-type]


def made_problem(limits: Limits = LIMITS, **scenario: object) -> Problem:
    """Of :func:`made_response`."""
    response = made_response(**scenario)  # type: ignore[arg-type]
    return Problem("made", Criterion(0.9, kept=True), response, METERING, limits)
