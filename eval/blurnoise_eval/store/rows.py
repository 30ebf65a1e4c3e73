"""Rows of a run's file, and of scores: what was found in a picture, in a target, and under a condition.

Domain: SI units and the units in the names; px of the simulated picture; shares and confidences from 0 to 1.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from blurnoise_eval.store.columns import (
    ANY_TEXT,
    BIG,
    COUNT,
    HASH,
    ID,
    MEASURED,
    NAME,
    PX,
    SHARE,
    AxisValues,
    Row,
    WithInterval,
    number,
)


@dataclass(frozen=True, slots=True)
class CellKey(Row):
    """What rows of one cell and model share."""

    cell_id: Annotated[str, ID, "hash of picture, repeat, conditions and seed"]
    model: Annotated[str, NAME, "the model"]
    camera: Annotated[str, NAME, "the camera"]
    image: Annotated[str, NAME, "the picture"]
    repeat: Annotated[int, COUNT, "number of the noise field, from 0"]
    conditions: AxisValues
    blur_px: Annotated[float | None, number(0.0, 1e12), "length of the motion during the exposure"]


@dataclass(frozen=True, slots=True)
class OfLamp(Row):
    """Further columns of cells in a run with a pulsed lamp.

    >>> OfLamp(pwm_phase=0.25, missed_pulse=1).stored()
    {'pwm_phase': 0.25, 'missed_pulse': 1}
    """

    pwm_phase: Annotated[float | None, SHARE, "phase of the lamp at the start of the exposure"] = None
    missed_pulse: Annotated[int | None, number(0, 1, "integer"), "1: the exposure fell between pulses"] = None


@dataclass(frozen=True, slots=True)
class CellRow(CellKey):
    """A model's answer to one picture under one condition."""

    seed: Annotated[int, BIG, "seed of the noise"]
    n_targets: Annotated[int, COUNT, "targets in the picture that the model knows"]
    target_confidence: Annotated[float | None, SHARE, "mean confidence in the targets"] = None
    detection_rate: Annotated[float | None, SHARE, "share of targets with a confidence of 0.25 or more"] = (
        None
    )
    n_detections: Annotated[int, COUNT, "detections of any score"] = 0
    saturated_share: Annotated[float | None, SHARE, "share of values at a limit of the sensor"] = None
    applied_exposure_s: Annotated[
        float | None, number(1e-12, 3600.0), "exposure, also if the camera set it"
    ] = None
    applied_gain_db: Annotated[float | None, MEASURED, "gain, also if the camera set it"] = None
    snr_db: Annotated[float | None, MEASURED, "signal to noise of the mean light"] = None
    brightness: Annotated[float | None, SHARE, "mean brightness of the picture"] = None
    inpainted_share: Annotated[
        float | None, SHARE, "mean share of the targets' background that was inpainted"
    ] = None
    simulate_ms: Annotated[float | None, MEASURED, "time of the simulation"] = None
    infer_ms: Annotated[float | None, MEASURED, "time of the inference"] = None
    error: Annotated[str | None, ANY_TEXT, "why the model failed"] = None
    example: Annotated[str | None, NAME, "file of the picture in the run's folder, if it is kept"] = None
    computed_by: Annotated[str | None, HASH, "key of the software, see summary.json"] = None
    lamp: OfLamp | None = None


