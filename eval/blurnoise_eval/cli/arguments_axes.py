"""The options of a sweep's axes, one each, and the grid that they state."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any

from blurnoise_eval.grid.axes import AXES

Usual = Mapping[str, tuple[float, ...]]


def add_axes(group: Any, numbers: Callable[[str], list[float]], usual: Usual | None = None) -> None:
    """An option per axis to a parser's group; ``numbers`` parses a list.

    usual: by axis name, what a command tests if not told, where that is not the axis' own default.
    """
    for axis in AXES:
        default = (usual or {}).get(axis.name, axis.default)
        told = ",".join(f"{axis.shown(value):g}" for value in default) or "the camera's, or none"
        group.add_argument(axis.option, type=numbers, metavar="LIST", help=f"{axis.about} (default {told})")


def grid(options: argparse.Namespace, usual: Usual | None = None) -> dict[str, tuple[float, ...]]:
    """Values by axis name, as a plan takes them: those given, else the usual ones, else none at all."""
    values: dict[str, tuple[float, ...]] = {}
    for axis in AXES:
        given = getattr(options, axis.dest)
        if given is not None:
            values[axis.name] = tuple(axis.of_option(value) for value in given)
        elif default := (usual or {}).get(axis.name, axis.default):
            values[axis.name] = default
    return values
