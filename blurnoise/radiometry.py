"""Moved to :mod:`blurnoise.optics.radiometry`."""

from blurnoise.optics.radiometry import *  # noqa: F403
