"""What a state shows: the picture, its measures, what a detector finds in it, and how much of the original that is.

All physics is the simulator's and all scoring the harness's: a picture here has the bits of the sweep's cell with the
same conditions and seed. Domain: pictures (H, W, 3) uint8 RGB; confidences 0 to 1, of each target. Texts from files
are escaped where they are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from html import escape
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch.nn.functional import avg_pool2d

from blurnoise.camera import Camera
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.camera.radiometry import photoelectrons
from blurnoise.light.conditions import middle_of
from blurnoise.scene.exposure import Exposure
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import windows
from blurnoise_eval.answers.recommendation import best_exposure, without_saturated
from blurnoise_eval.datasets import Picture
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.explorer.run import USUAL, Run
from blurnoise_eval.explorer.state import State, controls
from blurnoise_eval.grid.axes import EGO, EXPOSURE, MOVES, VELOCITY
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.plots.annotate import MOST_BOXES, OTHER_SCORE
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import FOUND_SCORE, MATCH_IOU
from blurnoise_eval.scoring.on_picture import ModelOutput, View
from blurnoise_eval.sweep.exposing import Frame, Scene, frames, snr_db

Picture8 = NDArray[np.uint8]
PREVIEW_PX = 120_000
"""A picture of more pixels is shown smaller first, while a slider moves."""
_GREY = 0.18
POINTS = 29  # of a curve, from end to end
_INK, _ACCENT, _GOOD = "#7c8894", "#2584ad", "#12803f2b"  # readable on light and dark


class Point(NamedTuple):
    """A point of the curve along the exposure, ms: the mean confidence, and the share of the picture's pixels that is
    saturated."""

    exposure_ms: float
    mean: float
    saturated: float = 0.0


def mean_confidence(sight: ModelOutput) -> float:
    """Over the targets; 0 without any."""
    return sum(float(row["confidence"]) for row in sight.targets) / max(1, len(sight.targets))


@dataclass(frozen=True)
class Standard:
    """A criterion applied to one picture: from ``level`` of ``unit`` on the mean confidence is enough. kept: the unit
    is the mean confidence in the original picture, of the targets found there, the only ones that count; else it is
    1. counted: ids of the targets that count."""

    level: float
    kept: bool
    unit: float
    counted: frozenset[int]

    @classmethod
    def of(cls, criterion: Criterion, clean: ModelOutput) -> Standard:
        """The standard of a picture, by the detector's answer to the original."""
        least = FOUND_SCORE if criterion.kept else 0.0
        rows = tuple(row for row in clean.targets if row["confidence"] >= least)
        unit = mean_confidence(clean._replace(targets=rows)) if criterion.kept else 1.0
        return cls(criterion.level, criterion.kept, unit, frozenset(row["target_id"] for row in rows))

    @property
    def required(self) -> float:
        """The mean confidence from which the detector works."""
        return self.level * self.unit

    def sight(self, sight: ModelOutput) -> ModelOutput:
        """With the targets that count alone."""
        return sight._replace(targets=tuple(row for row in sight.targets if row["target_id"] in self.counted))

    def text(self, mean: float) -> str:
        """A mean confidence in the criterion's unit."""
        return f"{100 * mean / self.unit:.0f} %" if self.kept else f"{mean:.2f}"


def window(curve: Sequence[Point], required: float, at_ms: float) -> tuple[float, float] | None:
    """From where to where along a curve the mean is enough, around ``at_ms`` or else the widest; None: nowhere.

    The ends are those of a run's windows, see :func:`~blurnoise_eval.answers.curves.windows`.
    """
    found = windows([point.exposure_ms for point in curve], [point.mean for point in curve], required)
    around = [each for each in found if each[0] <= at_ms <= each[1]]
    return next(iter(around or sorted(found, key=lambda each: each[0] - each[1])), None)


def window_sentence(curve: Sequence[Point], at_ms: float, standard: Standard) -> str:
    """From where to where along the curve the detector works, and which exposure keeps most, by the rule that
    recommends a run's."""
    values = [point.mean / standard.unit for point in curve]
    counted = without_saturated(values, [point.saturated for point in curve], standard.level)
    best = curve[best_exposure([point.exposure_ms for point in curve], counted) or 0]
    most = f"best: {standard.text(best.mean)} at {best.exposure_ms:g} ms"
    found, level = window(curve, standard.required, at_ms), standard.text(standard.required)
    if found is None:
        return f"Exposure: none of the {len(curve)} tested values reaches {level}; {most}."
    low, high = (f"{float(f'{end:.2g}'):g}" for end in found)
    ends = [f"from about {low}"] if found[0] > curve[0].exposure_ms else []
    ends += [f"{'to' if ends else 'up to about'} {high}"] if found[1] < curve[-1].exposure_ms else []
    where = f"{' '.join(ends)} ms" if ends else "at every tested value"
    here = "" if found[0] <= at_ms <= found[1] else ", not here"
    return f"Exposure: {level} or more {where}{here}; {most}."


