"""blurnoise: exposure, light, motion blur and sensor noise of a camera, in real units.

``simulate(image, camera, exposure_s=..., illuminance_lux=...)`` turns pictures (B, C, H, W) in [0, 1] into
the digital numbers that ``camera`` would give; ``develop`` turns digital numbers into a picture.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from blurnoise.blur.convolution import motion_blur
    from blurnoise.blur.layer import Layer
    from blurnoise.blur.layers import expose_layers
    from blurnoise.camera.camera import Camera
    from blurnoise.camera.captures import Capture
    from blurnoise.camera.radiometry import photoelectrons
    from blurnoise.camera.spectra import Curve
    from blurnoise.camera.transfer import Optics
    from blurnoise.light.lamp import Pwm
    from blurnoise.metrics import slanted_edge
    from blurnoise.motion.ego import blur_pixels, velocity_px_s
    from blurnoise.motion.trajectory import Trajectory
    from blurnoise.picture.develop import develop
    from blurnoise.scene.exposure import Exposure
    from blurnoise.scene.metering import AutoExposure
    from blurnoise.scene.plan import plan
    from blurnoise.scene.scene import Scene
    from blurnoise.scene.simulate import simulate
    from blurnoise.scene.take import Frames, TakeOptions, take, take_each
    from blurnoise.training.arrays import expose_numpy, labels_numpy
    from blurnoise.training.augmentation import RandomExposure
    from blurnoise.training.pictures import expose_pictures

__all__ = [
    "AutoExposure",
    "Camera",
    "Capture",
    "Curve",
    "Exposure",
    "Frames",
    "Layer",
    "Optics",
    "Pwm",
    "RandomExposure",
    "Scene",
    "TakeOptions",
    "Trajectory",
    "blur_pixels",
    "develop",
    "expose_layers",
    "expose_numpy",
    "expose_pictures",
    "labels_numpy",
    "motion_blur",
    "photoelectrons",
    "plan",
    "simulate",
    "slanted_edge",
    "take",
    "take_each",
    "velocity_px_s",
]
_MODULES = {
    "blur.convolution": ("motion_blur",),
    "blur.layer": ("Layer",),
    "blur.layers": ("expose_layers",),
    "camera.camera": ("Camera",),
    "camera.captures": ("Capture",),
    "camera.radiometry": ("photoelectrons",),
    "camera.spectra": ("Curve",),
    "camera.transfer": ("Optics",),
    "light.lamp": ("Pwm",),
    "metrics": ("slanted_edge",),
    "motion.ego": ("blur_pixels", "velocity_px_s"),
    "motion.trajectory": ("Trajectory",),
    "picture.develop": ("develop",),
    "scene.exposure": ("Exposure",),
    "scene.metering": ("AutoExposure",),
    "scene.plan": ("plan",),
    "scene.scene": ("Scene",),
    "scene.simulate": ("simulate",),
    "scene.take": ("Frames", "TakeOptions", "take", "take_each"),
    "training.arrays": ("expose_numpy", "labels_numpy"),
    "training.augmentation": ("RandomExposure",),
    "training.pictures": ("expose_pictures",),
}
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """Import on first use: the command line's help reads tables of this package, and torch is slow to import."""
    for module, names in _MODULES.items():
        if name in names:
            found = globals()[name] = getattr(importlib.import_module(f"{__name__}.{module}"), name)
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
