"""Bench of the whole chain: how fast pictures go through it, stage by stage, beside other libraries' blur and noise.

Units: times in ms for a whole batch; ratios to one ``torch.randn`` of the batch's shape, one normal value per
value of the pictures, taken in the same turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import torch
from kornia import augmentation
from torch import Tensor

from blurnoise.light import effects
from blurnoise.light.conditions import Conditions
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import Encoding
from blurnoise.optics.lens import Distortion, Lens
from blurnoise.optics.radiometry import photoelectrons
from blurnoise.picture.develop import develop_8bit
from blurnoise.scene.scene import scene_reflectance, simulate
from blurnoise.sensor import readout as sensor
from blurnoise_eval.bench.contenders import displacements, import_fault, nearest_odd
from blurnoise_eval.bench.timing import Quartiles, in_turns_ms, machine, quartiles
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.system.threads import limited_threads

Progress = Callable[[float], object]
Kind = Literal["whole", "stage", "other", "yardstick"]
PAPERS_TOOL_S = 1.0
"""Seconds that the tool of Lin et al. 2024 takes for one 1280x720 picture on a machine of this kind."""
YARDSTICK = "torch.randn"
BLUR = "blur alone"
NOISE = {"auto": "noise alone, auto", "full": "noise alone, full"}
WHOLE = {"auto": "simulate, auto", "full": "simulate, full"}
PICTURES = "simulate and develop"
COLOUR = "simulate and develop, Bayer"
KORNIA = "kornia MotionBlur + GaussianNoise"
ALBUMENTATIONS = "albumentations MotionBlur + ShotNoise + GaussNoise"


@dataclass(frozen=True)
class Case:
    """Pictures (B, C, H, W) float32, each moved ``length_px`` px at an angle of its own, and their camera."""

    name: str
    shape: tuple[int, int, int, int]
    camera: Camera
    length_px: float
    exposure_s: float
    illuminance_lux: float
    encoding: Encoding

    @property
    def values(self) -> int:
        """Values of all pictures."""
        return math.prod(self.shape)

    @property
    def angles_deg(self) -> list[float]:
        """The first picture moves to the right; the others' angles share half a turn."""
        return [180.0 * index / self.shape[0] for index in range(self.shape[0])]


IMX250 = Camera.preset("imx250")
PICTURE = Case("one picture", (1, 1, 720, 1280), IMX250, 30.0, 0.03, 50.0, "srgb")
BATCH = Case(
    "batch", (8, 3, 512, 512), replace(IMX250, defocus_radius_px=1.5, dark_current_e_s=10.0),
    31.0, 0.01, 100.0, "linear",
)  # fmt: skip
LENS = Case(
    "colour picture, lens over the field", (1, 3, 720, 1280),
    replace(
        IMX250, hfov_deg=70.0,
        lens=Lens(
            field_curvature_px=2.0, lateral_red=0.001, lateral_blue=-0.001, falloff_power=4.0,
            distortion=Distortion("opencv", (-0.2, 0.03, 0.0, 0.0)),
        ),
    ),
    30.0, 0.03, 50.0, "srgb",
)  # fmt: skip


@dataclass(frozen=True)
class Extent:
    """How much is measured; a call is repeated from ``fewest`` to ``most`` times, as fits into ``seconds``."""

    cases: tuple[Case, ...] = (BATCH, PICTURE, LENS)
    fewest: int = 5
    most: int = 21
    seconds: float = 6.0


FULL = Extent()
QUICK = Extent(fewest=2, most=7, seconds=0.5)


@dataclass(frozen=True)
class Row:
    """One measurement; to_randn: its median over that of ``YARDSTICK``."""

    case: str
    name: str
    kind: Kind
    ms: Quartiles
    to_randn: float

    def record(self) -> dict[str, Any]:
        """Flat, for a table."""
        flat = asdict(self)
        low, median, high = flat.pop("ms")
        return {**flat, "ms_low_quartile": low, "ms_median": median, "ms_high_quartile": high}


