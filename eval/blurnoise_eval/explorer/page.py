"""The page of the explorer: the newest state is shown, older ones are passed over.

The picture comes first and alone: while a slider moves a smaller one, each once the last has been painted; at rest
the full one, then what is measured and found in it, then the curve. Full pictures and models are computed in threads,
so that the server goes on answering. It needs the extra ``[explore]``, no network.
"""

from __future__ import annotations

import asyncio
import math
from base64 import b64encode
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from html import escape
from typing import TypeVar
from uuid import uuid4

import cv2
from nicegui import events, ui

from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.rendered import (
    Picture8,
    Point,
    Rendered,
    Subject,
    boxes,
    chart,
    curve_points,
    rendered,
    verdict,
    window_sentence,
)
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.state import OF_RUN, Control, State, controls
from blurnoise_eval.grid.axes import MOVES
from blurnoise_eval.run.exposing import Frame

_FULL = ThreadPoolExecutor(2, thread_name_prefix="explorer")
"""For all but smaller pictures, which wait for no full one."""
_PICTURES = 6
_KINDS = ("picture", "camera", "model")
_OPEN = (
    'Drop a picture anywhere on the page, or choose one: <input type="file" accept="image/*" '
    'onchange="openPicture(this.files[0]); this.value = null">'
)
_REST_S = 0.15
"""A slider that has not moved for so long is taken to rest."""
_PAINTED_S = 1.0  # for a picture to be painted, before the next one is sent all the same
_EXPECTED = (ValueError, TypeError, OSError, MemoryError, RuntimeError)
T = TypeVar("T")