@dataclass(frozen=True, slots=True)
class TargetAnswer(Row):
    """A model's answer for one target. The box is where the target is at mid-exposure.

    >>> answer = TargetAnswer(0, "sign 50 px", "sign", 10.0, 20.0, 60.0, 70.0, 50.0, 50.0, confidence=0.8)
    >>> answer.box_xyxy, answer.columns()["confidence"]
    ((10.0, 20.0, 60.0, 70.0), 0.8)
    """

    target_id: Annotated[int, COUNT, "number of the target in its picture"]
    group: Annotated[str, NAME, "kind of target that answers are given for"]
    label: Annotated[str, ANY_TEXT, "class"]
    x0: Annotated[float, PX, "left edge"]
    y0: Annotated[float, PX, "top edge"]
    x1: Annotated[float, PX, "right edge"]
    y1: Annotated[float, PX, "bottom edge"]
    width_px: Annotated[float, PX, "width"]
    height_px: Annotated[float, PX, "height"]
    confidence: Annotated[float, SHARE, "confidence in the target; of text that is read wrong 0"]
    confidence_swept: Annotated[float | None, SHARE, "as confidence, with the box that the motion sweeps"] = (
        None
    )
    inpainted_share: Annotated[float | None, SHARE, "share of the background that was inpainted"] = None
    truth: Annotated[str | None, ANY_TEXT, "text on the target"] = None
    text: Annotated[str | None, ANY_TEXT, "text that was read"] = None
    read_confidence: Annotated[float | None, SHARE, "confidence in that text"] = None
    character_error_rate: Annotated[float | None, number(0.0, 1e6), "edits per character of the truth"] = None

    @property
    def box_xyxy(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom, px."""
        return self.x0, self.y0, self.x1, self.y1


@dataclass(frozen=True, slots=True)
class TargetRow(CellKey):
    """A target of a cell, and the model's answer for it."""

    target: TargetAnswer


class LabelledBox(NamedTuple):
    """A detection: its box, left, top, right, bottom in px, its score, and the name of its class."""

    box_xyxy: tuple[float, float, float, float]
    score: float
    label: str


@dataclass(frozen=True, slots=True)
class Example:
    """A picture that was kept at ``path``, with a model's answer: what it detected, and what of the targets."""

    cell: CellRow
    path: Path
    detections: tuple[LabelledBox, ...]
    targets: tuple[TargetAnswer, ...]


@dataclass(frozen=True, slots=True)
class SkippedRow(Row):
    """A picture that could not be used.

    >>> SkippedRow("a.png", "is no picture").stored()
    {'image': 'a.png', 'reason': 'is no picture'}
    """

    image: Annotated[str, NAME, "the picture"]
    reason: Annotated[str, ANY_TEXT, "why"]


MEANS = ("applied_gain_db", "snr_db", "brightness", "saturated_share", "inpainted_share")
"""Columns of cells of which scores have the mean over pictures; None of original ones."""


@dataclass(frozen=True, slots=True)
class OfLamps(Row):
    """A further column of scores in a run with a pulsed lamp."""

    missed_pulse_share: Annotated[float | None, "share of the pictures that miss the pulsed lamp"] = None


@dataclass(frozen=True, slots=True)
class ScoreRow(Row):
    """The scores of a model under one condition, and means over its pictures."""

    model: Annotated[str, "the model"]
    conditions: AxisValues
    blur_px: Annotated[float | None, "length of the motion during the exposure"]
    n_pictures: Annotated[int, "pictures, times noise fields"]
    n_targets: Annotated[int | None, "targets, times noise fields"]
    errors: Annotated[int, "pictures on which the model failed"]
    applied_gain_db: Annotated[float | None, "mean gain"] = None
    snr_db: Annotated[float | None, "mean signal to noise"] = None
    brightness: Annotated[float | None, "mean brightness"] = None
    saturated_share: Annotated[float | None, "mean share of values at a limit of the sensor"] = None
    inpainted_share: Annotated[float | None, "mean share of the targets' background that was inpainted"] = (
        None
    )
    lamps: OfLamps | None = None
    scores: Mapping[str, WithInterval] = field(default_factory=dict)

    @classmethod
    def of_columns(cls, values: Mapping[str, Any], scores: Iterable[str]) -> ScoreRow:
        """The row of these values by column, with the columns of these scores."""
        about = {
            name: values[name] for name in ("model", "blur_px", "n_pictures", "n_targets", "errors", *MEANS)
        }
        lamps = [OfLamps(values[name]) for name in ("missed_pulse_share",) if name in values]
        estimates = {
            name: WithInterval(*(values[f"{name}{end}"] for end in ("", "_low", "_high"))) for name in scores
        }
        return cls(conditions=AxisValues.of(values), lamps=next(iter(lamps), None), scores=estimates, **about)
