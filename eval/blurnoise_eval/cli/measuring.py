"""``blurnoise measure``: the slanted edges of a picture, as a table, CSV, JSON or drawn."""

from __future__ import annotations

import argparse
import csv
import io
import json
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from blurnoise.metrics.estimate import Estimate
    from blurnoise_eval.quality.picture import Measured

_LABEL_WIDTH, _REGION_WIDTH = 24, 28  # of the table's columns, in characters


def measure(options: argparse.Namespace) -> int:
    """Measure the regions given, or those found."""
    from blurnoise_eval.datasets import decode
    from blurnoise_eval.drawing.photon_transfer import plot_suffix
    from blurnoise_eval.quality import picture as measuring
    from blurnoise_eval.system.files import write_whole

    if options.plot:
        plot_suffix(options.plot)  # before anything is measured
    target = measuring.Square(options.target_size, options.target_contrast)
    light = measuring.linear(
        decode(options.image), options.coding, black_level=options.black_level, full_scale=options.full_scale
    )
    rois, passed = (options.roi, ()) if options.roi else measuring.found_regions(light)
    measured = measuring.measure(light, rois, mode=options.mode, target=target)
    notes = [*light.notes, *passed]
    rows = [region.row() for region in measured]
    if options.csv:
        text = io.StringIO()
        writer = csv.DictWriter(text, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        write_whole(options.csv, text.getvalue().encode())
    if options.plot:
        from blurnoise_eval.quality import picture_figures as edge_figures

        edge_figures.write(light, measured, options.plot)
    if options.json:
        facts = {
            "image": str(options.image),
            "mode": options.mode,
            "unit": light.unit,
            "target": {"size_px": target.size_px, "contrast": target.contrast},
            "notes": notes,
            "regions": rows,
        }
        print(json.dumps(facts, allow_nan=False))
        return 0
    from rich.console import Console

    _print(Console(), measured, f"of {target.size_px} px, {100 * target.contrast:g} %")
    for note in notes:
        print(note, file=sys.stderr)
    for path in (options.csv, options.plot):
        if path:
            print(path)
    return 0


def _print(console: Console, measured: list[Measured], target: str) -> None:
    """A column per region, as many side by side as fit, and below them what speaks against the numbers."""
    from rich.table import Table

    from blurnoise_eval.quality.picture import TITLES

    side_by_side = max(1, (console.width - _LABEL_WIDTH) // _REGION_WIDTH)
    for start in range(0, len(measured), side_by_side):
        shown = measured[start : start + side_by_side]
        table = Table("region", *(str(region.number) for region in shown))
        table.add_row("x,y,w,h, px", *(",".join(map(str, region.roi)) for region in shown))
        table.add_row("angle, degrees", *(_angle(region) for region in shown), end_section=True)
        for name, title in TITLES.items():
            label = f"{title} {target}" if name == "snri" else title
            table.add_row(label, *(reading_text(region.estimates[name]) for region in shown))
        table.add_row("square, SNRI with", *(_second(region) for region in shown))
        console.print(table)
    for region in measured:
        if region.doubts:
            console.print(f"{region.number}: {'; '.join(region.doubts)}", highlight=False, markup=False)


def reading_text(reading: Estimate) -> str:
    """'0.09882 (0.0981–0.0995)', or a dash for what cannot be told."""
    if not reading.told:
        return "-"
    return f"{_number(reading.value, 4)} ({_number(reading.low, 3)}–{_number(reading.high, 3)})"


def _number(value: float, digits: int) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.{digits}g}"


def _angle(region: Measured) -> str:
    edge = region.edge
    return "-" if edge.orientation is None else f"{edge.angle_deg:.2f}, bright {edge.bright_side}"


def _second(region: Measured) -> str:
    if region.edge.orientation is None:
        return "-"
    return "same blur both ways" if region.second is None else f"edge {region.second}"
