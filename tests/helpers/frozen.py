"""Hashes of frames, cell ids, headers and answers: what a change of the code's shape must not change.

``python tests/helpers/frozen.py`` writes tests/data/frozen.json anew, after a change that is meant.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HELD = Path(__file__).parents[1] / "data" / "frozen.json"
# The same instructions on every x86-64 processor: with AVX2, NumPy's and OpenCV's last bits differ in some frames.
PORTABLE = {
    "ATEN_CPU_CAPABILITY": "default",
    "MKL_CBWR": "COMPATIBLE",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENCV_CPU_DISABLE": "FMA3,AVX2,AVX512_SKX,AVX512_ICL",
    "OMP_NUM_THREADS": "1",
}


def computed(kind: str) -> dict[str, str]:
    """Hashes by name, ``kind`` "frames" or "runs", in a process with the portable code path."""
    found = subprocess.run(
        [sys.executable, __file__, kind],
        env=os.environ | PORTABLE,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(found.stdout)


def processor() -> str:
    """The instructions of this processor, on which the scores of onnxruntime depend."""
    from numpy._core._multiarray_umath import __cpu_features__

    return " ".join(sorted(name for name, there in __cpu_features__.items() if there))


def digest(array) -> str:
    """The start of the SHA-256 of an array with its shape and type."""
    import numpy as np

    array = np.ascontiguousarray(array)
    return hashlib.sha256(repr((array.shape, array.dtype.str)).encode() + array.tobytes()).hexdigest()[:16]


def a_picture(channels=3, height=45, width=70):
    """A picture of waves, edges and a bright corner, 8 bit."""
    import numpy as np

    y, x = np.mgrid[:height, :width]
    waves = 0.5 + 0.3 * np.sin(x / 3.0) * np.cos(y / 5.0)
    planes = [np.where(x + y > 30 + 9 * each, waves, 0.1 + 0.2 * each) for each in range(3)]
    picture = np.stack(planes, -1)
    picture[:8, :8] = 1.0
    return (255 * picture[..., :channels] + 0.5).astype(np.uint8)


def simulated():
    """Digital numbers of a batch, by camera and conditions."""
    import numpy as np
    import torch

    import blurnoise
    from blurnoise import Trajectory, simulate

    light = torch.from_numpy(a_picture().transpose(2, 0, 1) / 255).float()[None].repeat(2, 1, 1, 1)
    shake = Trajectory.of(np.linspace(-1, 1, 41), 4 * np.sin(np.arange(82)).reshape(2, 41))
    conditions = {
        "still": {},
        "moving": {"velocity_px_s": [(500.0, 200.0), (-300.0, 0.0)]},
        "hot": {"temperature_c": 60.0, "exposure_s": 0.3},
        "shaken": {"trajectory": shake},
        "tungsten": {"illuminant": "planck:2856"},
        "bright": {"illuminance_lux": torch.tensor([400.0, 40000.0])},
    }
    for name in ("lin2024", "imx250c", "imx477", "ar0132m"):
        camera = blurnoise.Camera.preset(name)
        for under, stated in conditions.items():
            asked = {"exposure_s": 0.01, "illuminance_lux": 100.0, **stated}
            frames = simulate(light, camera, generator=[3, 4], **asked)
            yield f"simulate {name} {under}", frames.to(torch.int32).numpy()


def exposed():
    """Pictures as sweeps and the augmentation take them."""
    import torch
    from blurnoise_eval import expose

    from blurnoise import RandomExposure

    at = {"exposure_s": 0.01, "illuminance_lux": 60.0}
    conditions = {
        "still": at,
        "moving": {**at, "velocity_x_px_s": 700.0, "velocity_y_px_s": -90.0},
        "gain": {**at, "gain_db": "auto"},
        "lens": {**at, "f_number": 4.0, "defocus_radius_px": 2.0},
        "ego": {**at, "ego_speed_m_s": 15.0},
    }
    for camera in ("imx250c", "imx219", "ar0132x3"):
        for under, stated in conditions.items():
            yield f"expose {camera} {under}", expose(a_picture(), camera, seed=5, **stated).image
    torch.manual_seed(1)
    pictures = torch.from_numpy(a_picture().transpose(2, 0, 1) / 255).float()[None].repeat(3, 1, 1, 1)
    for camera in ("imx250c", "imx219", "ovsplit"):
        augment = RandomExposure(
            camera=camera,
            exposure_s=(0.001, 0.02),
            illuminance_lux=(5.0, 500.0),
            speed_px_s=(0.0, 900.0),
            p=1.0,
        )
        yield f"RandomExposure {camera}", augment(pictures).mul(255).round().to(torch.uint8).numpy()


def from_the_command_line():
    """Pictures that ``blurnoise simulate`` writes."""
    import cv2
    from blurnoise_eval.cli import main

    asked = {
        "still": ["--exposure-ms", "10", "--lux", "30"],
        "native": ["--exposure-ms", "5", "--dx", "800", "--camera", "imx477", "--bit-depth", "native"],
        "hdr": ["--exposure-ms", "20", "--lux", "500", "--hdr", "16"],
        "auto": ["--exposure-ms", "auto", "--lux", "3", "--camera", "imx219"],
        "object": ["--object", "20,10,24,20", "--moves", "targets", "--dx", "1500", "--exposure-ms", "8"],
    }
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "source.png")
        cv2.imwrite(str(source), a_picture()[..., ::-1])
        for under, words in asked.items():
            written = Path(folder, f"{under}.png")
            sys.stdout, kept = sys.stderr, sys.stdout
            code = main(["simulate", str(source), "-o", str(written), *words])
            sys.stdout = kept
            assert code == 0, under
            yield f"blurnoise simulate {under}", cv2.imread(str(written), cv2.IMREAD_UNCHANGED)


def of_runs():
    """Cell ids, rows, headers and answers of small runs."""
    from dataclasses import replace

    from blurnoise_eval import STOP_SIGN, SweepPlan, datasets, evaluate
    from blurnoise_eval.run.evaluation import usual_plan

    every = datasets.rendered_signs()
    signs = replace(every, pictures=tuple(every)[:3])
    grid = {"exposure_s": (0.001, 0.004, 0.016), "illuminance_lux": (5.0, 200.0)}
    plans = {
        "plain": (SweepPlan({**grid, "velocity_x_px_s": (0.0, 600.0)}), "imx250c"),
        "repeats": (SweepPlan(grid, repeats=2, seed=7), "lin2024"),
        "targets": (SweepPlan({**grid, "moves": (0.0, 1.0), "velocity_x_px_s": (900.0,)}), "imx250c"),
        "captures": (SweepPlan(grid), "ar0132x3"),
    }
    with tempfile.TemporaryDirectory() as folder:
        runs = {
            name: evaluate(
                pictures=signs, camera=camera, plan=plan, output=Path(folder, name), progress=False
            )
            for name, (plan, camera) in plans.items()
        }
        runs["decide"] = evaluate(
            STOP_SIGN,
            signs,
            "imx250c",
            usual_plan(),
            output=Path(folder, "decide"),
            strategy="search",
            progress=False,
        )
        for name, run in runs.items():
            rows = [
                {key: row[key] for key in row if not key.endswith("_ms") and key != "computed_by"}
                for row in run.cells
            ]
            yield f"{name}: cells", rows
            yield f"{name}: headers", [list(each[0]) for each in (run.cells, run.targets, run.scores)]
            yield f"{name}: answers", run.answers


def rounded(value):
    """Numbers to three digits: onnxruntime's last bits differ even among processors with the same instructions."""
    if isinstance(value, float):
        return float(f"{value:.3g}")
    if isinstance(value, dict):
        return {key: rounded(each) for key, each in value.items()}
    return [rounded(each) for each in value] if isinstance(value, list | tuple) else value


def main(kind: str) -> dict[str, str]:
    """Hashes by name."""
    if kind == "runs":
        return {
            name: hashlib.sha256(json.dumps(rounded(rows), default=str).encode()).hexdigest()[:16]
            for name, rows in of_runs()
        }
    makers = simulated, exposed, from_the_command_line
    return {name: digest(frame) for each in makers for name, frame in each()}


if __name__ == "__main__":
    if len(sys.argv) > 1:
        sys.stdout.write(json.dumps(main(sys.argv[1])))
    else:
        held = {"processor": processor(), "frames": computed("frames"), "runs": computed("runs")}
        HELD.write_text(json.dumps(held, indent=1) + "\n")
