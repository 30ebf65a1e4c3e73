"""What a state shows: the picture, what it measures, what a model finds in it, and how much that is of the original.

All physics is the simulator's and all scoring the harness's: a picture here has the bits of the sweep's cell with the
same conditions and seed. Domain: pictures (H, W, 3) uint8 RGB; scores per target, 0 to 1: confidences, or exact
matches of a text recogniser.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch.nn.functional import avg_pool2d

from blurnoise.light.conditions import middle_of
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.optics.radiometry import photoelectrons
from blurnoise.scene.exposure import Exposure
from blurnoise_eval.answers.criterion import CONFIDENCE, MATCHES, Criterion
from blurnoise_eval.answers.curves import windows
from blurnoise_eval.answers.recommendation import best_exposure, without_saturated
from blurnoise_eval.datasets import Picture
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.state import Control, State, with_figures
from blurnoise_eval.grid.axes import EGO, EXPOSURE, MOVES, VELOCITY
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.on_picture import Model, ModelOutput, View
from blurnoise_eval.sweep.exposing import Frame, Scene, frames, snr_db

Picture8 = NDArray[np.uint8]
PREVIEW_PX = 120_000
"""A picture of more pixels is shown smaller first, while a slider moves."""
_GREY = 0.18
POINTS = 29  # of a curve, from end to end


class Point(NamedTuple):
    """A point of a curve: the control's value, in its unit, the score of every target, and the share of the picture's
    pixels that is saturated."""

    value: float
    scores: tuple[float, ...]
    saturated: float = 0.0

    @property
    def mean(self) -> float:
        """Over the targets."""
        return sum(self.scores) / len(self.scores)


@dataclass(frozen=True)
class Standard:
    """A criterion applied to one picture. counted: ids of the targets that count; original: their mean score in the
    original picture. Where a share of that is asked for, targets that the model misses there do not count."""

    criterion: Criterion
    counted: frozenset[int]
    original: float

    @classmethod
    def of(cls, criterion: Criterion, clean: ModelOutput) -> Standard:
        """The standard of a picture, by the model's answer to the original."""
        scored = {row["target_id"]: _score(criterion, row) for row in clean.targets}
        if criterion.kept:
            scored = {name: score for name, score in scored.items() if score >= FOUND_SCORE}
        return cls(criterion, frozenset(scored), sum(scored.values()) / max(1, len(scored)))

    @property
    def enough(self) -> float:
        """The mean score from which the model works."""
        return self.criterion.level * (self.original if self.criterion.kept else 1.0)

    @property
    def title(self) -> str:
        """The name of the mean score."""
        return "Mean exact matches" if self.criterion.score == MATCHES else "Mean confidence"

    @property
    def found_from(self) -> float:
        """The confidence from which a target counts as found."""
        absolute = not self.criterion.kept and self.criterion.score == CONFIDENCE
        return self.criterion.level if absolute else FOUND_SCORE

    def sight(self, sight: ModelOutput) -> ModelOutput:
        """With the targets that count alone."""
        return sight._replace(targets=tuple(row for row in sight.targets if row["target_id"] in self.counted))

    def scores(self, sight: ModelOutput) -> tuple[float, ...]:
        """Of the targets that count."""
        return tuple(_score(self.criterion, row) for row in self.sight(sight).targets)

    def value(self, mean: float) -> float:
        """A mean score in the criterion's unit."""
        return mean / self.original if self.criterion.kept else mean

    def text(self, value: float) -> str:
        """A value in the criterion's unit, as people read it."""
        return f"{100 * value:.0f} %" if self.criterion.kept else f"{value:.2f}"


def works(
    curve: Sequence[Point], enough: float, at: float, *, logarithmic: bool = False
) -> tuple[float, float] | None:
    """From where to where along a curve the mean score is enough, around ``at`` or else the widest; None: nowhere.

    The ends are those of a run's windows, see :func:`~blurnoise_eval.answers.curves.windows`.
    """
    found = windows([point.value for point in curve], [point.mean for point in curve], enough, logarithmic)
    around = [window for window in found if window[0] <= at <= window[1]]
    return next(iter(around or sorted(found, key=lambda window: window[0] - window[1])), None)


def keeps_most(curve: Sequence[Point], standard: Standard) -> Point:
    """The point of a curve along the exposure to use, by the rule that recommends a run's exposure."""
    means = [standard.value(point.mean) for point in curve]
    values = without_saturated(means, [point.saturated for point in curve], standard.criterion.level)
    return curve[best_exposure([point.value for point in curve], values) or 0]


