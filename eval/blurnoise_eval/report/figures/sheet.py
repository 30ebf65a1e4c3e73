"""What the models saw: example pictures with boxes, or with the text that was read."""

from __future__ import annotations

import math

from matplotlib.figure import Figure

from blurnoise_eval.drawing.annotate import OTHER_SCORE, drawn_example, short_text
from blurnoise_eval.report.captions import outcome_text
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.figures.panels import MAX_COLUMNS
from blurnoise_eval.report.measured import spread_examples

MAX_EXAMPLES = 12


def contact_sheet(data: RunData) -> Figure:
    """Example pictures with their boxes: green found, dashed orange missed, thin blue other detections."""
    threshold = data.found_from
    chosen = spread_examples(data, MAX_EXAMPLES)
    drawn = [drawn_example(example, 640, threshold) for example in chosen]
    columns = min(MAX_COLUMNS, max(1, len(chosen)))
    rows = max(1, math.ceil(len(chosen) / columns))
    tallest = max(
        (picture.shape[0] / picture.shape[1] for picture in drawn if picture is not None), default=0.7
    )
    figure = Figure(figsize=(3.4 * columns + 0.2, (3.4 * tallest + 0.5) * rows + 0.4), layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in grid:
        axes.set_axis_off()
    several = len(data.manifest["models"]) > 1
    for axes, example, picture in zip(grid, chosen, drawn, strict=False):
        if picture is None:
            axes.text(0.5, 0.5, "picture file is missing", ha="center", transform=axes.transAxes)
        else:
            axes.imshow(picture, interpolation="antialiased")
        lines = [data.settings.condition_text(example), short_text(outcome_text(example, threshold), 52)]
        title = "\n".join([short_text(example["model"], 52), *lines] if several else lines)
        axes.set_title(title, fontsize=8, parse_math=False)
    legend = (
        f"green: target at or above {threshold:g}; dashed orange: target below; "
        f"thin blue: other detections from {OTHER_SCORE:g}"
    )
    if len(chosen) < len(data.examples):
        legend += f". {len(chosen)} of {len(data.examples)} examples shown"
    figure.supxlabel(legend if chosen else "No example pictures were kept.", fontsize=9)
    return figure
