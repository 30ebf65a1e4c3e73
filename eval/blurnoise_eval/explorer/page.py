"""The page of the explorer: how a visit is laid out in a browser. It needs the extra ``[explore]``, and no network.

Sliders hold positions; the state alone holds values. What the visitor does goes into the visit as a new state, and
what the visit sees comes back into elements that are there from the start.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from nicegui import events, ui

from blurnoise_eval.explorer import drawn, told, words
from blurnoise_eval.explorer.controls import STEPS, Control, control, controls
from blurnoise_eval.explorer.looking import Seen, Subject, works
from blurnoise_eval.explorer.shelf import MOST_UPLOADED_MB, Shelf, cell_state
from blurnoise_eval.explorer.state import OF_RUN, State
from blurnoise_eval.explorer.visit import Curve, Visit
from blurnoise_eval.grid.axes import AUTOMATIC

_KEYS = {"e": "exposure_s", "l": "illuminance_lux", "s": "speed", "g": "gain_db"}
"""Keys that move a control down, and with Shift up."""
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


class Page:
    """One visitor's page."""

    def __init__(self, shelf: Shelf, state: State, usual: State, note: str = "") -> None:
        self.shelf, self._usual = shelf, usual
        self.visit = Visit(shelf, state, self)
        self._client = ui.context.client
        self._rows: dict[str, _Row] = {}
        self._camera_of_rows = ""
        self._last: Seen | None = None
        self._building = False
        self._dark = ui.dark_mode(None)
        self._build()
        if note:
            self.fails(note)

    @property
    def state(self) -> State:
        """What is looked at."""
        return self.visit.state

    # -- what the visitor does -----------------------------------------------------------------------------------------

    def change(self, state: State, along: str = "") -> None:
        """Look at another state; along: the control that was moved."""
        if along:
            state = replace(state, along=along)
        if state != self.state:
            ui.run_javascript("document.body.classList.add('busy')")
            self.visit.change(state)
            self._stand()

    def _try(self, make: Callable[[], State], along: str = "") -> None:
        try:
            self.change(make(), along)
        except (ValueError, TypeError) as error:
            self.fails(str(error))
            self._stand()

    async def _upload(self, kind: str, event: events.UploadEventArguments) -> None:
        try:
            content = await event.file.read()
            name = await asyncio.get_running_loop().run_in_executor(
                None, self.shelf.take, kind, event.file.name, content
            )
        except (ValueError, OSError, MemoryError) as error:
            self.fails(str(error))
            return
        finally:
            self._uploads[kind].reset()
        self._fill_selects()
        if kind == "picture":
            self.change(replace(self.state, picture=name, cell="").put("moves", None))
        else:
            self.change(replace(self.state, **{kind: name}, cell=""))  # type: ignore[arg-type]

    def _copy(self, how: str) -> None:
        make = told.command if how == "command" else told.python
        text = make(self.state, self.shelf.files(self.state))
        ui.run_javascript(f"explorer.copy({json.dumps(text)})")
        with ui.dialog(value=True) as dialog, ui.card():
            ui.label(f"Copied: the {'command' if how == 'command' else 'script'} that makes this picture, bit for bit")
            ui.element("pre").classes("shown-code").props(f"data-how={how}").add_slot("default")
            with dialog.default_slot.children[0].default_slot.children[1]:
                ui.html(drawn.escape(text), sanitize=False, tag="code")
            ui.button("Close", on_click=dialog.close).props("flat no-caps")
        dialog.on("hide", dialog.delete)

    def _key(self, event: events.KeyEventArguments) -> None:
        if not event.action.keydown or event.modifiers.ctrl or event.modifiers.meta or event.modifiers.alt:
            return
        key = event.key.name
        if key.lower() in _KEYS and len(key) == 1:
            self._step(_KEYS[key.lower()], 1 if key.isupper() else -1)
        elif key == "n":
            self._try(lambda: replace(self.state, seed=self.state.seed + 1, cell=""))
        elif key == "b":
            ui.run_javascript("document.body.classList.toggle('no-boxes')")
        elif key in "cp":
            self._copy("command" if key == "c" else "python")
        elif key == "d":
            self._toggle_dark()
        elif key == "r":
            self.change(self._usual)
        elif key == "?":
            self._keys.open()

    def _step(self, name: str, towards: int) -> None:
        row = self._rows.get(name)
        if row is not None:
            at = row.control.read(self.state, self.shelf.camera(self.state))
            place = STEPS / 2 if at == AUTOMATIC else row.control.position(at)
            value = row.control.value(max(0.0, min(float(STEPS), place + 5 * towards)))
            self._try(lambda: row.control.put(self.state, value), name)

    def _toggle_dark(self) -> None:
        self._dark.value = not self._dark.value

    def _cell(self, event: events.GenericEventArguments) -> None:
        run = self.shelf.run
        if run is None or not isinstance(event.args, str) or "," not in event.args:
            return
        model = self._run_model()
        found = run.heat_map(model, self._fixed)
        row, column = (int(part) for part in event.args.split(","))
        at = {axis.name: value for axis, value in found.fixed} | {found.across.name: found.columns[column]}
        at |= {found.down.name: found.rows[row]} if found.down else {}
        picture = self.state.picture.removeprefix(f"{OF_RUN}/")
        if picture not in run.pictures:
            picture = run.pictures[0]
        try:
            cell_id = run.cell_at(at, picture)
            self.change(cell_state(self.shelf, cell_id, self.state))
        except ValueError as error:
            self.fails(str(error))

    # -- what the visit shows ------------------------------------------------------------------------------------------

    def subject(self, subject: Subject, file: str) -> None:
        """The untouched picture has changed."""
        height, width = subject.size
        small = str(width < 640).lower()
        for pane in self._held:
            pane.style(f"--ratio: {width / height:.5f}")
        for selector in (".untouched img.as-is", ".seen img.original"):
            self._js(f"explorer.show({selector!r}, {self._url(file)!r}, {small})")
        self._size.set_text(f"{width} x {height} px")

    def previewed(self, file: str) -> None:
        """A smaller picture, while a slider moves."""
        self._js(f"explorer.show('.seen img.as-seen', {self._url(file)!r}, false)")

    def seen(self, seen: Seen, file: str) -> None:
        """The picture in full, and all that is told of it."""
        self._last = seen
        height, width = seen.image.shape[:2]
        small = str(width < 640).lower()
        url = json.dumps(f"?{seen.state.query()}" if seen.state.query() else "?")
        self._js(
            f"explorer.show('.seen img.as-seen', {self._url(file)!r}, {small});"
            f"history.replaceState(null, '', location.pathname + {url});"
            "document.body.classList.remove('busy')"
        )
        classes = getattr(getattr(self.shelf.model(seen.state), "contract", None), "classes", ())
        threshold = seen.state.threshold
        self._over.set_content(drawn.boxes(seen.sight, (height, width), threshold, classes))
        self._over_clean.set_content(drawn.boxes(seen.clean, (height, width), threshold, classes))
        self._verdict.set_content(words.verdict(seen))
        self._conditions.set_text(self._told(seen))
        self._numbers.set_content(
            "".join(
                f"<div><dt>{drawn.escape(each.title)}</dt><dd data-number={each.name}><b>{drawn.escape(each.text)}</b>"
                f"<small>{drawn.escape(each.about)}</small></dd></div>"
                for each in seen.numbers
            )
        )
        if seen.histogram is not None:
            self._histogram.set_content(drawn.histogram(seen.histogram, seen.clipped))
        self._plan.set_content(drawn.plan_table(seen.plan))
        left = [each for each in seen.plan.stages if not each.kept and each.contribution_dn > 0]
        self._plan_fold.set_text(f"What the plan left out: {len(left)} of {len(seen.plan.stages)} parts, and why")
        self._message.set_visibility(False)
        if seen.sight is None:
            self._strip_card.set_visibility(False)
            self._window.set_text("")
        else:
            self._strip_card.set_visibility(True)
        if self.shelf.run:
            self._draw_heat()

    def strip(self, state: State, curve: Curve, along: Control, finished: bool) -> None:
        """The strip so far."""
        at = along.read(state, self.shelf.camera(state))
        if at == AUTOMATIC and self._last is not None and self._last.frame.exposure is not None:
            exposure = self._last.frame.exposure
            at = {"exposure_s": 1e3 * exposure.exposure_s, "gain_db": exposure.gain_db}.get(along.name, at)
        kept = works(curve, state.threshold, at) if finished else None
        self._strip_title.set_text(f"Confidence along {along.title.lower()}{f', {along.unit}' if along.unit else ''}")
        self._strip.set_content(drawn.strip(curve, along, at, state.threshold, kept))
        if finished:
            self._window.set_text(words.window(curve, along, at, state.threshold))

    def fails(self, told: str) -> None:
        """A line on what cannot be done."""
        self._message_text.set_text(told)
        self._message.set_visibility(True)
        self._js("document.body.classList.remove('busy')")

    def _told(self, seen: Seen) -> str:
        exposure = seen.frame.exposure
        if exposure is None:
            return ""
        return (
            f"{1e3 * exposure.exposure_s:.4g} ms, {exposure.illuminance_lux:.4g} lux, {seen.camera.name}, "
            f"gain {exposure.gain_db:.1f} dB"
        )

    def _url(self, file: str) -> str:
        return f"/pictures/{self.visit.token}/{file}"

    def _js(self, code: str) -> None:
        with self._client:
            ui.run_javascript(code)

    # -- how it is laid out --------------------------------------------------------------------------------------------

    def _build(self) -> None:
        ui.keyboard(self._key)
        self._uploads: dict[str, ui.upload] = {}
        with ui.element("div").classes("explorer"):
            self._build_top()
            with ui.element("header").classes("answer"):
                self._verdict = ui.html("Looking …", sanitize=False, tag="h1").props("aria-live=polite")
                self._window = ui.element("p")
                with self._window:
                    self._window = ui.label("")  # type: ignore[assignment]
            with ui.element("main").classes("main"):
                with ui.element("div").classes("message-slot"), ui.element("div").classes("message").props("role=alert") as box:
                    self._message, self._message_text = box, ui.label("")
                self._message.set_visibility(False)
                if self.shelf.run:
                    self._build_heat()
                self._build_panes()
                with ui.element("dl").classes("card numbers-card"):
                    self._numbers = ui.html("", sanitize=False).classes("numbers")
                with ui.element("section").classes("card strip-card") as self._strip_card:
                    self._strip_title = ui.label("Confidence").classes("strip-title")
                    self._strip = ui.html("", sanitize=False)
                    self._strip.on("click", self._strip_clicked, js_handler=_STRIP_CLICK)
                with ui.element("section").classes("card"):
                    ui.html("Values of the picture, red, green and blue", sanitize=False, tag="h2")
                    self._histogram = ui.html("", sanitize=False)
                with ui.element("section").classes("card fold"), ui.expansion().props("dense") as fold:
                    with fold.add_slot("header"):
                        self._plan_fold = ui.label("What the plan left out, and why").classes("plan-head")
                    self._plan = ui.html("", sanitize=False).classes("plan-wrap")
            with ui.element("aside").classes("side"):
                self._build_side()
        with ui.dialog() as self._keys, ui.card():
            ui.html(
                '<div class="keys">' + "".join(f"<kbd>{key}</kbd><span>{what}</span>" for key, what in _HELP) + "</div>",
                sanitize=False,
            )

    def _build_top(self) -> None:
        with ui.element("nav").classes("top"):
            run = f"<small>{drawn.escape(self.shelf.run.folder.name)}</small>" if self.shelf.run else "<small>explorer</small>"
            ui.html(f"blurnoise{run}", sanitize=False).classes("mark")
            for text, how in (("Copy as command", "command"), ("Copy as Python", "python")):
                ui.button(text.removeprefix("Copy as ").capitalize(), icon="content_copy", on_click=lambda how=how: self._copy(how)).props(
                    f'flat dense no-caps size=sm padding="4px 8px" aria-label="{text}" title="{text}"'
                ).classes(f"copy-{how}")
            ui.button(icon="restart_alt", on_click=lambda: self.change(self._usual)).props(
                'flat dense round aria-label="Back to the start" title="Back to the start"'
            ).classes("reset")
            ui.button(icon="contrast", on_click=self._toggle_dark).props(
                'flat dense round aria-label="Light or dark" title="Light or dark"'
            ).classes("dark")
            ui.button(icon="keyboard", on_click=lambda: self._keys.open()).props(
                'flat dense round aria-label="Keys" title="Keys"'
            ).classes("wide")

    def _build_panes(self) -> None:
        self._held: list[ui.element] = []
        with ui.element("section").classes("panes"):
            with ui.element("figure").classes("pane seen"):
                with ui.element("div").classes("held") as held:
                    ui.element("img").classes("as-seen").props('alt="The picture as the camera takes it"')
                    ui.element("img").classes("original").props('alt=""')
                    self._over = ui.html("", sanitize=False).classes("over")
                    ui.element("div").classes("loupe")
                self._held.append(held)
                with ui.element("figcaption").classes("caption"):
                    self._conditions = ui.label("")
                    hold = ui.button("Untouched").props('flat dense no-caps size=sm').classes("peek-button")
                    hold.on("pointerdown", js_handler="() => explorer.peek(true)")
                    hold.on("pointerup", js_handler="() => explorer.peek(false)")
                    hold.on("pointerleave", js_handler="() => explorer.peek(false)")
            with ui.element("figure").classes("pane untouched"):
                with ui.element("div").classes("held") as held:
                    ui.element("img").classes("as-is").props('alt="The picture as it is"')
                    self._over_clean = ui.html("", sanitize=False).classes("over")
                    ui.element("div").classes("loupe")
                self._held.append(held)
                with ui.element("figcaption").classes("caption"):
                    ui.label("Untouched")
                    self._size = ui.label("")

    def _build_side(self) -> None:
        with ui.element("section").classes("card conditions"):
            self._controls = ui.element("div")
        with ui.element("section").classes("card tools"):
            shelf = self.shelf
            self._selects = {
                "picture": ui.select(shelf.pictures(), label="Picture", on_change=lambda e: self._select("picture", e.value)),
                "camera": ui.select(shelf.cameras(), label="Camera", on_change=lambda e: self._select("camera", e.value)),
                "model": ui.select(shelf.models(), label="Model", on_change=lambda e: self._select("model", e.value)),
            }
            for each in self._selects.values():
                each.props("outlined dense options-dense").classes("w-full").style("margin-bottom: 10px")
            with ui.element("div").classes("uploads"):
                for kind, accept in (("picture", ".png,.jpg,.jpeg,.tif,.tiff,.bmp,.webp,.ppm"), ("camera", ".yaml,.yml,.json"), ("model", ".onnx")):
                    ui.button(kind.capitalize(), icon="upload").props(
                        f'outline dense no-caps size=sm aria-label="Upload a {kind}" title="Upload a {kind}"'
                    ).on("click", js_handler=f"() => explorer.choose({kind!r})")
                    upload = ui.upload(
                        on_upload=lambda event, kind=kind: self._upload(kind, event),
                        on_rejected=lambda kind=kind: self.fails(
                            f"{kind}: too large; must be at most {MOST_UPLOADED_MB[kind]} MB"
                        ),
                        max_file_size=MOST_UPLOADED_MB[kind] * 2**20,
                        auto_upload=True,
                    )
                    self._uploads[kind] = upload.classes(f"hidden-upload upload-{kind}").props(f'tabindex=-1 aria-hidden=true data-accept="{accept}"')
            threshold = _slider_row("Found from a confidence of")
            self._threshold, self._threshold_text = threshold
            self._threshold.on_value_change(lambda e: self._set_threshold(e.value))
        with ui.element("section").classes("card fold"), ui.expansion("The camera's own figures").props("dense"):
            self._figures = ui.element("div").classes("w-full")
        self._make_rows()

    def _make_rows(self) -> None:
        """Sliders for this camera: ranges follow it."""
        self._building = True
        camera = self.shelf.camera(self.state)
        self._controls.clear()
        self._figures.clear()
        self._rows = {}
        moves_apart = self.state.picture.startswith(("sign-", f"{OF_RUN}/"))
        keys = {name: key for key, name in _KEYS.items()}
        for each in controls(self.shelf.base_camera(self.state.camera)):
            if each.choices and each.name == "moves" and not moves_apart:
                continue
            with self._controls if each.group == "Conditions" else self._figures:
                self._rows[each.name] = _Row(each, keys.get(each.name, ""), self)
        self._camera_of_rows = f"{self.state.camera} {moves_apart}"
        self._building = False
        self._stand(camera=camera)

    def _stand(self, camera: Any = None) -> None:
        """Put sliders and selects where the state is."""
        moves_apart = self.state.picture.startswith(("sign-", f"{OF_RUN}/"))
        if self._camera_of_rows != f"{self.state.camera} {moves_apart}":
            try:
                self._make_rows()
            except ValueError as error:
                self.fails(str(error))
            return
        self._building = True
        try:
            camera = camera or self.shelf.camera(self.state)
            for row in self._rows.values():
                row.stand(self.state, row.control.read(self.state, camera))
            for kind, select in self._selects.items():
                if select.value != getattr(self.state, kind) and getattr(self.state, kind) in select.options:
                    select.set_value(getattr(self.state, kind))
            self._threshold.set_value(round(100 * self.state.threshold))
            self._threshold_text.set_text(f"{self.state.threshold:.2f}")
        except ValueError as error:
            self.fails(str(error))
        finally:
            self._building = False

    def _fill_selects(self) -> None:
        self._building = True
        shelf = self.shelf
        for kind, titles in (("picture", shelf.pictures()), ("camera", shelf.cameras()), ("model", shelf.models())):
            self._selects[kind].set_options(titles)
        self._building = False

    def _select(self, kind: str, value: str) -> None:
        if not self._building and value and value != getattr(self.state, kind):
            state = replace(self.state, **{kind: value}, cell="")  # type: ignore[arg-type]
            self.change(state.put("moves", None) if kind == "picture" else state)

    def _set_threshold(self, percent: float | None) -> None:
        if not self._building and percent is not None:
            self._try(lambda: replace(self.state, threshold=percent / 100))

    def moved(self, name: str, position: float) -> None:
        """A slider stands elsewhere."""
        row = self._rows.get(name)
        if not self._building and row is not None:
            self._try(lambda: row.control.put(self.state, row.control.value(position)), name)

    def typed(self, name: str, text: object) -> None:
        """A number, or "auto", was typed beside a slider."""
        row = self._rows[name]
        said = str(text).strip().lower()
        try:
            number = AUTOMATIC if said == "auto" and row.control.automatic else float(said.split()[0])
        except (ValueError, IndexError):
            self.fails(f"{row.control.title.lower()} = {str(text)[:40]!r}: must be a number")
            self._stand()
            return
        self._try(lambda: row.control.put(self.state, number), name)

    def automatic(self, name: str) -> None:
        """Left to the camera, or taken back from it."""
        row, state = self._rows[name], self.state
        if row.control.read(state, self.shelf.camera(state)) == AUTOMATIC:
            value = row.control.value(STEPS / 2)
            if self._last is not None and self._last.frame.exposure is not None:
                set_ = self._last.frame.exposure
                value = {"exposure_s": 1e3 * set_.exposure_s, "gain_db": set_.gain_db}.get(name, value)
            self._try(lambda: row.control.put(state, round(value, 2)), name)
        else:
            self._try(lambda: row.control.put(state, AUTOMATIC), name)

    def _strip_clicked(self, event: events.GenericEventArguments) -> None:
        if isinstance(event.args, (int, float)):
            along = control(self.state.along, self.shelf.camera(self.state))
            share = min(1.0, max(0.0, float(event.args)))
            value = float(round(share * len(along.choices) - 0.5)) if along.choices else along.value(STEPS * share)
            self._try(lambda: along.put(self.state, value), along.name)

    # -- a run ---------------------------------------------------------------------------------------------------------

    def _run_model(self) -> str:
        run = self.shelf.run
        known = run.models if run else ()
        own = self.state.model.removeprefix(f"{OF_RUN}/")
        return own if own in known else known[0]

    def _build_heat(self) -> None:
        run = self.shelf.run
        if run is None:
            return
        self._fixed: dict[str, float] = {}
        found = run.heat_map(self._run_model())
        with ui.element("section").classes("card heat-card"):
            ui.html("The run: mean confidence over its pictures. A cell shows its picture, computed anew from its seed.", sanitize=False, tag="h2")
            with ui.row().classes("items-center"):
                for axis, value in found.fixed:
                    options = {each: axis.text(each) for each in run.tested(axis.name)}
                    ui.select(options, value=value, label=axis.title, on_change=lambda e, name=axis.name: self._fix(name, e.value)).props("outlined dense options-dense").style("min-width: 130px")
            self._heat = ui.html("", sanitize=False).classes("heat-wrap w-full")
            self._heat.on("click", self._cell, js_handler=_HEAT_CLICK)

    def _fix(self, name: str, value: float) -> None:
        self._fixed[name] = value
        self._draw_heat()

    def _draw_heat(self) -> None:
        run = self.shelf.run
        if run is None:
            return
        found = run.heat_map(self._run_model(), self._fixed)
        at = self.state.at
        column = [place for place, value in enumerate(found.columns) if at[found.across.name] == value]
        row = [place for place, value in enumerate(found.rows) if found.down is None or at[found.down.name] == value]
        chosen = f"{row[0]},{column[0]}" if self.state.cell and row and column else ""
        self._heat.set_content(drawn.heat_map(found, chosen))


