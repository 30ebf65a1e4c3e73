"""The page of the explorer: one visitor's, which turns what the visitor does into states of a session.

It needs the extra ``[explore]``, and no network. Sliders hold positions; the state alone holds values.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from html import escape
from inspect import isawaitable

from nicegui import events, ui
from nicegui.elements.upload_files import FileUpload

from blurnoise_eval.explorer import snippets
from blurnoise_eval.explorer.answers import Answers
from blurnoise_eval.explorer.catalogue import MOST_UPLOADED_MB, Catalogue
from blurnoise_eval.explorer.controls import STEPS, Control
from blurnoise_eval.explorer.heat import Heat
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.session import Session
from blurnoise_eval.explorer.side import KEYS, Side
from blurnoise_eval.explorer.state import OF_RUN, State
from blurnoise_eval.grid.axes import AUTOMATIC, MOVES

_HELP = (
    ("e E, l L, s S, g G", "exposure, light, speed, gain: down, up"),
    ("arrow keys", "move the slider that has the focus"),
    ("o", "hold: the untouched picture"),
    ("b", "boxes on and off"),
    ("n", "another noise field"),
    ("c, p", "copy as command, as Python"),
    ("d", "light, dark"),
    ("r", "back to the start"),
)
_KEY_STEP = 5  # positions of a slider


class Page:
    """One visitor's page, from a state on. usual: to which it goes back. note: what could not be had of a URL."""

    def __init__(self, catalogue: Catalogue, state: State, usual: State, note: str = "") -> None:
        self.catalogue, self._usual = catalogue, usual
        self._answers = Answers(
            lambda file: f"/pictures/{self.session.token}/{file}",
            self.moved,
            base=catalogue.base,
            of_run=catalogue.run is not None,
        )
        self.session = Session(catalogue, state, self._answers)
        self._dark = ui.dark_mode(None)
        ui.keyboard(self._key)
        with ui.element("div").classes("explorer"):
            self._build_top()
            self._answers.build_head()
            with ui.element("main").classes("main"):
                if catalogue.run:
                    self._heat = ui.element("section").classes("card heat-card")
                self._answers.build_main()
            with ui.element("aside").classes("side"):
                self._side = Side(catalogue, state, self)
        with ui.dialog() as self._keys, ui.card():
            ui.html(
                "".join(f"<kbd>{key}</kbd><span>{what}</span>" for key, what in _HELP), sanitize=False
            ).classes("keys")
        self._map: Heat | None = None
        self._show()
        if note:
            self.fails(note)

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

    async def _read_run(self, opened: Run) -> None:
        await asyncio.to_thread(lambda: opened.heat_map(opened.models[0]))
        with self._heat:
            self._map = Heat(opened, self.state, partial(self._condition, opened))
        try:
            self._answers.run(*await asyncio.to_thread(lambda: opened.answer))
        except (ValueError, OSError) as error:
            self._answers.run("This run has no answer yet.", str(error))

    def fails(self, message: str) -> None:
        """A line on what cannot be done."""
        self._answers.fails(message)

    def change(self, state: State) -> None:
        """Show another state."""
        self._answers.goes_on()
        if state != self.state:
            self._answers.busy(True)
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
        try:
            self._side.show(self.state)
        except (ValueError, TypeError) as error:
            self.fails(str(error))
        if self._map is not None:
            self._map.show(self.state)

    # -- what the visitor does on the side -------------------------------------------------------------------

    def moved(self, control: Control, value: float) -> None:
        """A control has another value."""
        self._try(lambda: replace(control.put(self.state, value), along=control.name))

    def automatic(self, control: Control) -> None:
        """Left to the camera, or taken back from it, where the camera has set it."""
        if control.read(self.state, self.catalogue.camera(self.state)) != AUTOMATIC:
            self.moved(control, AUTOMATIC)
            return
        value = control.value(STEPS / 2)
        if self._answers.last is not None:
            taken = self._answers.last.exposure
            value = {"exposure_s": 1e3 * taken.exposure_s, "gain_db": taken.gain_db}.get(control.name, value)
        self.moved(control, min(control.high, max(control.low, float(f"{value:.4g}"))))

    def selected(self, kind: str, name: str) -> None:
        """Another picture, camera or model."""
        state = replace(self.state, **{kind: name}, cell="")  # type: ignore[arg-type]
        self._try(lambda: state.put(MOVES.name, None) if kind == "picture" else state)

    async def uploaded(self, kind: str, file: FileUpload) -> None:
        """A file has arrived: take it, or say why not."""
        name = file.name[-80:]
        if file.size() > MOST_UPLOADED_MB[kind] << 20:
            self.fails(f"{name}: must be at most {MOST_UPLOADED_MB[kind]} MB")
            return
        try:
            content = await file.read()
            self.selected(kind, await asyncio.to_thread(self.catalogue.take, kind, name, content))
        except (ValueError, OSError, MemoryError) as error:
            self.fails(str(error))

    # -- a run, keys, and what is copied ---------------------------------------------------------------------

    async def _condition(self, opened: Run, at: dict[str, float | None]) -> None:
        """A cell of the run's map: of the picture that is shown, or of the first."""
        before = self.state
        own = before.picture.removeprefix(f"{OF_RUN}/")
        picture = own if own in opened.pictures else opened.pictures[0]
        try:
            state = await asyncio.to_thread(
                lambda: self.catalogue.of_cell(opened.cell_at(at, picture), before)
            )
            self.change(state)
        except (ValueError, OSError) as error:
            self.fails(str(error))

    async def _key(self, event: events.KeyEventArguments) -> None:
        key, modifiers = event.key.name, event.modifiers
        if modifiers.ctrl or modifiers.meta or modifiers.alt or event.action.repeat:
            return
        if key == "o":
            self._answers.hold(event.action.keydown)
        elif not event.action.keydown:
            return
        elif key.lower() in KEYS:
            self._step(KEYS[key.lower()], 1 if key.isupper() else -1)
        elif key in (acts := {**self._acts, "b": self._answers.toggle_boxes, "n": self._reseed}):
            done = acts[key]()
            if isawaitable(done):
                await done

    def _reseed(self) -> None:
        self._try(lambda: replace(self.state, seed=self.state.seed + 1, cell=""))

    async def _turn(self) -> None:
        """Light in place of dark, or dark in place of light."""
        self._dark.set_value(not await ui.run_javascript("Quasar.Dark.isActive"))

    def _step(self, name: str, towards: int) -> None:
        control = self._side.control(name)
        if control is not None:
            at = control.read(self.state, self.catalogue.camera(self.state))
            place = STEPS / 2 if at == AUTOMATIC else control.position(at)
            self.moved(control, control.value(place + _KEY_STEP * towards))

    def _copy(self, what: str) -> None:
        make = snippets.command if what == "command" else snippets.python
        try:
            text = make(self.catalogue, self.state)
        except ValueError as error:
            self.fails(str(error))
            return
        ui.run_javascript(f"explorerCopy({json.dumps(text)})")
        with ui.dialog(value=True) as dialog, ui.card():
            ui.label(f"Copied: the {what} that makes this picture, bit for bit")
            ui.html(escape(text), sanitize=False, tag="pre").classes("shown-code")
            ui.button("Close", on_click=dialog.close).props("flat no-caps")
        dialog.on("hide", dialog.delete)

    def _build_top(self) -> None:
        self._acts: dict[str, Callable[[], object]] = {
            "c": partial(self._copy, "command"),
            "p": partial(self._copy, "script"),
            "r": lambda: self.change(self._usual),
            "d": self._turn,
            "?": lambda: self._keys.open(),
        }
        with ui.element("nav").classes("top"):
            name = self.catalogue.run.folder.name if self.catalogue.run else "explorer"
            ui.html(f"blurnoise<small>{escape(name)}</small>", sanitize=False).classes("mark")
            for key, icon, text, about in (
                ("c", "content_copy", "Command", "Copy as Command"),
                ("p", "content_copy", "Python", "Copy as Python"),
                ("r", "restart_alt", "", "Back to the start"),
                ("d", "contrast", "", "Light or dark"),
                ("?", "keyboard", "", "Keys"),
            ):
                button = ui.button(text, icon=icon, on_click=self._acts[key]).classes(f"act-{icon}")
                button.props(f'flat dense no-caps size=sm aria-label="{about}" title="{about}"')
