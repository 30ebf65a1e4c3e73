"""``python -m blurnoise_eval.gallery``: what ranges of conditions do to a picture."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from blurnoise_eval.cli import run_alone
from blurnoise_eval.cli._options import Json, new_file
from blurnoise_eval.grid.values import Range, bounds
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json

_EXPOSURE_MS, _LUX, _SPEED_PX_S = Range(1, 60), Range(5, 500), Range(0, 1000)


def _range(usual: Range, about: str) -> Any:
    return Option(parser=bounds, metavar="RANGE", show_default=False, help=f"{about} (default: {usual})")


def gallery(
    image: Annotated[Path, Argument(metavar="IMAGE", help="8- or 16-bit, grey or colour, sRGB-coded")],
    *,
    output: Annotated[
        Path, Option("-o", "--output", parser=new_file, metavar="OUT.png", help="or .pdf, .svg")
    ],
    exposure_ms: Annotated[Range, _range(_EXPOSURE_MS, "exposure time, ms")] = _EXPOSURE_MS,
    lux: Annotated[Range, _range(_LUX, "light on the scene, lux")] = _LUX,
    speed: Annotated[Range, _range(_SPEED_PX_S, "motion, px/s")] = _SPEED_PX_S,
    camera: Annotated[
        str,
        Option(metavar="NAME|FILE,...", help="one is drawn for each tile; see 'blurnoise cameras'"),
    ] = "imx250",
    count: Annotated[int, Option(metavar="N", help="tiles beside the picture itself")] = 11,
    seed: Annotated[int, Option(metavar="N", help="of the draws and the noise")] = 0,
    size: Annotated[
        int, Option(metavar="PX", help="a larger picture is shrunk to this longer side, px")
    ] = 480,
    as_json: Json = False,
) -> None:
    """Show what ranges of exposure, light and speed do to a picture, before a network
    is trained on them: draws as the augmentation blurnoise.training.augmentation.RandomExposure
    makes them, one tile each, brightest first.

      python -m blurnoise_eval.gallery photo.jpg -o gallery.png
      python -m blurnoise_eval.gallery photo.jpg -o gallery.png --exposure-ms 1:60 --lux 5:500 \\
          --speed 0:1000 --camera imx250,ar0237 --count 14 --seed 1

    A range is low:high, or a number that stays. Exposure and light are drawn
    log-uniformly: each doubling is as likely as the next. Speeds are px/s of the
    picture as shown, in any direction.
    """
    from blurnoise._core.checks import in_range
    from blurnoise.training.ranges import ExposureRanges
    from blurnoise_eval.cameras import find
    from blurnoise_eval.datasets import decode
    from blurnoise_eval.plots import gallery
    from blurnoise_eval.system.files import plot_suffix, write_figure

    plot_suffix(output)
    in_range("size", size, 16, 1 << 14)
    ranges = ExposureRanges(
        [find(name) for name in camera.split(",")],
        exposure_s=(exposure_ms.low / 1e3, exposure_ms.high / 1e3),
        illuminance_lux=lux,
        speed_px_s=speed,
    )
    scene = gallery.scene(decode(image), size)
    with ProgressBar("gallery", count) as advance:
        tiles = gallery.tiles(scene, ranges, count, seed, advance)
    write_figure(output, gallery.draw(scene, tiles), dpi=gallery.DPI)
    if as_json:
        say_json({"output": str(output), "tiles": [tile.facts() for tile in tiles]})
    else:
        say(output)


if __name__ == "__main__":
    sys.exit(run_alone(gallery, "python -m blurnoise_eval.gallery", sys.argv[1:]))
