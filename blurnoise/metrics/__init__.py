"""Image-quality metrics of linear pictures, with their uncertainty.

The slanted edge is here; :mod:`~blurnoise.metrics.information`, :mod:`~blurnoise.metrics.sharpness`,
:mod:`~blurnoise.metrics.patches` (with PSNR and SSIM) and :mod:`~blurnoise.metrics.flicker` are modules of their own.
"""

from blurnoise.metrics.edge.measurement import Flag, SlantedEdge, slanted_edge

__all__ = ["Flag", "SlantedEdge", "slanted_edge"]
