"""A figure's panels, one per model, target group and setting, and what they share: title, legend, notes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from blurnoise_eval.drawing.annotate import short_text
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.measured import largest_groups, spread, unseen_below
from blurnoise_eval.report.settings import Setting, Settings
from blurnoise_eval.report.words import title_text

MAX_PANELS = 12
MAX_COLUMNS = 4
MAX_LINES = 10
Key = tuple[str, str, Setting]  # model, group, setting


@dataclass(frozen=True)
class Panels:
    """A figure, its axes by (model, group, setting), what was left out, and what values are shown."""

    figure: Figure
    axes: dict[Key, Axes]
    notes: list[str]
    shown: str

    def __iter__(self) -> Iterator[tuple[Key, Axes]]:
        return iter(self.axes.items())

    def finish(
        self, x_label: str, legend_title: str, notes: Sequence[str], entries: Sequence[Patch] = ()
    ) -> Figure:
        """The figure with its labels, its notes and one legend for all panels."""
        if not self.axes:
            return self.figure
        self.figure.supxlabel("\n".join([x_label, *self.notes, *notes]), fontsize=9)
        self.figure.supylabel(f"{self.shown} (dashed: what is asked)", fontsize=9)
        handles, _ = next(iter(self.axes.values())).get_legend_handles_labels()
        every = [*handles, *entries]
        self.figure.legend(
            handles=every, title=legend_title, loc="outside upper center", fontsize=8, title_fontsize=8,
            ncols=min(len(every), 3 if len(self.axes) == 1 else 6), frameon=False,
        )  # fmt: skip
        return self.figure


def panels(data: RunData, settings: Settings, most: int = MAX_PANELS) -> Panels:
    """At most so many empty panels: a row of settings per target group, first of all groups of one model, then of the
    next."""
    models = list(dict.fromkeys(answer["model"] for answer in data.answers))
    shown_models = models[:most]
    rows_left = most // max(1, len(shown_models))
    shown_settings = spread(settings.every, min(MAX_COLUMNS, rows_left) if rows_left > 1 else 1)
    groups = largest_groups(data, rows_left // max(1, len(shown_settings)))
    asked = {(answer["model"], answer["group"]) for answer in data.answers}
    keys = [
        (model, group, at)
        for model in shown_models for group in groups for at in shown_settings if (model, group) in asked
    ]  # fmt: skip
    columns = len(shown_settings) if len(shown_settings) > 1 else min(3, max(1, len(keys)))
    if len(shown_settings) == 1 < len(shown_models) and 1 < len(groups) <= MAX_COLUMNS:
        columns = len(groups)  # a row for each model
    rows = max(1, math.ceil(len(keys) / columns))
    wide = 3.5 if columns < MAX_COLUMNS else 3.0
    figure = Figure(figsize=(max(5.0, wide * columns) + 0.4, 2.7 * rows + 1.5), layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False, sharey=True).flat)
    for axes in grid[len(keys) :]:
        axes.set_axis_off()
    if not keys:
        grid[0].text(0.5, 0.5, "No targets in these pictures.", ha="center", transform=grid[0].transAxes)
    counts = {
        "models": (len(shown_models), len(models)),
        "target groups": (len(groups), len({answer["group"] for answer in data.answers})),
        "settings" if settings.further else "light levels": (len(shown_settings), len(settings.every)),
    }
    notes = [f"{shown} of {every} {what} shown." for what, (shown, every) in counts.items() if shown < every]
    if special := settings.special_text(data.manifest["camera"]):
        notes.append(f"Held: {special}.")
    if any(unseen_below(data, model, group) is not None for model, group, _ in keys):
        notes.append("Grey: below the lowest score that leaves the graph.")
    found = Panels(figure, dict(zip(keys, grid, strict=False)), notes, title_text(data.criterion))
    for (model, group, at), axes in found:
        n_targets = max(a["n_targets"] for a in data.answers if (a["model"], a["group"]) == (model, group))
        between = "\n" if settings.further else ", "
        title = f"{short_text(group, 24)}{between}{settings.text(at)} (n = {n_targets})"
        _dress(axes, title if len(models) == 1 else f"{short_text(model, 36)}\n{title}", data.highest)
        if (unseen := unseen_below(data, model, group)) is not None:
            axes.axhspan(-0.03, unseen, color="0.88", lw=0, zorder=0)
        axes.axhline(data.manifest["threshold"], color="0.25", lw=0.9, ls=(0, (4, 3)), zorder=1)
    return found


def _dress(axes: Axes, title: str, highest: float) -> None:
    axes.set_title(title, fontsize=9, parse_math=False)
    axes.set_ylim(-0.03, 1.03 * highest)
    axes.set_yticks([0, 0.2, 0.4, 0.6, 0.8, 1.0])
    axes.grid(color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
