"""What is seen of a state: the picture, what it measures, what a model finds, and what the plan left out.

All physics is the simulator's and all judging the harness's: a picture here has the bits of the sweep's cell with the
same conditions and seed. Domain: pictures (H, W, 3) uint8 RGB.
"""

from __future__ import annotations

import math
import threading
from bisect import insort
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from torch.nn.functional import avg_pool2d

from blurnoise.light.conditions import middle_of
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.optics.radiometry import photoelectrons
from blurnoise.picture.steps import magnification
from blurnoise.scene.plan import TOLERANCE_DN, Plan, plan
from blurnoise.scene.scene import Exposure
from blurnoise_eval.datasets import Picture
from blurnoise_eval.explorer.binning import binned
from blurnoise_eval.explorer.controls import Control
from blurnoise_eval.explorer.judging import Standard, Stop, finer
from blurnoise_eval.explorer.mtf50 import mtf50
from blurnoise_eval.explorer.runs import Run
from blurnoise_eval.explorer.state import State
from blurnoise_eval.grid.axes import AXES, EXPOSURE, VELOCITY
from blurnoise_eval.grid.conditions import Cell, Conditions
from blurnoise_eval.scoring.criterion import KEPT, Criterion
from blurnoise_eval.scoring.on_picture import Model, Sight, View, view
from blurnoise_eval.sweep.exposing import Frame, Scene, frames, snr_db

Picture8 = NDArray[np.uint8]
PREVIEW_PX = 120_000
"""A picture of more pixels is seen smaller first, while a slider moves."""
GREY = 0.18
BINS = 64
OWN = Criterion(KEPT, kept=True)
"""What is enough of a picture that is of no run."""
_MORE = 18  # exposures at most, beyond those of a strip


class Subject:
    """A picture as light, what models say of it as it is, and its smaller twins. Any number of threads may look.

    run: of which it is, and as which it is taken. Raises :class:`~blurnoise_eval.datasets.UnreadablePicture` where it
    cannot be loaded.
    """

    def __init__(self, picture: Picture, run: Run | None = None) -> None:
        self.picture, self._run = picture, run
        self.scene = run.scene(picture) if run else Scene(picture.load(), picture=picture)
        self.clean = self.scene.image8
        self._views: dict[tuple[str, str], View] = {}
        self._twins: dict[int, Scene] = {}
        self._lock = threading.Lock()

    @property
    def size(self) -> tuple[int, int]:
        """(H, W)."""
        return self.clean.shape[0], self.clean.shape[1]

    @property
    def smaller(self) -> int:
        """How many times smaller it is seen first; 1 where it is small enough."""
        return math.ceil(math.sqrt(self.size[0] * self.size[1] / PREVIEW_PX))

    def frame(self, state: State, camera: Camera) -> Frame:
        """The picture of a state: the cell that a sweep would compute for it. Raises ``ValueError``."""
        cell = Cell("seen", 0, state.at, state.seed)
        if self._run:
            return self._run.expose(self.scene, cell, camera)
        (frame,) = frames(self.scene, [cell], camera)
        return frame

    def view(self, model: Model) -> View:
        """The model before the picture, which it is shown as it is, once."""
        name = (model.name, model.sha256)
        with self._lock:
            if name not in self._views:
                while len(self._views) >= 3:
                    del self._views[next(iter(self._views))]
                self._views[name] = view(model, self.picture, self.clean)
            return self._views[name]

    def twin(self, n: int) -> Scene:
        """The picture with its light averaged over n x n px."""
        with self._lock:
            if n not in self._twins:
                light = avg_pool2d(self.scene.light.light, n, ceil_mode=True, count_include_pad=False)
                coded = srgb_from_linear(light)[0].clamp(0, 1).mul(65535).round().permute(1, 2, 0)
                self._twins[n] = Scene(coded.contiguous().numpy().astype(np.uint16))
            return self._twins[n]


