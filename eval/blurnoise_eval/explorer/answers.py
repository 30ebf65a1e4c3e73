"""The page's answers: both pictures, the sentence, the strip, numbers, histogram and plan, as a visit is shown
them."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from html import escape

from nicegui import core, events, ui
from socketio.exceptions import TimeoutError as Unanswered  # type: ignore[import-untyped]  # it has none

from blurnoise_eval.explorer import drawn, words
from blurnoise_eval.explorer.controls import STEPS, Control
from blurnoise_eval.explorer.judging import works
from blurnoise_eval.explorer.looking import Seen, Subject
from blurnoise_eval.explorer.state import State
from blurnoise_eval.explorer.visit import Curve
from blurnoise_eval.grid.axes import AUTOMATIC

_STRIP_CLICK = """(e) => {
  const svg = e.target.closest("svg"), box = svg && svg.getBoundingClientRect();
  if (!svg) return;
  const left = Number(svg.dataset.left), right = Number(svg.dataset.right);
  emit(((e.clientX - box.left) / box.width - left) / (right - left));
}"""
_SMALL_PX = 640  # across; a smaller picture is shown pixel by pixel
_PATIENCE_S = 1.0  # for a picture to be painted


class Answers:
    """Built in two places, the head and the main column. url: of a picture's file. strip_clicked: told of the control
    of the strip and the value where it is clicked."""

    def __init__(self, url: Callable[[str], str], strip_clicked: Callable[[Control, float], None]) -> None:
        self._url, self._strip_clicked = url, strip_clicked
        self._client = ui.context.client
        self.last: Seen | None = None
        self._along: Control | None = None

    def build_head(self, of_run: bool) -> None:
        """The sentence: of a run its answer; what is made of one picture then stands with that."""
        self._of_run = of_run
        with ui.element("header").classes("answer"):
            if of_run:
                self._run = ui.html("Reading the run …", sanitize=False, tag="h1").classes("of-run")
                self._sure = ui.label("").classes("window")
            else:
                self._build_sentence("h1")

    def _build_sentence(self, tag: str) -> None:
        self._verdict = ui.html("Looking …", sanitize=False, tag=tag).props("aria-live=polite")
        self._window = ui.label("").classes("window")

    def build_message(self) -> None:
        """The place of what fails."""
        with ui.element("div").classes("message-slot"):
            self._message = ui.element("div").classes("message").props("role=alert")
            with self._message:
                self._message_text = ui.label("")
        self._message.set_visibility(False)

    def build_main(self) -> None:
        """Pictures first."""
        self._held: list[ui.element] = []
        if self._of_run:
            with ui.element("div").classes("answer of-cell"):
                self._build_sentence("h2")
        with ui.element("section").classes("panes"):
            self._conditions = self._pane(
                "seen", ("as-seen", "original"), "The picture as the camera takes it"
            )
            self._size = self._pane("untouched", ("as-is",), "The picture as it is")
        with ui.element("section").classes("card strip-card") as self._strip_card:
            self._strip_title = ui.label("Confidence").classes("strip-title")
            self._strip = ui.html("", sanitize=False)
            self._strip.on("click", self._clicked, js_handler=_STRIP_CLICK)
        with ui.element("dl").classes("card numbers-card"):
            self._numbers = ui.html("", sanitize=False).classes("numbers")
        with ui.element("section").classes("card"):
            ui.html("Values of the picture, red, green and blue", sanitize=False, tag="h2")
            self._histogram = ui.html("", sanitize=False)
        with ui.element("section").classes("card fold"), ui.expansion().props("dense") as fold:
            with fold.add_slot("header"):
                self._plan_title = ui.label("What the plan left out, and why").classes("plan-head")
            self._plan = ui.html("", sanitize=False).classes("plan-wrap")

    def _pane(self, kind: str, images: tuple[str, ...], about: str) -> ui.label:
        """One picture with what lies over it; returns the label below."""
        with ui.element("figure").classes(f"pane {kind}"):
            with ui.element("div").classes("held") as held:
                for place, each in enumerate(images):
                    ui.element("img").classes(each).props(f'alt="{"" if place else about}"')
                over = ui.html("", sanitize=False).classes("over")
                ui.element("div").classes("loupe")
            self._held.append(held)
            with ui.element("figcaption").classes("caption"):
                label = ui.label("")
                if kind == "seen":
                    self._over = over
                    hold = ui.button("Untouched").props("flat dense no-caps size=sm").classes("peek-button")
                    for event, on in (
                        ("pointerdown", "true"),
                        ("pointerup", "false"),
                        ("pointerleave", "false"),
                    ):
                        hold.on(event, js_handler=f"() => explorer.peek({on})")
                else:
                    self._over_clean = over
        return label

    def run(self, answer: str, sure: str) -> None:
        """What the run answers, as HTML, and how sure that is."""
        self._run.set_content(answer)
        self._sure.set_text(sure)

    # -- as a visit is shown ---------------------------------------------------------------------------------

    def subject(self, subject: Subject, file: str) -> None:
        """The untouched picture has changed."""
        height, width = subject.size
        for pane in self._held:
            pane.style(f"--ratio: {width / height:.5f}")
        for selector in (".untouched img.as-is", ".seen img.original"):
            self._show(selector, file, width)
        self._size.set_text(f"Untouched, {width} x {height} px")

    async def preview(self, jpeg: bytes) -> None:
        """A smaller picture, while a slider moves: through the open socket, past what NiceGUI keeps to send again."""
        with suppress(Unanswered):
            await core.sio.call("preview", jpeg, to=self._client.id, timeout=_PATIENCE_S)

    def picture(self, file: str, width_px: int) -> None:
        """The picture in full."""
        self._show(".seen img.as-seen", file, width_px)

    def seen(self, seen: Seen) -> None:
        """What is told of the picture."""
        self.last = seen
        size = seen.image.shape[0], seen.image.shape[1]
        found_from = seen.standard.found_from if seen.standard else 0.0
        query = json.dumps(f"?{seen.state.query()}" if seen.state.query() else "")
        self.js(f"history.replaceState(null, '', location.pathname + {query})")
        self.js("document.body.classList.remove('busy')")
        self._over.set_content(drawn.boxes(seen.sight, size, found_from, seen.classes))
        self._over_clean.set_content(drawn.boxes(seen.clean, size, found_from, seen.classes))
        self._verdict.set_content(words.verdict(seen))
        self._conditions.set_text(words.conditions(seen))
        self._numbers.set_content(
            "".join(
                f"<div><dt>{escape(each.title)}</dt><dd data-number={each.name}><b>{escape(each.text)}</b>"
                f"<small>{escape(each.about)}</small></dd></div>"
                for each in seen.numbers
            )
        )
        if seen.histogram is not None:
            self._histogram.set_content(drawn.histogram(seen.histogram, seen.clipped))
        self._plan.set_content(drawn.plan_table(seen.plan))
        self._plan_title.set_text(words.left_out(seen.plan))
        self._strip_card.set_visibility(bool(seen.sight and seen.sight.targets))
        self._window.set_text(words.instead(seen))

    def strip(self, state: State, curve: Curve, along: Control, finished: bool) -> None:
        """The strip so far."""
        self._along = along
        exposure = self.last.frame.exposure if self.last else None
        at = along.read(state, self.last.camera) if self.last else AUTOMATIC
        if at == AUTOMATIC and exposure is not None:
            at = {"exposure_s": 1e3 * exposure.exposure_s, "gain_db": exposure.gain_db}.get(along.name, at)
        standard = self.last.standard if self.last else None
        if standard is None:
            return
        kept = works(curve, standard.enough, at, logarithmic=along.logarithmic) if finished else None
        unit = f", {along.unit}" if along.unit else ""
        self._strip_title.set_text(f"{standard.title} along {along.title.lower()}{unit}")
        self._strip.set_content(drawn.strip(curve, along, at, standard.enough, kept))
        if finished:
            self._window.set_text(words.window(curve, along, at, standard))

    def fails(self, told: str) -> None:
        """A line on what cannot be done; what was seen before stays."""
        if self.last is None:
            self._verdict.set_content("No picture yet.")
        self._message_text.set_text(told)
        self._message.set_visibility(True)
        self.js("document.body.classList.remove('busy')")

    def goes_on(self) -> None:
        """What failed is passed: no line on it."""
        self._message.set_visibility(False)

    def js(self, code: str) -> None:
        """Run a line in the visitor's browser, from wherever this is called."""
        with self._client:
            ui.run_javascript(code)

    def _show(self, selector: str, file: str, width: int) -> None:
        small = "true" if width < _SMALL_PX else "false"
        self.js(f"explorer.show({selector!r}, {self._url(file)!r}, {small})")

    def _clicked(self, event: events.GenericEventArguments) -> None:
        if isinstance(event.args, (int, float)) and self._along is not None:
            share, along = min(1.0, max(0.0, float(event.args))), self._along
            count = len(along.choices)
            value = float(min(count - 1, int(share * count))) if count else along.value(STEPS * share)
            self._strip_clicked(along, value)
