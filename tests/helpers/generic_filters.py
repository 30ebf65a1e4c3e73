"""Colour filters as they might be, for want of measured ones."""

import numpy as np

from blurnoise.camera.colour import FilterCurves
from blurnoise.camera.spectra import Curve

_NM = {"red": (600.0, 40.0), "green": (535.0, 40.0), "blue": (460.0, 30.0)}


def behind_generic_filters(bare):
    """A sensor of one quantum efficiency behind Gaussian filters about 600, 535 and 460 nm, 90 % at the peak."""
    nm = np.arange(400.0, 651.0, 10.0)

    def curve(transmission):
        return Curve((*nm, 660.0), (*np.round(np.full(len(nm), bare) * transmission, 4), 0.0))

    each = {
        name: curve(0.9 * np.exp(-(((nm - centre_nm) / spread_nm) ** 2) / 2))
        for name, (centre_nm, spread_nm) in _NM.items()
    }
    return FilterCurves(**each, clear=curve(1.0))
