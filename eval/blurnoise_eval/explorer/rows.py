"""A row of the page's side: a control with its number to type, and its slider or its choices."""

from __future__ import annotations

import math
from collections.abc import Callable
from html import escape
from typing import Protocol

from nicegui import events, ui
from nicegui.elements.mixins.value_element import ValueElement

from blurnoise_eval.explorer.controls import STEPS, Control
from blurnoise_eval.explorer.state import State
from blurnoise_eval.grid.axes import AUTOMATIC

_EVERY_S = 0.02


class Moved(Protocol):
    """Who is told of what the visitor does to a row, by the control's name."""

    def slid(self, name: str, position: float) -> None:
        """The slider stands elsewhere."""

    def typed(self, name: str, text: str) -> None:
        """A number, or "auto", was typed."""

    def chosen(self, name: str, place: float) -> None:
        """One of its choices."""

    def automatic(self, name: str) -> None:
        """Left to the camera, or taken back from it."""


class _Slider(ValueElement[float | None]):
    """NiceGUI's slider, which tells more often where it stands."""

    def __init__(self, moved: Callable[[events.ValueChangeEventArguments[float | None]], None]) -> None:
        super().__init__(tag="q-slider", value=0, on_value_change=moved, throttle=_EVERY_S)
        self.props(f":min=0 :max={STEPS} :step=1")


class Row:
    """One control on the page; key: that moves it."""

    def __init__(self, control: Control, key: str, told: Moved) -> None:
        self.control = control
        name = control.name
        self._auto: ui.button | None = None
        self._choice: ui.select | None = None
        with ui.element("div").classes("control").props(f"data-control={name}") as self._element:
            with ui.element("div").classes("line"):
                shortcut = f"<kbd>{key}</kbd>" if key else ""
                ui.html(f"{escape(control.title)}{shortcut}", sanitize=False).classes("name")
                if control.choices:
                    self._choice = ui.select(dict(enumerate(control.choices)), value=0)
                    self._choice.on_value_change(lambda e: told.chosen(name, float(e.value)))
                    self._choice.props(f'dense outlined options-dense aria-label="{control.title}"')
                    return
                if control.automatic:
                    self._auto = ui.button("auto", on_click=lambda: told.automatic(name)).props("flat dense")
                    self._auto.classes("auto")
                unit = f'suffix="{control.unit}" ' if control.unit else ""
                self._number = ui.input().props(
                    f'dense outlined {unit}aria-label="{control.title}, {control.unit}"'
                )
                self._number.on("change", lambda: told.typed(name, str(self._number.value)))
            self._slider = _Slider(lambda e: None if e.value is None else told.slid(name, e.value))
            self._slider.props(f'aria-label="{control.title}"')

    def stand(self, state: State, value: float) -> None:
        """Stand where the state is."""
        self._element.classes(**({"add": "last"} if state.along == self.control.name else {"remove": "last"}))
        if self._choice is not None:
            self._choice.set_value(int(value))
            return
        automatic = value == AUTOMATIC
        self._element.classes(**({"add": "set"} if automatic else {"remove": "set"}))
        if self._auto is not None:
            self._auto.props("color=primary" if automatic else "color=grey")
        self._number.set_value("auto" if automatic else f"{value:.4g}" if math.isfinite(value) else "")
        if not automatic and math.isfinite(value):
            place = round(self.control.position(value))
            if self._slider.value is None or abs(self._slider.value - place) >= 1:
                self._slider.set_value(place)
