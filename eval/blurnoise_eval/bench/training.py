"""Comparison of trainings: whether a detector trained with the exposure augmentation holds up better than without.

Networks that differ by their training alone, several seeds of each arm, see the same pictures under the same
conditions; what is compared is what they find. :mod:`blurnoise_eval.bench.compared` says how.

Units: exposure s, light lux, speed px/s, blur px.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from blurnoise.optics.camera import Camera
from blurnoise_eval.bench.compared import (
    FAILS,
    THRESHOLD,
    Array,
    Interval,
    Measure,
    Outcome,
    designs,
    failure,
    interval,
    measures,
    moving_px,
)
from blurnoise_eval.bench.timing import machine
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.grid.conditions import Cell, Conditions, SweepPlan
from blurnoise_eval.scoring.matching import (
    AveragePrecision,
    Ranking,
    average_precision,
    hits,
    target_confidence,
)
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep import run_folder as results
from blurnoise_eval.sweep.blocks import count_cells
from blurnoise_eval.sweep.engines import ThreadEngine

Progress = Callable[[int], None]
Boxes = Sequence[Sequence[tuple[float, float, float, float]]]

LABEL = "stop sign"
OURS = "exposure"
"""The arm on trial; the others are its rivals."""
CAMERA = Camera.preset("imx250")
_LIGHTS_LUX = (10.0, 50.0, 250.0)
SCENES = SweepPlan(
    {
        "exposure_s": (1e-3, 2e-3, 5e-3, 10e-3, 20e-3, 40e-3),
        "illuminance_lux": _LIGHTS_LUX,
        "velocity_x_px_s": (0.0, 150.0, 400.0, 800.0, 1500.0, 3000.0),
    },
    examples=False,
)
PHOTOGRAPHS = SweepPlan(
    {
        "exposure_s": (1e-3, 5e-3, 20e-3, 40e-3),
        "illuminance_lux": _LIGHTS_LUX,
        "velocity_x_px_s": (0.0, 400.0, 1500.0, 3000.0),
    },
    examples=False,
)
QUICK = SweepPlan(
    {"exposure_s": (2e-3, 20e-3), "illuminance_lux": (10.0, 50.0), "velocity_x_px_s": (0.0, 1500.0)},
    examples=False,
)


@dataclass(frozen=True)
class Model:
    """A trained network: the arm and the seed of its training, and its ONNX file."""

    arm: str
    seed: int
    path: Path

    @property
    def name(self) -> str:
        """Arm and seed."""
        return f"{self.arm}-{self.seed}"


@dataclass(frozen=True)
class Part:
    """Pictures with the targets labelled ``LABEL``, and the conditions under which they are seen."""

    name: str
    pictures: PictureSet
    plan: SweepPlan

    @property
    def conditions(self) -> list[Conditions | None]:
        """The clean picture first, as None."""
        return [None, *self.plan.conditions()]


@dataclass(frozen=True)
class Row:
    """What an arm's network of one seed found under one condition of a part; ``at`` None: clean."""

    part: str
    arm: str
    seed: int
    at: Conditions | None
    precision: AveragePrecision
    confidence: float
    false_positives: float

    def record(self) -> dict[str, Any]:
        """Flat, for a table."""
        at = self.at
        return {
            "set": self.part,
            "arm": self.arm,
            "seed": self.seed,
            "clean": at is None,
            "exposure_s": at and at.exposure_s,
            "illuminance_lux": at and at.illuminance_lux,
            "velocity_x_px_s": at and at["velocity_x_px_s"],
            "blur_px": at and at.blur_px,
            **self.precision._asdict(),
            "mean_confidence": self.confidence,
            "false_positives_per_picture": self.false_positives,
        }


@dataclass(frozen=True)
class Summary:
    """A measure of one arm, mean over its seeds."""

    part: str
    measure: str
    arm: str
    estimate: Interval


@dataclass(frozen=True)
class Difference:
    """A measure of the arm on trial less that of a rival, on the same pictures."""

    part: str
    measure: Measure
    rival: str
    estimate: Interval

    @property
    def outcome(self) -> Outcome:
        """What it means for the arm on trial."""
        return self.measure.outcome(self.estimate)


@dataclass(frozen=True)
class Failure:
    """The blur, px, at which an arm's curve (mean of its seeds) fails; None: not up to ``longest_px``."""

    part: str
    measure: str
    arm: str
    at_px: float | None
    returned: bool
    longest_px: float


