"""Frames and runs of today, to hold a change of the code against: ``python tests/helpers/golden.py --help``.

Sums of frames are exact and depend on the processor: write and compare on one machine. What a frame's sum no longer
says, its mean and deviation do.
"""

import argparse
import csv
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise import (
    AutoExposure,
    Camera,
    ExposedScene,
    Exposure,
    Layer,
    Trajectory,
    charts,
    develop,
    simulate,
)
from blurnoise.light.flicker import Pwm
from blurnoise.motion.ego import Vehicle
from blurnoise.optics.camera import PRESETS, Capture, staggered
from blurnoise.scene.hdr import Flicker, captured, fuse
from blurnoise.training.augmentation import RandomExposure, expose_pictures

Frames = dict[str, Callable[[], Tensor]]
REAL = Path(__file__).resolve().parents[3] / "shared" / "real"
HEIGHT_PX, WIDTH_PX = 49, 63
CONDITIONS: dict[str, Any] = {"exposure_s": 0.012, "illuminance_lux": 60.0}
RUN_COMMANDS = {
    "grid": "sweep --limit 2 --exposure-ms 1,10,90 --lux 3,1000 --dx 0,300",
    "photographs": "sweep --model {real}/models/yolox_nano.onnx --images {real}/photos --limit 2 --keep 0.8 "
    "--exposure-ms 1,10 --lux 10 --dx 0,300",
    "ap": "sweep --model {real}/models/yolox_nano.onnx --coco {real}/photos/instances.json --limit 3 "
    "--score ap50 --exposure-ms 1,10 --lux 10 --dx 0,300",
    "reader": "sweep --model ppocr --limit 1 --exposure-ms 1,10 --lux 10 --dx 0,300",
    "decide": "decide --plan {folder}/one.yaml --lux 10:1000 --dx 0,300",
    "program": "program {folder}/grid",
    "maps": "-m blurnoise_eval.maps {folder}/grid",
}
"""Arguments of the command line, without the output; in this order, as some read the run of another."""
_ELAPSED = ("_ms", "_per_s", "seconds", "computed_by")  # columns that no two commits share


def picture(seed: int = 0, height_px: int = HEIGHT_PX, width_px: int = WIDTH_PX, channels: int = 3) -> Tensor:
    """A sign before a background of smooth and of fine texture, (1, C, H, W)."""
    generator = torch.Generator().manual_seed(seed)
    coarse = torch.rand((1, channels, 5, 6), generator=generator)
    smooth = torch.nn.functional.interpolate(coarse, (height_px, width_px), mode="bilinear")
    fine = torch.rand((1, channels, height_px, width_px), generator=generator)
    background = 0.8 * smooth + 0.2 * fine
    if channels != 3:
        return background
    return charts.stop_sign(min(height_px, width_px) * 0.6, background=background)


def golden_frames() -> Frames:
    """Every frame by its name, as the call that makes it."""
    scene, generator = picture(), [7]
    frames: Frames = {}

    def add(name: str, camera: Camera, **conditions: Any) -> None:
        given = CONDITIONS | {"generator": generator} | conditions
        frames[name] = lambda: simulate(scene, camera, **given)

    cameras = {name: replace(camera, captures=()) for name, camera in PRESETS.items()}
    for name, camera in cameras.items():
        for fidelity in ("auto", "full"):
            add(f"{name}, straight, {fidelity}", camera, velocity_px_s=(700.0, -300.0), fidelity=fidelity)
    still, rolling = cameras["imx250"], cameras["mt9m034"]
    path = Trajectory.sinusoid(3.0, 120.0, direction_deg=30.0, duration_s=0.2)
    road = Vehicle(height_m=1.4, pitch_deg=2.0).flow_px_s(still, (HEIGHT_PX, WIDTH_PX), 25.0)
    objects = [
        Layer(
            torch.rand((3, 15, 17), generator=torch.Generator().manual_seed(3)),
            torch.nn.functional.pad(torch.ones(11, 13), (2, 2, 2, 2)),
            velocity_px_s=(900.0, 200.0),
            place_px=(20, 15),
        )
    ]
    for name, camera in (("global", still), ("rolling", rolling)):
        add(f"{name}, path", camera, trajectory=path)
        add(f"{name}, path and velocity", camera, trajectory=path, velocity_px_s=(500.0, 0.0))
        add(f"{name}, flow", camera, velocity_px_s=road)
        add(f"{name}, object before a still background", camera, layers=objects)
        add(
            f"{name}, object before a moving background",
            camera,
            layers=objects,
            velocity_px_s=(-400.0, 100.0),
        )
    for scan in ("down", "up"):
        add(
            f"global reset, {scan}",
            replace(rolling, shutter="global-reset", scan=scan),
            velocity_px_s=(500.0, 0.0),
        )
    add(
        "well below the converter's range",
        replace(still, full_well_e=3000.0),
        exposure_s=0.05,
        illuminance_lux=400.0,
    )
    add("dark, warm and long", still, exposure_s=0.5, illuminance_lux=0.001, temperature_c=60.0)
    add("without noise", still, noise=False)
    add("before rounding", still, quantised=False)
    add("little read noise", replace(still, read_noise_e=0.4))
    for cfa in ("RGGB", "GBRG"):
        camera = replace(cameras["imx250c"], cfa=cfa)
        for method in ("bilinear", "edge"):
            frames[f"{cfa}, developed, {method}"] = lambda camera=camera, method=method: develop(
                simulate(scene, camera, **CONDITIONS, generator=generator), replace(camera, demosaic=method)
            )
    frames["JPEG"] = lambda: develop(
        simulate(scene, still, **CONDITIONS, generator=generator), replace(still, jpeg_quality=80)
    )
    for name, captures in (
        ("staggered", staggered(16.0)),
        ("two gains", (Capture(gain_db=18.0), Capture(start_s=0.0))),
    ):
        frames[f"HDR, {name}"] = lambda captures=captures: fuse(captured(
            ExposedScene(4 * scene), still, captures, exposure_s=0.02, illuminance_lux=200.0,
            velocity_px_s=(300.0, 50.0), generator=generator, flicker=Flicker(Pwm(90.0, 0.3)),
        ), still, captures)  # fmt: skip
    frames["training"] = lambda: expose_pictures(
        torch.cat([scene, picture(1)]), ["imx250", "ar0237"], exposure_s=[0.002, 0.03], illuminance_lux=[5.0, 200.0],
        speed_px_s=[300.0, 600.0], direction_deg=[10.0, 100.0], gain_db=AutoExposure(), generator=[1, 2],
    )  # fmt: skip
    frames["drawn for training"] = _drawn
    frames |= {
        f"sweep, gain {gain_db:g} dB": lambda gain_db=gain_db: _swept(still, gain_db)
        for gain_db in (0.0, 30.0)
    }
    frames["sweep, mosaic"] = lambda: _swept(cameras["imx250c"], 12.0)
    return frames