def verdict(sight: ModelOutput, standard: Standard) -> tuple[bool, str]:
    """Whether the model works on the picture, and a sentence on it."""
    if sight.error:
        return False, f"The model fails on this picture: {sight.error[:160]}"
    scores, level = standard.scores(sight), standard.criterion.level
    if not scores:
        return False, "No score: the model finds nothing in the original picture. Choose another model."
    mean = sum(scores) / len(scores)
    value = standard.value(mean)
    hits = sum(row["confidence"] >= standard.found_from for row in sight.targets)
    text = f"{standard.title} {mean:.2f}"
    if standard.criterion.kept:
        text = f"Keeps {standard.text(value)} of its {standard.criterion.noun} in the original "
        text += f"({mean:.2f} of {standard.original:.2f})"
    enough = "" if value >= level else f"; enough is {standard.text(level)}"
    return value >= level, f"{text}, {hits} of {len(scores)} found{enough}."


def window_sentence(curve: Sequence[Point], along: Control, at: float, standard: Standard) -> str:
    """From where to where along the curve the model works, and which value keeps most."""
    if not curve:
        return ""
    level = standard.text(standard.criterion.level)
    of_exposure = along.name == EXPOSURE.name
    best = keeps_most(curve, standard) if of_exposure else max(curve, key=lambda point: point.mean)
    most = (
        f"most, {standard.text(standard.value(best.mean))} at {along.text(best.value)} {along.unit}".rstrip()
    )
    window = works(curve, standard.enough, at, logarithmic=along.logarithmic)
    if window is None:
        return f"{along.title}: none of the {len(curve)} values tried reaches {level}; {most}."
    low, high = window
    ends = [f"from about {low:.2g}"] if low > curve[0].value else []
    ends += [f"{'to' if ends else 'up to about'} {high:.2g}"] if high < curve[-1].value else []
    where = f"{' '.join(ends)} {along.unit}".rstrip() if ends else "at every value tried"
    if along.choices:
        good = [along.choices[int(point.value)] for point in curve if point.mean >= standard.enough]
        where = f"with {', '.join(good)}"
    here = "" if low <= at <= high or along.choices else ", not here"
    return f"{along.title}: {level} or more {where}{here}; {most}."


def _score(criterion: Criterion, row: dict[str, Any]) -> float:
    if criterion.score == MATCHES:
        return float(row["text"] == row["truth"])
    return float(row["confidence"])


class Subject:
    """A picture as light, what models find in the original, and a smaller copy. Any number of threads may use it.

    run: the run that the picture is of, with whose settings it is taken. Raises
    :class:`~blurnoise_eval.datasets.UnreadablePicture` where it cannot be loaded.
    """

    def __init__(self, picture: Picture, run: Run | None = None) -> None:
        self._run = run
        self.scene = run.scene(picture) if run else Scene(picture.load(), picture=picture)
        self.original = self.scene.image8
        self.size = self.original.shape[0], self.original.shape[1]
        self.smaller = math.ceil(math.sqrt(self.size[0] * self.size[1] / PREVIEW_PX))
        """How many times smaller it is shown first; 1 where it is small enough."""
        self._views = cache(lambda model: View(model, picture, self.original))

    def frame(self, state: State, camera: Camera) -> Frame:
        """The picture of a state: the cell that a sweep would compute for it. Raises ``ValueError``."""
        cell = Cell("seen", 0, state.at, state.seed)
        if self._run:
            return self._run.expose(self.scene, cell, camera)
        return next(frames(self.scene, [cell], camera))

    def view(self, model: Model) -> View:
        """A model's view of the picture; each model is given the original once."""
        return self._views(model)  # type: ignore[arg-type]  # models are told apart by identity

    @cached_property
    def small(self) -> Scene:
        """The picture with its light averaged over ``smaller`` x ``smaller`` px."""
        light = avg_pool2d(self.scene.light.light, self.smaller, ceil_mode=True, count_include_pad=False)
        coded = srgb_from_linear(light)[0].clamp(0, 1).mul(65535).round().permute(1, 2, 0)
        return Scene(coded.contiguous().numpy().astype(np.uint16))

    def preview(self, state: State, camera: Camera) -> Picture8:
        """The picture ``smaller`` times smaller, with its motion and defocus; each pixel has the noise of a
        full one. Raises ``ValueError`` where parts of the picture move apart."""
        n, at = self.smaller, state.at
        if at[EGO.name] or at[MOVES.name]:
            raise ValueError("preview: shows one motion of all the picture")
        slower = {name: (at[name] or 0.0) / n for name in VELOCITY}
        defocus_px = at.exposure(camera).camera.defocus_radius_px / n
        cell = Cell("preview", 0, Conditions(**{**at, **slower, "defocus_radius_px": defocus_px}), state.seed)
        return next(frames(self.small, [cell], replace(camera, row_time_s=n * camera.row_time_s))).image


