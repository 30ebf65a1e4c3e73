"""Digital numbers of scenes in linear light, which may exceed white: ``take`` with the arguments of an exposure."""

import torch

from blurnoise import Camera, Exposure, Scene, TakeOptions, plan, take
from blurnoise.camera.lens import Lens
from blurnoise.camera.sensor import Sensor

BUSY = Camera(
    "busy",
    Lens(f_number=2.8, transmission=0.9, defocus_radius_px=1.2),
    Sensor(
        pixel_pitch_um=4.0,
        quantum_efficiency=0.5,
        full_well_e=9000.0,
        system_gain_dn_per_e=0.4,
        read_noise_e=2.5,
        dark_current_e_s=30.0,
        prnu=0.01,
        dsnu_e=3.0,
        black_level_dn=60.0,
    ),
)
"""Every noise, and a lens."""


def raw_frames(
    light, camera, captures=None, *, noise=True, quantised=True, lamp_mask=None, generator=(0,), **values
):
    """The frames of every capture of a scene, or of light (B, C, H, W)."""
    scene = light if isinstance(light, Scene) else Scene(light, lamp_mask=lamp_mask)
    camera = camera if captures is None else camera.with_figures(captures=tuple(captures))
    exposure = Exposure(camera, **batched(values, len(scene.light)), seed=list(generator))
    return take(scene, exposure, TakeOptions(("raw",), noise=noise, quantised=quantised)).raw


def batched(values, batch):
    """The values of an exposure, its numbers as tensors (B,)."""
    return {
        name: torch.full((batch,), value, dtype=torch.float64) if isinstance(value, float) else value
        for name, value in values.items()
    }


def budget(
    camera, *, exposure_s, illuminance_lux, displacement_px=(0.0, 0.0), scene=None, tolerance_dn=0.1, **values
):
    """The plan of an exposure in which everything moves so far."""
    velocity = tuple(px / exposure_s if exposure_s else 0.0 for px in displacement_px)
    return plan(
        Exposure(camera, exposure_s, illuminance_lux, velocity, **values), scene, tolerance_dn=tolerance_dn
    )
