"""Moved to :mod:`blurnoise.optics.gains`."""

from blurnoise.optics.gains import *  # noqa: F403
