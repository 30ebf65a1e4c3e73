"""For one step."""

from blurnoise._core.checks import (
    DRAWN_FROM,
    LARGEST_PICTURE,
    LIMITS,
    Limit,
    counted,
    limited,
    limited_motion,
    limited_per_image,
    within,
)

__all__ = [
    "DRAWN_FROM",
    "LARGEST_PICTURE",
    "LIMITS",
    "Limit",
    "counted",
    "limited",
    "limited_motion",
    "limited_per_image",
    "within",
]
