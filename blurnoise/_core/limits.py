"""Limits of physical quantities, one table: beyond them an argument is an error, whoever takes it.

By the argument's name, in the unit that stands in it. They lie outside anything that is built or seen, and inside
what single precision and bounded time and memory can do. The axes of sweeps, which import nothing as heavy as this
package, state theirs themselves; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from annotated_types import Interval
from torch import Tensor

from blurnoise._core.checks import Numbers, in_range, integer, per_image, shown


class Limit(NamedTuple):
    """From low to high, both included; above: low itself is not."""

    low: float
    high: float
    above: bool = False


ABSOLUTE_ZERO_C = -273.15
LIMITS: Mapping[str, Limit] = {
    # conditions
    "exposure_s": Limit(0.0, 3600.0),
    "illuminance_lux": Limit(0.0, 1e9),  # 10 000 suns
    "velocity_px_s": Limit(-1e7, 1e7),
    "speed_px_s": Limit(0.0, 1e7),
    "displacement_px": Limit(-1e5, 1e5),  # of its transforms' lengths those that are fast are soon found
    "shake_px": Limit(0.0, 1e4),
    "variation_px": Limit(0.0, 1e6),
    "direction_deg": Limit(-1e6, 1e6),  # single precision still tells a tenth of a degree
    "temperature_c": Limit(ABSOLUTE_ZERO_C, 300.0),
    "gain_db": Limit(-120.0, 120.0),
    "tolerance_dn": Limit(0.0, 65536.0, above=True),
    "white_e": Limit(0.0, 1e32),  # electrons of white, or per photon
    # cameras
    "pixel_pitch_um": Limit(0.1, 1000.0),
    "f_number": Limit(0.5, 256.0),  # in air no lens is below 0.5
    "full_well_e": Limit(1.0, 1e12),
    "system_gain_dn_per_e": Limit(1e-9, 1e9),
    "read_noise_e": Limit(0.0, 1e6),
    "analogue_gain_max_db": Limit(0.0, 120.0),
    "gain_max_db": Limit(0.0, 120.0),
    "from_db": Limit(0.0, 120.0),
    "dark_current_e_s": Limit(0.0, 1e9),
    "dark_reference_c": Limit(ABSOLUTE_ZERO_C, 300.0),
    "dark_doubling_c": Limit(1.0, 1000.0),
    "prnu": Limit(0.0, 1.0),
    "dsnu_e": Limit(0.0, 1e6),
    "diffraction_wavelength_um": Limit(0.0, 20.0),  # thermal infrared included
    # lenses
    "field_curvature_px": Limit(-50.0, 50.0),
    "lateral_red": Limit(-0.1, 0.1),  # of the magnification
    "lateral_blue": Limit(-0.1, 0.1),
    "falloff_power": Limit(0.0, 16.0),  # of the field angle's cosine
    "focal_px": Limit(0.0, 1e9, above=True),
    "coefficient": Limit(-1e6, 1e6),
    # blurs
    "radius_px": Limit(0.0, 1000.0),
    "defocus_radius_px": Limit(0.0, 1000.0),
    "gaussian_sigma_px": Limit(0.0, 1000.0),
    "diffraction_lambda_n_px": Limit(0.0, 1000.0),
    # roads
    "speed_m_s": Limit(0.0, 3e8),
    "ego_kmh": Limit(0.0, 360.0),  # as of sweeps
    "distance_m": Limit(1e-6, 1e9),
    "target_width_m": Limit(1e-6, 1e9),
    "width_px": Limit(1.0, 1 << 20),
    "hfov_deg": Limit(1e-3, 360.0),
    "velocity_m_s": Limit(-3e8, 3e8),
    "rotation_deg_s": Limit(-1e5, 1e5),
    "camera_height_m": Limit(0.0, 1e6, above=True),
    "pitch_deg": Limit(-90.0, 90.0),
    "heading_deg": Limit(-360.0, 360.0),
    "depth_m": Limit(1e-6, 1e9),
    "blur_px": Limit(0.0, 1e5, above=True),
    # charts and their measurement
    "size_px": Limit(0.01, 1 << 14),
    "height_px": Limit(1, 1 << 14),
    "cycles": Limit(1, 1 << 14),
    "supersample": Limit(1, 64),
    "contrast": Limit(0.0, 1e6, above=True),
    "data_range": Limit(0.0, 1e30, above=True),
    "target_px": Limit(1, 128),
    "bootstrap": Limit(0, 100_000),
    "angle_deg": Limit(-1e6, 1e6),
    "centre_px": Limit(-1e6, 1e6),
    # captures and lamps
    "exposure_ratio": Limit(1e-6, 1e6),
    "sensitivity": Limit(1e-6, 1e6),
    "start_s": Limit(0.0, 3600.0),
    "frequency_hz": Limit(1e-3, 1e9),
    "row_time_s": Limit(0.0, 1.0),
    "phase_rad": Limit(-1e6, 1e6),
    "acceleration_px_s2": Limit(-1e13, 1e13),  # 1e5 px from rest within 0.14 ms
    # spectra
    "kelvin": Limit(300.0, 1e6),
    "wavelength_nm": Limit(1.0, 1e6),
    "value": Limit(0.0, 1e30),  # of a curve, either sign
}
LARGEST_PICTURE = 1 << 28
"""Pixels of what is made as large as stated."""
DRAWN_FROM: Mapping[str, float] = {"exposure_s": 1e-9, "illuminance_lux": 1e-6, "white_e": 1e-3}
"""The least that is drawn log-uniformly: from there to the limit single precision holds the ratio."""


def limited(name: str, value: float, entry: str | None = None) -> float:
    """``value`` as a float. Raises ``TypeError`` or ``ValueError`` outside the limit of its name, or of ``entry``."""
    low, high, above = LIMITS[entry or name]
    return in_range(name, value, low, high, above=above)


def limited_per_image(name: str, value: Numbers, batch: int, like: Tensor) -> Tensor:
    """:func:`blurnoise._core.checks.per_image` within the limit of its name."""
    low, high, _ = LIMITS[name]
    return per_image(name, value, batch, like, low=low, high=high)


def counted(name: str, value: int, entry: str | None = None) -> int:
    """``value``, an integer within the limit of its name, or of ``entry``. Raises as :func:`limited` does."""
    low, high, _ = LIMITS[entry or name]
    return integer(name, value, int(low), int(high))


def within(name: str) -> Interval:
    """The limit of a dataclass's field, for its annotation."""
    low, high, above = LIMITS[name]
    return Interval(gt=low, le=high) if above else Interval(ge=low, le=high)


def limited_motion(name: str, motion_px: Tensor) -> None:
    """Raise ``ValueError`` unless every displacement is within the limit, or a rounding beyond it."""
    most, moved = LIMITS["displacement_px"].high, motion_px.detach()
    if not bool((moved.abs() <= most * (1 + 1e-6)).all()):
        longest = moved if moved.numel() <= 2 else moved.flatten()[moved.abs().argmax()]
        raise ValueError(f"{name} = {shown(longest)}: must be finite and >= {-most:g} and <= {most:g}")
