"""Moved to :mod:`blurnoise.optics.camera`."""

from blurnoise.optics.camera import *  # noqa: F403
