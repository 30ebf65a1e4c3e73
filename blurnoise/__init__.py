"""blurnoise: exposure, light, motion blur and sensor noise of a camera, in real units.

``simulate(image, camera, exposure_s=..., illuminance_lux=...)`` turns pictures (B, C, H, W) in [0, 1] into
the digital numbers that ``camera`` would give; ``develop`` turns those into a picture again.
"""

from blurnoise.blur import defocus, motion_blur
from blurnoise.camera import Camera
from blurnoise.motion import blur_pixels, velocity_px_s
from blurnoise.sensor.readout import develop, photoelectrons
from blurnoise.simulate import simulate
from blurnoise.spectra import Curve

__all__ = [
    "Camera",
    "Curve",
    "blur_pixels",
    "defocus",
    "develop",
    "motion_blur",
    "photoelectrons",
    "simulate",
    "velocity_px_s",
]
__version__ = "0.1.0"
