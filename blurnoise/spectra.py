"""Moved to :mod:`blurnoise.optics.spectra`."""

from blurnoise.optics.spectra import *  # noqa: F403
