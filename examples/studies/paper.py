"""Reproduce Lin et al., Optimizing Camera Exposure Time for Automotive Applications, Sensors 2024, 24(16), 5135.

  python examples/studies/paper.py -o paper               all items: minutes
  python examples/studies/paper.py -o paper --quick       one noise field for each condition, not three
  python examples/studies/paper.py -o paper --only sic    one item

Each item is a table or figure of the paper: its statement, the result here, and the rule by which the two agree.
Networks receive pictures as in the paper: grey from coded values, used as light, in linear 8 bits. DIR/paper.csv has
all rows, DIR/ITEM.png the figures. The exit code is 1 if an item does not agree. Text is read with PP-OCR of the
package rapidocr; without it these items are "not run".
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import pandas
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from paper_checks import COLUMNS, Figure
from paper_items import ITEMS, NOT_COMPARED
from paper_measurements import Measurements, pp_ocr


def draw(figures: Sequence[Figure], path: Path) -> None:
    """Draw the figures of an item: lines as measured here, yellow what the paper says."""
    columns = min(len(figures), 2)
    rows = -(-len(figures) // columns)
    drawing = Drawing(figsize=(5.6 * columns, 3.8 * rows), layout="constrained")
    for axes, figure in zip(drawing.subplots(rows, columns, squeeze=False).flat, figures, strict=True):
        for label, curve in figure.lines.items():
            axes.plot(*zip(*curve.items(), strict=True), "o-", ms=3.2, lw=1.4, label=label)
        if min(x for curve in figure.lines.values() for x in curve) > 0:
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.xaxis.set_minor_locator(NullLocator())
        for line, (low, high, what) in enumerate(figure.published):
            axes.axvspan(low, high, color="#e8b000", alpha=0.35, lw=1.6, zorder=0)
            axes.annotate(
                what, (low, 1.0), (0, 3 + 9 * line), xycoords=("data", "axes fraction"),
                textcoords="offset points", fontsize=7.5, color="#7a5c00",
            )  # fmt: skip
        axes.set(xlabel=figure.x_label, ylabel=figure.y_label)
        axes.set_title(figure.title, fontsize=9, pad=6 + 9 * len(figure.published))
        axes.legend(fontsize=7.5, frameon=False)
    drawing.savefig(path, dpi=130)


def main(words: Sequence[str] | None = None) -> int:
    """Run the items; returns 1 where one differs that should agree."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [item.name for item in ITEMS]
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the results"
    )
    parser.add_argument("--only", action="append", choices=names, help="run this item; repeatable")
    parser.add_argument("--quick", action="store_true", help="one noise field for each condition, not three")
    parser.add_argument("--model", type=Path, metavar="M.onnx", help="detector (default: the built-in one)")
    options = parser.parse_args(words)
    options.output.mkdir(parents=True, exist_ok=True)
    measurements = Measurements(options.model, pp_ocr(), repeats=1 if options.quick else 3)
    table = []
    for item in ITEMS:
        if item.name not in (options.only or names):
            continue
        rows, figures = item.run(measurements)
        table += rows
        for row in rows:
            print(f"{row['verdict']:8}  {row['where']}, {row['what']}: {row['result']}")
        if figures:
            draw(figures, options.output / f"{item.name}.png")
    pandas.DataFrame(table, columns=COLUMNS).to_csv(options.output / "paper.csv", index=False)
    for what, why in NOT_COMPARED.items():
        print(f"not compared: {what}: {why}")
    count = Counter(row["verdict"] for row in table)
    print("; ".join(f"{count[verdict]} {verdict}" for verdict in ("agrees", "differs", "not run")))
    return int(count["differs"] > 0)


if __name__ == "__main__":
    sys.exit(main())
