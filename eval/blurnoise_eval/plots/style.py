"""One style for all figures: axes, ticks that are plain numbers, colours, small multiples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

T = TypeVar("T")
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""The palette of Okabe and Ito, for colour-blind readers."""
GREY = "0.45"
MAX_LINES = 10
"""The most lines of one panel."""


def tidy(*grid: Axes, title: str | None = None, x: str | None = None, y: str | None = None) -> None:
    """Draw a pale grid below the data, small tick labels and no box. Titles have no mathematics: names may contain
    dollar signs."""
    for axes in grid:
        axes.grid(color="0.9", lw=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        if title is not None:
            axes.set_title(title, fontsize=9, parse_math=False)
        if x is not None:
            axes.set_xlabel(x, fontsize=9)
        if y is not None:
            axes.set_ylabel(y, fontsize=9)


def plain_numbers(*every: Axis, digits: Sequence[int] | None = None, base: int = 10) -> None:
    """Label ticks as 0.5 and 1000, without powers. digits: the ticks in each decade of a logarithmic axis."""
    for axis in every:
        if digits is not None:
            axis.set_major_locator(LogLocator(base, subs=digits))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def small_multiples(
    count: int,
    columns: int,
    cell: tuple[float, float],
    around: tuple[float, float] = (0.0, 1.0),
    **options: Any,
) -> tuple[Figure, list[Axes]]:
    """A figure of ``count`` panels; the rest of the last row is blank.

    cell: width and height of a panel, inches; around: of the margin. options: of ``Figure.subplots``.
    """
    rows = max(1, -(-count // columns))
    size = (cell[0] * columns + around[0], cell[1] * rows + around[1])
    figure = Figure(figsize=size, layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False, **options).flat)
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, grid[:count]


def say_only(axes: Axes, text: str) -> None:
    """Show a text in place of a panel without data."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", transform=axes.transAxes)


def legend_above(figure: Figure, handles: Sequence[Any], title: str, columns: int = 8) -> None:
    """One legend for all panels, above them."""
    legend = figure.legend(
        handles=handles, title=title, loc="outside upper center", ncols=max(1, min(len(handles), columns)),
        fontsize=8.5, frameon=False,
    )  # fmt: skip
    legend.get_title().set_parse_math(False)


def spread(values: Iterable[T], count: int) -> list[T]:
    """At most ``count`` of the values, evenly spread, with the first and the last.

    >>> spread(range(10), 4)
    [0, 3, 6, 9]
    """
    every = list(values)
    if len(every) <= count:
        return every
    return [every[round(i)] for i in np.linspace(0, len(every) - 1, count)]


def line_colours(name: str, count: int, *, dark: bool = False) -> list[str]:
    """``count`` hex colours of a map from dark to bright, without its brightest sixth; on dark paper without its
    darkest two fifths.

    >>> line_colours("viridis", 2), line_colours("viridis", 2, dark=True)
    (['#440154', '#95d840'], ['#2a788e', '#fde725'])
    """
    first, last, alone = (0.4, 1.0, 0.6) if dark else (0.0, 0.84, 0.35)
    even = matplotlib.colormaps[name](np.linspace(first, last, count) if count != 1 else [alone])
    return [str(matplotlib.colors.to_hex(colour)) for colour in even]
