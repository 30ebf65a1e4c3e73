"""Pictures that are explored: exposed as in a sweep, smaller while a slider moves, and evaluated by a detector.

All physics is the simulator's and all scoring the harness's: a picture has the bits of the sweep's cell with the same
conditions and seed. Domain: pictures (H, W, 3) uint8 RGB.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch.nn.functional import avg_pool2d

from blurnoise.camera import Camera
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.camera.radiometry import photoelectrons
from blurnoise.light.resolved import middle_of
from blurnoise.scene.exposure import Exposure
from blurnoise_eval.answers.criterion import CONFIDENCE, KEPT, Criterion
from blurnoise_eval.datasets import Picture
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.explorer.state import State, controls
from blurnoise_eval.explorer.verdict import Point, Standard, mean_confidence
from blurnoise_eval.plan.axes import EGO, EXPOSURE, HEADLAMP, MOVES, VELOCITY
from blurnoise_eval.plan.conditions import Cell, Conditions, cell_seed
from blurnoise_eval.plan.plan import usual_plan
from blurnoise_eval.plots.annotate import MOST_BOXES, OTHER_SCORE
from blurnoise_eval.run.exposing import Frame, PictureScene, frames, snr_db
from blurnoise_eval.run.run import Run
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import FOUND_SCORE, MATCH_IOU
from blurnoise_eval.scoring.on_picture import ModelOnPicture, ModelOutput

PREVIEW_PX = 120_000
"""A picture of more pixels is shown smaller while a slider moves."""
CURVE_EVERY = 8
"""A curve has a point at every eighth position of the slider."""
_USUAL = Criterion(KEPT, kept=True)
"""The criterion without a run, and of a run that is not judged by confidences."""
_GREY = 0.18


class Subject:
    """A picture as light, and the detections in the original. Any number of threads may use it.

    run: the run that the picture is of, with whose settings it is exposed. grey_anchor: of a photograph. Raises
    :class:`~blurnoise_eval.datasets.UnreadablePicture` where it cannot be loaded.
    """

    def __init__(self, picture: Picture, run: Run | None = None, grey_anchor: str | None = None) -> None:
        self._name, self._of_run = picture.name, run is not None
        criterion = run.criterion if run else _USUAL
        self._criterion = criterion if criterion.score == CONFIDENCE else _USUAL
        plan = replace(usual_plan(), grey_anchor=grey_anchor)
        self.scene = run.scene(picture) if run else PictureScene(picture.load(), plan, picture)
        self.original = self.scene.image8
        self.size = self.original.shape[0], self.original.shape[1]
        self.smaller = math.ceil(math.sqrt(self.size[0] * self.size[1] / PREVIEW_PX))
        """How many times smaller a preview is; 1 of a picture that needs none."""
        self._view = cache(lambda model: ModelOnPicture(model, picture, self.original))

    def frame(self, state: State, camera: Camera) -> Frame:
        """The picture of a state: the cell that a sweep would compute for it. Raises ``ValueError``."""
        seed = state.seed
        if seed is None:
            seed = cell_seed(self.scene.plan.seed, self._name, state.repeat) if self._of_run else 0
        return next(frames(self.scene, [Cell(self._name, state.repeat, state.at, seed)], camera))

    @cached_property
    def small(self) -> PictureScene:
        """The picture with its light averaged over ``smaller`` x ``smaller`` px."""
        light = avg_pool2d(self.scene.light.light, self.smaller, ceil_mode=True, count_include_pad=False)
        # 16 bits: with 8, the steps of dark tones would be visible beneath little noise.
        coded = srgb_from_linear(light)[0].clamp(0, 1).mul(65535).round().permute(1, 2, 0)
        return PictureScene(coded.contiguous().numpy().astype(np.uint16))

    def preview(self, state: State, camera: Camera) -> NDArray[np.uint8]:
        """The picture ``smaller`` times smaller, with its motion and defocus; each pixel has the noise of a
        full one. Raises ``ValueError`` where parts of the picture move apart."""
        n, at = self.smaller, state.at
        if any(at[axis.name] for axis in (EGO, MOVES, HEADLAMP)) or self.scene.plan.lamps is not None:
            raise ValueError("preview: needs one motion of the whole picture, and no lamps")
        slower = {name: (at[name] or 0.0) / n for name in VELOCITY}
        defocus_px = at.exposure(camera).camera.lens.defocus_radius_px / n
        shrunk = Conditions(**{**at, **slower, "defocus_radius_px": defocus_px})
        # n times fewer rows are read in the time of all, so that a rolling shutter bends the picture as much
        slow_rows = camera.with_figures(row_time_s=n * camera.sensor.row_time_s)
        return next(frames(self.small, [Cell("preview", 0, shrunk, state.seed or 0)], slow_rows)).image

    def rendered(self, frame: Frame, model: Detector | None) -> Rendered:
        """A frame with the detections in it."""
        if model is None:
            return Rendered(frame)
        view = self._view(model)
        standard = Standard.of(self._criterion, view.clean)
        output = view.evaluate(frame.image, frame.move_boxes, frame.sweep_boxes)
        return Rendered(frame, PictureScore(output, view.clean, standard, model.contract.classes))

    def curve(self, state: State, camera: Camera, model: Detector) -> Iterator[Point]:
        """Mean confidences along the exposure, from end to end of its slider."""
        values = controls(camera)[EXPOSURE.name].values
        for value in values[::CURVE_EVERY]:
            with suppress(ValueError):  # more motion than is allowed
                frame = self.frame(state.put(EXPOSURE.name, value), camera)
                rendered = self.rendered(frame, model)
                if rendered.scored and rendered.scored.counted.targets:
                    saturated = rendered.frame.saturated or 0.0
                    yield Point(EXPOSURE.shown(value), mean_confidence(rendered.scored.counted), saturated)


@dataclass(frozen=True)
class PictureScore:
    """The detections in a picture and in its original, with the standard of the picture and the names of classes."""

    output: ModelOutput
    clean: ModelOutput
    standard: Standard
    classes: tuple[str, ...]

    @property
    def counted(self) -> ModelOutput:
        """The output with the targets that count."""
        return self.standard.of_counted(self.output)

    @property
    def boxes(self) -> list[dict[str, Any]]:
        """The boxes to draw over the picture, see :meth:`_drawn`."""
        return self._drawn(self.counted)

    @property
    def original_boxes(self) -> list[dict[str, Any]]:
        """The boxes to draw over the original picture."""
        return self._drawn(self.standard.of_counted(self.clean))

    def _drawn(self, output: ModelOutput) -> list[dict[str, Any]]:
        """Boxes (left, top, right, bottom), px, with kind and text: targets "found" and "missed" with their
        confidence, and "other" detections."""
        targets = sorted(output.targets, key=lambda row: -row.width_px * row.height_px)[:MOST_BOXES]
        boxes_xyxy = [row.box_xyxy for row in targets]
        detections = output.detections.leading
        drawn = []
        for box, score, class_id in zip(
            detections.boxes_xyxy.tolist(),
            detections.scores.tolist(),
            detections.class_ids.tolist(),
            strict=True,
        ):
            if score >= OTHER_SCORE and not (iou([box], boxes_xyxy) >= MATCH_IOU).any():
                text = f"{self.classes[class_id][:24]} {score:.2f}"
                drawn.append({"box": box, "kind": "other", "text": text})
        del drawn[MOST_BOXES:]
        for row, box in zip(targets, boxes_xyxy, strict=True):
            kind = "found" if row.confidence >= FOUND_SCORE else "missed"
            drawn.append({"box": box, "kind": kind, "text": f"{row.confidence:.2f}"})
        return drawn


@dataclass(frozen=True)
class Rendered:
    """A picture, with its detections if there is a detector."""

    frame: Frame
    scored: PictureScore | None = None

    @property
    def exposure(self) -> Exposure:
        """How the picture was taken."""
        if self.frame.exposure is None:
            raise ValueError("conditions: must be specified; this is the original picture")
        return self.frame.exposure

    @property
    def verdict(self) -> tuple[bool, str]:
        """Whether the detector works on the picture, and a sentence on it."""
        return self.scored.standard.verdict(self.scored.counted) if self.scored else (True, "No model.")

    @property
    def numbers(self) -> dict[str, tuple[str, float | None, str]]:
        """Title, value and unit of the picture's figures, by the names that ``simulate`` prints.

        The blur of a camera that drives is the middle of the blurs over the picture.
        """
        exposure, camera = self.exposure, self.exposure.amplified.camera
        blur_px = math.hypot(*exposure.velocity_px_s) * exposure.exposure_s
        if exposure.drives:
            height, width = self.frame.image.shape[:2]
            flow = exposure.vehicle.flow_px_s(exposure.camera, (height, width), exposure.ego_speed_m_s)
            blur_px = float(middle_of(flow[None] * exposure.exposure_s)[0].norm())
        white_e = photoelectrons(camera, exposure.illuminance_lux, exposure.exposure_s, exposure.illuminant)
        return {
            "white_electrons": ("White", white_e, "e-"),
            "saturation_electrons": ("Saturation", camera.sensor.saturation_e, "e-"),
            "snr_db": ("SNR at 18 % grey", snr_db(exposure, _GREY), "dB"),
            "exposure_ms": ("Exposure", 1e3 * exposure.exposure_s, "ms"),
            "gain_db": ("Gain", exposure.gain_db, "dB"),
            "blur_px": ("Motion blur", blur_px, "px"),
            "clipped_percent": ("Saturated", 100 * (self.frame.saturated or 0.0), "%"),
        }
