"""The page of the explorer, one visitor's, and the session behind it: the newest state is shown, older ones are
passed over.

The picture comes first and alone: while a slider moves a smaller one, each once the last has been painted; at rest
the full one, then what is measured and found in it, then the curve. The work is done in a few threads that all
visitors share, so that the server goes on answering. It needs the extra ``[explore]``, and no network.
"""

from __future__ import annotations

import asyncio
import math
from base64 import b64encode
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from html import escape
from typing import TypeVar
from uuid import uuid4
from weakref import proxy

import cv2
from nicegui import events, ui

from blurnoise_eval.explorer import charts
from blurnoise_eval.explorer.catalogue import MOST_UPLOADED_MB, Catalogue, command, python
from blurnoise_eval.explorer.rendered import (
    Picture8,
    Point,
    Rendered,
    Subject,
    curve_points,
    rendered,
    verdict,
    window_sentence,
    works,
)
from blurnoise_eval.explorer.run import HeatMap, Run
from blurnoise_eval.explorer.state import OF_RUN, Control, State, control, controls
from blurnoise_eval.grid.axes import AUTOMATIC, MOVES
from blurnoise_eval.sweep.exposing import Frame

FIRST = ThreadPoolExecutor(2, thread_name_prefix="explorer-first")
REST = ThreadPoolExecutor(2, thread_name_prefix="explorer-rest")
"""Smaller pictures wait for no full one."""
_PICTURES = 6
_REST_S = 0.15
"""A slider that has not moved for so long is taken to rest."""
_EXPECTED = (ValueError, TypeError, OSError, MemoryError, RuntimeError)
T = TypeVar("T")
_PAINTED_S = 1.0  # for a picture to be painted, before the next one is sent all the same


