"""blurnoise: exposure, light, motion blur and sensor noise of a camera, in real units.

``simulate(image, camera, exposure_s=..., illuminance_lux=...)`` turns pictures (B, C, H, W) in [0, 1] into
the digital numbers that ``camera`` would give; ``develop`` turns digital numbers into a picture.
"""

import importlib
from typing import TYPE_CHECKING, Any

from blurnoise.blur.convolution import defocus, motion_blur
from blurnoise.blur.layers import Layer, expose_layers
from blurnoise.light.flicker import Pwm
from blurnoise.motion.ego import blur_pixels, velocity_px_s
from blurnoise.motion.trajectory import Trajectory
from blurnoise.optics.camera import Camera
from blurnoise.optics.captures import Capture
from blurnoise.optics.radiometry import photoelectrons
from blurnoise.optics.spectra import Curve
from blurnoise.optics.transfer import Optics
from blurnoise.picture.develop import develop
from blurnoise.scene.metering import AutoExposure
from blurnoise.scene.plan import plan
from blurnoise.scene.scene import ExposedScene, Exposure, simulate

if TYPE_CHECKING:
    from blurnoise.metrics import slanted_edge
    from blurnoise.training.arrays import expose_numpy, labels_numpy
    from blurnoise.training.augmentation import RandomExposure
from blurnoise.training.pictures import expose_pictures

__all__ = [
    "AutoExposure",
    "Camera",
    "Capture",
    "Curve",
    "ExposedScene",
    "Exposure",
    "Layer",
    "Optics",
    "Pwm",
    "RandomExposure",
    "Trajectory",
    "blur_pixels",
    "defocus",
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
    "velocity_px_s",
]
_LATE = {
    "RandomExposure": "blurnoise.training.augmentation",
    "expose_numpy": "blurnoise.training.arrays",
    "expose_pictures": "blurnoise.training.pictures",
    "labels_numpy": "blurnoise.training.arrays",
    "slanted_edge": "blurnoise.metrics",
}
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """Import on first use what is slow to import and seldom needed: Kornia's augmentations, the metrics."""
    if name in _LATE:
        return getattr(importlib.import_module(_LATE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
