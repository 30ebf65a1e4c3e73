"""What a state shows: the picture, what it measures, what a model finds in it, and what the plan left out.

All physics is the simulator's and all judging the harness's: a picture here has the bits of the sweep's cell with the
same conditions and seed. Domain: pictures (H, W, 3) uint8 RGB.
"""

from __future__ import annotations

import math
import threading
from bisect import insort
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from torch.nn.functional import avg_pool2d

from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.optics.radiometry import photoelectrons
from blurnoise.scene.plan import Plan
from blurnoise.scene.scene import Exposure
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import Picture
from blurnoise_eval.explorer.binning import binned
from blurnoise_eval.explorer.controls import Control
from blurnoise_eval.explorer.judging import Point, Standard, finer
from blurnoise_eval.explorer.measured import motion_px, mtf50
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.state import State, with_figures
from blurnoise_eval.grid.axes import AXES, EXPOSURE, VELOCITY
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.scoring.on_picture import Model, Sight, View
from blurnoise_eval.sweep.exposing import Frame, Scene, frames, snr_db

Picture8 = NDArray[np.uint8]
PREVIEW_PX = 120_000
"""A picture of more pixels is shown smaller first, while a slider moves."""
BINS = 64
_GREY = 0.18
_POINTS, _FINER = 15, 18  # of a curve: from end to end, and exposures at most beyond these


class Subject:
    """A picture as light, what models find in it as it is, and smaller twins. Any number of threads may use it.

    run: of which it is, and as which it is taken. Raises :class:`~blurnoise_eval.datasets.UnreadablePicture` where it
    cannot be loaded.
    """

    def __init__(self, picture: Picture, run: Run | None = None) -> None:
        self.picture, self._run = picture, run
        self.scene = run.scene(picture) if run else Scene(picture.load(), picture=picture)
        self.original = self.scene.image8
        self.size = self.original.shape[0], self.original.shape[1]
        self.smaller = math.ceil(math.sqrt(self.size[0] * self.size[1] / PREVIEW_PX))
        """How many times smaller it is shown first; 1 where it is small enough."""
        self._views: dict[tuple[str, str], View] = {}
        self._twin: Scene | None = None
        self._lock = threading.Lock()

    def frame(self, state: State, camera: Camera) -> Frame:
        """The picture of a state: the cell that a sweep would compute for it. Raises ``ValueError``."""
        cell = Cell("seen", 0, state.at, state.seed)
        if self._run:
            return self._run.expose(self.scene, cell, camera)
        return next(frames(self.scene, [cell], camera))

    def view(self, model: Model) -> View:
        """The model before the picture, which it is shown as it is, once."""
        name = (model.name, model.sha256)
        with self._lock:
            if name not in self._views:
                self._views = dict([*self._views.items()][-2:]) | {
                    name: View(model, self.picture, self.original)
                }
            return self._views[name]

    def twin(self) -> Scene:
        """The picture with its light averaged over ``smaller`` x ``smaller`` px."""
        with self._lock:
            if self._twin is None:
                light = avg_pool2d(
                    self.scene.light.light, self.smaller, ceil_mode=True, count_include_pad=False
                )
                coded = srgb_from_linear(light)[0].clamp(0, 1).mul(65535).round().permute(1, 2, 0)
                self._twin = Scene(coded.contiguous().numpy().astype(np.uint16))
            return self._twin

    def preview(self, state: State, camera: Camera) -> Picture8:
        """The picture ``smaller`` times smaller, its blur and noise those of the full size, averaged; the noise is
        another draw. Raises ``ValueError`` where parts move apart, or beyond a binned camera's limits."""
        n, at = self.smaller, state.at
        of_lens = {each.name: None for each in AXES if each.into.startswith("camera.")}
        slower = {name: (at[name] or 0.0) / n for name in VELOCITY}
        cell = Cell("preview", 0, Conditions(**{**at, **of_lens, **slower}), state.seed)
        return next(frames(self.twin(), [cell], binned(at.exposure(camera).camera, n))).image


class Number(NamedTuple):
    """A figure of what is shown: its name, title, value, text with the unit, and a word on it."""

    name: str
    title: str
    value: float | None
    text: str
    about: str = ""