class Page:
    """The page of a picture, camera and model, from a state on.

    files: takes the last pictures, as PNG, by the names in their URLs. note: what a URL asked for in vain.
    """

    def __init__(self, catalogue: Catalogue, state: State, files: dict[str, bytes], note: str = "") -> None:
        self.catalogue, self.run, self.state, self.files = catalogue, catalogue.run, state, files
        self._changed, self._painted = asyncio.Event(), asyncio.Event()
        self._changed.set()
        self._drawn: object = None
        self._build()
        self.fails(note)

    async def live(self) -> None:
        """Show the picture of the state, then what changes, until cancelled."""
        subject = await self._reported(self.state, _full(self.catalogue.subject, self.state))
        if subject is None:
            return
        self._panes.style(f"--ratio: {subject.size[1] / subject.size[0]:.5f}")
        self._original.set_source(self._keep(await _full(encoded, subject.original)))
        rest: asyncio.Task[None] | None = None
        try:
            while await self._changed.wait():
                self._changed.clear()
                if rest is not None:
                    rest.cancel()
                state, first = self.state, self._picture if subject.smaller == 1 else self._preview
                frame = await self._reported(state, first(subject, state))
                rest = asyncio.create_task(self._reported(state, self._rest(subject, state, frame)))
        finally:
            if rest is not None:
                rest.cancel()

    async def _reported(self, state: State, work: Awaitable[T]) -> T | None:
        """What ``work`` returns; None where it fails, which the page says of the state that is shown."""
        try:
            return await work
        except _EXPECTED as error:
            if state is self.state:
                self.fails(str(error) or type(error).__name__)
            return None

    async def _preview(self, subject: Subject, state: State) -> None:
        """The smaller copy of a large picture; returns once it is painted."""
        camera = self.catalogue.camera(state)
        with suppress(ValueError):  # the full size says why, or there is no smaller copy
            picture = await asyncio.to_thread(subject.preview, state, camera)
            jpeg = b64encode(encoded(picture, ".jpg")).decode()
            self._painted.clear()
            with self._panes:  # past the page's elements, which NiceGUI would render anew
                ui.run_javascript(
                    f"getElement({self._seen.id}).$refs.img.src = 'data:image/jpeg;base64,{jpeg}'"
                )
            with suppress(TimeoutError):
                await asyncio.wait_for(self._painted.wait(), _PAINTED_S)

    async def _picture(self, subject: Subject, state: State) -> Frame:
        frame = await _full(subject.frame, state, self.catalogue.camera(state))
        self._seen.set_source(self._keep(await _full(encoded, frame.image)))
        return frame

    async def _rest(self, subject: Subject, state: State, frame: Frame | None) -> None:
        """At rest the full picture, what is measured and found in it, and the curve."""
        if subject.smaller > 1:
            await asyncio.sleep(_REST_S)
            frame = await self._picture(subject, state)
        if frame is None:
            return
        camera = self.catalogue.camera(state)
        model = await self._reported(state, _full(self.catalogue.model, state))
        found = await _full(rendered, state, subject, frame, model)
        self._show_rendered(found)
        if model is None or found.standard is None or not found.sight or not found.sight.targets:
            return
        points, curve = curve_points(state, subject, camera, model, found.standard), list[Point]()
        while (point := await _full(next, points, None)) is not None:
            curve.append(point)
        if curve:
            at_ms = 1e3 * found.exposure.exposure_s
            self._curve.options.update(chart(curve, at_ms, found.standard.required))
            self._curve.update()
            self._window.set_text(window_sentence(curve, at_ms, found.standard))

    def _keep(self, content: bytes) -> str:
        """The URL of a picture."""
        name = uuid4().hex
        self.files[name] = content
        for old in [*self.files][:-_PICTURES]:
            del self.files[old]
        return f"/pictures/{name}"

    def change(self, make: Callable[[], State]) -> None:
        """Show another state, which may not be allowed; of another picture, camera or model on another page, as its
        controls are others."""
        self._message.set_text("")
        try:
            state = make()
        except (ValueError, TypeError) as error:
            self.fails(str(error))
        else:
            if any(getattr(state, kind) != getattr(self.state, kind) for kind in _KINDS):
                with self._panes:
                    ui.navigate.to(f"/?{state.query(self.catalogue.base)}")
                return
            if state != self.state:
                self._panes.classes(add="busy")
                self.state = state
                self._changed.set()
        self._show_controls()

    def moved(self, control: Control, text: str) -> None:
        """A control has another value, as it is typed."""
        self.change(lambda: control.put(self.state, text))

    def _select(self, kind: str, name: str) -> None:
        state = replace(self.state, **{kind: name}, cell="")  # type: ignore[arg-type]
        self.change(lambda: state.put(MOVES.name, None) if kind == "picture" else state)

    def _cell(self, run: Run, at: Mapping[str, float]) -> None:
        """A cell of the run's map: of the picture that is shown, or of the first."""
        own = self.state.picture.removeprefix(f"{OF_RUN}/")
        picture = own if own in run.pictures else run.pictures[0]
        self.change(lambda: self.catalogue.of_cell(run.cell(image=picture, repeat=0, **at), self.state))

    def _copy(self, make: Callable[[State], str]) -> None:
        try:
            text = make(self.state)
        except ValueError as error:
            self.fails(str(error))
            return
        with ui.dialog(value=True) as dialog, ui.card():
            ui.label("For this picture, bit for bit")
            ui.code(text, language=None)
        dialog.on("hide", dialog.delete)

    def fails(self, message: str) -> None:
        """A line on what cannot be done; what was shown before stays."""
        self._message.set_text(" ".join(message.split())[:400])
        self._panes.classes(remove="busy")

    def _show_rendered(self, found: Rendered) -> None:
        """What is measured and found in the picture."""
        with self._panes:
            ui.navigate.history.replace(f"?{found.state.query(self.catalogue.base)}")
        self._seen.set_content(boxes(found, found.sight))
        self._original.set_content(boxes(found, found.clean))
        good, sentence = verdict(found)
        self._verdict.set_content(escape(sentence))
        self._verdict.classes(add="" if good else "no", remove="no" if good else "")
        numbers = []
        for name, (title, value, unit) in found.numbers.items():
            text = "none" if value is None else f"{value:.5g} {unit}"
            numbers.append(f"<div><dt>{title}</dt><dd data-number={name}>{text}</dd></div>")
        self._numbers.set_content("".join(numbers))
        self._curve_card.set_visibility(bool(found.sight and found.sight.targets))
        self._window.set_text("")
        self._panes.classes(remove="busy")

    def _show_controls(self) -> None:
        """Put every control where the state is."""
        state = self.state
        with suppress(ValueError, TypeError):  # of the camera, which is reported with the picture
            camera = self.catalogue.camera(state)
            for row in self._rows:
                row.show(row.control.read(state, camera))
            if self.run:
                self._show_map(self.run)

    def _show_map(self, run: Run) -> None:
        """Mean confidences of a run as cells to click, that of the picture marked."""
        model, shown = self.state.model.removeprefix(f"{OF_RUN}/"), self.state.at if self.state.cell else {}
        found = run.heat_map(model, self.state.at.on(self.catalogue.camera(self.state)))
        if self._drawn == (found, shown):
            return
        self._drawn = found, shown
        self._heat.clear()
        self._heat.style(f"grid-template-columns: auto repeat({len(found.columns)}, minmax(44px, 1fr))")
        with self._heat:
            for row in reversed(found.rows):
                ui.label(found.down.text(row))
                for column in found.columns:
                    if (column, row) not in found.cells:
                        ui.label()
                        continue
                    at, mean = found.cells[column, row]
                    cell = ui.button(f"{mean:.2f}", on_click=partial(self._cell, run, at))
                    cell.style(f"--mean: {mean:.2f}")
                    if shown and all(shown[name] in (None, value) for name, value in at.items()):
                        cell.classes("shown")
            ui.label()
            for column in found.columns:
                ui.label(found.across.text(column))

    def _build(self) -> None:
        ui.button.default_props("flat dense no-caps")
        with ui.element("div").classes("explorer"):
            with ui.element("nav"):
                ui.label("blurnoise explorer").classes("mark")
                ui.button("Copy as Command", on_click=partial(self._copy, self.catalogue.command))
                ui.button("Copy as Python", on_click=partial(self._copy, self.catalogue.script))
                ui.button("Reset", on_click=lambda: ui.navigate.to("/"))
            with ui.element("main"):
                self._build_answers()
            with ui.element("aside"):
                self._build_controls()
        self._show_controls()

    def _build_answers(self) -> None:
        self._verdict = ui.html("Rendering …", sanitize=False, tag="h1").props("aria-live=polite")
        self._window = ui.label().classes("window")
        self._message = ui.label().classes("message").props("role=alert")
        with ui.element("section").classes("panes") as self._panes:
            self._seen = _pane("seen", "Simulated picture")
            self._original = _pane("original", "Original")
        self._seen.on("loaded", self._painted.set, args=[])
        with ui.card().classes("curve-card later") as self._curve_card:
            ui.label("Mean confidence over the exposure time, ms")
            self._curve = ui.echart({}, renderer="svg")
        self._curve_card.set_visibility(False)
        self._numbers = ui.html("", sanitize=False, tag="dl").classes("numbers q-card later")
        if self.run:
            with ui.card():
                ui.label("Mean confidence over the pictures of the run. Click a cell to show its picture.")
                self._heat = ui.element("div").classes("map")

    def _build_controls(self) -> None:
        every = controls(self.catalogue.camera(replace(self.state, figures=())))
        if not self.state.picture.startswith(("sign-", f"{OF_RUN}/")):  # of others nobody knows the parts
            del every[MOVES.name]
        with ui.card():
            self._rows = [Row(each, self.moved) for name, each in every.items() if name in self.state.at]
        with ui.card():
            for kind in _KINDS:
                name = getattr(self.state, kind)
                select = ui.select(self.catalogue.titles(kind), label=kind.capitalize(), value=name)
                select.props("dense")
                select.on_value_change(lambda event, kind=kind: self._select(kind, event.value))
            ui.html(_OPEN, sanitize=False, tag="label").classes("open")
        ui.on("dropped", lambda event: self._select("picture", event.args))
        ui.on("refused", lambda event: self.fails(event.args))
        with ui.expansion("Values of the camera").classes("q-card"):
            self._rows += [Row(each, self.moved) for name, each in every.items() if name not in self.state.at]


