"""The camera, its lens and its sensor: records with units, presets and files; radiometry and transfer functions."""

from blurnoise.camera.camera import PRESETS as PRESETS
from blurnoise.camera.camera import Camera as Camera
