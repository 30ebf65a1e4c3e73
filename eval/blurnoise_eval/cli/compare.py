"""``blurnoise compare``: does the simulator describe my camera?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument

from blurnoise_eval.cli._options import BlackLevel, FullScale, Json, Linear, Srgb
from blurnoise_eval.system.terminal import say, say_json, table_lines


def compare(
    simulated: Annotated[
        Path, Argument(metavar="SIMULATED", help="what 'blurnoise simulate' made of the chart")
    ],
    real: Annotated[Path, Argument(metavar="REAL", help="your camera's picture of it, of the same size")],
    *,
    linear: Linear = False,
    srgb: Srgb = False,
    black_level: BlackLevel = None,
    full_scale: FullScale = None,
    as_json: Json = False,
) -> None:
    """Compare a simulated picture with a real one of the same chart: mean, noise at each level and sharpness of
    slanted edges. Each quantity agrees, or differs by more than chance allows.

      blurnoise compare simulated.png real.png --black-level 64 --full-scale 4095

    Noise is looked for where both pictures are even. Align them to a few pixels. Simulate with --bit-depth native,
    and take the real one raw, so that both are linear.
    """
    if linear and srgb:
        raise ValueError("linear, srgb: must be one of them")
    for picture in (simulated, real):
        if picture.is_dir():
            raise ValueError(f"compare = {str(picture)!r}: is a folder; must be a picture of a chart")
    from blurnoise_eval.datasets import decode
    from blurnoise_eval.quality import comparison

    pair = comparison.pair_of(
        decode(simulated),
        decode(real),
        "linear" if linear else "srgb" if srgb else "auto",
        black_level=black_level,
        full_scale=full_scale,
    )
    quantities, notes = comparison.compare(pair)
    rows = [quantity.row() for quantity in quantities]
    if as_json:
        say_json({"simulated": str(simulated), "real": str(real), "notes": notes, "quantities": rows})
        return
    right = [head in ("simulated", "real", "chance") for head in comparison.HEADS]
    say(*table_lines(comparison.HEADS, [quantity.cells() for quantity in quantities], right))
    say(*notes, error=True)