class Slider(ui.slider):
    """A slider that moves at once: NiceGUI's waits for the server, and keys pressed meanwhile are lost."""

    LOOPBACK = False


class Row:
    """One control on the page. moved: called with what is typed, or where the slider is put, not by ``show``."""

    def __init__(self, control: Control, moved: Callable[[Control, str], None]) -> None:
        self.control, self._moved, self._at = control, moved, -1.0
        title = control.axis.title
        with ui.element("div").classes("control").props(f"data-control={control.axis.name}"):
            ui.label(title)
            self._text = ui.input().props(f'dense suffix="{control.axis.unit}" aria-label="{title}"')
            self._text.on("change", lambda: moved(control, self._text.value))
            slider = Slider(min=0, max=control.steps, on_change=self._slid)
            self._slider = slider.props(f'aria-label="{title}"')

    def show(self, value: float) -> None:
        """Stand at a value."""
        self._text.set_value(self.control.text(value))
        if math.isfinite(value):
            self._at = round(self.control.position(value))
            self._slider.set_value(self._at)

    def _slid(self, event: events.ValueChangeEventArguments[float | None]) -> None:
        if event.value is not None and event.value != self._at:
            self._at = event.value
            self._moved(self.control, self.control.text(self.control.value(event.value)))


def _pane(kind: str, caption: str) -> ui.interactive_image:
    """A picture with boxes over it, and the caption below."""
    with ui.element("figure").classes(f"pane {kind}"):
        picture = ui.interactive_image(sanitize=False).props(f'alt="{caption}"')
        ui.label(caption).classes("window")
    return picture


def encoded(image: Picture8, suffix: str = ".png") -> bytes:
    """As PNG, exactly, and not packed: that takes longer than the simulation; or as JPEG."""
    flags = [cv2.IMWRITE_PNG_COMPRESSION, 0] if suffix == ".png" else []
    return bytes(cv2.imencode(suffix, image[..., ::-1], flags)[1].tobytes())


async def _full(work: Callable[..., T], *given: object) -> T:
    return await asyncio.get_running_loop().run_in_executor(_FULL, partial(work, *given))