@dataclass(frozen=True)
class Bench:
    """What was measured, and on which machine."""

    rows: list[Row]
    extent: Extent
    machine: dict[str, Any]

    def row(self, case: str, name: str) -> Row:
        """The row of these."""
        return next(row for row in self.rows if (row.case, row.name) == (case, name))

    def rest_ms(self, case: str, fidelity: str) -> float:
        """Median time of the whole less its stages alone: checks, decoding, planning."""
        stages = self.row(case, BLUR).ms.median + self.row(case, NOISE[fidelity]).ms.median
        return self.row(case, WHOLE[fidelity]).ms.median - stages

    def losses(self) -> list[str]:
        """Where another library takes 2 % less time than ``simulate``, though it does less."""
        found = []
        for row in self.rows:
            for whole in WHOLE.values() if row.kind == "other" else ():
                share = row.ms.median / self.row(row.case, whole).ms.median
                if share < 0.98:
                    found.append(f"{row.case}: {row.name} takes {share:.2f} of the time of {whole}")
        return found

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON; the facts of one picture first, where it was measured."""
        return {
            **self._one_picture(),
            "machine": self.machine,
            "albumentations": _albumentations_fault() or "measured",
            "cases": [
                {**asdict(case), "camera": case.camera.to_dict(), "angles_deg": case.angles_deg}
                for case in self.extent.cases
            ],
            "profile_ms": {
                case.name: {
                    fidelity: {
                        "blur": self.row(case.name, BLUR).ms.median,
                        "noise": self.row(case.name, NOISE[fidelity]).ms.median,
                        "rest": self.rest_ms(case.name, fidelity),
                    }
                    for fidelity in WHOLE
                }
                for case in self.extent.cases
            },
            "losses": self.losses(),
            "rows": [row.record() for row in self.rows],
        }

    def _one_picture(self) -> dict[str, Any]:
        if PICTURE not in self.extent.cases:
            return {}
        times = self.row(PICTURE.name, WHOLE["auto"]).ms
        return {
            "picture": "1x1x720x1280, 30 ms, 1000 px/s",
            "median_ms": times.median,
            "quartiles_ms": f"{times.low:.1f} to {times.high:.1f}",
            "faster_than_papers_tool": 1e3 * PAPERS_TOOL_S / times.median,
        }


def steps(extent: Extent) -> int:
    """What the shares told to ``progress`` add up to."""
    return sum(len(_calls(case)) for case in extent.cases)


def measure(extent: Extent = FULL, threads: int = 2, progress: Progress = lambda share: None) -> Bench:
    """Time every case: whole, in stages, and other libraries, in turns."""
    facts = machine(threads)
    rows = []
    with limited_threads(threads):
        for case in extent.cases:
            calls = _calls(case)
            turns = in_turns_ms(
                {name: call for name, (_, call) in calls.items()},
                fewest=extent.fewest, most=extent.most, seconds=extent.seconds, progress=progress,
            )  # fmt: skip
            times = {name: quartiles(values) for name, values in turns.items()}
            randn = times[YARDSTICK].median
            rows += [
                Row(case.name, name, kind, times[name], times[name].median / randn)
                for name, (kind, _) in calls.items()
            ]
    return Bench(rows, extent, facts)


def write(bench: Bench, folder: Path) -> None:
    """Write simulate.csv, a row per measurement, and simulate.json; raises ``OSError``."""
    write_bench("simulate", [row.record() for row in bench.rows], bench.document(), folder)


def _calls(case: Case) -> dict[str, tuple[Kind, Callable[[], object]]]:
    image = torch.rand(case.shape, generator=torch.Generator().manual_seed(0))
    camera, seeds = case.camera, list(range(len(image)))
    motion = displacements(case.length_px, case.angles_deg)
    conditions: dict[str, Any] = {"exposure_s": case.exposure_s, "temperature_c": 25.0, "generator": seeds}
    light = scene_reflectance(image, case.encoding)
    white_e = photoelectrons(camera, case.illuminance_lux, case.exposure_s)
    none = light.new_zeros(len(light))
    at = Conditions(camera, none, none, none, motion)
    blur = partial(effects.through, light, at)
    apart = [effect for effect in effects.EFFECTS if effect.blur(at) is None]
    moved = blur()
    whole = partial(
        simulate, image, camera=camera, illuminance_lux=case.illuminance_lux,
        velocity_px_s=motion / case.exposure_s, encoding=case.encoding, **conditions,
    )  # fmt: skip
    noise = partial(sensor.read_out, moved, camera, white_e=white_e, **conditions)
    seen_by = {PICTURES: camera, **({COLOUR: _with_mosaic(camera)} if image.shape[1] == 3 else {})}

    def pictures(by: Camera) -> Tensor:
        return develop_8bit(whole(camera=by), by)

    calls: dict[str, tuple[Kind, Callable[[], object]]] = {
        **{name: ("whole", partial(whole, fidelity=fidelity)) for fidelity, name in WHOLE.items()},
        **{name: ("whole", partial(pictures, by)) for name, by in seen_by.items()},
        BLUR: ("stage", blur),
        **{f"{each.name} alone": ("stage", partial(each.apply, light, at, "reflect")) for each in apart},
        **{name: ("stage", partial(noise, fidelity=fidelity)) for fidelity, name in NOISE.items()},
        KORNIA: ("other", partial(_kornia(nearest_odd(case.length_px)), image)),
    }
    if _albumentations_fault() is None:
        calls[ALBUMENTATIONS] = ("other", partial(_albumentations, image, nearest_odd(case.length_px)))
    calls[YARDSTICK] = ("yardstick", partial(torch.randn, case.shape))
    return calls


def _with_mosaic(camera: Camera) -> Camera:
    """The camera behind the colour filters, and with the colour matrix, of the preset imx250c."""
    of = Camera.preset("imx250c")
    return replace(camera, cfa=of.cfa, quantum_efficiency=of.quantum_efficiency, ccm=of.ccm)


def _kornia(taps: int) -> torch.nn.Sequential:
    turned = augmentation.RandomMotionBlur(taps, (-180.0, 180.0), 0.0, border_type="reflect", p=1.0)
    return torch.nn.Sequential(turned, augmentation.RandomGaussianNoise(0.0, 0.05, p=1.0))


def _albumentations_fault() -> str | None:
    fault = import_fault("albumentations")
    if fault is None and not hasattr(import_module("albumentations"), "ShotNoise"):
        return "without ShotNoise"
    return fault


def _albumentations(image: Tensor, taps: int) -> list[Any]:
    library = import_module("albumentations")
    chain = [
        library.MotionBlur(blur_limit=(taps, taps), p=1.0),
        library.ShotNoise(p=1.0),
        library.GaussNoise(p=1.0),
    ]
    pictures = [picture.permute(1, 2, 0).contiguous().numpy() for picture in image]
    return [library.Compose(chain)(image=picture)["image"] for picture in pictures]
