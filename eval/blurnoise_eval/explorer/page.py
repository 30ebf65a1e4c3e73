"""The page of the explorer: one visitor's, which turns what the visitor does into states of the visit.

It needs the extra ``[explore]``, and no network. Sliders hold positions; the state alone holds values.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable
from dataclasses import replace
from html import escape

from nicegui import events, ui

from blurnoise_eval.explorer import told
from blurnoise_eval.explorer.answers import Answers
from blurnoise_eval.explorer.controls import STEPS, Control
from blurnoise_eval.explorer.gate import UPLOADS
from blurnoise_eval.explorer.heat import Heat
from blurnoise_eval.explorer.shelf import Shelf, cell_state
from blurnoise_eval.explorer.side import KEYS, Side
from blurnoise_eval.explorer.state import OF_RUN, State
from blurnoise_eval.explorer.visit import Visit
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


def _finite(text: str) -> float:
    if not math.isfinite(number := float(text)):
        raise ValueError(text)
    return number


class Page:
    """One visitor's page, from a state on. usual: to which it goes back. note: what could not be had of a URL."""

    def __init__(self, shelf: Shelf, state: State, usual: State, note: str = "") -> None:
        self.shelf, self._usual = shelf, usual
        self._dark = ui.dark_mode(None)
        self._answers = Answers(lambda file: f"/pictures/{self.visit.token}/{file}", self._put)
        self.visit = Visit(shelf, state, self._answers)
        ui.keyboard(self._key)
        with ui.element("div").classes("explorer"):
            self._build_top()
            self._answers.build_head(shelf.run is not None)
            with ui.element("main").classes("main"):
                self._answers.build_message()
                self._heat = Heat(shelf.run, state, self._condition) if shelf.run else None
                self._answers.build_main()
            with ui.element("aside").classes("side"):
                self._side = Side(shelf, self, f"{UPLOADS}{self.visit.token}/")
        with ui.dialog() as self._keys, ui.card():
            rows = "".join(f"<kbd>{key}</kbd><span>{what}</span>" for key, what in _HELP)
            ui.html(f'<div class="keys">{rows}</div>', sanitize=False)
        self._answers.js("explorer.listen()")
        self._stand()
        if note:
            self.fails(note)

    @property
    def state(self) -> State:
        """What is looked at."""
        return self.visit.state

    async def live(self) -> None:
        """Show what is looked at, until cancelled."""
        telling = asyncio.create_task(self._tell_run()) if self.shelf.run else None
        try:
            await self.visit.loop()
        finally:
            if telling is not None:
                telling.cancel()

    async def _tell_run(self) -> None:
        try:
            told = await asyncio.get_running_loop().run_in_executor(None, self.shelf.answer)
        except (ValueError, OSError) as error:
            told = "This run has no answer yet.", str(error)
        self._answers.run(*told)

    def fails(self, told: str) -> None:
        """A line on what cannot be done."""
        self._answers.fails(told)

    def change(self, state: State) -> None:
        """Look at another state."""
        self._answers.goes_on()
        if state != self.state:
            self._answers.js("document.body.classList.add('busy')")
            self.visit.change(state)
        self._stand()

    def _try(self, make: Callable[[], State], along: str = "") -> None:
        """Look at a state that may not be had; along: the control that was moved."""
        try:
            state = make()
            self.change(replace(state, along=along) if along else state)
        except (ValueError, TypeError) as error:
            self.fails(str(error))
            self._stand()

    def _stand(self) -> None:
        try:
            self._side.stand(self.state)
            if self._heat is not None:
                self._heat.draw(self.state)
        except (ValueError, TypeError) as error:
            self.fails(str(error))

    def _put(self, control: Control, value: float) -> None:
        self._try(lambda: control.put(self.state, value), control.name)

    # -- what the side tells ---------------------------------------------------------------------------------

    def slid(self, name: str, position: float) -> None:
        """A slider stands elsewhere."""
        if (control := self._side.control(name)) is not None:
            self._put(control, control.value(position))

    def chosen(self, name: str, place: float) -> None:
        """A choice was made."""
        if (control := self._side.control(name)) is not None:
            self._put(control, place)

    def typed(self, name: str, text: str) -> None:
        """A number, or "auto", was typed."""
        control = self._side.control(name)
        if control is None:
            return
        said = text.strip().lower()
        try:
            number = (
                AUTOMATIC
                if said == "auto" and control.automatic
                else _finite(said.split()[0].replace(",", "."))
            )
        except (ValueError, IndexError):
            self.fails(f"{control.title.lower()} = {text[:40]!r}: must be a number")
            self._stand()
            return
        self._put(control, number)

    def automatic(self, name: str) -> None:
        """Left to the camera, or taken back from it, where the camera has set it."""
        control = self._side.control(name)
        if control is None:
            return
        value = AUTOMATIC
        if control.read(self.state, self.shelf.camera(self.state)) == AUTOMATIC:
            value = control.value(STEPS / 2)
            last = self._answers.last
            if last is not None and last.frame.exposure is not None:
                taken = last.frame.exposure
                value = {"exposure_s": 1e3 * taken.exposure_s, "gain_db": taken.gain_db}.get(name, value)
                value = min(control.high, max(control.low, float(f"{value:.4g}")))
        self._put(control, value)

    def selected(self, kind: str, name: str) -> None:
        """Another picture, camera or model."""
        if name != getattr(self.state, kind):
            state = replace(self.state, **{kind: name}, cell="")  # type: ignore[arg-type]
            self._try(lambda: state.put(MOVES.name, None) if kind == "picture" else state)

    async def uploaded(self, kind: str, name: str, content: bytes) -> None:
        """A file has arrived: take it, or say why not."""
        try:
            taken = await asyncio.get_running_loop().run_in_executor(
                None, self.shelf.take, kind, name, content
            )
        except (ValueError, OSError, MemoryError) as error:
            self.fails(str(error))
            return
        self._side.fill()
        self._answers.goes_on()
        self.selected(kind, taken)

    # -- a run, keys, and what is copied ---------------------------------------------------------------------

    def _condition(self, at: dict[str, float]) -> None:
        """A cell of the run's map: of the picture that is seen, or of the first."""
        run = self.shelf.run
        if run is not None:
            own = self.state.picture.removeprefix(f"{OF_RUN}/")
            picture = own if own in run.pictures else run.pictures[0]
            self._try(lambda: cell_state(self.shelf, run.cell_at(at, picture), self.state))

    def _key(self, event: events.KeyEventArguments) -> None:
        modified = event.modifiers.ctrl or event.modifiers.meta or event.modifiers.alt
        if not event.action.keydown or modified:
            return
        key = event.key.name
        if len(key) == 1 and key.lower() in KEYS:
            self._step(KEYS[key.lower()], 1 if key.isupper() else -1)
        elif key == "n":
            self._try(lambda: replace(self.state, seed=self.state.seed + 1, cell=""))
        elif key == "b":
            self._answers.js("document.body.classList.toggle('no-boxes')")
        elif key in ("c", "p"):
            self._copy("command" if key == "c" else "script")
        elif key == "d":
            self._answers.js("explorer.turn()")
        elif key == "r":
            self.change(self._usual)
        elif key == "?":
            self._keys.open()

    def _step(self, name: str, towards: int) -> None:
        control = self._side.control(name)
        if control is not None:
            at = control.read(self.state, self.shelf.camera(self.state))
            place = STEPS / 2 if at == AUTOMATIC else control.position(at)
            self.slid(name, place + _KEY_STEP * towards)

    def _copy(self, what: str) -> None:
        make = told.command if what == "command" else told.python
        text = make(self.state, self.shelf.files(self.state))
        self._answers.js(f"explorer.copy({json.dumps(text)})")
        with ui.dialog(value=True) as dialog, ui.card():
            ui.label(f"Copied: the {what} that makes this picture, bit for bit")
            ui.html(escape(text), sanitize=False, tag="pre").classes("shown-code")
            ui.button("Close", on_click=dialog.close).props("flat no-caps")
        dialog.on("hide", dialog.delete)

    def _turn(self, dark: bool) -> None:
        self._dark.value = dark

    def _build_top(self) -> None:
        with ui.element("nav").classes("top"):
            name = self.shelf.run.folder.name if self.shelf.run else "explorer"
            ui.html(f"blurnoise<small>{escape(name)}</small>", sanitize=False).classes("mark")
            for text, what in (("Command", "command"), ("Python", "script")):
                button = ui.button(text, icon="content_copy", on_click=lambda what=what: self._copy(what))
                button.props('flat dense no-caps size=sm padding="4px 8px"').classes(f"copy-{what}")
                button.props(f'aria-label="Copy as {text}" title="Copy as {text}"')
            for icon, about, kind, act in (
                ("restart_alt", "Back to the start", "reset", lambda: self.change(self._usual)),
                ("contrast", "Light or dark", "dark", lambda: self._answers.js("explorer.turn()")),
                ("keyboard", "Keys", "wide", lambda: self._keys.open()),
            ):
                button = ui.button(icon=icon, on_click=act).classes(kind)
                button.props(f'flat dense round aria-label="{about}" title="{about}"')
        ui.on("turn", lambda event: self._turn(bool(event.args)))
