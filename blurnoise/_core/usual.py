"""The usual conditions, which sweeps test and trainings draw from unless told otherwise: a camera on a vehicle.

Exposures: up to the 30 ms that 30 frames/s leave. Lights: two streets at night in the vehicle's low beam, dusk, and
daylight out of the sun, with their sources in ``blurnoise/light/data/lights.csv``. Speeds: of a sign 5 m beside the
optical axis and 12.5 m ahead of a camera that drives at 0, 50 and 100 km/h and has the AR0132AT's 1280 px over 60
degrees. A pinhole moves it by f v 5 m / (12.5 m)^2, 493 px/s at 50 km/h; so does ``blurnoise motion --speed-kmh 20
--distance-m 12.5 --lens rectilinear``, as 5 / 12.5 of the 50 km/h lies across the line of sight. Gain: what brings
the mean of each picture to 18 %.

Nothing heavy is imported, as the command line's help reads this.
"""

from typing import Literal

COLOUR, MONOCHROME = "imx250c", "imx250m"
"""Presets of cameras, for pictures in colour and for grey ones."""
# Half decades, from a bright day's shortest to what 30 frames a second allow.
EXPOSURE_S = tuple(ms / 1e3 for ms in (0.03, 0.1, 0.3, 1, 3, 10, 30))
LIGHTS = ("street", "lit-street", "dusk", "daylight")
"""Of :func:`blurnoise.light.lights.named_lights`, which sweeps of pictures test."""
ILLUMINANCE_LUX = (1.0, 20.0, 400.0, 20_000.0)
"""Theirs, for what has no headlamps: trainings and charts."""
DISTANCE_M = 12.5
"""Of that sign. Rendered signs are lit by headlamps as there, whatever their size."""
SPEED_PX_S = {"at rest": 0.0, "50 km/h": 500.0, "100 km/h": 1000.0}
GAIN: Literal["auto"] = "auto"
TEMPERATURE_C = 25.0