@dataclass(frozen=True)
class Bench:
    """What was found. sets: what the parts are; models: the networks and how they were trained."""

    rows: list[Row]
    summaries: list[Summary]
    differences: list[Difference]
    failures: list[Failure]
    sets: dict[str, dict[str, Any]]
    models: list[dict[str, Any]]
    machine: dict[str, Any]

    @property
    def arms(self) -> list[str]:
        """The arms, in the order given."""
        return list(dict.fromkeys(row.arm for row in self.rows))

    @property
    def seeds(self) -> int:
        """Networks of each arm."""
        return len({row.seed for row in self.rows})

    def summary(self, part: str, measure: str, arm: str) -> Interval:
        """The estimate of these."""
        wanted = (part, measure, arm)
        return next(s.estimate for s in self.summaries if (s.part, s.measure, s.arm) == wanted)

    def failure(self, part: str, measure: str, arm: str) -> Failure | None:
        """Where these fail; None for a measure that is no failure point."""
        wanted = (part, measure, arm)
        return next((f for f in self.failures if (f.part, f.measure, f.arm) == wanted), None)

    def verdicts(self) -> list[str]:
        """A sentence for each set of pictures and rival: where ours is better, where worse, where neither."""
        pairs = dict.fromkeys((found.part, found.rival) for found in self.differences)
        return [self._verdict(part, rival) for part, rival in pairs]

    def _verdict(self, part: str, rival: str) -> str:
        asked = [d for d in self.differences if (d.part, d.rival) == (part, rival) and d.measure.verdict]
        clauses = []
        for outcome, words in (
            ("better", f"is better than {rival} in"),
            ("worse", f"is worse than {rival} in"),
            ("undecided", f"does not differ from {rival} by more than chance in"),
        ):
            if told := [_told(difference) for difference in asked if difference.outcome == outcome]:
                clauses.append(f"{words} {_listed(told)}")
        facts = self.sets[part]
        return (
            f"On {part} ({facts['pictures']} pictures, {facts['targets']} signs) training with {OURS} "
            f"{'; it '.join(clauses)}."
        )

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "verdicts": self.verdicts(),
            "machine": self.machine,
            "camera": CAMERA.to_dict(),
            "sets": self.sets,
            "models": self.models,
            "threshold": THRESHOLD,
            "summaries": [
                {"set": s.part, "measure": s.measure, "arm": s.arm, **s.estimate._asdict()}
                for s in self.summaries
            ],
            "differences": [
                {
                    "set": d.part, "measure": d.measure.name, "of": f"{OURS} - {d.rival}",
                    **d.estimate._asdict(), "outcome": d.outcome,
                }
                for d in self.differences
            ],
            "failures": [asdict(failure) for failure in self.failures],
            "rows": [row.record() for row in self.rows],
        }  # fmt: skip


def steps(models: Sequence[Model], parts: Iterable[Part]) -> int:
    """How many steps ``progress`` is told of: cells, then conditions of each model to be judged."""
    return sum(count_cells(part.pictures, part.plan) + len(models) * len(part.conditions) for part in parts)


def measure(
    models: Sequence[Model],
    parts: Sequence[Part],
    folder: Path,
    *,
    threads: int = 1,
    progress: Progress = lambda done: None,
) -> Bench:
    """Run all models over every part, each cell simulated once, in ``folder``/runs/PART, and compare.

    What was stopped goes on. Raises ``ValueError`` for arms with unequal seeds, a model that does not know
    ``LABEL``, and a part in which no picture that can be read has a target;
    :class:`blurnoise_eval.store.store.StoreError` where ``folder`` holds runs of other models, pictures or
    conditions.
    """
    seeds: dict[str, list[int]] = {}
    for model in models:
        seeds.setdefault(model.arm, []).append(model.seed)
    if not models or len({tuple(sorted(of_arm)) for of_arm in seeds.values()}) > 1:
        raise ValueError(f"models = {seeds}: must have the same seeds in each arm")
    detectors = {model: Detector(model.path) for model in models}
    for model, detector in detectors.items():
        if LABEL not in detector.contract.classes:
            raise ValueError(f"models = {str(model.path)!r}: does not know {LABEL!r}")
    about = [_about(model, detector) for model, detector in detectors.items()]
    bench = Bench([], [], [], [], {}, about, machine(threads))
    for part in parts:
        run = folder / "runs" / part.name
        unread = _run(list(detectors.values()), part, run, threads, progress)
        _judge(bench, part, unread, detectors, run, progress)
    return bench


def write(bench: Bench, folder: Path) -> None:
    """Write training.csv, a row per set, arm, seed and condition, and training.json; raises ``OSError``."""
    write_bench("training", [row.record() for row in bench.rows], bench.document(), folder)


def _about(model: Model, detector: Detector) -> dict[str, Any]:
    training = detector.session.get_modelmeta().custom_metadata_map.get("blurnoise.training")
    facts = {"arm": model.arm, "seed": model.seed, "file": model.path.name, "sha256": detector.sha256}
    return {**facts, "training": json.loads(training) if training else None}