@dataclass(frozen=True)
class Number:
    """A figure of what is seen: how it is called, its text with the unit, and a word on it."""

    name: str
    title: str
    value: float | None
    text: str
    about: str = ""


@dataclass(frozen=True)
class Seen:
    """A state, looked at. sight, clean: what the model finds in it and in the original picture, with the targets
    that count by ``standard``; None without a model.
    histogram: (3, BINS) shares of the values of red, green and blue; clipped: shares of values at 0 and at the top.
    classes: names of what the model finds."""

    state: State
    frame: Frame
    camera: Camera
    numbers: tuple[Number, ...]
    plan: Plan
    sight: Sight | None = None
    clean: Sight | None = None
    standard: Standard | None = None
    histogram: NDArray[np.float64] | None = None
    clipped: tuple[float, float] = (0.0, 0.0)

    classes: tuple[str, ...] = ()

    @property
    def image(self) -> Picture8:
        """The picture."""
        return self.frame.image

    @property
    def confidence(self) -> float | None:
        """Mean over the targets; None without any."""
        return confidence(self.sight)


def seen(
    state: State,
    subject: Subject,
    camera: Camera,
    model: Model | None = None,
    frame: Frame | None = None,
    criterion: Criterion = OWN,
) -> Seen:
    """Look at a picture through ``camera``, which is that of the state with the state's figures. frame: the
    picture, where it is there already. criterion: what is enough.

    Raises ``ValueError`` for what does not go together.
    """
    frame = frame or subject.frame(state, camera)
    before = subject.view(model) if model else None
    sight, clean, standard = None, None, None
    if before is not None:
        standard = Standard.of(criterion, before.clean)
        clean = standard.sight(before.clean)
        sight = standard.sight(before.look(frame.image, frame.move_boxes, frame.sweep_boxes))
    taken = _taken(frame)
    shares, clipped = histogram(frame.image)
    return Seen(
        state,
        frame,
        camera,
        numbers(frame, subject.size),
        plan_of(taken, subject.size),
        sight,
        clean,
        standard,
        shares,
        clipped,
        tuple(getattr(model.contract, "classes", ())) if model else (),
    )


def preview(state: State, subject: Subject, camera: Camera) -> Picture8:
    """The picture ``subject.smaller`` times smaller, its blur and noise those of the full size, averaged; the
    noise is another draw. Raises ``ValueError`` where parts move apart, or beyond a binned camera's limits."""
    n, at = subject.smaller, state.at
    with_lens = at.exposure(camera).camera
    of_lens = {each.name: None for each in AXES if each.into.startswith("camera.")}
    slower = {name: (at[name] or 0.0) / n for name in VELOCITY}
    cell = Cell("preview", 0, Conditions(**{**at, **of_lens, **slower}), state.seed)
    (frame,) = frames(subject.twin(n), [cell], binned(with_lens, n))
    return frame.image


def strip(
    state: State,
    subject: Subject,
    camera: Camera,
    model: Model,
    along: Control,
    criterion: Criterion,
    count: int = 15,
) -> Iterator[Stop]:
    """Scores of the targets along a control, from end to end, then, of the exposure, more where the model keeps most.
    camera: without the state's figures."""
    before = subject.view(model)
    standard = Standard.of(criterion, before.clean)

    def stop(value: float) -> Stop:
        at = along.put(state, value)
        try:
            frame = subject.frame(at, at.camera_of(camera))
        except ValueError:  # beyond what goes together
            return Stop(value)
        sight = before.look(frame.image, frame.move_boxes, frame.sweep_boxes)
        return Stop(value, standard.scores(sight), frame.saturated or 0.0)

    curve: list[Stop] = []
    for value in along.stops(count):
        curve.append(stop(value))
        yield curve[-1]
    for _ in range(_MORE if along.name == EXPOSURE.name else 0):
        further = finer(curve, standard)
        if further is None:
            return
        point = stop(further)
        insort(curve, point)
        yield point


