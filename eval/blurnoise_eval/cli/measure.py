"""``blurnoise measure``: image quality of a captured chart or video, or of simulated charts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from blurnoise_eval.cli import inputs
from blurnoise_eval.cli._options import (
    BlackLevel,
    CodingOfPicture,
    FullScale,
    Json,
    Region,
    new_folder,
    region,
    settings,
)
from blurnoise_eval.plan.axes import AXES, with_defaults
from blurnoise_eval.plan.files import PlanFile
from blurnoise_eval.plan.lamps import pwm_of
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.settings import Text, nested, setting
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json, show, width

if TYPE_CHECKING:
    from collections.abc import Sequence

    from blurnoise_eval.measure.captured import Captured
    from blurnoise_eval.measure.edges import MeasuredEdge

_LABEL_WIDTH, _REGION_WIDTH, _PIPE_WIDTH = 24, 28, 80  # of the table's columns, in characters


@dataclass(frozen=True, kw_only=True)
class ChartPlan(SweepPlan):
    """A plan with this command's defaults of axes and repeats."""

    AXES = with_defaults(
        [  # the charts have no common mean to meter, so nothing is automatic
            replace(axis, automatic=False, about=axis.about.partition("; auto")[0]) for axis in AXES
        ],
        exposure_s=[ms / 1e3 for ms in (0.5, 1, 2, 5, 10, 15, 20, 30, 45, 60, 90)],
        illuminance_lux=(5, 50, 500),
        velocity_x_px_s=(0, 200, 500, 1000),
        velocity_y_px_s=(0,),
        gain_db=(0,),
    )

    LIGHTS = ()

    repeats: int = setting(2, "number of repeats with other noise (default: 1; 2 for charts)")


@dataclass(frozen=True)
class ChartFile(PlanFile):
    """A plan's file with this command's plan and camera."""

    plan: ChartPlan = nested(ChartPlan)
    camera: Text | None = setting(None, "a preset or a camera file (default: imx250m)", "NAME|FILE")


