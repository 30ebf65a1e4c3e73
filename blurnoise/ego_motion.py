"""Moved to :mod:`blurnoise.motion.ego`."""

from blurnoise.motion.ego import *  # noqa: F403
