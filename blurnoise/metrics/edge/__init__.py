"""A slanted edge, step by step: where it lies, what stands beside it, its spline, its response."""