class Page:
    """One visitor's page of a picture, camera and model, from a state on. note: what a URL asked for that is not
    there."""

    def __init__(self, catalogue: Catalogue, state: State, note: str = "") -> None:
        self.catalogue = catalogue
        self.session = Session(catalogue, state, self)
        self._painted = asyncio.Event()
        self._last: Rendered | None = None
        self._map: HeatMap | None = None
        ui.button.default_props("flat dense no-caps")
        with ui.element("div").classes("explorer"):
            with ui.element("nav"):
                ui.label("blurnoise explorer").classes("mark")
                for what in ("Command", "Python"):
                    ui.button(f"Copy as {what}", on_click=partial(self._copy, what))
                ui.button("Reset", on_click=lambda: ui.navigate.to("/"))
            with ui.element("main"):
                self._build_answers(catalogue.run)
            with ui.element("aside"):
                self._build_side(state)
        self._show()
        if note:
            self.fails(note)

    def _build_answers(self, run: Run | None) -> None:
        if run:
            self._answer = ui.label("Reading the run …").classes("run-answer")
        self._verdict = ui.html("Rendering …", sanitize=False, tag="h1").props("aria-live=polite")
        self._window = ui.label().classes("window")
        self._message = ui.label().classes("message").props("role=alert")
        self._message.set_visibility(False)
        with ui.element("section").classes("panes") as self._panes:
            self._seen = _pane("seen", "As the camera takes it")
            self._original = _pane("original", "Original")
        self._seen.on("loaded", self._painted.set, args=[])
        with ui.card().classes("curve-card later") as self._curve_card:
            self._title = ui.label()
            self._curve = ui.echart({}, renderer="svg")
        self._curve_card.set_visibility(False)
        self._numbers = ui.html("", sanitize=False, tag="dl").classes("numbers q-card later")
        self._left_out = ui.label().classes("window later")
        if run:
            with ui.card():
                ui.label("The run: mean confidence over its pictures. Click a cell to show its picture.")
                self._heat = ui.echart({}, renderer="svg", on_point_click=partial(self._cell, run))

    def _build_side(self, state: State) -> None:
        every = controls(self.catalogue.camera(state, figures=False)).values()
        apart = state.picture.startswith(("sign-", f"{OF_RUN}/"))  # of others nobody knows the parts
        with ui.card():
            self._rows = [
                Row(each, self.moved) for each in every if each.axis and (apart or each.axis is not MOVES)
            ]
        with ui.card():
            for kind in ("picture", "camera", "model"):
                name = getattr(state, kind)
                select = ui.select(self.catalogue.titles(kind, name), label=kind.capitalize(), value=name)
                select.on_value_change(lambda event, kind=kind: self._select(kind, event.value)).props(
                    "dense"
                )
            page, limit = (
                proxy(self),
                f"a picture must be at most {MOST_UPLOADED_MB} MB",
            )  # FastAPI keeps routes
            ui.upload(
                label="Upload a picture",
                auto_upload=True,
                max_file_size=MOST_UPLOADED_MB << 20,
                on_upload=lambda event: page.uploaded(event),
                on_rejected=lambda: page.fails(limit),
            ).props("accept=image/* flat bordered")
        with ui.expansion("Figures of the camera").classes("q-card"):
            self._rows += [Row(each, self.moved) for each in every if each.axis is None]

    @property
    def state(self) -> State:
        """What is shown."""
        return self.session.state

    async def live(self) -> None:
        """Show what changes, until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self.session.run())
            if self.catalogue.run is not None:
                tasks.create_task(self._read_run(self.catalogue.run))

    async def _read_run(self, run: Run) -> None:
        model = self.state.model.removeprefix(f"{OF_RUN}/")
        self._map = await asyncio.to_thread(run.heat_map, model, self.state.at)
        self._show()
        try:
            self._answer.set_text(await asyncio.to_thread(lambda: run.answer))
        except (ValueError, OSError) as error:
            self._answer.set_text(f"This run has no answer yet. {error}")

    def fails(self, message: str) -> None:
        """A line on what cannot be done; what was shown before stays."""
        if self._last is None:
            self._verdict.set_content("No picture yet.")
        self._message.set_text(message)
        self._message.set_visibility(True)
        self._panes.classes(remove="busy")

    def change(self, state: State) -> None:
        """Show another state."""
        self._message.set_visibility(False)
        if state != self.state:
            self._panes.classes(add="busy")
            self.session.change(state)
        self._show()

    def _try(self, make: Callable[[], State]) -> None:
        """Show a state that may not be allowed."""
        try:
            self.change(make())
        except (ValueError, TypeError) as error:
            self.fails(str(error))
            self._show()

    def _show(self) -> None:
        """Put every control where the state is."""
        state = self.state
        with suppress(ValueError, TypeError):  # of the camera, which the session reports
            camera = self.catalogue.camera(state)
            for row in self._rows:
                row.show(row.control.read(state, camera), last=row.control.name == state.along)
        if self._map is not None and (run := self.catalogue.run):
            self._map = run.heat_map(state.model.removeprefix(f"{OF_RUN}/"), state.at)
            self._heat.options.update(charts.heat_map(self._map, state.at if state.cell else None))
            self._heat.update()

    # -- what the visitor does -------------------------------------------------------------------------------

    def moved(self, control: Control, value: float | str) -> None:
        """A control has another value, a number or what is typed."""
        self._try(lambda: replace(control.put(self.state, value), along=control.name))

    def _select(self, kind: str, name: str) -> None:
        """Another picture, camera or model: another page, as its controls are others."""
        state = replace(self.state, **{kind: name}, cell="")  # type: ignore[arg-type]
        state = state.put(MOVES.name, None) if kind == "picture" else state
        with self._panes:
            ui.navigate.to(f"/?{state.query(self.catalogue.base)}")

    async def uploaded(self, event: events.UploadEventArguments) -> None:
        """A picture has arrived: take it, or report why not."""
        try:
            if event.file.size() > MOST_UPLOADED_MB << 20:
                raise ValueError(f"{event.file.name[-80:]}: must be at most {MOST_UPLOADED_MB} MB")
            content = await event.file.read()
            self._select("picture", await asyncio.to_thread(self.catalogue.take, event.file.name, content))
        except (ValueError, OSError, MemoryError) as error:
            self.fails(str(error))

    async def _cell(self, run: Run, event: events.EChartPointClickEventArguments) -> None:
        """A cell of the run's map: of the picture that is shown, or of the first."""
        own = self.state.picture.removeprefix(f"{OF_RUN}/")
        picture = own if own in run.pictures else run.pictures[0]
        if self._map is not None:
            column, row, _ = map(int, event.value)  # type: ignore[arg-type]  # of a heat map's cell
            at = self._map.condition(column, row)
            self._try(lambda: self.catalogue.of_cell(run.cell_at(at, picture), self.state))

    def _copy(self, what: str) -> None:
        make = command if what == "Command" else python
        try:
            text = make(self.catalogue, self.state)
        except ValueError as error:
            self.fails(str(error))
            return
        ui.clipboard.write(text)
        with ui.dialog(value=True) as dialog, ui.card():
            ui.label(f"{what} for this picture, bit for bit (copied, where the browser allows it)")
            ui.label(text).classes("code")
        dialog.on("hide", dialog.delete)

    # -- what the session shows ------------------------------------------------------------------------------

    def subject(self, subject: Subject, url: str) -> None:
        """The original picture."""
        self._panes.style(f"--ratio: {subject.size[1] / subject.size[0]:.5f}")
        self._original.set_source(url)

    async def preview(self, jpeg: bytes) -> None:
        """A smaller picture, of a state that may have passed; returns once it is painted."""
        self._painted.clear()
        source = f"data:image/jpeg;base64,{b64encode(jpeg).decode()}"
        with self._panes:  # past the page's elements, which NiceGUI would render anew
            ui.run_javascript(f"getElement({self._seen.id}).$refs.img.src = '{source}'")
        with suppress(TimeoutError):
            await asyncio.wait_for(self._painted.wait(), _PAINTED_S)

    def picture(self, url: str) -> None:
        """The picture in full."""
        self._seen.set_source(url)

    def rendered(self, found: Rendered) -> None:
        """What is measured and found in the picture."""
        self._last, standard = found, found.standard
        with self._panes:
            ui.navigate.history.replace(f"/?{found.state.query(self.catalogue.base)}")
        size, found_from = found.image.shape[:2], standard.found_from if standard else 0.0
        self._seen.set_content(charts.boxes(found.sight, size, found_from, found.classes))
        self._original.set_content(charts.boxes(found.clean, size, found_from, found.classes))
        good, sentence = verdict(found.sight, standard) if found.sight and standard else (True, "No model.")
        self._verdict.set_content(escape(sentence))
        self._verdict.classes(add="" if good else "no", remove="no" if good else "")
        self._numbers.set_content(
            "".join(
                f"<div><dt>{escape(each.title)}</dt><dd data-number={each.name}>{escape(each.text)}</dd></div>"
                for each in found.numbers
            )
        )
        self._left_out.set_text(found.left_out)
        self._curve_card.set_visibility(bool(found.sight and found.sight.targets))
        self._window.set_text("")
        self._panes.classes(remove="busy")

    def curve(self, curve: list[Point], along: Control, finished: bool) -> None:
        """Scores along a control, as far as they are known."""
        found = self._last
        if found is None or found.standard is None:
            return
        at = along.read(found.state, found.camera)
        if at == AUTOMATIC:
            taken = {"exposure_s": 1e3 * found.exposure.exposure_s, "gain_db": found.exposure.gain_db}
            at = taken[along.name]
        enough = found.standard.enough
        window = works(curve, enough, at, logarithmic=along.logarithmic) if finished else None
        self._title.set_text(f"{found.standard.title} along {along.title.lower()}, {along.unit}".rstrip(", "))
        self._curve.options.clear()
        self._curve.options.update(charts.scores(curve, along, at, enough, window))
        self._curve.update()
        if finished:
            self._window.set_text(window_sentence(curve, along, at, found.standard))


