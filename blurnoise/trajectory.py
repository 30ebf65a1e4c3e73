"""Moved to :mod:`blurnoise.motion.trajectory`."""

from blurnoise.motion.trajectory import *  # noqa: F403
