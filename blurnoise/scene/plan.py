"""The error budget of a frame: how much each part of the chain contributes, and which parts may be left out.

Unit: DN RMS, for a white surface at its brightest under the conditions. Contributions are bounds that hold for any
picture within [0, 1], so the omitted parts stay within the tolerance for every picture. "What is left out" in
docs/pages/physics.md explains the effect of rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import torch

from blurnoise._core.checks import an_instance, limited
from blurnoise.camera import Camera, radiometry
from blurnoise.camera.captures import factors
from blurnoise.light import effects
from blurnoise.light.capture import LATER_CAPTURE
from blurnoise.light.effect import LightEffect
from blurnoise.light.motion import MOTION_VARIATION
from blurnoise.light.resolved import Number, Resolved
from blurnoise.picture.fusion import readers, saturations_e
from blurnoise.picture.steps import FUSION
from blurnoise.scene.captures import captures_of_exposure
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene, brightest
from blurnoise.sensor import stages
from blurnoise.sensor.stage import MERGE_READ_NOISE_E, SensorStage, within_range_dn

TOLERANCE_DN = 0.1
"""Default tolerance for omitted parts, DN RMS: a third of the error of rounding to digital numbers."""
_DITHER_DN = 0.5  # normal noise, RMS, from which on rounding adds 1/12 DN^2 whatever the mean, to 0.009 DN^2
_ROUNDING_DN2 = 0.25  # what rounding makes, at most, of a spread that goes to 0
_SINGLE = 2.0**-24  # relative, of a number in single precision


@dataclass(frozen=True)
class Contribution:
    """One effect or stage: its contribution in DN RMS, whether it is modelled, and how or why not.

    >>> from blurnoise import Camera
    >>> needed = plan(Exposure(Camera.preset("imx250"), 0.01, 50.0))
    >>> {each.name: round(each.contribution_dn, 2) for each in needed.stages}["quantisation"]  # 1 / sqrt(12)
    0.29
    """

    name: str
    contribution_dn: float
    kept: bool
    how: str


@dataclass(frozen=True)
class Plan:
    """The contributions in causal order, and the omitted parts; plans are equal if they model the same parts.

    camera: the camera with the omitted figures set to 0. without: the names of the omitted effects and stages; never
    shot noise, since ``noisy`` says whether any noise is modelled. left_out_dn: RMS of all omitted parts, at most
    tolerance_dn; it includes the effect of rounding on noise that is too small to dither.

    >>> from blurnoise import Camera
    >>> needed = plan(Exposure(Camera.preset("imx250"), 0.01, 50.0), tolerance_dn=0.1)
    >>> needed.noisy, needed.left_out_dn <= needed.tolerance_dn
    (True, True)
    """

    stages: tuple[Contribution, ...] = field(compare=False)
    camera: Camera
    without: frozenset[str] = frozenset()
    noisy: bool = True
    left_out_dn: float = field(default=0.0, compare=False)
    tolerance_dn: float = field(default=0.0, compare=False)

    def reduced(self, at: Resolved[Number]) -> Resolved[Number]:
        """The conditions with the omitted parts set to 0."""
        flow = None if MOTION_VARIATION.name in self.without else at.flow_px
        if self.camera is at.camera and flow is at.flow_px:
            return at
        return replace(at, camera=self.camera, flow_px=flow)


def plan(
    exposure: Exposure[Any],
    scene: Scene | None = None,
    *,
    tolerance_dn: float = TOLERANCE_DN,
) -> Plan:
    """Keep the smallest set of effects and stages whose omissions stay within ``tolerance_dn`` (> 0), DN RMS.

    Effects and stages are omitted by their contribution, smallest first, as long as the root of the sum of squares is
    within the tolerance. Noise stays where its absence would make rounding cost more. The plan is that of the first
    frame of a scene, by default a white picture of the sensor's size; of several captures it is that of the first
    one, the motion since then that of the last one. Raises ``ValueError`` naming the argument.

    >>> from blurnoise import Camera, Exposure
    >>> needed = plan(Exposure(Camera.preset("imx250"), 0.01, 50.0, velocity_px_s=(400.0, 0.0)))
    >>> [stage.name for stage in needed.stages if stage.kept]
    ['motion', 'spectral integration', 'shot noise', 'read noise', 'quantisation']
    """
    an_instance("exposure", exposure, Exposure)
    tolerance_dn = limited("tolerance_dn", tolerance_dn)
    camera, _ = exposure.amplified
    if scene is None:
        scene = Scene(torch.ones(1, 1, 1, 1, dtype=torch.float64).expand(1, 1, *camera.field.size))
    an_instance("scene", scene, Scene)
    plans = []
    for at, _ in captures_of_exposure(scene, exposure, len(scene.light)):
        light, at = effects.scene_at(scene.light, at, border=scene.border)
        whitest = scene.brightest if light is scene.light else brightest(light, at.layers)
        white = whitest[0] * radiometry.peak(at.camera, at.illuminant)
        plans.append((at, plan_at(next(at.each()), tolerance_dn, white)))
    (at, first), (_, last) = plans[0], plans[-1]
    if len(plans) == 1:
        return first
    moved = LATER_CAPTURE.name  # by the last capture everything has moved farthest
    stages = [
        later if later.name == moved else now for now, later in zip(first.stages, last.stages, strict=True)
    ]
    return replace(first, stages=(*stages, _of_fusion(camera, float(at.white_e[0]))))


def plan_at(at: Resolved[float], tolerance_dn: float = TOLERANCE_DN, brightest: float = 1.0) -> Plan:
    """:func:`plan` of a frame whose brightest surface has so much light.

    >>> from blurnoise import Camera
    >>> at = Resolved(Camera.preset("imx250"), exposure_s=0.01, temperature_c=25.0, white_e=5000.0)
    >>> "motion" in plan_at(at).without  # nothing moves
    True
    """
    lit = at if brightest == 1.0 else replace(at, white_e=at.white_e * brightest)
    return _plan(lit, tolerance_dn, effects.EFFECTS, stages.STAGES)


@lru_cache(maxsize=1024)
def _plan(
    at: Resolved[float],
    tolerance_dn: float,
    of_light: tuple[LightEffect, ...],
    of_sensor: tuple[SensorStage, ...],
) -> Plan:
    camera = at.camera
    every: tuple[LightEffect | SensorStage, ...] = (*of_light, *of_sensor)
    bounds = {  # an error in units of white cannot exceed the range
        effect.name: 0.0 if effect.idle(camera) else within_range_dn(camera, effect.bound(at) * at.white_e)
        for effect in of_light
    }
    bounds |= {stage.name: bound for stage in of_sensor if (bound := stage.bound_dn(at)) is not None}
    stay = {each.name for each in every if each.essential}
    spreading = {stage.name for stage in of_sensor if stage.spreads or stage.draws}
    dithers = {stage.name for stage in of_sensor if stage.dither_dn(at) >= _DITHER_DN}
    left_out, rounding_dn2 = _left_out(camera, bounds, (stay, spreading, dithers), tolerance_dn**2)
    shot, read = stages.SHOT_NOISE.name, stages.READ_NOISE.name
    if shot not in left_out and camera.sensor.read_noise_e >= MERGE_READ_NOISE_E:
        left_out.discard(read)  # it shares shot noise's draw and costs nothing
    spread_dn = math.hypot(*(bounds[name] for name in bounds if name in spreading & left_out))
    rounding_dn2 = min(rounding_dn2, _rounding_dn2(camera, spread_dn))
    figures = frozenset(figure for each in every if each.name in left_out for figure in each.figures)
    reduced = _reduced(camera, figures) if figures else camera
    noisy = any(stage.draws and stage.name not in left_out for stage in of_sensor)
    kept = [effect for effect in of_light if effect.name not in left_out]
    hows = {effect.name: effect.how(replace(at, camera=reduced)) for effect in kept}
    hows |= {stage.name: stage.how(reduced, noisy) for stage in of_sensor}
    hows |= {name: "left out: within the tolerance" if bounds[name] else "none here" for name in left_out}
    contributions = tuple(
        Contribution(name, bound, name not in left_out, hows[name]) for name, bound in bounds.items()
    )
    total = math.sqrt(rounding_dn2 + sum(each.contribution_dn**2 for each in contributions if not each.kept))
    return Plan(contributions, reduced, frozenset(left_out - stay - {shot}), noisy, total, tolerance_dn)


@lru_cache(maxsize=256)
def _reduced(camera: Camera, figures: frozenset[str]) -> Camera:
    """The camera with these figures 0, or without points: one for all plans, since making a camera checks it."""
    return camera.with_figures(**{figure: type(camera.figure(figure))() for figure in figures})


def _of_fusion(camera: Camera, white_e: float) -> Contribution:
    """The fusion of several captures, which is never omitted: the light of white that the first capture clips."""
    first, captures = readers(camera)[0], camera.sensor.captures
    beyond_dn = within_range_dn(first, max(0.0, white_e - first.sensor.saturation_e))
    ratios = ", ".join(f"{factor:.4g}" for factor in factors(captures))
    how = f"{len(captures)} captures of 1 / ({ratios}) of the light, to {saturations_e(camera)[-1]:.4g} e-"
    return Contribution(FUSION.name, beyond_dn, True, how)


def _left_out(
    camera: Camera, bounds: Mapping[str, float], parts: tuple[set[str], ...], budget_dn2: float
) -> tuple[set[str], float]:
    """The parts to omit, and the DN^2 that rounding adds to their error."""
    stay, spreading, dithers = parts
    for kept, charged in ((stay, False), (stay | dithers, False), (stay, True)):
        if kept != stay and budget_dn2 > _ROUNDING_DN2:
            continue
        left_out, spent_dn2, spread_dn2, rounding_dn2 = set[str](), 0.0, 0.0, 0.0
        for name, bound in sorted(bounds.items(), key=lambda item: item[1]):
            spread = spread_dn2 + (bound**2 if name in spreading else 0.0)
            rounding = _rounding_dn2(camera, math.sqrt(spread)) if charged else 0.0
            if spent_dn2 + bound**2 + rounding > budget_dn2 or (name in kept and bound > 0):
                continue
            spent_dn2, spread_dn2, rounding_dn2 = spent_dn2 + bound**2, spread, rounding
            left_out.add(name)
        if dithers - left_out or not _rounding_dn2(camera, math.sqrt(spread_dn2)):
            return left_out, 0.0
    return left_out, rounding_dn2


def _rounding_dn2(camera: Camera, spread_dn: float) -> float:
    """DN^2 that rounding adds to a spread that is not dithered."""
    if spread_dn <= _SINGLE * camera.sensor.full_scale_dn:
        return 0.0
    # A spread that stays away from a rounding border is rounded to one number: nothing is left of it to err.
    from_border_dn = abs(camera.sensor.black_level_dn % 1 - 0.5)
    return _ROUNDING_DN2 if from_border_dn < 4 * spread_dn else min(spread_dn, _ROUNDING_DN2)
