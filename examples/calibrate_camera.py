"""Calibrate a camera from frames: dark and flat ones at eight exposures, two of each.

    python examples/calibrate_camera.py [FOLDER]

FOLDER holds your own, as dark_10ms_0.png or flat_2.5ms_1.npy. Without it the frames of a made-up camera are taken
here, so that what comes out can be held against what is true.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import torch
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.to_camera import camera_of

from blurnoise import Camera, photoelectrons, simulate

TRUE = Camera.preset("imx250")


def take_frames(folder: Path, size_px: int = 128) -> None:
    """An even light that comes to 90 % of saturation at 20 ms, and the lens covered."""
    lux = 0.9 * TRUE.sensor.saturation_e / photoelectrons(TRUE, 1.0, 0.02)
    for step in range(1, 9):
        for kind, light in (("dark", 0.0), ("flat", lux)):
            for number in range(2):
                frame = simulate(
                    torch.ones(1, 1, size_px, size_px),
                    TRUE,
                    exposure_s=0.0025 * step,
                    illuminance_lux=light,
                    fidelity="full",
                    generator=[100 * step + 10 * number + (kind == "dark")],
                )
                np.save(folder / f"{kind}_{2.5 * step}ms_{number}.npy", frame[0, 0].numpy().astype(np.uint16))


with tempfile.TemporaryDirectory() as made:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else made)
    if len(sys.argv) == 1:
        take_frames(folder)
    found = measure(folder)
camera = camera_of(found, "mine")  # camera.save("mine.yaml") makes a file for --camera

for name in ("system_gain_dn_per_e", "read_noise_e", "full_well_e", "black_level_dn"):
    true = "" if len(sys.argv) > 1 else f" (true: {TRUE.figure(name):.4g})"
    print(f"{name}: {camera.figure(name):.4g}{true}")
