"""For one step."""

from blurnoise._core.borders import Window, continued_in, cut, placed

__all__ = ["Window", "continued_in", "cut", "placed"]