def confidence(sight: Sight | None) -> float | None:
    """Mean over the targets; None without a model or a target."""
    rows = sight.targets if sight else ()
    return sum(float(row["confidence"]) for row in rows) / len(rows) if rows else None


def found(sight: Sight, found_from: float) -> tuple[int, int]:
    """How many targets are found, and of how many."""
    return sum(row["confidence"] >= found_from for row in sight.targets), len(sight.targets)


def _taken(frame: Frame) -> Exposure:
    if frame.exposure is None:
        raise ValueError("conditions: must be stated; this is the untouched picture")
    return frame.exposure


def plan_of(exposure: Exposure, size: tuple[int, int]) -> Plan:
    """What the frame of an exposure kept and left out, within what that frame's gain leaves of the tolerance."""
    camera, digital_db = exposure.amplified
    moved, varies = _motion_px(exposure, size)
    gain = max(1.0, 10 ** (digital_db / 20)) * magnification(camera)
    return plan(
        camera,
        exposure_s=exposure.exposure_s,
        illuminance_lux=exposure.illuminance_lux,
        displacement_px=moved,
        variation_px=varies,
        trajectory=exposure.trajectory,
        temperature_c=exposure.temperature_c,
        tolerance_dn=TOLERANCE_DN / gain,
        size=size,
    )


def _motion_px(exposure: Exposure, size: tuple[int, int]) -> tuple[tuple[float, float], float]:
    """Motion during the exposure, and by how much that of some pixels is another."""
    if exposure.drives:
        flow = exposure.vehicle.flow_px_s(exposure.camera, size, exposure.ego_speed_m_s)
        middle, varies = middle_of(flow[None] * exposure.exposure_s)
        return (float(middle[0, 0]), float(middle[0, 1])), float(varies)
    x, y = exposure.velocity_px_s
    return (x * exposure.exposure_s, y * exposure.exposure_s), 0.0


def numbers(frame: Frame, size: tuple[int, int]) -> tuple[Number, ...]:
    """What engineers ask of a frame first."""
    exposure = _taken(frame)
    camera, digital_db = exposure.amplified
    white_e = photoelectrons(camera, exposure.illuminance_lux, exposure.exposure_s)
    grey_db = snr_db(exposure, GREY)
    moved, varies = _motion_px(exposure, size)
    blur_px = math.hypot(*moved)
    angle_deg = math.degrees(math.atan2(moved[1], moved[0])) if blur_px else 0.0
    along, across = (mtf50(camera.optics, moved, angle) for angle in (angle_deg, angle_deg + 90))
    sharp = [f"{f:.3f}" if math.isfinite(f) else "> 0.5" for f in (along, across)]
    share = white_e / camera.saturation_e
    clipped = frame.saturated or 0.0
    gain_db = exposure.gain_db
    return (
        Number(
            "white_electrons",
            "White",
            white_e,
            f"{_thousands(white_e)} e-",
            f"{_percent(share)} of {_thousands(camera.saturation_e)} e-",
        ),
        Number(
            "snr_db",
            "SNR at 18 % grey",
            grey_db,
            "none" if grey_db is None else f"{grey_db:.1f} dB",
            "no light" if grey_db is None else f"{10 ** (grey_db / 20):.3g} : 1",
        ),
        Number(
            "blur_px",
            "Motion blur",
            blur_px,
            f"{blur_px:.1f} px",
            f"up to {varies:.1f} px otherwise at places"
            if varies
            else f"in {1e3 * exposure.exposure_s:.4g} ms",
        ),
        Number(
            "mtf50",
            "MTF50 of the chain",
            along if math.isfinite(along) else None,
            f"{sharp[0]} c/px",
            f"{sharp[1]} across" if blur_px else "lens alone",
        ),
        Number("clipped", "Clipped", clipped, _percent(clipped), "of all values"),
        Number(
            "gain_db",
            "Gain",
            gain_db,
            f"{gain_db:.1f} dB",
            f"{digital_db:.1f} dB of it digital" if abs(digital_db) > 0.05 else "analogue" if gain_db else "",
        ),
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