class Row:
    """One control on the page. moved: called with a state's change when the visitor makes one, not by ``show``."""

    def __init__(self, control: Control, moved: Callable[[Control, float | str], None]) -> None:
        self.control, self._moved, self._at = control, moved, -1.0
        with ui.element("div").classes("control").props(f"data-control={control.name}") as self._element:
            ui.label(control.title)
            self._text = ui.input().props(f'dense suffix="{control.unit}" aria-label="{control.title}"')
            self._text.on("change", lambda: moved(control, self._text.value))
            self._slider = ui.slider(min=0, max=control.steps, on_change=self._slid)
            self._slider.props(f'aria-label="{control.title}"')

    def show(self, value: float, last: bool) -> None:
        """Stand at a value. last: it was moved last."""
        self._element.classes(add="last" if last else "", remove="" if last else "last")
        self._text.set_value(self.control.text(value))
        if math.isfinite(value):
            self._at = round(self.control.position(value))
            self._slider.set_value(self._at)

    def _slid(self, event: events.ValueChangeEventArguments[float | None]) -> None:
        if event.value is not None and event.value != self._at:
            self._at = event.value
            self._moved(self.control, self.control.value(event.value))


def _pane(kind: str, caption: str) -> ui.interactive_image:
    """A picture with boxes over it, and the caption below."""
    with ui.element("figure").classes(f"pane {kind}"):
        picture = ui.interactive_image(sanitize=False).props(f'alt="{caption}"')
        ui.label(caption).classes("window")
    return picture