class _Row:
    """A control on the page: its name, its number to type, and its slider or its choices."""

    def __init__(self, control: Control, key: str, page: Page) -> None:
        self.control = control
        name = control.name
        self._auto: ui.button | None = None
        with ui.element("div").classes("control").props(f"data-control={name}") as self._element:
            with ui.element("div").classes("line"):
                shortcut = f"<kbd>{key}</kbd>" if key else ""
                ui.html(f"{drawn.escape(control.title)}{shortcut}", sanitize=False).classes("name")
                if control.choices:
                    self._choice = ui.select(
                        dict(enumerate(control.choices)),
                        value=0,
                        on_change=lambda e: None if page._building else page._try(lambda: control.put(page.state, float(e.value)), name),
                    ).props(f'dense outlined options-dense aria-label="{control.title}"')
                    return
                if control.automatic:
                    self._auto = ui.button("auto", on_click=lambda: page.automatic(name)).props("flat dense").classes("auto")
                self._number = ui.input().props(f'dense outlined suffix="{control.unit}" aria-label="{control.title}, {control.unit}"')
                self._number.on("change", lambda e: page.typed(name, self._number.value))
            self._slider = ui.slider(min=0, max=STEPS, step=1).props(f'aria-label="{control.title}"')
            self._slider.on_value_change(lambda e: page.moved(name, e.value) if e.value is not None else None)

    def stand(self, state: State, value: float) -> None:
        """Stand where the state is."""
        self._element.classes(**({"add": "last"} if state.along == self.control.name else {"remove": "last"}))
        if self.control.choices:
            self._choice.set_value(int(value))
            return
        automatic = value == AUTOMATIC
        if self._auto is not None:
            self._auto.props("color=primary" if automatic else "color=grey")
        self._number.set_value("auto" if automatic else f"{value:.4g}" if math.isfinite(value) else "")
        if not automatic and math.isfinite(value):
            place = round(self.control.position(value))
            if self._slider.value is None or abs(self._slider.value - place) >= 1:
                self._slider.set_value(place)


def _slider_row(title: str) -> tuple[ui.slider, ui.label]:
    with ui.element("div").classes("control").style("margin-top: 12px"):
        with ui.element("div").classes("line"):
            ui.label(title).classes("name")
            text = ui.label("").style("font-weight: 600")
        slider = ui.slider(min=0, max=100, step=1).props(f'aria-label="{title}"').classes("threshold-slider")
    return slider, text


_STRIP_CLICK = """(e) => {
  const svg = e.target.closest("svg"), box = svg && svg.getBoundingClientRect();
  if (!svg) return;
  const left = Number(svg.dataset.left), right = Number(svg.dataset.right);
  emit(((e.clientX - box.left) / box.width - left) / (right - left));
}"""
_HEAT_CLICK = '(e) => { const cell = e.target.closest("button[data-place]"); if (cell) emit(cell.dataset.place); }'