def _drawn() -> Tensor:
    torch.manual_seed(5)
    expose = RandomExposure(speed_px_s=(0.0, 900.0), shake_px=(0.0, 3.0), gain_db=(0.0, 12.0), p=1.0)
    drawn: Tensor = expose(torch.cat([picture(seed) for seed in range(4)]))
    return drawn


def _swept(camera: Camera, gain_db: float) -> Tensor:
    """Six frames of one picture, as sweeps make them."""
    given = (picture()[0].permute(1, 2, 0) * 255).round().byte().numpy()
    exposures = [
        Exposure(camera, exposure_s, lux, velocity_px_s=(speed, 0.0), gain_db=gain_db, seed=11)
        for exposure_s in (0.001, 0.01)
        for speed in (0.0, 800.0)
        for lux in (5.0, 500.0)
    ]
    return torch.stack(
        [torch.from_numpy(frame.picture) for frame in ExposedScene.of_picture(given).frames(exposures)]
    )


def summary(values: NDArray[Any]) -> dict[str, Any]:
    """What the file says of an array."""
    digest = hashlib.sha256(
        f"{values.dtype} {values.shape}".encode() + np.ascontiguousarray(values).tobytes()
    )
    wide = values.astype(np.float64)
    return {
        "sha256": digest.hexdigest()[:16],
        "mean": float(f"{wide.mean():.9g}"),
        "std": float(f"{wide.std():.9g}"),
    }


def tables(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Every table of a command's output as sorted rows, without what depends on time or place."""
    for path in sorted(folder.rglob("*.csv")):
        with path.open(newline="") as file:
            rows = [
                ", ".join(
                    f"{column}={value}"
                    for column, value in row.items()
                    if not (column or "").endswith(_ELAPSED)
                )
                for row in csv.DictReader(file)
            ]
        yield path.name, sorted(rows)


def run_summaries(real: Path, folder: Path) -> dict[str, Any]:
    """Rows and sums of each command's tables; those of photographs only where there are any."""
    found: dict[str, Any] = {}
    (folder / "one.yaml").write_text("limit: 1\n")
    for name, command in RUN_COMMANDS.items():
        if "{real}" in command and not real.is_dir():
            continue
        arguments = command.format(real=real, folder=folder).split()
        program = [] if arguments[0] == "-m" else ["-m", "blurnoise_eval.cli"]
        threads = [] if name == "program" else ["--threads", "1"]
        subprocess.run(
            [sys.executable, *program, *arguments, *threads, "-o", folder / name],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        for table, rows in tables(folder / name):
            digest = hashlib.sha256("\n".join(rows).encode()).hexdigest()[:16]
            found[f"{name}/{table}"] = {"sha256": digest, "rows": len(rows)}
    return found


def compared(before: dict[str, Any], after: dict[str, Any]) -> int:
    """Print what differs between two summaries; returns how many entries do."""
    changes = [name for name in sorted(before.keys() | after.keys()) if before.get(name) != after.get(name)]
    for name in changes:
        print(f"{name}: {before.get(name, 'none')} -> {after.get(name, 'none')}")
    print(f"{len(changes)} of {len(after)} changed")
    return len(changes)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    files = parser.add_mutually_exclusive_group(required=True)
    files.add_argument(
        "--write", type=Path, metavar="FILE", help="write sums to this file, beside what it has"
    )
    files.add_argument("--compare", type=Path, metavar="FILE", help="compare with it; ends with 1 on changes")
    parser.add_argument("--frames", action="store_true", help="frames (default)")
    parser.add_argument("--runs", action="store_true", help="seven small runs of the command line")
    parser.add_argument(
        "--real", type=Path, default=REAL, metavar="DIR", help="models/ and photos/, for two runs"
    )
    given = parser.parse_args(arguments)
    torch.set_num_threads(1)
    found: dict[str, Any] = {}
    if given.frames or not given.runs:
        found["frames"] = {name: summary(call().detach().numpy()) for name, call in golden_frames().items()}
    if given.runs:
        with tempfile.TemporaryDirectory() as folder:
            found["runs"] = run_summaries(given.real, Path(folder))
    if given.compare:
        before = json.loads(given.compare.read_text())
        return int(sum(compared(before.get(part, {}), own) for part, own in found.items()) > 0)
    before = json.loads(given.write.read_text()) if given.write.exists() else {}
    given.write.write_text(json.dumps(before | found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