@settings(
    ChartFile, "camera", "exposure_ms", "lux", "light", "illuminant", "dx", "dy", "gain", template=False
)
def measure(
    image: Annotated[
        Path | None,
        Argument(
            metavar="IMAGE",
            help="8- or 16-bit picture of a chart; for flicker a video, or a folder of frames (default: simulated "
            "charts)",
        ),
    ] = None,
    *,
    of: Annotated[
        Literal["edges", "star", "glare", "flicker"],
        Option(
            help="what to measure: slanted edges; the Siemens star in --roi; glare, with a --roi of a light trap and "
            "one of the white field; flicker of the lamp in --roi, and with one of the scene without it, detection"
        ),
    ] = "edges",
    output: Annotated[
        Path | None,
        Option("-o", "--output", parser=new_folder, metavar="DIR", help="folder for tables and figures"),
    ] = None,
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
    coding: CodingOfPicture = "auto",
    black_level: BlackLevel = None,
    full_scale: FullScale = None,
    oecf: Annotated[
        Path | None,
        Option(
            metavar="FILE.csv",
            help="response curve of the camera from a grey scale; each line: digital number, light",
        ),
    ] = None,
    target: Annotated[
        str | None,
        Option(
            metavar="PX,CONTRAST",
            help="target square for SNRI: side, 1 to 64 px, and contrast to the mean level (default: 10,0.1)",
        ),
    ] = None,
    config: ChartFile,
    as_json: Json = False,
) -> None:
    """Measure image quality at the slanted edges of a picture, of another chart, or of simulated charts over
    exposure, light and motion. Each value has a 95 % interval.

      blurnoise measure chart.png                          detects the edges
      blurnoise measure photo.jpg --roi 410,96,80,120      measures one region
      blurnoise measure raw.png --black-level 40 --full-scale 4095 -o edges
      blurnoise measure clip.avi --of flicker --roi 300,80,20,20
      blurnoise measure -o quality --camera mine.yaml --lux 20 --dx 0,100

    Edges: MTF50 and related metrics, acutance, CNR and edge SNR, contrast, information capacity (SIC),
    noise-equivalent quanta (NEQ) and the SNR of an ideal observer (SNRI). With -o, the command writes DIR/edges.csv,
    .json and .png.

    A dash with a reason replaces a value that cannot be measured: the edge is clipped, blurred beyond its region, or
    one of two edges in the region. A question mark marks a value that may be wrong; the reason is below the table.

    Some processing cannot be detected from a single edge: a tone curve that is symmetric about the middle of the
    edge, mild sharpening (amount up to 0.3) of an edge with sigma 1 px or more, and median or bilateral filters. For
    the tone curve, use --oecf or edges with another contrast.

    SIC radial assumes the same blur in all directions. SIC square and the NEQ sum integrate over the square of all
    frequencies. They use the nearest edge of the other orientation; if there is none, they assume the same blur in
    both directions. NEQ refers to the bright side of the edge. It does not need the gain, but the black level.

    Simulated charts (without IMAGE): the same metrics, patch SNR, contrast transfer accuracy (CTA), veiling glare,
    MTF50 of a star, PSNR and SSIM; where the plan has a pulsed lamp (pwm) that lights them, also its flicker. Each
    chart is simulated with two noise fields, or with as many as 'repeats' of the plan says. The command writes
    DIR/quality.csv (one row per condition and metric) and DIR/quality.json. For each light it draws a figure in
    DIR/figures: the metrics against exposure, one line per speed. Where a value is not available (saturated, lost in
    noise, blurred beyond the chart), its flags give the reason. Headlamps of --light do not light charts.
    """
    of_edges: dict[str, Any] = {"mode": None if mode == "exact" else mode, "target": target}
    of_image: dict[str, Any] = {"roi": roi, "of": None if of == "edges" else of, **of_edges}
    of_image |= {"coding": None if coding == "auto" else coding, "black_level": black_level}
    of_image |= {"full_scale": full_scale, "oecf": oecf}
    if image is None:
        inputs.refuse_unused(of_image, "IMAGE")
        if output is None:
            raise ValueError("output: is missing; set -o DIR, or IMAGE to measure a picture")
        _measure_charts(config, output, as_json)
        return
    usual = ChartFile.of({})
    changed: dict[str, Any] = {
        axis.key: config.plan.values(axis.name) != usual.plan.values(axis.name) or None
        for axis in ChartPlan.AXES
    }
    changed["light"] = config.plan.light or None
    changed["camera"] = config.camera
    changed["plan"] = config != usual or None if not any(changed.values()) else None  # of what has no option
    inputs.refuse_unused(changed, "simulated charts, so no IMAGE")
    if of != "edges":
        inputs.refuse_unused(of_edges, "--of edges")
    from blurnoise.metrics.edge.response import ISO_EDITION
    from blurnoise_eval.calibration.tone import read_oecf
    from blurnoise_eval.datasets import decode
    from blurnoise_eval.measure import captured, edges
    from blurnoise_eval.measure.figures import draw_regions
    from blurnoise_eval.measure.linear import linear
    from blurnoise_eval.system.files import check_outputs, write_figure, write_records

    square = edges.TargetSquare.parse(target) if target else edges.TargetSquare()
    if output:
        check_outputs(output, f"{of}.csv", f"{of}.json", *(["edges.png"] if of == "edges" else []))
    curve = read_oecf(oecf) if oecf else None
    light = partial(linear, coding=coding, black_level=black_level, full_scale=full_scale, oecf=curve)
    if of == "flicker":
        _say_captured(captured.flickering(image, light, roi or []), of, image, output, as_json)
        return
    picture = light(decode(image))
    if of in ("star", "glare"):
        seen = captured.star(picture, roi or []) if of == "star" else captured.glare(picture, roi or [])
        _say_captured(seen, of, image, output, as_json)
        say(*picture.notes, error=True)
        return
    notes = [*picture.notes, *([f"iso: {ISO_EDITION}"] if mode == "iso" else [])]
    regions = edges.measure(picture, roi or edges.detected_regions(picture), mode=mode, target=square)
    rows = [edge.row() for edge in regions]
    facts = {"image": str(image), "mode": mode, "unit": picture.unit, "target": vars(square)}
    document = {**facts, "notes": notes, "regions": rows}
    if output:
        output.mkdir(parents=True, exist_ok=True)
        write_records("edges", rows, document, output)
        write_figure(output / "edges.png", draw_regions(picture, regions), dpi=110)
    if as_json:
        say_json(document)
        return
    _say_table(regions, f"of {square.size_px} px, {100 * square.contrast:g} %")
    say(*notes, error=True)
    say(*(output / name for name in ("edges.csv", "edges.png") if output))