def _run(
    detectors: Sequence[Detector], part: Part, folder: Path, threads: int, progress: Progress
) -> set[str]:
    """Sweep, or go on sweeping; returns the names of the pictures that cannot be read."""
    with Store(folder, create=True) as store:
        results.open_run(store, detectors, CAMERA, part.pictures, part.plan, {"threads": threads})
        engine = ThreadEngine(threads)
        sweep.run(detectors, CAMERA, part.pictures, part.plan, store, engine=engine, progress=progress)
        return {entry["image"] for entry in store.skipped()}


def _judge(
    bench: Bench,
    part: Part,
    unread: set[str],
    detectors: dict[Model, Detector],
    run: Path,
    progress: Progress,
) -> None:
    """Add to ``bench`` what the models made of a part."""
    pictures = [picture for picture in part.pictures if picture.name not in unread]
    boxes = _boxes(pictures)
    if not any(boxes):
        raise ValueError(f"{part.name} = {part.pictures.source!r}: no picture that can be read has a {LABEL}")
    bench.sets[part.name] = {
        "source": part.pictures.source,
        "pictures": len(boxes),
        "targets": sum(map(len, boxes)),
        "unread": sorted(unread),
        "plan": part.plan.to_dict(),
    }
    arms = list(dict.fromkeys(model.arm for model in detectors))
    seeds = len(detectors) // len(arms)
    of_pictures, of_seeds = designs(len(boxes), len(arms), seeds)
    scores: dict[str, Array] = {}
    turns = dict.fromkeys(arms, 0)
    with Store(run) as store:
        for model, detector in detectors.items():
            place, turn = arms.index(model.arm), turns[model.arm]
            turns[model.arm] += 1
            class_id = detector.contract.classes.index(LABEL)
            for index, at in enumerate(part.conditions):
                cells = [Cell(each.name, 0, at, 0).cell_id for each in pictures]
                found = [store.detections(cell, detector.name) for cell in cells]
                drawn = _scores(found, boxes, class_id, of_pictures)
                for score, values in drawn.items():
                    into = scores.setdefault(
                        score, np.zeros((len(of_pictures), len(arms), len(part.conditions)))
                    )
                    into[:, place, index] += of_seeds[:, place, turn] * values
                precision = average_precision(found, boxes, class_id)
                mean, false = float(drawn["confidence"][0]), float(drawn["false_positives"][0])
                bench.rows.append(Row(part.name, model.arm, model.seed, at, precision, mean, false))
                progress(1)
    _compare(bench, part, arms, scores, seeds)


def _compare(bench: Bench, part: Part, arms: list[str], scores: dict[str, Array], seeds: int) -> None:
    """Add the measures of the arms, their differences and failures."""
    for asked in measures(part.conditions):
        values = dict(zip(arms, np.moveaxis(asked.of(scores), 1, 0), strict=True))
        bench.summaries.extend(
            Summary(part.name, asked.name, arm, interval(values[arm], seeds)) for arm in arms
        )
        bench.differences.extend(
            Difference(part.name, asked, rival, interval(values[OURS], seeds, values[rival]))
            for rival in arms
            if OURS in arms and rival != OURS
        )
    moving = moving_px(part.conditions)
    for score, name in FAILS.items():
        for place, arm in enumerate(arms):
            point = failure(scores[score][0, place], moving)
            bench.failures.append(Failure(part.name, name, arm, *point, max(moving.values())))


def _boxes(pictures: Iterable[Picture]) -> Boxes:
    return [
        [t.box_xyxy for t in picture.targets or () if t.label == LABEL and not t.crowd]
        for picture in pictures
    ]


def _scores(found: Sequence[Detections], boxes: Boxes, class_id: int, weights: Array) -> dict[str, Array]:
    """Scores (designs,) of one network under one condition, for pictures weighted (designs, pictures)."""
    confidence, false, signs = np.zeros((3, len(boxes)))
    for index, (each, of_picture) in enumerate(zip(found, boxes, strict=True)):
        sure = each.scores[each.class_ids == class_id] >= THRESHOLD
        signs[index] = len(of_picture)
        confidence[index] = sum(target_confidence(each, box, class_id) for box in of_picture)
        false[index] = np.sum(sure & ~hits(each, of_picture, class_id))
    every = weights @ signs
    return {
        "ap50": Ranking.of(found, boxes, class_id).ap50(weights),
        "confidence": np.divide(
            weights @ confidence, every, out=np.full_like(every, np.nan), where=every > 0
        ),
        "false_positives": weights @ false / weights.sum(axis=1),
    }


def _told(difference: Difference) -> str:
    words, (value, low, high) = str(difference.measure.verdict), difference.estimate
    if difference.outcome == "undecided" or value is None:
        return words
    return f"{words} ({value:+.2f}, {low:+.2f} to {high:+.2f})"


def _listed(parts: Sequence[str]) -> str:
    return f"{', '.join(parts[:-1])} and {parts[-1]}" if len(parts) > 1 else parts[0]
