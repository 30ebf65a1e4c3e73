"""Image-quality metrics of linear pictures: what an instrument would say of them, and how sure it can be.

The slanted edge is here; :mod:`~blurnoise.metrics.information` and :mod:`~blurnoise.metrics.edge_information`,
:mod:`~blurnoise.metrics.noise`, :mod:`~blurnoise.metrics.contrast` and :mod:`~blurnoise.metrics.similarity` are
modules of their own.
"""

from blurnoise.metrics.edge.flags import Flag
from blurnoise.metrics.edge.measurement import SlantedEdge, slanted_edge

__all__ = ["Flag", "SlantedEdge", "slanted_edge"]