class Number(NamedTuple):
    """A figure of a picture: its name, title, value, and text with the unit."""

    name: str
    title: str
    value: float | None
    text: str


@dataclass(frozen=True)
class Rendered:
    """What a state shows. camera: with the state's figures. sight, clean: what the model finds in the picture and the
    original, with the targets that count by ``standard``; None without a model. classes: their names."""

    state: State
    frame: Frame
    exposure: Exposure
    camera: Camera
    numbers: tuple[Number, ...]
    left_out: str
    sight: ModelOutput | None = None
    clean: ModelOutput | None = None
    standard: Standard | None = None
    classes: tuple[str, ...] = ()

    @property
    def image(self) -> Picture8:
        """The picture."""
        return self.frame.image

    @property
    def confidence(self) -> float | None:
        """Mean over the targets; None without a model or a target."""
        rows = self.sight.targets if self.sight else ()
        return sum(float(row["confidence"]) for row in rows) / len(rows) if rows else None


def rendered(
    state: State, subject: Subject, camera: Camera, frame: Frame, model: Model | None, criterion: Criterion
) -> Rendered:
    """What a picture, ``frame``, measures and what a model finds in it. camera: with the state's figures."""
    exposure = frame.exposure
    if exposure is None:
        raise ValueError("conditions: must be specified; this is the original picture")
    plan = subject.scene.plan(exposure)
    left_out = f"Effects left out: {plan.left_out_dn:.2g} of {plan.tolerance_dn:.3g} DN RMS allowed."
    measured = numbers(exposure, frame.saturated or 0.0, subject.size)
    found = Rendered(state, frame, exposure, camera, measured, left_out)
    if model is None:
        return found
    view = subject.view(model)
    standard = Standard.of(criterion, view.clean)
    return replace(
        found,
        sight=standard.sight(view.evaluate(frame.image, frame.move_boxes, frame.sweep_boxes)),
        clean=standard.sight(view.clean),
        standard=standard,
        classes=tuple(getattr(model.contract, "classes", ())),
    )


def curve_points(
    state: State, subject: Subject, camera: Camera, model: Model, along: Control, standard: Standard
) -> Iterator[Point]:
    """Scores of the targets along a control, from end to end. camera: without the state's figures."""
    view = subject.view(model)
    for value in along.places(POINTS):
        at = along.put(state, value)
        with suppress(ValueError):  # conditions that do not go together
            frame = subject.frame(at, with_figures(camera, at.figures))
            sight = view.evaluate(frame.image, frame.move_boxes, frame.sweep_boxes)
            if scores := standard.scores(sight):
                yield Point(value, scores, frame.saturated or 0.0)


def numbers(exposure: Exposure, saturated: float, size: tuple[int, int]) -> tuple[Number, ...]:
    """Electrons of white, signal to noise, blur, saturation and gain. saturated: the share of pixels."""
    camera, digital_db = exposure.amplified
    white_e = photoelectrons(camera, exposure.illuminance_lux, exposure.exposure_s)
    grey_db = snr_db(exposure, _GREY)
    blur_px = math.hypot(*exposure.velocity_px_s) * exposure.exposure_s
    if exposure.drives:  # in the middle of what the pixels see
        flow = exposure.vehicle.flow_px_s(exposure.camera, size, exposure.ego_speed_m_s)
        blur_px = float(middle_of(flow[None] * exposure.exposure_s)[0].norm())
    digital = f", {digital_db:.1f} dB of it digital" if abs(digital_db) > 0.05 else ""
    well = f"{white_e / camera.saturation_e:.2g} of saturation"
    return (
        Number("white_electrons", "White", white_e, f"{white_e:.5g} e-, {well}"),
        Number("snr_db", "SNR at 18 % grey", grey_db, "none" if grey_db is None else f"{grey_db:.1f} dB"),
        Number("exposure_ms", "Exposure", 1e3 * exposure.exposure_s, f"{1e3 * exposure.exposure_s:.4g} ms"),
        Number("blur_px", "Motion blur", blur_px, f"{blur_px:.1f} px"),
        Number("clipped", "Saturated", saturated, f"{100 * saturated:.2g} %"),
        Number("gain_db", "Gain", exposure.gain_db, f"{exposure.gain_db:.1f} dB{digital}"),
    )
