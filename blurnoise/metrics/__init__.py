"""Image-quality metrics of linear pictures: what an instrument would say of them, and how sure it can be."""

from blurnoise.metrics.edge_flags import Flag
from blurnoise.metrics.slanted_edge import SlantedEdge, slanted_edge

__all__ = ["Flag", "SlantedEdge", "slanted_edge"]
