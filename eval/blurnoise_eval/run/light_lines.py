"""Lines of a run's first screen and page that say what its lights are: a line for each light, in lux and cd/m2.

Luminances are medians over targets and pictures. That of a white surface under E lux is E / pi; a target has what
its 95th percentile of luminance in the picture receives of ambient light and headlamps, and what its sheeting
returns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from statistics import median
from typing import NamedTuple

import numpy as np

from blurnoise.light.headlamps import Headlamps
from blurnoise.light.headlit import NEAREST_M, RoadView, observation_deg
from blurnoise.light.road_objects import road_object
from blurnoise_eval.plan.axes import HEADLAMP, LIGHT, axis
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.report.words import counted
from blurnoise_eval.run.headlit_scenes import HeadlitFacts, StandingTarget
from blurnoise_eval.run.setup import Setup
from blurnoise_eval.store.store import PictureFacts

_MOST_CLASSES = 2
_NIGHT_LUX = 50.0  # below the light of dusk, signs are seen by headlamps
_FARTHEST_BESIDE_M = 20.0  # that a target beside the road is
MATT = "Signs are taken for matt; see --headlamp low."
UNLABELLED = "Without labels headlamps light nothing: no distance of a target is known."
KNOWN = "Headlamp light is known to a factor of 2."


class RunLight(NamedTuple):
    """A light of a run: lux, spectrum by name, beam."""

    lux: float
    illuminant: str
    beam: str

    def text(self, plan: SweepPlan) -> str:
        """'street: 1 lux (led-4000), low beam'."""
        named = plan.light_at(self.lux)
        name = f"{named.name}: " if named is not None else ""
        spectrum = f" ({self.illuminant})" if self.illuminant not in ("", "D55") or name else ""
        beam = (
            "" if self.beam == "off" and not name else f", {HEADLAMP.text(HEADLAMP.choice_index(self.beam))}"
        )
        return f"{name}{LIGHT.text(self.lux)}{spectrum}{beam}"


def lights_of(conditions: Iterable[Mapping[str, float | None]]) -> list[RunLight]:
    """The lights of conditions, each once, the darkest first.

    >>> from blurnoise_eval.plan.conditions import Conditions
    >>> lights_of([Conditions(exposure_s=0.01, illuminance_lux=1.0, headlamp=1.0)])
    [RunLight(lux=1.0, illuminant='D55', beam='low')]
    """
    found = set()
    for at in conditions:
        lux, beam = at[LIGHT.name], HEADLAMP.choice(at[HEADLAMP.name] or 0.0)
        value = at["illuminant"]
        illuminant = "D55" if value is None else axis("illuminant").typed(value)
        found.add(RunLight(float(lux or 0.0), illuminant, beam))
    return sorted(found, key=lambda each: (each.lux, each.illuminant, HEADLAMP.choices.index(each.beam)))


def light_lines(
    setup: Setup,
    pictures: Mapping[str, PictureFacts],
    labels: Iterable[str],
    conditions: Iterable[Mapping[str, float | None]],
) -> list[str]:
    """The lines. labels: the classes of the run's targets; conditions: those that were tested.

    Raises ``ValueError`` for facts of pictures that no sweep writes.
    """
    plan, lights = setup.plan, lights_of(conditions)
    if not plan.beams:
        signs = [label for label in labels if _shines(label, plan)]
        night = any(0 < light.lux <= _NIGHT_LUX for light in lights)
        named = [light.text(plan) for light in lights] if plan.light else []
        return [*named, *[MATT] * bool(signs and night)]
    every = [HeadlitFacts.read(each.headlit) for each in pictures.values() if each.headlit is not None]
    view = plan.lit.view(setup.camera, plan.vehicle)
    lines = [_line(light, plan, view, every) for light in lights]
    if not setup.labelled:
        return [*lines, UNLABELLED]
    return [*lines, *_notes(every), *_contradiction(setup, every, pictures), KNOWN]


def _shines(label: str, plan: SweepPlan) -> bool:
    of = road_object(label, plan.lit.road_objects)
    return of is not None and of.sheeting is not None


def _line(light: RunLight, plan: SweepPlan, view: RoadView, every: Sequence[HeadlitFacts]) -> str:
    """'1 lux, low beam. stop sign, median 50 m, 1.2 deg: white 2.30 cd/m2 (2.18 by sheeting III), background .06'."""
    by_class: dict[str, list[StandingTarget]] = {}
    for facts in every:
        for target in facts.targets:
            by_class.setdefault(target.label, []).append(target)
    shown = sorted(by_class, key=lambda label: -len(by_class[label]))[:_MOST_CLASSES]
    parts = [_of_class(label, by_class[label], light, view) for label in shown]
    text = ". ".join([light.text(plan), "; ".join(filter(None, parts))]) if parts else light.text(plan)
    if not every:
        return text
    return f"{text}, background {_background(light, view, every)}"


def _of_class(label: str, targets: Sequence[StandingTarget], light: RunLight, view: RoadView) -> str:
    of = road_object(label, view.own)
    if of is None:
        return ""
    material = view.material(of)
    whites = np.array([target.white for target in targets])
    lux, returned = np.full(len(targets), light.lux), np.zeros(len(targets))
    where = ""
    if light.beam != "off":
        lamps = _lamps(light)
        places = np.array([target[1:4] for target in targets], float)
        right, ahead, up = places.T
        lit = lamps.onto(right, up, ahead, material, view.vehicle.height_m)
        lux, returned = lux + lit.illuminance_lux, returned + lit.luminance_cd_m2
        middle = sorted(targets, key=lambda target: target.ahead_m)[(len(targets) - 1) // 2]
        place = middle.right_m, middle.up_m, middle.ahead_m
        angle = observation_deg(lamps, place, view.vehicle.height_m)
        where = f", median {middle.ahead_m:.3g} m" + (f", {angle:.1f} deg" if material else "")
    luminance = median((whites * lux / math.pi + returned).tolist())
    by = ""
    if material is not None and light.beam != "off":
        by = f" ({_figure(median(returned.tolist()))} by sheeting {material.name})"
    part = "white" if material is not None else "brightest parts"
    return f"{label}{where}: {part} {_figure(luminance)} cd/m2{by}"


def _background(light: RunLight, view: RoadView, every: Sequence[HeadlitFacts]) -> str:
    """Dark and, in headlamps, lit: a photograph does not say which."""
    dark = median(facts.background for facts in every) * light.lux / math.pi
    walls = []
    for facts in every if light.beam != "off" else ():
        if facts.targets:
            at = sorted(facts.targets, key=lambda target: target.ahead_m)[(len(facts.targets) - 1) // 2]
            lit = _lamps(light).onto(at.right_m, at.up_m, at.ahead_m)
            walls.append(facts.background * (light.lux + float(lit.illuminance_lux)) / math.pi)
    if not walls:
        return _figure(dark)
    if view.background == "lit":
        return f"{_figure(median(walls))} (lit as a wall)"
    return f"{_figure(dark)} ({_figure(median(walls))} if lit)"


def _notes(every: Sequence[HeadlitFacts]) -> Iterator[str]:
    """What was limited or assumed, and of how many targets."""
    targets = [target for facts in every for target in facts.targets]
    total = len(targets) + sum(facts.unknown for facts in every)
    nearer = sum(target.nearer for target in targets)
    if nearer:
        yield f"{nearer} of {counted(total, 'target')} are nearer than {NEAREST_M:g} m: lit as at {NEAREST_M:g} m."
    if cut := sum(target.cut_off for target in targets):
        yield f"{cut} of {counted(total, 'target')} reach the side of their picture: they may be nearer than assumed."
    if unknown := total - len(targets):
        yield (
            f"{unknown} of {counted(total, 'target')} have no known size and receive no headlight; "
            "road_objects in the file of --plan states it."
        )
    boxes = [target for target in targets if not target.outlined]
    if boxes:
        octagons = any(target.label == "stop sign" for target in boxes)
        yield (
            f"{len(boxes)} of {counted(total, 'target')} have no outline: the whole box shines"
            + "; 17 % of an octagon's box is not sign" * octagons
            + "."
        )


def _contradiction(
    setup: Setup, every: Sequence[HeadlitFacts], pictures: Mapping[str, PictureFacts]
) -> Iterator[str]:
    """Named speeds in px/s that the targets' distance does not allow: y = dx d^2 / (f v)."""
    targets = [target for facts in every for target in facts.targets]
    dx = axis("velocity_x_px_s")
    named = [
        (value, name)
        for value, name in zip(dx.default, dx.default_names, strict=True)
        if value and value in setup.plan.values(dx.name) and name.endswith("km/h")
    ]
    if not targets or not named:
        return
    sizes = [(each.height_px, each.width_px) for each in pictures.values()]
    size = sizes[len(sizes) // 2]
    focal_px = setup.camera.field.focal_px[0] * setup.camera.field.per_sensor_px(size)
    away_m = median(target.ahead_m for target in targets)
    value, name = named[0]
    beside_m = value * away_m**2 / (focal_px * float(name.split()[0]) / 3.6)
    if beside_m > _FARTHEST_BESIDE_M:
        yield (
            f"{value:g} px/s at {name} and {away_m:.3g} m means {beside_m:.3g} m beside the axis; "
            "use --ego-kmh."
        )


def _lamps(light: RunLight) -> Headlamps:
    return Headlamps(light.beam)  # type: ignore[arg-type]  # a beam's name


def _figure(number: float) -> str:
    """Three digits: '2.30', '0.062', '412'."""
    if number == 0:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(number))))
    return f"{number:.{min(digits, 4)}f}" if number >= 1e-3 else f"{number:.2g}"
