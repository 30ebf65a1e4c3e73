"""Moved to :mod:`blurnoise.optics.colour`."""

from blurnoise.optics.colour import *  # noqa: F403
