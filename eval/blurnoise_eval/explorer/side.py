"""The page's side: a row for every control, what picture, camera and model there are, and uploads."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from html import escape
from typing import Protocol
from weakref import proxy

from nicegui import events, ui
from nicegui.elements.upload_files import FileUpload

from blurnoise_eval.explorer.catalogue import MOST_UPLOADED_MB, Catalogue
from blurnoise_eval.explorer.controls import STEPS, Control, controls
from blurnoise_eval.explorer.state import OF_RUN, State
from blurnoise_eval.grid.axes import AUTOMATIC, MOVES

KEYS: Mapping[str, str] = {"e": "exposure_s", "l": "illuminance_lux", "s": "velocity_x_px_s", "g": "gain_db"}
"""Keys that move a control down, and with Shift up."""
_ACCEPTED = {"picture": ".png,.jpg,.jpeg,.tif,.tiff,.bmp,.webp,.ppm", "camera": ".yaml,.yml,.json"}


class Listener(Protocol):
    """Who acts on what the visitor does on the side."""

    def moved(self, control: Control, value: float) -> None:
        """A control has another value; AUTOMATIC: it is left to the camera."""

    def automatic(self, control: Control) -> None:
        """Left to the camera, or taken back from it."""

    def selected(self, kind: str, name: str) -> None:
        """Another picture, camera or model."""

    async def uploaded(self, kind: str, file: FileUpload) -> None:
        """A file has arrived."""

    def fails(self, message: str) -> None:
        """A line on what cannot be done."""


class Side:
    """Built where it is made; ``listener`` acts on what the visitor does, not on what ``show`` changes."""

    def __init__(self, catalogue: Catalogue, state: State, listener: Listener) -> None:
        self._catalogue, self._listener, self._state = catalogue, listener, state
        self._rows: dict[str, Row] = {}
        self._rows_of: tuple[str, bool] | None = None
        self._uploads: set[str] = set()
        with ui.element("section").classes("card conditions"):
            self._conditions = ui.element("div")
        with ui.element("section").classes("card tools"):
            self._selects = {
                kind: ui.select({}, label=kind.capitalize(), on_change=self._selected(kind)).props(
                    "outlined dense"
                )
                for kind in ("picture", "camera", "model")
            }
            with ui.row():
                for kind in _ACCEPTED:
                    self._build_upload(kind)
        with ui.expansion("The camera's own figures").classes("card fold"):
            self._figures = ui.element("div").classes("w-full")

    def control(self, name: str) -> Control | None:
        """The control of a row."""
        row = self._rows.get(name)
        return row.control if row else None

    def show(self, state: State) -> None:
        """Put everything where the state is. Raises ``ValueError`` for a camera that is not there."""
        self._state = state
        self._make_rows(state)
        camera = self._catalogue.camera(state)
        for row in self._rows.values():
            row.show(state, row.control.read(state, camera))
        self._uploads |= {name for name in (state.picture, state.camera) if self._catalogue.uploaded(name)}
        for kind, select in self._selects.items():
            titles, name = self._catalogue.titles(kind, self._uploads), getattr(state, kind)
            if (titles, name) != (select.options, select.value):
                select.set_options(titles, value=name)

    def _make_rows(self, state: State) -> None:
        """Ranges follow the camera; parts move apart only in pictures that say what their targets are."""
        apart = state.picture.startswith(("sign-", f"{OF_RUN}/"))
        if self._rows_of == (state.camera, apart):
            return
        self._rows_of = state.camera, apart
        self._conditions.clear()
        self._figures.clear()
        keys = {name: key for key, name in KEYS.items()}
        self._rows = {}
        for name, each in controls(self._catalogue.camera(state, figures=False)).items():
            if apart or name != MOVES.name:
                with self._figures if each.of_camera else self._conditions:
                    self._rows[name] = Row(each, keys.get(name, ""), self._listener)

    def _selected(self, kind: str) -> Callable[[events.ValueChangeEventArguments[str]], None]:
        def select(event: events.ValueChangeEventArguments[str]) -> None:
            if event.value and event.value != getattr(self._state, kind):
                self._listener.selected(kind, event.value)

        return select

    def _build_upload(self, kind: str) -> None:
        most, listener = (
            MOST_UPLOADED_MB[kind],
            proxy(self._listener),
        )  # FastAPI keeps routes of pages that are gone
        upload = ui.upload(
            auto_upload=True,
            max_file_size=most << 20,
            on_upload=lambda event: listener.uploaded(kind, event.file),
            on_rejected=lambda: listener.fails(f"{kind}: a file must be at most {most} MB"),
        )
        upload.props(f'accept="{_ACCEPTED[kind]}"').classes(f"upload-{kind} hidden")
        button = ui.button(kind.capitalize(), icon="upload").props("outline dense no-caps size=sm")
        button.props(f'aria-label="Upload a {kind}" title="Upload a {kind}"')
        button.on("click", js_handler=f"() => getElement({upload.id}).$refs.qRef.pickFiles()")


class Row:
    """One control on the page; key: that moves it."""

    def __init__(self, control: Control, key: str, listener: Listener) -> None:
        self.control, self._listener, self._at = control, listener, math.nan
        self._shown: tuple[float, str] | None = None
        with ui.element("div").classes("control").props(f"data-control={control.name}") as self._element:
            with ui.element("div").classes("line"):
                shortcut = f"<kbd>{key}</kbd>" if key else ""
                ui.html(f"{escape(control.title)}{shortcut}", sanitize=False).classes("name")
                if control.choices:
                    self._choice = ui.select(dict(enumerate(control.choices)), on_change=self._moved)
                    self._choice.props(f'dense outlined aria-label="{control.title}"')
                    return
                self._auto = ui.button("auto", on_click=lambda: listener.automatic(control)).props(
                    "flat dense"
                )
                self._auto.classes("auto").set_visibility(control.automatic)
                self._number = ui.number(suffix=control.unit, format="%.4g").props("dense outlined step=any")
                self._number.props(f'aria-label="{control.title}, {control.unit}"').on("change", self._typed)
            self._slider = ui.slider(min=0, max=STEPS, on_change=self._moved)
            self._slider.props(f'aria-label="{control.title}"')

    def show(self, state: State, value: float) -> None:
        """Stand where the state is."""
        if (value, state.along) == self._shown:
            return
        self._at, self._shown = value, (value, state.along)
        self._element.classes(**_class("last", state.along == self.control.name))
        if self.control.choices:
            self._choice.set_value(int(value))
            return
        automatic = value == AUTOMATIC
        self._element.classes(**_class("automatic", automatic))
        self._auto.props(f"color={'primary' if automatic else 'grey'}")
        self._number.set_value(float(f"{value:.4g}") if math.isfinite(value) else None)
        self._number.props(f'placeholder="{"auto" if automatic else ""}"')
        if math.isfinite(value):
            self._slider.set_value(self._place)

    @property
    def _place(self) -> int:
        return round(self.control.position(self._at))

    def _moved(self, event: events.ValueChangeEventArguments[float | None]) -> None:
        """By the visitor: what ``show`` puts there is where it stands."""
        if event.value is None:
            return
        if self.control.choices:
            if event.value != self._at:
                self._listener.moved(self.control, float(event.value))
        elif self._at == AUTOMATIC or event.value != self._place:
            self._listener.moved(self.control, self.control.value(event.value))

    def _typed(self) -> None:
        """A number, or nothing, which leaves it to the camera."""
        if self._number.value is not None:
            self._listener.moved(self.control, self._number.value)
        elif self.control.automatic:
            self._listener.moved(self.control, AUTOMATIC)


def _class(name: str, on: bool) -> dict[str, str]:
    return {"add": name} if on else {"remove": name}
