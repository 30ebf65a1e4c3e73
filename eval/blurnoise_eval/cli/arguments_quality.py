"""What ``blurnoise quality`` understands."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from blurnoise_eval.cli.arguments_axes import add_axes

ABOUT = """\
What exposure, light and motion do to a camera's picture, in numbers: on simulated charts MTF50, edge SNR, CNR,
patch SNR, information capacity, NEQ, SNRI, Michelson contrast, CDP, PSNR and SSIM, with intervals.

  blurnoise quality -o quality                                    the built-in camera at 5, 50 and 500 lux
  blurnoise quality -o quality --camera mine.yaml --lux 20 --dx 0,100

Writes DIR/quality.csv (a row per condition and metric), DIR/quality.json, and per setting two pictures in
DIR/figures: every metric against exposure, a line per speed, and against blur, a line per exposure. Where a
number cannot be told (saturated, lost in noise, blurred beyond its chart) there is none, and the flags say why.
"""
USUAL = {
    "exposure_s": tuple(ms / 1e3 for ms in (0.5, 1, 2, 5, 10, 15, 20, 30, 45, 60, 90)),
    "illuminance_lux": (5.0, 50.0, 500.0),
}
"""What is tested unless told, where a sweep's defaults are not it."""


def add_options(quality: argparse.ArgumentParser, numbers: Callable[[str], list[float]]) -> None:
    """Everything but the camera and ``--json``; ``numbers`` parses a list."""
    grid = quality.add_argument_group("conditions, each as 1,5,10 or start:stop:step (stop included)")
    add_axes(grid, numbers, USUAL)
    grid.add_argument(
        "--repeats", type=int, default=2, metavar="N", help="noise fields per chart (default 2)"
    )
    grid.add_argument("--seed", type=int, default=0, metavar="N", help="of the noise (default 0)")
    quality.add_argument(
        "--threads", type=int, metavar="N", help="conditions at a time (default: every core)"
    )
    quality.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="for everything")