class Subject:
    """A picture as light, what detectors find in the original, and a smaller copy. Any number of threads may use it.

    run: the run that the picture is of, with whose settings it is taken. Raises
    :class:`~blurnoise_eval.datasets.UnreadablePicture` where it cannot be loaded.
    """

    def __init__(self, picture: Picture, run: Run | None = None) -> None:
        self._run, self.criterion = run, run.criterion if run else USUAL
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

    def view(self, model: Detector) -> View:
        """A detector's view of the picture; each is given the original once."""
        return self._views(model)

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
        if at[EGO.name] or at[MOVES.name] or self.scene.lamps is not None:
            raise ValueError("preview: needs one motion of the whole picture, and no lamps")
        slower = {name: (at[name] or 0.0) / n for name in VELOCITY}
        defocus_px = at.exposure(camera).camera.lens.defocus_radius_px / n
        cell = Cell("preview", 0, Conditions(**{**at, **slower, "defocus_radius_px": defocus_px}), state.seed)
        return next(
            frames(self.small, [cell], camera.with_figures(row_time_s=n * camera.sensor.row_time_s))
        ).image


Number = tuple[str, float | None, str]
"""A figure of a picture: its title, value and unit."""


@dataclass(frozen=True)
class Rendered:
    """What a state shows. sight, clean: what the detector finds in the picture and the original, with the targets
    that count by ``standard``; None without a detector. classes: their names."""

    state: State
    frame: Frame
    exposure: Exposure
    sight: ModelOutput | None = None
    clean: ModelOutput | None = None
    standard: Standard | None = None
    classes: tuple[str, ...] = ()

    @property
    def numbers(self) -> dict[str, Number]:
        """Its measures, by the names that ``simulate`` prints. Of a camera that drives, the blur is in the middle of
        the places'."""
        exposure, camera = self.exposure, self.exposure.amplified.camera
        blur_px = math.hypot(*exposure.velocity_px_s) * exposure.exposure_s
        if exposure.drives:
            height, width = self.frame.image.shape[:2]
            flow = exposure.vehicle.flow_px_s(exposure.camera, (height, width), exposure.ego_speed_m_s)
            blur_px = float(middle_of(flow[None] * exposure.exposure_s)[0].norm())
        white_e = photoelectrons(camera, exposure.illuminance_lux, exposure.exposure_s)
        return {
            "white_electrons": ("White", white_e, "e-"),
            "saturation_electrons": ("Saturation", camera.sensor.saturation_e, "e-"),
            "snr_db": ("SNR at 18 % grey", snr_db(exposure, _GREY), "dB"),
            "exposure_ms": ("Exposure", 1e3 * exposure.exposure_s, "ms"),
            "gain_db": ("Gain", exposure.gain_db, "dB"),
            "blur_px": ("Motion blur", blur_px, "px"),
            "clipped_percent": ("Saturated", 100 * (self.frame.saturated or 0.0), "%"),
        }


def verdict(found: Rendered) -> tuple[bool, str]:
    """Whether the detector works on the picture, and a sentence on it."""
    if found.sight is None or found.standard is None:
        return True, "No model."
    sight, standard = found.sight, found.standard
    if sight.error:
        return False, f"The model failed on this picture: {sight.error[:160]}"
    if not sight.targets:
        return False, "No score, as the model finds nothing in the original picture. Choose another model."
    mean = mean_confidence(sight)
    hits = sum(row["confidence"] >= FOUND_SCORE for row in sight.targets)
    text = f"Mean confidence {mean:.2f}"
    if standard.kept:
        kept = f"Keeps {standard.text(mean)} of its confidence in the original"
        text = f"{kept} ({mean:.2f} of {standard.unit:.2f})"
    good = mean >= standard.required
    required = "" if good else f"; required: {standard.text(standard.required)}"
    return good, f"{text}, {hits} of {len(sight.targets)} found{required}."


def rendered(state: State, subject: Subject, frame: Frame, model: Detector | None) -> Rendered:
    """What a picture, ``frame``, measures and what a detector finds in it."""
    if frame.exposure is None:
        raise ValueError("conditions: must be specified; this is the original picture")
    found = Rendered(state, frame, frame.exposure)
    if model is None:
        return found
    view = subject.view(model)
    standard = Standard.of(subject.criterion, view.clean)
    return replace(
        found,
        sight=standard.sight(view.evaluate(frame.image, frame.move_boxes, frame.sweep_boxes)),
        clean=standard.sight(view.clean),
        standard=standard,
        classes=model.contract.classes,
    )


