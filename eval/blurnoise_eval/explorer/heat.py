"""The page's panel of a run: its heat map, whose cells are buttons."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import events, ui

from blurnoise_eval.explorer import drawn
from blurnoise_eval.explorer.runs import HeatMap, Run
from blurnoise_eval.explorer.state import OF_RUN, State

_CLICK = '(e) => { const cell = e.target.closest("button[data-place]"); if (cell) emit(cell.dataset.place); }'
_ABOUT = "The run: mean confidence over its pictures. A cell shows its picture, computed anew from its seed."


class Heat:
    """Built where it is made; ``chosen`` is told of the condition whose cell is clicked, by the axes' names."""

    def __init__(self, run: Run, state: State, chosen: Callable[[dict[str, float]], None]) -> None:
        self._run, self._state, self._chosen = run, state, chosen
        self._fixed: dict[str, float] = {}
        with ui.element("section").classes("card heat-card"):
            ui.html(_ABOUT, sanitize=False, tag="h2")
            with ui.row().classes("items-center"):
                for axis, value in self._map.fixed:
                    select = ui.select(
                        {each: axis.text(each) for each in run.tested(axis.name)},
                        value=value,
                        label=axis.title,
                    )
                    select.props("outlined dense options-dense").style("min-width: 180px")
                    select.on_value_change(lambda e, name=axis.name: self._fix(name, e.value))
            self._table = ui.html("", sanitize=False).classes("heat-wrap w-full")
            self._table.on("click", self._click, js_handler=_CLICK)
        self.draw(state)

    def draw(self, state: State) -> None:
        """The map, with the cell of the state pressed."""
        self._state = state
        found, at = self._map, state.at
        columns = [place for place, value in enumerate(found.columns) if at[found.across.name] == value]
        down = found.down
        rows = [place for place, value in enumerate(found.rows) if down is None or at[down.name] == value]
        fixed = all(at[axis.name] == value for axis, value in found.fixed)
        seen = bool(state.cell and rows and columns and fixed)
        self._table.set_content(drawn.heat_map(found, f"{rows[0]},{columns[0]}" if seen else ""))

    @property
    def _map(self) -> HeatMap:
        own = self._state.model.removeprefix(f"{OF_RUN}/")
        models = self._run.models
        return self._run.heat_map(own if own in models else models[0], self._fixed)

    def _fix(self, name: str, value: float) -> None:
        self._fixed[name] = value
        self.draw(self._state)

    def _click(self, event: events.GenericEventArguments) -> None:
        found = self._map
        row, _, column = str(event.args).partition(",")
        if not (
            row.isdecimal()
            and column.isdecimal()
            and int(row) < len(found.rows)
            and int(column) < len(found.columns)
        ):
            return
        at = {axis.name: value for axis, value in found.fixed} | {
            found.across.name: found.columns[int(column)]
        }
        if found.down is not None:
            at[found.down.name] = found.rows[int(row)]
        self._chosen(at)
