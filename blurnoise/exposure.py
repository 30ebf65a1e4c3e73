"""Moved to :mod:`blurnoise.scene.scene`."""

from blurnoise.scene.scene import *  # noqa: F403
