"""What ``blurnoise measure`` understands."""

from __future__ import annotations

import argparse
from pathlib import Path

ABOUT = """\
Measure the slanted edges of a picture: MTF50 and its kin, CNR and edge SNR, contrast, information capacity (SIC),
noise-equivalent quanta (NEQ) and an ideal observer's SNR (SNRI), each with a 95 % interval.

  blurnoise measure chart.png                             finds the edges by itself
  blurnoise measure raw.png --black-level 40 --full-scale 4095 --plot edges.png --csv edges.csv
  blurnoise measure photo.jpg --roi 410,96,80,120         this region: left, top, width, height, px

Where a number cannot be told (clipped, blurred beyond the region, two edges) there is a dash and the reason.
SIC radial takes the blur for the same in all directions. SIC square and the NEQ sum cover the square of all
frequencies: with the nearest edge across the other axis, or without one as if the blur were the same both ways.
NEQ is that of the bright side; it needs no gain, which cancels, but the black level.
"""


def region(text: str) -> tuple[int, int, int, int]:
    """Parse "x,y,w,h". Raises ``ArgumentTypeError``."""
    try:
        left, top, width, height = (int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: must be x,y,w,h, four whole numbers of px") from None
    return left, top, width, height


def add_options(measure: argparse.ArgumentParser) -> None:
    """Everything but ``--json``."""
    measure.add_argument("image", type=Path, metavar="IMAGE", help="8- or 16-bit, grey or colour")
    measure.add_argument(
        "--roi", type=region, action="append", metavar="X,Y,W,H",
        help="a region, px, instead of those found; may be given several times",
    )  # fmt: skip
    measure.add_argument(
        "--mode", choices=("exact", "iso"), default="exact",
        help="exact: a spline through every pixel (default); iso: the steps of ISO 12233, with their errors",
    )  # fmt: skip
    coding = measure.add_mutually_exclusive_group()
    for name, about in (
        ("linear", "the numbers are linear in light (default for 16 bits)"),
        ("srgb", "the numbers are sRGB-coded (default for 8 bits)"),
    ):
        coding.add_argument(
            f"--{name}", dest="coding", action="store_const", const=name, default="auto", help=about
        )
    measure.add_argument("--black-level", type=float, metavar="DN", help="of no light (default 0)")
    measure.add_argument(
        "--full-scale", type=float, metavar="DN", help="the most a pixel can hold (default: all bits set)"
    )
    measure.add_argument(
        "--target-size",
        type=int,
        default=10,
        metavar="PX",
        help="side of SNRI's square, 1 to 64 (default 10)",
    )
    measure.add_argument(
        "--target-contrast", type=float, default=0.1, metavar="C",
        help="of SNRI's square to the region's mean level (default 0.1)",
    )  # fmt: skip
    measure.add_argument(
        "--plot", type=Path, metavar="OUT.png",
        help="draw the regions, and of the first four edge, ESF, LSF and SFR; or .pdf, .svg",
    )  # fmt: skip
    measure.add_argument("--csv", type=Path, metavar="OUT.csv", help="a row per region, for pandas")
