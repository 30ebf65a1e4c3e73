"""The page's side: a row for every control, what picture, camera and model there are, and uploads."""

from __future__ import annotations

from typing import Any, Protocol

from nicegui import ui

from blurnoise_eval.explorer.controls import Control, controls
from blurnoise_eval.explorer.rows import Moved, Row
from blurnoise_eval.explorer.shelf import Shelf
from blurnoise_eval.explorer.state import OF_RUN, State
from blurnoise_eval.grid.axes import MOVES

KEYS = {"e": "exposure_s", "l": "illuminance_lux", "s": "speed", "g": "gain_db"}
"""Keys that move a control down, and with Shift up."""
_ACCEPTED = {
    "picture": ".png,.jpg,.jpeg,.tif,.tiff,.bmp,.webp,.ppm",
    "camera": ".yaml,.yml,.json",
}


class Told(Moved, Protocol):
    """Who is told of what the visitor does on the side."""

    def selected(self, kind: str, name: str) -> None:
        """Another picture, camera or model."""


class Side:
    """Built where it is made. uploads: the URL of uploads, less their kind. It tells ``told`` of what the visitor
    does, not of what ``stand`` changes."""

    def __init__(self, shelf: Shelf, told: Told, uploads: str) -> None:
        self._shelf, self._told, self._standing = shelf, told, False
        self._rows: dict[str, Row] = {}
        self._rows_of = ""
        with ui.element("section").classes("card conditions"):
            self._conditions = ui.element("div")
        with ui.element("section").classes("card tools"):
            self._build_tools(uploads)
        with (
            ui.element("section").classes("card fold"),
            ui.expansion("The camera's own figures").props("dense"),
        ):
            self._figures = ui.element("div").classes("w-full")

    def control(self, name: str) -> Control | None:
        """The control of a row."""
        row = self._rows.get(name)
        return row.control if row else None

    def stand(self, state: State) -> None:
        """Put everything where the state is. Raises ``ValueError`` for a camera that is not there."""
        self._standing = True
        try:
            self._make_rows(state)
            camera = self._shelf.camera(state)
            for row in self._rows.values():
                row.stand(state, row.control.read(state, camera))
            for kind, select in self._selects.items():
                if getattr(state, kind) in select.options:
                    select.set_value(getattr(state, kind))
        finally:
            self._standing = False

    def fill(self) -> None:
        """What there is to select, anew."""
        self._standing = True
        for kind, titles in self._titles().items():
            self._selects[kind].set_options(titles)
        self._standing = False

    def _titles(self) -> dict[str, dict[str, str]]:
        shelf = self._shelf
        return {"picture": shelf.pictures(), "camera": shelf.cameras(), "model": shelf.models()}

    def _make_rows(self, state: State) -> None:
        """Ranges follow the camera; parts move apart only in pictures that say what their targets are."""
        apart = state.picture.startswith(("sign-", f"{OF_RUN}/"))
        if self._rows_of == f"{state.camera} {apart}":
            return
        self._rows_of = f"{state.camera} {apart}"
        self._conditions.clear()
        self._figures.clear()
        keys = {name: key for key, name in KEYS.items()}
        self._rows = {}
        for each in controls(self._shelf.base_camera(state.camera)):
            if each.name == MOVES.name and not apart:
                continue
            with self._conditions if each.group == "Conditions" else self._figures:
                self._rows[each.name] = Row(each, keys.get(each.name, ""), self)

    def _build_tools(self, uploads: str) -> None:
        self._selects: dict[str, Any] = {}
        for kind, titles in self._titles().items():
            select = ui.select(titles, label=kind.capitalize())
            select.on_value_change(lambda e, kind=kind: self._select(kind, e.value))
            self._selects[kind] = select.props("outlined dense options-dense").classes("w-full")
        with ui.element("div").classes("uploads"):
            for kind, accepted in _ACCEPTED.items():
                button = ui.button(kind.capitalize(), icon="upload").props("outline dense no-caps size=sm")
                button.props(f'aria-label="Upload a {kind}" title="Upload a {kind}"')
                button.on("click", js_handler=f"() => document.querySelector('.upload-{kind}').click()")
                chosen = ui.element("input").props(
                    f'type=file accept="{accepted}" tabindex=-1 aria-hidden=true'
                )
                chosen.classes(f"hidden-upload upload-{kind}")
                chosen.on("change", js_handler=f"e => explorer.upload({uploads + kind!r}, e.target)")

    # -- what rows tell, passed on unless it is this side's own doing ----------------------------------------

    def slid(self, name: str, position: float) -> None:
        """As :class:`Moved` has it; so the others."""
        if not self._standing:
            self._told.slid(name, position)

    def typed(self, name: str, text: str) -> None:
        """A number was typed."""
        if not self._standing:
            self._told.typed(name, text)

    def chosen(self, name: str, place: float) -> None:
        """A choice was made."""
        if not self._standing:
            self._told.chosen(name, place)

    def automatic(self, name: str) -> None:
        """Left to the camera, or taken back."""
        self._told.automatic(name)

    def _select(self, kind: str, name: str | None) -> None:
        if not self._standing and name:
            self._told.selected(kind, name)