@dataclass(frozen=True)
class Rendered:
    """What a state shows. sight, clean: what the model finds in it and in the original picture, with the targets that
    count by ``standard``; None without a model. histogram: (3, BINS) shares of the values of red, green and blue;
    clipped: shares of values at 0 and at the top. classes: names of what the model finds."""

    state: State
    frame: Frame
    exposure: Exposure
    camera: Camera
    numbers: tuple[Number, ...]
    plan: Plan
    histogram: NDArray[np.float64]
    clipped: tuple[float, float]
    sight: Sight | None = None
    clean: Sight | None = None
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
    """What a picture, ``frame``, measures and what a model finds in it. camera: that of the state, with the state's
    figures. criterion: what is enough. Raises ``ValueError`` for the untouched picture."""
    if frame.exposure is None:
        raise ValueError("conditions: must be stated; this is the untouched picture")
    shares, clipped = histogram(frame.image)
    found = Rendered(
        state,
        frame,
        frame.exposure,
        camera,
        numbers(frame.exposure, frame.saturated or 0.0, subject.size),
        subject.scene.plan(frame.exposure),
        shares,
        clipped,
    )
    if model is None:
        return found
    before = subject.view(model)
    standard = Standard.of(criterion, before.clean)
    return replace(
        found,
        sight=standard.sight(before.look(frame.image, frame.move_boxes, frame.sweep_boxes)),
        clean=standard.sight(before.clean),
        standard=standard,
        classes=tuple(getattr(model.contract, "classes", ())),
    )


def curve_points(
    state: State,
    subject: Subject,
    camera: Camera,
    model: Model,
    along: Control,
    standard: Standard,
    count: int = _POINTS,
) -> Iterator[Point]:
    """Scores of the targets along a control, from end to end, then, of the exposure, more where the model keeps most.
    camera: without the state's figures."""
    before = subject.view(model)

    def point(value: float) -> Point | None:
        at = along.put(state, value)
        with suppress(ValueError):  # beyond what goes together
            frame = subject.frame(at, with_figures(camera, at.figures))
            sight = before.look(frame.image, frame.move_boxes, frame.sweep_boxes)
            return Point(value, standard.scores(sight), frame.saturated or 0.0)
        return None

    curve: list[Point] = []
    values, further = along.places(count), _FINER if along.name == EXPOSURE.name else 0
    while values:
        if (found := point(values.pop(0))) and found.scores:
            insort(curve, found)
            yield found
        if not values and further and curve and (value := finer(curve, standard)) is not None:
            further -= 1
            values = [value]


def numbers(exposure: Exposure, saturated: float, size: tuple[int, int]) -> tuple[Number, ...]:
    """What engineers ask of a frame first. saturated: the share of its pixels."""
    camera, digital_db = exposure.amplified
    white_e = photoelectrons(camera, exposure.illuminance_lux, exposure.exposure_s)
    grey_db = snr_db(exposure, _GREY)
    motion = motion_px(exposure, size)
    angles = (motion.angle_deg, motion.angle_deg + 90)
    along, across = (mtf50(camera.optics, (motion.x, motion.y), angle) for angle in angles)
    sharp = [f"{f:.3f}" if math.isfinite(f) else "> 0.5" for f in (along, across)]
    of_well = f"{_percent(white_e / camera.saturation_e)} of {_thousands(camera.saturation_e)} e-"
    digital = f"{digital_db:.1f} dB of it digital" if abs(digital_db) > 0.05 else ""
    elsewhere = f"up to {motion.varies:.1f} px otherwise at places" if motion.varies else ""
    return (
        Number("white_electrons", "White", white_e, f"{_thousands(white_e)} e-", of_well),
        Number("snr_db", "SNR at 18 % grey", grey_db, "none", "no light")
        if grey_db is None
        else Number(
            "snr_db", "SNR at 18 % grey", grey_db, f"{grey_db:.1f} dB", f"{10 ** (grey_db / 20):.3g} : 1"
        ),
        Number(
            "blur_px",
            "Motion blur",
            motion.blur_px,
            f"{motion.blur_px:.1f} px",
            elsewhere or f"in {1e3 * exposure.exposure_s:.4g} ms",
        ),
        Number(
            "mtf50",
            "MTF50 of the chain",
            along if math.isfinite(along) else None,
            f"{sharp[0]} c/px",
            f"{sharp[1]} across" if motion.blur_px else "lens alone",
        ),
        Number("clipped", "Clipped", saturated, _percent(saturated), "of all values"),
        Number("gain_db", "Gain", exposure.gain_db, f"{exposure.gain_db:.1f} dB", digital or "analogue"),
    )


def histogram(image: Picture8) -> tuple[NDArray[np.float64], tuple[float, float]]:
    """Shares (3, BINS) of each colour's values, and the shares at 0 and at 255 of all."""
    counts = np.stack([cv2.calcHist([image], [each], None, [256], [0, 256]).ravel() for each in range(3)])
    clipped = (float(counts[:, 0].sum() / image.size), float(counts[:, 255].sum() / image.size))
    return counts.reshape(3, BINS, -1).sum(-1) / (image.size / 3), clipped


def _thousands(value: float) -> str:
    return f"{value:,.0f}".replace(",", " ") if value >= 100 else f"{value:.3g}"


def _percent(share: float) -> str:
    return "0 %" if share == 0 else f"{100 * share:.2g} %" if share < 1 else f"{100 * share:.0f} %"
