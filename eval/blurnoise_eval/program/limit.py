"""One cap of the exposure time for a camera's own auto exposure: the best one, what it costs, and one for each light.

Domain: s, lux, px/s, dB; values in the criterion's unit. An auto exposure takes the time that the picture needs
without gain, at most the cap, and gain makes up for the rest. So a cap does nothing in bright light, loses at rest in
the dark, where gain is noise, and saves what moves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.program.optimise import COST_PER_DB, interval_of
from blurnoise_eval.program.problem import Problem, Schedule
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.system.tables import finite

Array = NDArray[np.float64]
_CAPS = 16  # that are compared with the chosen one, for what pictures cannot tell apart
_BINDS = 0.98  # a cap above this share of the time that is asked for does nothing


@dataclass(frozen=True)
class SpeedEffect:
    """What the cap changes at one speed, mean over the lights: above 0 it saves, below it loses.

    speed_px_s: in the scenario's unit. low, high: the 95 % interval, paired by picture; None from few pictures.
    """

    speed_px_s: float
    share: float
    value: float | None
    difference: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class LightCap:
    """One light: exposure and gain under the cap, and the cap that is best at this light alone.

    lacks_gain: whether the camera's gain is at its limit. too_bright: whether the picture is too bright even at the
    shortest exposure. saturated: the share of saturated values, None where the run does not have it. best_s: None
    where no cap is needed. from_s, to_s: the caps that pictures cannot tell from it.
    """

    illuminance_lux: float
    exposure_s: float
    gain_db: float
    lacks_gain: bool
    too_bright: bool
    saturated: float | None
    value: float | None
    best_s: float | None
    from_s: float | None
    to_s: float | None


@dataclass(frozen=True)
class ExposureCap:
    """The best cap for all lights and speeds of a problem.

    from_s, to_s: the caps that pictures cannot tell from it (95 %, all of them together). schedule, uncapped: with
    the cap, and with the longest exposure that the limits allow, longest_s.
    low, high: 95 % interval of the schedule's value; None from few pictures.
    """

    problem: Problem
    limit_s: float
    from_s: float
    to_s: float
    longest_s: float
    low: float | None
    high: float | None
    schedule: Schedule
    uncapped: Schedule
    speeds: tuple[SpeedEffect, ...]
    lights: tuple[LightCap, ...]


def under_cap(problem: Problem, cap_s: float) -> list[float]:
    """The exposures of auto exposure with this cap, one for each light of the scenario."""
    return [problem.limits.settled(min(total_s, cap_s)) for total_s in problem.totals_s]


def best_limit(problem: Problem, saturated: Callable[[float], float | None] | None = None) -> ExposureCap:
    """The cap whose auto exposure has the best mean over the lights; of equals the longest.

    saturated: the share of saturated values at a light times exposure, lux s, see :func:`saturated_at`.

    Raises ``ValueError`` that names the lights at which no exposure is left.
    """
    lights = problem.scenario.lights_lux
    caps = list(problem.times_s)
    if not caps:
        raise problem.nothing_left([lights[0], lights[-1]])
    worth = _worth(problem, caps)  # (L, S)
    usable = np.asarray(np.isfinite(worth).all(axis=0))
    if not usable.any():
        without = np.flatnonzero(~np.isfinite(worth).any(axis=1))
        raise problem.nothing_left([lights[k] for k in without] or [lights[0], lights[-1]])
    caps = [cap for cap, can in zip(caps, usable, strict=True) if can]
    worth = worth[:, usable]
    mean = worth.mean(axis=0)
    chosen = len(mean) - 1 - int(np.argmax(mean[::-1]))
    step = max(1, -(-len(caps) // _CAPS))
    compared = sorted({chosen, len(caps) - 1, *range(chosen % step, len(caps), step)})
    tied, best = _tied(problem, [caps[k] for k in compared], worth[:, compared], compared.index(chosen))
    schedule, uncapped = (problem.schedule(under_cap(problem, cap)) for cap in (caps[chosen], caps[-1]))
    low, high = interval_of(problem, schedule)
    of_lights = []
    for k, (light, total_s) in enumerate(zip(lights, problem.totals_s, strict=True)):
        best_s, from_s, to_s = best[k]
        needed = best_s < _BINDS * min(total_s, caps[-1])
        of_lights.append(
            LightCap(
                illuminance_lux=light,
                exposure_s=schedule.exposures_s[k],
                gain_db=schedule.gains_db[k],
                lacks_gain=schedule.lacks_gain[k],
                too_bright=total_s < _BINDS * problem.limits.first_s,
                saturated=saturated(light * schedule.exposures_s[k]) if saturated else None,
                value=schedule.values[k],
                best_s=best_s if needed else None,
                from_s=from_s if needed else None,
                to_s=to_s if needed else None,
            )
        )
    return ExposureCap(
        problem=problem,
        limit_s=caps[chosen],
        from_s=tied[0],
        to_s=tied[1],
        longest_s=caps[-1],
        low=low,
        high=high,
        schedule=schedule,
        uncapped=uncapped,
        speeds=tuple(_effects(problem, schedule, uncapped, known=low is not None)),
        lights=tuple(of_lights),
    )


def saturated_at(lux_s: Array, shares: Array) -> Callable[[float], float | None]:
    """The share of saturated values at a light times exposure, lux s: that of the nearest tested one, None beyond
    half a stop. lux_s, shares: (N,) of the tested ones; NaN where the share is not known.

    >>> saturated = saturated_at(np.array([1.0, 2.0]), np.array([0.1, 0.3]))
    >>> saturated(1.9), saturated(9.0)
    (0.3, None)
    """
    known = np.isfinite(shares) & (lux_s > 0)
    stops, shares = np.log2(lux_s[known]), shares[known]

    def saturated(wanted: float) -> float | None:
        apart = np.abs(stops - np.log2(wanted))
        near = apart <= min(0.5, apart.min(initial=np.inf) + 1e-6)
        return float(shares[near].mean()) if near.any() else None

    return saturated


def _worth(problem: Problem, caps_s: Sequence[float]) -> Array:
    """The objective less the cost of gain, (L, S); NaN where the run has not tested it or limits forbid it."""
    lights = problem.scenario.lights_lux
    exposures_s = np.transpose([under_cap(problem, cap) for cap in caps_s])
    _, values = problem.at(np.repeat(lights, len(caps_s)), exposures_s.ravel())
    gain_db = problem.inputs.metering.gain_db
    gains_db = np.array(
        [[gain_db(lux, time) for time in row] for lux, row in zip(lights, exposures_s, strict=True)]
    )
    flickers = np.array(
        [
            [problem.limits.avoidable(time, total) for time in row]
            for total, row in zip(problem.totals_s, exposures_s, strict=True)
        ]
    )
    allowed = gains_db <= problem.limits.gain_max_db + 1e-9
    if problem.limits.mains_hz or problem.limits.led:
        allowed &= ~flickers
    return np.where(allowed, values.reshape(gains_db.shape) - COST_PER_DB * gains_db, np.nan)


def _tied(
    problem: Problem, caps_s: Sequence[float], worth: Array, chosen: int
) -> tuple[tuple[float, float], list[tuple[float, float, float]]]:
    """The shortest and the longest cap that pictures cannot tell from the chosen one, for all lights together; and
    for each light its best cap with the same two."""
    exposures_s = np.transpose([under_cap(problem, cap) for cap in caps_s])
    of_lights, means, influences, sigmas = [], [], [], []
    for light, row, of_light in zip(problem.scenario.lights_lux, exposures_s, worth, strict=True):
        value, influence, cov = problem.uncertain([light] * len(row), row)
        own = len(of_light) - 1 - int(np.argmax(of_light[::-1]))
        of_lights.append(_around(caps_s, own, value, influence, uncertainty.sigma_of_differences(cov, own)))
        means.append(value)
        influences.append(influence)
        sigmas.append(uncertainty.sigma_of_differences(cov, chosen))
    _, from_s, to_s = _around(
        caps_s, chosen, np.mean(means, axis=0), np.mean(influences, axis=0), np.mean(sigmas, axis=0)
    )
    return (from_s, to_s), of_lights


def _around(
    caps_s: Sequence[float], own: int, value: Array, influence: Array, sigma: Array
) -> tuple[float, float, float]:
    """A cap, and the shortest and the longest of its neighbours that are not surely worse, at 95 % together."""
    confidence = 1 - 0.05 / max(1, len(caps_s) - 1)
    worse = value[own] - value
    low, _ = uncertainty.of_difference(worse, influence[:, [own]] - influence, confidence)
    surely = np.nan_to_num(worse - np.hypot(worse - low, uncertainty.NORMAL * sigma), nan=-1.0) > 0
    first = last = own
    while first > 0 and not surely[first - 1]:
        first -= 1
    while last < len(caps_s) - 1 and not surely[last + 1]:
        last += 1
    return caps_s[own], caps_s[first], caps_s[last]


def _effects(problem: Problem, schedule: Schedule, uncapped: Schedule, *, known: bool) -> list[SpeedEffect]:
    """What the cap changes at each speed, paired by picture. known: whether the pictures are enough for intervals."""
    effects = []
    for speed, share in problem.scenario.speeds_px_s.items():
        alone = replace(problem, scenario=replace(problem.scenario, speeds_px_s={speed: 1.0}))
        values, differences, influences, sigmas = [], [], [], []
        for light, capped_s, longest_s in zip(
            problem.scenario.lights_lux, schedule.exposures_s, uncapped.exposures_s, strict=True
        ):
            value, influence, cov = alone.uncertain([light, light], [capped_s, longest_s])
            values.append(value[0])
            differences.append(value[0] - value[1])
            influences.append(influence[:, 0] - influence[:, 1])
            sigmas.append(uncertainty.sigma_of_differences(cov, 1)[0])
        mean = float(np.mean(differences))
        low, high = (
            uncertainty.of_difference(mean, np.mean(influences, axis=0)) if known else (np.nan, np.nan)
        )
        wide = uncertainty.NORMAL * float(np.mean(sigmas))
        effects.append(
            SpeedEffect(
                speed_px_s=speed,
                share=share,
                value=finite(float(np.mean(values))),
                difference=finite(mean),
                low=finite(float(mean - np.hypot(mean - low, wide))),
                high=finite(float(mean + np.hypot(high - mean, wide))),
            )
        )
    return effects