def _say_captured(seen: Captured, of: str, image: Path, output: Path | None, as_json: bool) -> None:
    """Write and print what a chart or a video shows."""
    from blurnoise_eval.measure.edges import estimate_text
    from blurnoise_eval.system.files import write_records

    document = {"image": str(image), "of": of, **seen.document()}
    if output:
        output.mkdir(parents=True, exist_ok=True)
        write_records(of, seen.rows, document, output)
    if as_json:
        say_json(document)
        return
    for title, number in seen.numbers.items():
        flags = f"  [{', '.join(sorted(number.flags))}]" if number.flags else ""
        say(f"{title}: {estimate_text(number)}{flags}")
        if "no_star" in number.flags:
            say(f"{image}: no star fills the region; state it with --roi X,Y,WIDTH,HEIGHT", error=True)
    say(*([output / f"{of}.csv"] if output else []))


def _measure_charts(config: ChartFile, output: Path, as_json: bool) -> None:
    camera = inputs.camera(config.camera, config.cfa, colour=False)
    workers = inputs.threads(config.threads)
    from blurnoise_eval.measure import charts
    from blurnoise_eval.measure.figures import write
    from blurnoise_eval.system.files import check_outputs

    plan = config.plan
    charts.check(camera, plan)
    check_outputs(output, "quality.csv", "quality.json", "figures/exposure-*.png")
    output.mkdir(parents=True, exist_ok=True)
    with ProgressBar("measure", len(plan.conditions())) as advance:
        rows = charts.measure(
            camera,
            plan.conditions(),
            repeats=plan.repeats,
            seed=plan.seed,
            spectrum=plan.own_spectrum,
            lamp=pwm_of(plan.lamps.pwm)[0] if plan.lamps and plan.lamps.pwm else None,
            threads=workers,
            progress=advance,
        )
    charts.write(rows, camera, plan, output)
    figures = write(rows, camera.name, output / "figures")
    if as_json:
        say_json({"output": str(output), "rows": len(rows), "figures": [str(path) for path in figures]})
        return
    say(f"figures: {', '.join(map(str, figures))}")


def _say_table(regions: Sequence[MeasuredEdge], target: str) -> None:
    """Print a column per region, as many side by side as fit, and the warnings below."""
    from rich.table import Table

    from blurnoise_eval.measure.edges import EDGE_METRICS, angle_text, estimate_text, second_text

    side_by_side = max(1, ((width() or _PIPE_WIDTH) - _LABEL_WIDTH) // _REGION_WIDTH)
    for start in range(0, len(regions), side_by_side):
        shown = regions[start : start + side_by_side]
        table = Table("region", *(str(region.number) for region in shown))
        table.add_row("x,y,w,h, px", *(",".join(map(str, region.roi)) for region in shown))
        table.add_row("angle, degrees", *(angle_text(region) for region in shown), end_section=True)
        for metric in EDGE_METRICS:
            label = f"{metric.title} {target}" if metric.name == "snri" else metric.label.replace(" / ", ", ")
            table.add_row(label, *(estimate_text(region.estimates[metric.name]) for region in shown))
        table.add_row("used for square, SNRI", *(second_text(region) for region in shown))
        show(table)
    for edge in regions:
        if edge.doubts:
            say(f"{edge.number}: {'; '.join(edge.doubts)}")