def curve_points(
    state: State, subject: Subject, camera: Camera, model: Detector, standard: Standard
) -> Iterator[Point]:
    """Mean confidences along the exposure, from end to end."""
    view, along = subject.view(model), controls(camera)[EXPOSURE.name]
    for place in range(POINTS):
        exposure_ms = along.value(along.steps * place / (POINTS - 1))
        with suppress(ValueError):  # more motion than is allowed
            frame = subject.frame(state.put(EXPOSURE.name, EXPOSURE.of_option(exposure_ms)), camera)
            sight = standard.sight(view.evaluate(frame.image, frame.move_boxes, frame.sweep_boxes))
            if sight.targets:
                yield Point(exposure_ms, mean_confidence(sight), frame.saturated or 0.0)


def boxes(found: Rendered, sight: ModelOutput | None) -> str:
    """As SVG over the picture: targets with their confidence, found and missed, and what else a detector finds in it
    or, where ``sight`` is of that, in the original."""
    if sight is None:
        return ""
    size = height, width = found.frame.image.shape[:2]  # of its own, since a smaller picture may lie below
    targets = sorted(sight.targets, key=lambda row: -row["width_px"] * row["height_px"])[:MOST_BOXES]
    places = [[row["x0"], row["y0"], row["x1"], row["y1"]] for row in targets]
    leading = sight.detections.leading
    rows = zip(leading.boxes_xyxy.tolist(), leading.scores.tolist(), leading.class_ids.tolist(), strict=True)
    drawn = [
        _box(box, "other", f"{found.classes[class_id][:24]} {score:.2f}", size)
        for box, score, class_id in [row for row in rows if row[1] >= OTHER_SCORE][:MOST_BOXES]
        if not (iou([box], places) >= MATCH_IOU).any()
    ]
    for row, place in zip(targets, places, strict=True):
        kind = "found" if row["confidence"] >= FOUND_SCORE else "missed"
        drawn.append(_box(place, kind, f"{row['confidence']:.2f}", size))
    return (
        f'<svg class="boxes" viewBox="0 0 {width} {height}" width="100%" height="100%" preserveAspectRatio="none">'
        f"{''.join(drawn)}</svg>"
    )


def _box(box: Sequence[float], kind: str, text: str, size: tuple[int, int]) -> str:
    font = max(size) / 32
    x0, y0, x1, y1 = (min(max(edge, -1e5), 1e5) for edge in box)
    y = y0 - 0.3 * font if y0 > 1.3 * font else y1 + font
    return (
        f'<g class="{kind}"><rect x="{x0:.1f}" y="{y0:.1f}" width="{max(0.0, x1 - x0):.1f}" '
        f'height="{max(0.0, y1 - y0):.1f}" vector-effect="non-scaling-stroke"/>'
        f'<text x="{max(0.0, x0):.1f}" y="{y:.1f}" font-size="{font:.1f}">{escape(text)}</text></g>'
    )


def chart(curve: Sequence[Point], at_ms: float, required: float) -> dict[str, Any]:
    """Mean confidences along the exposure, as options of ECharts. at_ms: of the picture; required: the level."""
    works = window(curve, required, at_ms)
    lines = [
        {"yAxis": required, "lineStyle": {"type": "dashed"}},
        {"xAxis": at_ms, "lineStyle": {"type": "solid", "width": 2}},
    ]
    area = [[{"xAxis": works[0]}, {"xAxis": works[1]}]] if works else []
    mean = {
        "type": "line",
        "data": [[point.exposure_ms, point.mean] for point in curve],
        "symbolSize": 7,
        "color": _ACCENT,
        "markLine": {"symbol": "none", "label": {"show": False}, "lineStyle": {"color": _INK}, "data": lines},
        "markArea": {"itemStyle": {"color": _GOOD}, "data": area},
    }
    ends = {"min": curve[0].exposure_ms, "max": curve[-1].exposure_ms}
    return {
        "animation": False,
        "textStyle": {"color": _INK},
        "grid": {"left": 34, "right": 16, "top": 8, "bottom": 24},
        "tooltip": {"trigger": "item"},
        "xAxis": {"type": "log", **ends, "splitLine": {"show": False}, "axisLabel": {"hideOverlap": True}},
        "yAxis": {"min": 0, "max": 1, "interval": 0.5},
        "series": [mean],
    }
