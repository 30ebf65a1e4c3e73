"""``blurnoise measure``: measure the slanted edges of a picture; table, CSV, JSON or plot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Option

from blurnoise_eval.cli._options import BlackLevel, FullScale, Json, Linear, Region, Srgb, new_file, region
from blurnoise_eval.system.terminal import say, say_json, show, width

if TYPE_CHECKING:
    from blurnoise_eval.measure.edges import Measured

_LABEL_WIDTH, _REGION_WIDTH, _PIPE_WIDTH = 24, 28, 80  # of the table's columns, in characters


def measure(
    image: Annotated[Path, Argument(metavar="IMAGE", help="8- or 16-bit picture, grey or colour")],
    *,
    roi: Annotated[
        list[Region] | None,
        Option(
            parser=region,
            metavar="X,Y,W,H",
            help="region with one edge: left, top, width, height, px; repeatable (default: edges are detected)",
        ),
    ] = None,
    mode: Annotated[
        Literal["exact", "iso"],
        Option(
            help="exact: a spline fit of all pixels; iso: the algorithm of ISO 12233:2023, with its known errors"
        ),
    ] = "exact",
    linear: Linear = False,
    srgb: Srgb = False,
    black_level: BlackLevel = None,
    full_scale: FullScale = None,
    oecf: Annotated[
        Path | None,
        Option(
            metavar="FILE.csv",
            help="response curve of the camera from a grey scale; each line: digital number, light",
        ),
    ] = None,
    target_size: Annotated[
        int, Option(metavar="PX", help="side of the target square for SNRI, 1 to 64 px")
    ] = 10,
    target_contrast: Annotated[
        float,
        Option(metavar="C", help="contrast of the target square for SNRI to the mean level of the region"),
    ] = 0.1,
    plot: Annotated[
        Path | None,
        Option(
            parser=new_file,
            metavar="OUT.png",
            help="plot the regions, and ESF, LSF and SFR of the first four edges (.png, .pdf or .svg)",
        ),
    ] = None,
    table: Annotated[
        Path | None,
        Option("--csv", parser=new_file, metavar="OUT.csv", help="write a table with one row per region"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure the slanted edges of a picture: MTF50 and related metrics, CNR and edge SNR, contrast, information
    capacity (SIC), noise-equivalent quanta (NEQ) and the SNR of an ideal observer (SNRI). Each value has a 95 %
    interval.

      blurnoise measure chart.png                          detects the edges
      blurnoise measure photo.jpg --roi 410,96,80,120      measures one region
      blurnoise measure raw.png --black-level 40 --full-scale 4095 \\
          --plot edges.png --csv edges.csv

    A dash with a reason replaces a value that cannot be measured: the edge is clipped, blurred beyond its region, or
    one of two edges in the region. A question mark marks a value that may be wrong; the reason is below the table.

    Some processing cannot be detected from a single edge: a tone curve that is symmetric about the middle of the
    edge, mild sharpening (amount up to 0.3) of an edge with sigma 1 px or more, and median or bilateral filters. For
    the tone curve, use --oecf or edges with another contrast.

    SIC radial assumes the same blur in all directions. SIC square and the NEQ sum integrate over the square of all
    frequencies. They use the nearest edge of the other orientation; if there is none, they assume the same blur in
    both directions. NEQ refers to the bright side of the edge. It does not need the gain, but the black level.
    """
    if linear and srgb:
        raise ValueError("linear, srgb: only one of them is allowed")
    from blurnoise.metrics.edge.response import ISO_EDITION
    from blurnoise_eval.calibration.tone import read_oecf
    from blurnoise_eval.datasets import decode
    from blurnoise_eval.measure import edges as measuring
    from blurnoise_eval.measure import linear as linearising
    from blurnoise_eval.system.files import plot_suffix, write_figure, write_whole
    from blurnoise_eval.system.tables import csv_lines

    if plot:
        plot_suffix(plot)  # before anything is measured
    target = measuring.Square(target_size, target_contrast)
    light = linearising.linear(
        decode(image),
        "linear" if linear else "srgb" if srgb else "auto",
        black_level=black_level,
        full_scale=full_scale,
        oecf=read_oecf(oecf) if oecf else None,
    )
    notes = [*light.notes, *([f"iso: {ISO_EDITION}"] if mode == "iso" else [])]
    measured = measuring.measure(light, roi or measuring.found_regions(light), mode=mode, target=target)
    rows = [region.row() for region in measured]
    if table:
        write_whole(table, "".join(csv_lines(list(rows[0]), rows)).encode())
    if plot:
        from blurnoise_eval.measure.figures import draw_regions

        write_figure(plot, draw_regions(light, measured), dpi=110)
    if as_json:
        facts = {"image": str(image), "mode": mode, "unit": light.unit, "target": vars(target)}
        say_json({**facts, "notes": notes, "regions": rows})
        return
    _print(measured, f"of {target.size_px} px, {100 * target.contrast:g} %")
    say(*notes, error=True)
    say(*filter(None, (table, plot)))


def _print(measured: list[Measured], target: str) -> None:
    """Print a column per region, as many side by side as fit, and the warnings below."""
    from rich.table import Table

    from blurnoise_eval.measure.edges import EDGE_METRICS, angle_text, reading_text, second_text

    side_by_side = max(1, ((width() or _PIPE_WIDTH) - _LABEL_WIDTH) // _REGION_WIDTH)
    for start in range(0, len(measured), side_by_side):
        shown = measured[start : start + side_by_side]
        table = Table("region", *(str(region.number) for region in shown))
        table.add_row("x,y,w,h, px", *(",".join(map(str, region.roi)) for region in shown))
        table.add_row("angle, degrees", *(angle_text(region) for region in shown), end_section=True)
        for metric in EDGE_METRICS:
            label = f"{metric.title} {target}" if metric.name == "snri" else metric.label.replace(" / ", ", ")
            table.add_row(label, *(reading_text(region.estimates[metric.name]) for region in shown))
        table.add_row("used for square, SNRI", *(second_text(region) for region in shown))
        show(table)
    for each in measured:
        if each.doubts:
            say(f"{each.number}: {'; '.join(each.doubts)}")
