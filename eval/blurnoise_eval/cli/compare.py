"""``blurnoise compare``: compare a simulated picture of a chart with a real one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument

from blurnoise_eval.cli._options import BlackLevel, FullScale, Json, Linear, Srgb
from blurnoise_eval.system.terminal import say, say_json, table_lines


def compare(
    simulated: Annotated[
        Path, Argument(metavar="SIMULATED", help="picture of the chart, simulated with 'blurnoise simulate'")
    ],
    real: Annotated[
        Path, Argument(metavar="REAL", help="picture of the chart, taken by your camera, of the same size")
    ],
    *,
    linear: Linear = False,
    srgb: Srgb = False,
    black_level: BlackLevel = None,
    full_scale: FullScale = None,
    as_json: Json = False,
) -> None:
    """Compare a simulated picture of a chart with a real one: mean, noise at each level, and sharpness of edges.

      blurnoise compare simulated.png real.png --black-level 64 --full-scale 4095

    For each quantity the table says whether the pictures agree, or differ by more than chance allows. Noise is
    measured in areas that are uniform in both pictures. Align the pictures to a few pixels. Both should be linear:
    simulate with --bit-depth native, and use a raw picture of the camera.
    """
    if linear and srgb:
        raise ValueError("linear, srgb: only one of them is allowed")
    for name, picture in (("simulated", simulated), ("real", real)):
        if picture.is_dir():
            raise ValueError(f"{name} = {str(picture)!r}: is a folder; must be a picture of a chart")
    from blurnoise_eval.datasets import decode
    from blurnoise_eval.measure import pictures

    pair = pictures.pair_of(
        decode(simulated),
        decode(real),
        "linear" if linear else "srgb" if srgb else "auto",
        black_level=black_level,
        full_scale=full_scale,
    )
    quantities, notes = pictures.compare(pair)
    rows = [quantity.row() for quantity in quantities]
    if as_json:
        say_json({"simulated": str(simulated), "real": str(real), "notes": notes, "quantities": rows})
        return
    right = [head in ("simulated", "real", "chance") for head in pictures.HEADS]
    say(*table_lines(pictures.HEADS, [quantity.cells() for quantity in quantities], right))
    say(*notes, error=True)
