"""Bench of motion blur: every way to blur, time beside error, on the same pictures, taken in turns.

Units: times in ms per megapixel (1e6 values), errors in 8-bit digital numbers (DN; 255 is white), MTF50 as a
relative error, lengths in px, angles in degrees from x (right) towards y (down).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from blurnoise_eval.bench import truth
from blurnoise_eval.bench.contenders import BASELINE, Contender, albumentations_state, contenders
from blurnoise_eval.bench.timing import Quartiles, in_turns_ms, machine, quartiles
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.system.threads import limited_threads

Progress = Callable[[float], object]
NO_BLUR, EXACT = "no blur", "exact response"
"""No contenders: the sharp picture itself, and ``truth.moved`` on its pixels, which leaves their aliasing."""
_WHITE_DN = 255.0


@dataclass(frozen=True)
class Extent:
    """How much is measured.

    shape: (B, C, H, W) of the timed pictures, which take the angles in turn. A call is repeated from
    ``fewest`` to ``most`` times, as often as fits into ``seconds``. scene_px: side of the judged pictures.
    """

    timed_px: tuple[float, ...] = (1.5, 6, 15, 25, 31, 60, 101, 400)
    judged_px: tuple[float, ...] = (1.5, 3, 6, 10.4, 25, 60)
    angles_deg: tuple[float, ...] = (0, 17, 45, 73)
    scenes: tuple[str, ...] = tuple(truth.SCENES)
    shape: tuple[int, int, int, int] = (4, 1, 720, 1280)
    scene_px: int = 256
    fewest: int = 3
    most: int = 16
    seconds: float = 1.5

    @property
    def lengths_px(self) -> list[float]:
        """Every length, timed or judged."""
        return sorted({*self.timed_px, *self.judged_px})

    @property
    def plane_px(self) -> int:
        """Side of a judged picture with all that its blurs reach."""
        return truth.plane_side(self.scene_px, max(self.judged_px))


FULL = Extent()
QUICK = Extent((1.5, 6, 25), (1.5, 6, 25), (0, 17), ("Siemens star", "text"), most=8, seconds=0.3)


@dataclass(frozen=True)
class Row:
    """One measurement, with quartiles where it was repeated.

    kind: "time" (all angles in one batch), "error" (RMS, of one scene) or "mtf50", whose value is None where
    the response never halves.
    """

    kind: str
    method: str
    length_px: float
    angle_deg: float | None
    scene: str | None
    value: float | None
    unit: str
    quartiles: Quartiles | None = None

    def record(self) -> dict[str, Any]:
        """Flat, for a table."""
        flat = asdict(self)
        low, _, high = flat.pop("quartiles") or (None, None, None)
        return {**flat, "low_quartile": low, "high_quartile": high}


@dataclass(frozen=True)
class Bench:
    """What was measured, of whom, and on which machine."""

    rows: list[Row]
    extent: Extent
    methods: list[Contender]
    machine: dict[str, Any]

    def time(self, method: str, length_px: float) -> Quartiles | None:
        """Quartiles in ms per megapixel, or None where it was left out."""
        return next((row.quartiles for row in self._rows("time", method, length_px)), None)

    def median(self, method: str, length_px: float) -> float | None:
        """Time in ms per megapixel, or None where it was left out."""
        time = self.time(method, length_px)
        return None if time is None else time.median

    def ratio(self, method: str, length_px: float) -> float | None:
        """Time over Kornia's at this length; None where either was left out."""
        own, baseline = self.median(method, length_px), self.median(BASELINE, length_px)
        return own / baseline if own and baseline else None

    def error_dn(self, method: str, length_px: float) -> float | None:
        """RMS error over every scene and angle, or None where it was not judged."""
        values = [row.value for row in self._rows("error", method, length_px) if row.value is not None]
        return float(np.sqrt(np.mean(np.square(values)))) if values else None

    def mtf50_error(self, method: str, length_px: float) -> float | None:
        """The error farthest from 0 over the angles; None where it was not judged or never halves."""
        values = [row.value for row in self._rows("mtf50", method, length_px)]
        known = [value for value in values if value is not None]
        return max(known, key=abs) if known and len(known) == len(values) else None

    def losses(self) -> list[str]:
        """Where somebody else's method takes less time than ``auto``, or errs less, by 2 % or more."""
        found = []
        others = [method.name for method in self.methods if not method.ours]
        for length, other in product(self.extent.lengths_px, others):
            shares = [
                (theirs / own, what)
                for value, what in ((self.median, "time"), (self.error_dn, "error"))
                if (own := value("auto", length)) and (theirs := value(other, length))
            ]
            if any(share < 0.98 for share, _ in shares):
                told = ", ".join(f"{share:.2f} of auto's {what}" for share, what in shares)
                found.append(f"{length:g} px: {other} has {told}")
        return found

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON; "summary" holds a line per method and length."""
        names = [*(method.name for method in self.methods), NO_BLUR, EXACT]
        return {
            "machine": self.machine,
            "extent": asdict(self.extent),
            "methods": {method.name: method.about for method in self.methods},
            "albumentations": albumentations_state(),
            "summary": [
                {
                    "method": name,
                    "length_px": length,
                    "ms_per_megapixel": self.median(name, length),
                    "time_to_kornia": self.ratio(name, length),
                    "rms_error_dn": self.error_dn(name, length),
                    "worst_mtf50_error": self.mtf50_error(name, length),
                }
                for name, length in product(names, self.extent.lengths_px)
            ],
            "losses": self.losses(),
            "rows": [row.record() for row in self.rows],
        }

    def _rows(self, kind: str, method: str, length_px: float) -> Iterator[Row]:
        return (r for r in self.rows if (r.kind, r.method, r.length_px) == (kind, method, length_px))


def steps(extent: Extent) -> int:
    """What the shares told to ``progress`` add up to."""
    timed = sum(length <= method.longest_px for method in contenders() for length in extent.timed_px)
    return timed + (len(extent.scenes) + 1) * len(extent.judged_px)


def measure(extent: Extent = FULL, threads: int = 2, progress: Progress = lambda share: None) -> Bench:
    """Time, judge and halve: every method on the same pictures."""
    methods = contenders()
    facts = machine(threads)
    with limited_threads(threads):
        rows = [
            *_timed(methods, extent, progress),
            *_judged(methods, extent, progress),
            *_halved(methods, extent, progress),
        ]
    return Bench(rows, extent, methods, facts)


def write(bench: Bench, folder: Path) -> None:
    """Write blur.csv, a row per measurement, and blur.json with all else; raises ``OSError``."""
    write_bench("blur", [row.record() for row in bench.rows], bench.document(), folder)


def _timed(methods: Sequence[Contender], extent: Extent, progress: Progress) -> Iterator[Row]:
    image = torch.rand(extent.shape, generator=torch.Generator().manual_seed(0))
    angles = [extent.angles_deg[index % len(extent.angles_deg)] for index in range(len(image))]
    megapixels = image.numel() / 1e6
    for length in extent.timed_px:
        turns = in_turns_ms(
            {m.name: partial(m.blur, image, length, angles) for m in methods if length <= m.longest_px},
            fewest=extent.fewest, most=extent.most, seconds=extent.seconds, progress=progress,
        )  # fmt: skip
        for name, measured in turns.items():
            times_ms = quartiles([value / megapixels for value in measured])
            yield Row("time", name, length, None, None, times_ms.median, "ms/megapixel", times_ms)


def _judged(methods: Sequence[Contender], extent: Extent, progress: Progress) -> Iterator[Row]:
    angles = extent.angles_deg
    cases = list(product(extent.judged_px, angles))
    for scene in extent.scenes:
        fine = truth.SCENES[scene](extent.scene_px, extent.plane_px)
        sharp = truth.pixels(fine)
        truths = map(truth.pixels, truth.moved(fine, [(truth.FINE * length, a) for length, a in cases]))
        plain = truth.moved(sharp, cases)
        image = torch.from_numpy(sharp).float().repeat(len(angles), 1, 1, 1)
        for length in extent.judged_px:
            expected = list(islice(truths, len(angles)))
            pictures = {NO_BLUR: [sharp] * len(angles), EXACT: list(islice(plain, len(angles)))}
            pictures |= {m.name: list(m.blur(image, length, angles)[:, 0].numpy()) for m in methods}
            progress(1)
            for (name, blurred), (index, angle) in product(pictures.items(), enumerate(angles)):
                difference = _centre(blurred[index] - expected[index], extent.scene_px)
                error = _WHITE_DN * math.sqrt(float(np.mean(difference**2)))
                yield Row("error", name, length, angle, scene, error, "DN")


def _halved(methods: Sequence[Contender], extent: Extent, progress: Progress) -> Iterator[Row]:
    point = torch.zeros(len(extent.angles_deg), 1, extent.plane_px, extent.plane_px)
    point[..., extent.plane_px // 2, extent.plane_px // 2] = 1
    for length in extent.judged_px:
        for method in methods:
            spread = method.blur(point, length, extent.angles_deg)[:, 0].double().numpy()
            for plane, angle in zip(spread, extent.angles_deg, strict=True):
                found = truth.mtf50(plane, angle)
                error = None if found is None else found * length / truth.MTF50_LENGTH - 1
                yield Row("mtf50", method.name, length, angle, None, error, "relative")
        progress(1)


def _centre(plane: truth.Plane, scene_px: int) -> truth.Plane:
    """The middle three quarters of a scene, from the plane around it."""
    start, side = len(plane) // 2 - 3 * scene_px // 8, 3 * scene_px // 4
    return plane[start : start + side, start : start + side]
