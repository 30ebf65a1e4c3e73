"""The simulation on trial by brackets: pictures of a camera against simulated pictures of the same scene.

Tone curve and scene come from one half of a bracket, and the other half is simulated; then the halves change places.
Beside it the defaults: one photograph of the bracket, with the default tone curve and camera.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from blurnoise.camera import Camera
from blurnoise.camera.colour import Points
from blurnoise.scene.scene import Scene
from blurnoise_eval import default_tone
from blurnoise_eval.calibration.bracket import Bracket, Bytes, Shot, placed, read_bracket
from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.tone import Tone, fit_tone
from blurnoise_eval.default_camera import default_camera, is_grey
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.measure import followed
from blurnoise_eval.measure.bracket_scene import MergedScene, merge, off_exposure, shown
from blurnoise_eval.measure.bracket_worth import BRACKET, DEFAULTS, ROUTES, BracketTrial, Curves
from blurnoise_eval.measure.picture_measures import MEASURES, grey
from blurnoise_eval.plan.plan import usual_plan

FEWEST = 4
"""Pictures at rest: three for a tone curve, and one to compare."""
FEWEST_FITTED = 3
"""Pictures from which a tone curve is fitted."""
FEWEST_TONED = 2
"""Pictures at rest where the tone curve is known."""
_HALVES = 6  # pictures from which on every other one is left out; of fewer, one at a time
_MIDDLE = 118  # grey of a picture that is well exposed, 18 % in sRGB
_WRONG_EV = 1 / 3
_SHOWN_DN, _SHOWN_SHARE = (
    (16, 235),
    0.01,
)  # values, and share of them, that a picture must have for a tone curve


def try_bracket(
    folder: Path, models: Sequence[Detector], camera: Camera | None = None, seed: int = 0
) -> BracketTrial:
    """A bracket of a folder on trial. camera: whose noise and, if it has points, tone; None: the default camera.

    A picture whose light is a third of a stop off its exposure, while the others agree, is not compared. Raises
    ``ValueError`` for fewer than four pictures at rest, and as :func:`read_bracket` and :func:`fit_tone` do;
    ``OSError`` as reading does.
    """
    bracket = read_bracket(folder)
    still = [place for place, shot in enumerate(bracket.shots) if not shot.moving]
    known = None if camera is None or isinstance(camera.isp.tone, str) else camera.isp.tone
    fewest = FEWEST_TONED if known else FEWEST
    must = f"must be {fewest} or more" + ("" if known else ", three for the tone curve and one to compare")
    refuse(len(still) < fewest, f"{folder}: pictures of the scene at rest: {len(still)}; {must}")
    colour = not all(map(is_grey, bracket.pictures))
    if camera is None:  # a photograph has been through its mosaic once; a second one would blur it again
        camera = default_camera(colour=colour, cfa="none" if colour else None)
    whole = _HalfBracket.of(bracket, still, known, str(folder))
    wrong, notes = whole.wrong(bracket, still), [*bracket.notes, *whole.tone.doubts]
    for place, off in wrong.items():
        light = f"by the other pictures its light is {off:+.1f} EV off its exposure"
        notes.append(
            f"{bracket.shots[place].name}: {light}; wrong EXIF, or a lens or light that changed? not compared"
        )
    captured, simulated = [*bracket.pictures], dict[int, Bytes]()
    for left_out, others in _folds(bracket.shots, still, wrong):
        half = whole if len(others) == len(still) else _HalfBracket.of(bracket, others, known, str(folder))
        shots = [bracket.shots[place] for place in left_out]
        taken = shown(half.scene, shots, camera.with_figures(tone=half.tone.points), seed)
        simulated |= zip(left_out, taken, strict=True)
        notes += half.tone.left_out
    for place in (place for place, shot in enumerate(bracket.shots) if shot.moving):
        captured[place], moved = placed(captured[place], simulated[place])
        name = bracket.shots[place].name
        notes.append(f"{name}: in motion; moved by {moved} to lie over the scene at rest")
    right = [place for place in still if place not in wrong]
    best = min(right, key=lambda place: abs(float(np.median(grey(captured[place]))) - _MIDDLE))
    every = range(len(captured))
    trial = BracketTrial(
        name=folder.resolve().name,
        shots=bracket.shots,
        captured=captured,
        simulated={
            BRACKET: [simulated[place] for place in every],
            DEFAULTS: _usual(bracket, best, colour, seed),
        },
        compared={
            BRACKET: [place not in wrong for place in every],
            DEFAULTS: [place not in wrong and place != best for place in every],
        },
        rows=(),
        curves=(),
        camera=camera.with_figures(
            tone=whole.tone.points, sources={**camera.sources, "tone": whole.tone.text}
        ),
        tone=whole.tone.text,
        scene=whole.scene,
        notes=tuple(dict.fromkeys(notes)),
    )
    return replace(trial, rows=[*_rows(trial)], curves=[_curves(trial, model) for model in models])


class _HalfBracket(NamedTuple):
    """Tone curve and scene of some pictures of a bracket."""

    tone: Tone
    scene: MergedScene
    left_out: frozenset[str] = frozenset()

    @classmethod
    def of(cls, bracket: Bracket, places: Sequence[int], known: Points | None, about: str) -> _HalfBracket:
        shots, pictures = [bracket.shots[p] for p in places], [bracket.pictures[p] for p in places]
        tone, gone = Tone(known or (), "that of the camera file"), set[str]()
        if known is None:
            shown = [_shows(picture) for picture in pictures]
            few = f"{about}: pictures that are neither black nor white: {sum(shown)} of {len(shown)}"
            refuse(sum(shown) < FEWEST_FITTED, f"{few}; must be {FEWEST_FITTED} or more for a tone curve")
            fitted, names = [*compress(shots, shown)], [shot.name for shot in compress(shots, shown)]
            tone = fit_tone([*compress(pictures, shown)], [shot.exposure for shot in fitted], names, about)
            # those that the fit left out do not count; black and white ones say how dark and bright the ends are
            gone = {*names} - {*tone.names}
            kept = [shot.name not in gone for shot in shots]
            shots, pictures = [*compress(shots, kept)], [*compress(pictures, kept)]
        return cls(tone, merge(shots, pictures, tone.points), frozenset(gone))

    def wrong(self, bracket: Bracket, places: Sequence[int]) -> dict[int, float]:
        """Pictures whose light is off their exposure by more than ``_WRONG_EV``, EV, among those that the fit left
        out."""
        found = {}
        for place in places:
            shot = bracket.shots[place]
            off = off_exposure(self.scene, shot, bracket.pictures[place], self.tone.points)
            if shot.name in self.left_out and abs(off) > _WRONG_EV:
                found[place] = off
        return found


def _shows(picture: Bytes) -> bool:
    """Whether a picture has values from which a tone curve can be fitted."""
    return bool(((picture >= _SHOWN_DN[0]) & (picture <= _SHOWN_DN[1])).mean() >= _SHOWN_SHARE)


def _folds(
    shots: Sequence[Shot], still: Sequence[int], wrong: Iterable[int]
) -> Iterator[tuple[list[int], list[int]]]:
    """Places to simulate, and those at rest that they are simulated from: of what is in motion or wrong, all."""
    right = [place for place in still if place not in wrong]
    parts = 2 if len(right) >= _HALVES else len(right)
    for part in range(parts):
        left_out = right[part::parts]
        yield left_out, [place for place in right if place not in left_out]
    if beside := [place for place, shot in enumerate(shots) if shot.moving or place in wrong]:
        yield beside, right


def _usual(bracket: Bracket, best: int, colour: bool, seed: int) -> list[Bytes]:
    """All exposures simulated from one photograph, as a sweep does by default."""
    tone, camera = default_tone.of_photographs(usual_plan().picture_tone, default_camera(colour=colour))
    light = Scene.of_picture(bracket.pictures[best], encoding=tone).light
    scene = MergedScene(light[0].permute(1, 2, 0).numpy(), bracket.shots[best], 0.0)
    return [*shown(scene, bracket.shots, camera, seed)]


def _rows(trial: BracketTrial) -> Iterator[dict[str, Any]]:
    for route in ROUTES:
        for place, (shot, captured) in enumerate(zip(trial.shots, trial.captured, strict=True)):
            for measure in MEASURES:
                real, model = measure.of(captured, trial.simulated[route][place])
                yield {
                    "bracket": trial.name, "picture": shot.name, "exposure_ev": float(trial.stops[place]),
                    "route": route, "compared": trial.compared[route][place], "measure": measure.name,
                    "captured": real, "simulated": model,
                }  # fmt: skip


def _curves(trial: BracketTrial, model: Detector) -> Curves:
    found = [model.detect(picture) for picture in trial.captured]
    objects, once = followed.objects(found, model.contract.classes)
    simulated = {
        route: followed.confidences([model.detect(picture) for picture in pictures], objects)
        for route, pictures in trial.simulated.items()
    }
    return Curves(model.name, objects, followed.confidences(found, objects), simulated, once)
