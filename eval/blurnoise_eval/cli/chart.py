"""``blurnoise chart``: render a test chart."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from typer import Argument, Option

from blurnoise_eval.cli._options import PictureWritten
from blurnoise_eval.system.terminal import say

Kind = Literal["slanted-edge", "siemens-star", "stop-sign", "flat-patch"]
CHARTS: tuple[str, ...] = get_args(Kind)


def chart(
    kind: Annotated[Kind, Argument(metavar="KIND", help="kind of chart")],
    *,
    output: PictureWritten,
    size: Annotated[float, Option(metavar="PX", help="size of the star or the sign, px")] = 100.0,
    width: Annotated[int, Option(metavar="PX", help="width of the picture, px")] = 320,
    height: Annotated[int, Option(metavar="PX", help="height of the picture, px")] = 320,
    angle: Annotated[
        float | None,
        Option(metavar="DEG", help="rotation, degrees, counter-clockwise (default: 5 for the edge, else 0)"),
    ] = None,
    bit_depth: Annotated[Literal["8", "16"], Option(help="bit depth of the sRGB PNG")] = "8",
) -> None:
    """Render a test chart from its geometry.

      blurnoise chart stop-sign --size 50 -o sign.png
      blurnoise chart slanted-edge --bit-depth 16 -o edge.png

    In Python, the functions of blurnoise.charts return the charts as linear reflectance.
    """
    from blurnoise import charts
    from blurnoise._core.checks import limited
    from blurnoise.camera.colour import srgb_from_linear
    from blurnoise_eval.datasets import write_picture

    angle_deg = angle if angle is not None else (5.0 if kind == "slanted-edge" else 0.0)
    limited("size", size, "size_px")
    limited("angle", angle_deg, "angle_deg")
    if kind == "slanted-edge":
        linear = charts.slanted_edge(height, width, angle_deg=angle_deg)
    elif kind == "siemens-star":
        linear = charts.siemens_star(size, height_px=height, width_px=width, angle_deg=angle_deg)
    elif kind == "stop-sign":
        linear = charts.stop_sign(size, height_px=height, width_px=width, angle_deg=angle_deg)
    else:
        linear = charts.flat_patch(height, width)
    full_scale, dtype = (255, "uint8") if bit_depth == "8" else (65535, "uint16")
    coded = (
        srgb_from_linear(linear.double()).mul(full_scale).round()[0].permute(1, 2, 0).numpy().astype(dtype)
    )
    write_picture(output, coded[..., 0] if coded.shape[2] == 1 else coded)
    say(output)
