"""The grid of a sweep: axes, conditions, cells."""