class Session:
    """One visitor's, of one picture and model. files: the last pictures, as PNG, by their names. token: part of their
    URLs, which nobody else can guess."""

    def __init__(self, catalogue: Catalogue, state: State, page: Page) -> None:
        self.catalogue, self.state, self.token = catalogue, state, uuid4().hex
        self.files: dict[str, bytes] = {}
        self._page, self._changed, self._shown = page, asyncio.Event(), False
        self._changed.set()

    def change(self, state: State) -> None:
        """Show another state."""
        self.state = state
        self._changed.set()

    async def run(self) -> None:
        """Show the picture of the state, then what changes, until cancelled."""
        rest: asyncio.Task[None] | None = None
        subject = await self._reported(self.state, _in(REST, self.catalogue.subject, self.state))
        if subject is None:
            return
        self._page.subject(subject, self._keep(await _in(REST, encoded, subject.original)))
        try:
            while await self._changed.wait():
                self._changed.clear()
                if rest is not None:
                    rest.cancel()
                state, first = self.state, self._full if subject.smaller == 1 else self._preview
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
                self._page.fails(" ".join(str(error).split())[:400] or type(error).__name__)
            return None

    async def _preview(self, subject: Subject, state: State) -> None:
        """The smaller copy of a large picture."""
        camera = self.catalogue.camera(state)
        if self._shown:
            with suppress(ValueError):  # the full size says why, or there is no smaller copy
                preview = await _in(FIRST, lambda: encoded(subject.preview(state, camera), ".jpg"))
                await self._page.preview(preview)

    async def _full(self, subject: Subject, state: State) -> Frame:
        frame = await _in(REST, subject.frame, state, self.catalogue.camera(state))
        self._page.picture(self._keep(await _in(REST, encoded, frame.image)))
        self._shown = True
        return frame

    async def _rest(self, subject: Subject, state: State, frame: Frame | None) -> None:
        """At rest the full picture, what is measured and found in it, and the curve."""
        if subject.smaller > 1:
            await asyncio.sleep(_REST_S if self._shown else 0)
            frame = await self._full(subject, state)
        if frame is None:
            return
        camera = self.catalogue.camera(state)
        model = await self._reported(state, _in(REST, self.catalogue.model, state))
        criterion = self.catalogue.criterion(state, model)
        found = await _in(REST, rendered, state, subject, camera, frame, model, criterion)
        self._page.rendered(found)
        if subject.smaller > 1:
            await _in(REST, lambda: subject.small)  # before a slider waits for it
        if model is None or found.standard is None or not found.sight or not found.sight.targets:
            return
        base = self.catalogue.camera(state, figures=False)
        along = control(state.along, camera)
        points, curve = curve_points(state, subject, base, model, along, found.standard), list[Point]()
        while (point := await _in(REST, next, points, None)) is not None:
            curve.append(point)
            if len(curve) % 3 == 0:
                self._page.curve(curve, along, False)
        self._page.curve(curve, along, True)

    def _keep(self, content: bytes) -> str:
        """The URL of a picture."""
        name = uuid4().hex
        self.files[name] = content
        for old in [*self.files][:-_PICTURES]:
            del self.files[old]
        return f"/pictures/{self.token}/{name}"


def encoded(image: Picture8, suffix: str = ".png") -> bytes:
    """As PNG, exactly, and not packed: that takes longer than the simulation; or as JPEG of quality 92."""
    flags = [cv2.IMWRITE_PNG_COMPRESSION, 0, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]
    _, data = cv2.imencode(
        suffix, image[..., ::-1], flags if suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, 92]
    )
    return bytes(data.tobytes())


async def _in(threads: ThreadPoolExecutor, work: Callable[..., T], *given: object) -> T:
    return await asyncio.get_running_loop().run_in_executor(threads, partial(work, *given))
