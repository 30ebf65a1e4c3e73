"""The page's answers: both pictures, sentences, the curve of scores, numbers, histogram and plan."""

from __future__ import annotations

import asyncio
from base64 import b64encode
from collections.abc import Callable
from contextlib import suppress
from html import escape

from nicegui import events, ui

from blurnoise_eval.explorer import charts, sentences
from blurnoise_eval.explorer.boxes import boxes
from blurnoise_eval.explorer.controls import Control
from blurnoise_eval.explorer.judging import Point, works
from blurnoise_eval.explorer.rendered import Rendered, Subject
from blurnoise_eval.explorer.state import State
from blurnoise_eval.grid.axes import AUTOMATIC

_CLICK = """(e) => {
  const chart = getElement(ID).chart, left = chart.getDom().getBoundingClientRect().left;
  emit(chart.convertFromPixel({xAxisIndex: 0}, e.clientX - left));
}"""
_SMALL_PX = 640  # across; a smaller picture is shown pixel by pixel
_PAINTED_S = 1.0  # for a picture to be painted, before the next one is sent all the same


class Answers:
    """Shows what a :class:`~.session.Session` renders. url: of a picture's file. chosen: called with the control of
    the curve and the value where it is clicked. base: of the query in the page's address. of_run: the run's own
    answer stands first."""

    def __init__(
        self,
        url: Callable[[str], str],
        chosen: Callable[[Control, float], None],
        base: State,
        *,
        of_run: bool,
    ) -> None:
        self._url, self._chosen, self._of_run = url, chosen, of_run
        self._base = base
        self.last: Rendered | None = None
        self._along: Control | None = None
        self._painted = asyncio.Event()

    def build_head(self) -> None:
        """The sentence that answers: of a run its own."""
        with ui.element("header").classes("answer"):
            if self._of_run:
                self._run = ui.html("Reading the run …", sanitize=False, tag="h1").classes("of-run")
                self._sure = ui.label().classes("window")
            else:
                self._build_sentence("h1")

    def build_main(self) -> None:
        """Pictures first."""
        self._message = ui.label().classes("message").props("role=alert")
        self._message.set_visibility(False)
        if self._of_run:
            with ui.element("div").classes("answer of-cell"):
                self._build_sentence("h2")
        with ui.element("section").classes("panes") as self._panes:
            self._seen, self._conditions = self._pane("seen", "The picture as the camera takes it")
            self._original, self._size = self._pane("untouched", "The picture as it is")
        with self._seen:
            self._held = ui.element("img").classes("original").props('alt=""')
        self._seen.on("loaded", self._painted.set, args=[])
        with ui.element("section").classes("card curve-card") as self._curve_card:
            self._title = ui.html("", sanitize=False, tag="h2")
            self._curve = ui.echart({}, renderer="svg").classes("curve")
            self._curve.on("click", self._clicked, js_handler=_CLICK.replace("ID", str(self._curve.id)))
        self._curve_card.set_visibility(False)
        self._numbers = ui.html("", sanitize=False, tag="dl").classes("card numbers")
        with ui.element("section").classes("card"):
            ui.html("Values of the picture, red, green and blue", sanitize=False, tag="h2")
            self._histogram = ui.echart({}, renderer="svg").classes("histogram")
            self._ends = ui.html("", sanitize=False).classes("ends")
        with ui.expansion("What the plan left out, and why").classes("card fold") as self._fold:
            columns = [("part", "part of the chain"), ("dn", "DN RMS, at most"), ("how", "what is done")]
            self._plan = ui.table(
                rows=[],
                columns=[
                    {"name": name, "label": label, "field": name, "align": "left"} for name, label in columns
                ],
            ).props("flat dense wrap-cells hide-bottom")
            self._left_out = ui.label().classes("window")

    def _build_sentence(self, tag: str) -> None:
        self._verdict = ui.html("Rendering …", sanitize=False, tag=tag).props("aria-live=polite")
        self._window = ui.label().classes("window")

    def _pane(self, kind: str, about: str) -> tuple[ui.interactive_image, ui.label]:
        """A picture with boxes over it, and the label below."""
        with ui.element("figure").classes(f"pane {kind}"):
            picture = ui.interactive_image(sanitize=False).props(f'alt="{about}"')
            with picture:
                ui.element("div").classes("loupe")
            with ui.element("figcaption"):
                label = ui.label()
                if kind == "seen":
                    hold = ui.button("Untouched").props("flat dense no-caps size=sm").classes("hold-button")
                    hold.on("pointerdown", lambda: self.hold(True))
                    hold.on("pointerup", lambda: self.hold(False))
        return picture, label

    def hold(self, on: bool) -> None:
        """The original in place of the picture, as long as it is held."""
        self._panes.classes(add="held" if on else "", remove="" if on else "held")

    def toggle_boxes(self) -> None:
        """Boxes on or off."""
        self._panes.classes(toggle="no-boxes")

    def busy(self, on: bool) -> None:
        """Whether another picture is being rendered."""
        self._panes.classes(add="busy" if on else "", remove="" if on else "busy")

    def run(self, answer: str, sure: str) -> None:
        """What the run answers, as HTML, and how sure that is."""
        self._run.set_content(answer)
        self._sure.set_text(sure)

    def fails(self, message: str) -> None:
        """A line on what cannot be done; what was shown before stays."""
        if self.last is None:
            self._verdict.set_content("No picture yet.")
        self._message.set_text(message)
        self._message.set_visibility(True)
        self.busy(False)

    def goes_on(self) -> None:
        """What failed is passed: no line on it."""
        self._message.set_visibility(False)

    # -- as a session shows it -------------------------------------------------------------------------------

    def subject(self, subject: Subject, file: str) -> None:
        """The original picture has changed."""
        height, width = subject.size
        self._panes.style(f"--ratio: {width / height:.5f}")
        self._panes.classes(
            add="small" if width < _SMALL_PX else "", remove="" if width < _SMALL_PX else "small"
        )
        self._original.set_source(self._url(file))
        self._held.props(f'src="{self._url(file)}"')
        self._size.set_text(f"Untouched, {width} x {height} px")

    async def preview(self, jpeg: bytes) -> None:
        """A smaller picture, while a slider moves."""
        self._painted.clear()
        source = f"data:image/jpeg;base64,{b64encode(jpeg).decode()}"
        with self._panes:  # past the page's elements, which NiceGUI would render anew
            ui.run_javascript(f"getElement({self._seen.id}).$refs.img.src = '{source}'")
        with suppress(TimeoutError):
            await asyncio.wait_for(self._painted.wait(), _PAINTED_S)

    def picture(self, file: str) -> None:
        """The picture in full."""
        self._seen.set_source(self._url(file))

    def rendered(self, found: Rendered) -> None:
        """What is measured and found in the picture."""
        self.last = found
        with self._panes:
            ui.navigate.history.replace(f"/?{found.state.query(self._base)}")
        size = found.image.shape[0], found.image.shape[1]
        found_from = found.standard.found_from if found.standard else 0.0
        self._seen.set_content(boxes(found.sight, size, found_from, found.classes))
        self._original.set_content(boxes(found.clean, size, found_from, found.classes))
        self._verdict.set_content(sentences.verdict(found))
        self._conditions.set_text(sentences.conditions(found))
        self._numbers.set_content(
            "".join(
                f"<div><dt>{escape(each.title)}</dt><dd data-number={each.name}><b>{escape(each.text)}</b>"
                f"<small>{escape(each.about)}</small></dd></div>"
                for each in found.numbers
            )
        )
        self._histogram.options.update(charts.histogram(found.histogram))
        self._histogram.update()
        low, high = found.clipped
        self._ends.set_content(f"<span>{low:.2%} black</span><span>{high:.2%} clipped</span>")
        self._plan.rows = [
            {"part": each.name, "dn": f"{each.contribution_dn:.2g}", "how": each.how}
            for each in found.plan.stages
        ]
        self._fold.set_text(sentences.left_out(found))
        allowed = f"{found.plan.left_out_dn:.2g} of {found.plan.tolerance_dn:.3g} DN RMS allowed"
        self._left_out.set_text(f"Left out in all: {allowed}.")
        targets = bool(found.sight and found.sight.targets)
        self._curve_card.set_visibility(targets)
        self._window.set_text(
            "" if targets or found.sight is None or found.sight.error else sentences.INSTEAD
        )
        self.busy(False)

    def curve(self, curve: list[Point], along: Control, finished: bool) -> None:
        """Scores along a control, as far as they are known."""
        found = self.last
        if found is None or found.standard is None:
            return
        self._along = along
        at = along.read(found.state, found.camera)
        if at == AUTOMATIC:
            at = {"exposure_s": 1e3 * found.exposure.exposure_s, "gain_db": found.exposure.gain_db}[
                along.name
            ]
        enough = found.standard.enough
        window = works(curve, enough, at, logarithmic=along.logarithmic) if finished else None
        unit = f", {along.unit}" if along.unit else ""
        self._title.set_content(escape(f"{found.standard.title} along {along.title.lower()}{unit}"))
        self._curve.options.clear()
        self._curve.options.update(charts.scores(curve, along, at, enough, window))
        self._curve.update()
        if finished:
            self._window.set_text(sentences.window(curve, along, at, found.standard))

    def _clicked(self, event: events.GenericEventArguments) -> None:
        if isinstance(event.args, (int, float)) and self._along is not None:
            along, value = self._along, float(event.args)
            value = float(round(value)) if along.choices else along.value(along.position(value))
            self._chosen(along, min(along.high, max(along.low, value)))
