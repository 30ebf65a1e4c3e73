"""What exposure and gain make of the pictures: gain, signal to noise and brightness, each by itself.

So that a picture that is dark can be told from one that is noisy.
"""

from __future__ import annotations

from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from blurnoise_eval.grid.axes import milliseconds, velocity_of
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.figures.panels import MAX_LINES
from blurnoise_eval.report.measured import finite

_PANELS = (
    ("applied_gain_db", "Gain / dB"),
    ("snr_db", "SNR of the mean light / dB"),
    ("brightness", "Mean of the picture, 0-1"),
    ("saturated", "Share of saturated pixels"),
)


def gain_snr_brightness(data: RunData) -> Figure:
    """A panel each over exposure, a line per setting, at the slowest motion: means over the pictures."""
    figure = Figure(figsize=(3.3 * len(_PANELS), 3.6), layout="constrained")
    grid = figure.subplots(1, len(_PANELS), squeeze=False)[0]
    every = data.settings.every
    shown = every[:: max(1, -(-len(every) // MAX_LINES))]
    colours = colormaps["viridis"]
    first = data.manifest["models"][0]["name"]
    slowest = data.velocities_px_s[0] if data.velocities_px_s else None
    rows = [
        row
        for row in data.scores
        if not row["clean"] and row["model"] == first and velocity_of(row) == slowest
    ]
    for axes, (name, label) in zip(grid, _PANELS, strict=True):
        for place, setting in enumerate(shown):
            line = [
                (1e3 * row["exposure_s"], value)
                for row in rows
                if data.settings.of(row) == setting and (value := finite(row.get(name))) is not None
            ]
            colour = colours(0.05 + 0.85 * place / max(1, len(shown) - 1))
            if line:
                told = {"color": colour, "label": data.settings.text(setting)}
                axes.plot(*zip(*sorted(line), strict=True), "o-", ms=3, lw=1.4, **told)
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(lambda ms, _: milliseconds(ms / 1e3)))
        axes.xaxis.set_minor_formatter(FuncFormatter(lambda ms, _: ""))
        axes.set_xlabel("Exposure / ms", fontsize=9)
        axes.set_title(label, fontsize=9)
        axes.grid(color="0.9", lw=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    handles, labels = grid[0].get_legend_handles_labels()
    if handles:
        columns = min(4, len(labels))
        figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize=8, frameon=False)
    return figure
