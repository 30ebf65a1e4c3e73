"""What ``blurnoise quality`` understands."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

ABOUT = """\
What exposure, light and motion do to a camera's picture, in numbers: on simulated charts MTF50, edge SNR, CNR,
patch SNR, information capacity, NEQ, SNRI, Michelson contrast, CDP, PSNR and SSIM, with intervals.

  blurnoise quality -o quality                                    the built-in camera at 5, 50 and 500 lux
  blurnoise quality -o quality --camera mine.yaml --lux 20 --dx 0,100

Writes DIR/quality.csv (a row per condition and metric), DIR/quality.json, and per light two pictures in
DIR/figures: every metric against exposure, a line per speed, and against blur, a line per exposure. Where a
number cannot be told (saturated, lost in noise, blurred beyond its chart) there is none, and the flags say why.
"""
_LISTS = (
    ("--exposure-ms", "0.5,1,2,5,10,15,20,30,45,60,90", "exposure times, ms"),
    ("--lux", "5,50,500", "light on the charts, lux"),
    ("--dx", "0,200,500,1000", "motion to the right, px/s"),
    ("--dy", "0", "motion down, px/s"),
)


def add_options(quality: argparse.ArgumentParser, numbers: Callable[[str], list[float]]) -> None:
    """Everything but the camera and ``--json``; ``numbers`` parses a list."""
    grid = quality.add_argument_group("conditions, each as 1,5,10 or start:stop:step (stop included)")
    for name, usual, about in _LISTS:
        grid.add_argument(
            name, type=numbers, default=numbers(usual), metavar="LIST", help=f"{about} (default {usual})"
        )
    grid.add_argument(
        "--repeats", type=int, default=2, metavar="N", help="noise fields per chart (default 2)"
    )
    grid.add_argument("--seed", type=int, default=0, metavar="N", help="of the noise (default 0)")
    grid.add_argument(
        "--temperature-c", type=float, default=25.0, metavar="C", help="of the sensor, degC (default 25)"
    )
    quality.add_argument(
        "--threads", type=int, metavar="N", help="conditions at a time (default: every core)"
    )
    quality.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="for everything")
