"""The page's map of a run: mean confidences as buttons."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import ui

from blurnoise_eval.explorer.run import HeatMap, Run
from blurnoise_eval.explorer.state import OF_RUN, State
from blurnoise_eval.grid.axes import Axis

_ABOUT = "The run: mean confidence over its pictures. A cell shows its picture, computed anew from its seed."
Place = tuple[float, float]


class Heat:
    """Built where it is made; ``chosen`` is called with the condition whose cell is clicked, by the axes' names."""

    def __init__(
        self, run: Run, state: State, chosen: Callable[[dict[str, float | None]], Awaitable[None]]
    ) -> None:
        self._run, self._chosen = run, chosen
        self._fixed: dict[str, float] = {}
        self._shown: tuple[str, dict[str, float]] | None = None
        self._cells: dict[Place, ui.element] = {}
        self._map = self._of(state)
        ui.html(_ABOUT, sanitize=False, tag="h2")
        with ui.row():
            for axis in self._map.fixed:
                ui.select(
                    {each: axis.text(each) for each in run.tested(run.models[0])[axis.name]},
                    value=self._map.at[axis.name],
                    label=axis.title,
                    on_change=lambda event, name=axis.name: self._fix(name, event.value),
                ).props("outlined dense").classes("w-44")
        self._table = ui.element("div").classes("heat")
        self._about = ui.label().classes("window")
        self.show(state)

    def show(self, state: State) -> None:
        """The map of the state's model, with its cell pressed."""
        self._state, now = state, (state.model, dict(self._fixed))
        if now != self._shown:
            self._shown, self._map = now, self._of(state)
            self._build()
        for (x, y), button in self._cells.items():
            pressed = bool(state.cell) and self._map.is_at(x, y, state.at)
            button.props(f"aria-pressed={str(pressed).lower()}")

    def _of(self, state: State) -> HeatMap:
        own, models = state.model.removeprefix(f"{OF_RUN}/"), self._run.models
        return self._run.heat_map(own if own in models else models[0], self._fixed)

    def _build(self) -> None:
        found = self._map
        self._table.clear()
        self._cells = {}
        self._table.style(
            f"grid-template-columns: max-content repeat({len(found.columns)}, minmax(42px, 1fr))"
        )
        with self._table:
            for text in ("", *(_plain(found.across, x) for x in found.columns)):
                ui.label(text)
            for y in found.rows:
                ui.label(_plain(found.down, y))
                for x in found.columns:
                    self._build_cell(x, y)
        down = f"down: {_title(found.down)}; " if found.down else ""
        self._about.set_text(f"{down}across: {_title(found.across)}")

    def _build_cell(self, x: float, y: float) -> None:
        mean = self._map.mean(x, y)
        if mean is None:
            ui.label("")
            return
        button = ui.element("button").classes("cell" + " deep" * (mean > 0.55)).style(f"--mean: {mean:.3f}")
        at = ", ".join(
            axis.text(value) for axis, value in ((self._map.across, x), (self._map.down, y)) if axis
        )
        button.props(f'type=button aria-label="{at}: {mean:.2f}" title="{at}"')
        button.on("click", partial(self._chosen, self._map.condition(x, y)), args=[])
        with button:
            ui.label(f"{mean:.2f}")
        self._cells[x, y] = button

    def _fix(self, name: str, value: float) -> None:
        self._fixed[name] = value
        self.show(self._state)


def _plain(axis: Axis | None, value: float) -> str:
    if axis is None:
        return ""
    return axis.text(value) if axis.choices or math.isinf(value) else f"{axis.shown(value):.4g}"


def _title(axis: Axis) -> str:
    return f"{axis.title}, {axis.unit}".removesuffix(", ")
