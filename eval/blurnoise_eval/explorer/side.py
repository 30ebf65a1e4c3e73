"""The page's side: a row for every control, what picture, camera and model there are, and uploads."""

from __future__ import annotations

from typing import Any, Protocol

from nicegui import events, ui

from blurnoise_eval.explorer.controls import Control, controls
from blurnoise_eval.explorer.rows import Moved, Row, share_row
from blurnoise_eval.explorer.shelf import MOST_UPLOADED_MB, Shelf
from blurnoise_eval.explorer.state import OF_RUN, State
from blurnoise_eval.grid.axes import MOVES

KEYS = {"e": "exposure_s", "l": "illuminance_lux", "s": "speed", "g": "gain_db"}
"""Keys that move a control down, and with Shift up."""
_ACCEPTED = {
    "picture": ".png,.jpg,.jpeg,.tif,.tiff,.bmp,.webp,.ppm",
    "camera": ".yaml,.yml,.json",
    "model": ".onnx,.json,.yaml,.yml",
}


class Told(Moved, Protocol):
    """Who is told of what the visitor does on the side."""

    def selected(self, kind: str, name: str) -> None:
        """Another picture, camera or model."""

    def threshold(self, share: float) -> None:
        """Another confidence to count as found."""

    async def uploaded(self, kind: str, event: events.UploadEventArguments) -> None:
        """A file has arrived."""

    def fails(self, told: str) -> None:
        """A line on what cannot be done."""


class Side:
    """Built where it is made. It tells ``told`` of what the visitor does, and not of what ``stand`` changes."""

    def __init__(self, shelf: Shelf, told: Told) -> None:
        self._shelf, self._told, self._standing = shelf, told, False
        self._rows: dict[str, Row] = {}
        self._rows_of = ""
        with ui.element("section").classes("card conditions"):
            self._conditions = ui.element("div")
        with ui.element("section").classes("card tools"):
            self._build_tools()
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
            self._threshold.set_value(round(100 * state.threshold))
            self._threshold_text.set_text(f"{state.threshold:.2f}")
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

    def _build_tools(self) -> None:
        self._selects: dict[str, Any] = {}
        for kind, titles in self._titles().items():
            select = ui.select(titles, label=kind.capitalize())
            select.on_value_change(lambda e, kind=kind: self._select(kind, e.value))
            self._selects[kind] = select.props("outlined dense options-dense").classes("w-full")
        self._uploads: dict[str, ui.upload] = {}
        with ui.element("div").classes("uploads"):
            for kind, accepted in _ACCEPTED.items():
                button = ui.button(kind.capitalize(), icon="upload").props("outline dense no-caps size=sm")
                with_contract = ", or a contract of one" if kind == "model" else ""
                button.props(f'aria-label="Upload a {kind}" title="Upload a {kind}{with_contract}"')
                button.on("click", js_handler=f"() => explorer.choose({kind!r})")
                self._uploads[kind] = ui.upload(
                    on_upload=lambda event, kind=kind: self._upload(kind, event),
                    on_rejected=lambda kind=kind: self._told.fails(_too_large(kind)),
                    max_file_size=MOST_UPLOADED_MB[kind] * 2**20,
                    multiple=kind == "model",
                    auto_upload=True,
                )
                self._uploads[kind].classes(f"hidden-upload upload-{kind}")
                self._uploads[kind].props(f'tabindex=-1 aria-hidden=true data-accept="{accepted}"')
        self._threshold, self._threshold_text = share_row("Found from a confidence of")
        self._threshold.on_value_change(lambda e: self._share(e.value))

    async def _upload(self, kind: str, event: events.UploadEventArguments) -> None:
        await self._told.uploaded(kind, event)
        self._uploads[kind].reset()

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

    def _share(self, percent: float | None) -> None:
        if not self._standing and percent is not None:
            self._told.threshold(percent / 100)


def _too_large(kind: str) -> str:
    return f"{kind}: the file is too large; must be at most {MOST_UPLOADED_MB[kind]} MB"
