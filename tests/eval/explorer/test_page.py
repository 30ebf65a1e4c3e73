"""A page: the newest state counts, what fails is said and the page goes on, what is kept is bounded."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.rendered import POINTS
from blurnoise_eval.explorer.state import State

pytest.importorskip("nicegui")
from blurnoise_eval.explorer import page as pages  # needs NiceGUI
from blurnoise_eval.explorer.page import Page

QUIET = State(model="none")


class Told(Page):
    """A page without elements: what it would show, in order."""

    def _build(self):
        self.events: list[tuple[str, Any]] = []
        self.paints = True
        for name in ("_panes", "_original", "_seen", "_curve", "_window", "_message"):
            setattr(self, name, MagicMock())
        self._seen.set_source = lambda url: self.events.append(("picture", url))
        self._curve.options.update = lambda options: self.events.append(("curve", options["series"][0]))

    def fails(self, message):
        if message:
            self.events.append(("fails", message))

    def _show_controls(self):
        pass

    def _show_rendered(self, found):
        self.events.append(("seen", found))

    def of(self, kind):
        return [what for each, what in self.events if each == kind]

    def show(self, state):
        self.state = state
        self._changed.set()

    def navigated(self, url):
        self.events.append(("page", url))

    def run_javascript(self, script):
        self.events.append(("preview", script))
        if self.paints:
            self._painted.set()


@pytest.fixture(scope="module")
def catalogue():
    return Catalogue()


Steps = Callable[[Told], Awaitable[None]]
Visit = Callable[[State, Steps], Told]


@pytest.fixture
def visit(catalogue, monkeypatch):
    async def go(state, steps):
        page = Told(catalogue, state, {})
        navigate = SimpleNamespace(to=page.navigated)
        monkeypatch.setattr(
            pages, "ui", SimpleNamespace(run_javascript=page.run_javascript, navigate=navigate)
        )
        loop = asyncio.create_task(page.live())
        await steps(page)
        loop.cancel()
        return page

    return lambda state, steps: asyncio.run(asyncio.wait_for(go(state, steps), 60))


async def until(ready):
    while not ready():
        await asyncio.sleep(0.01)


def test_of_many_changes_the_last_is_seen_exactly_and_few_between(visit, catalogue):
    async def steps(page):
        await until(lambda: page.of("seen"))
        for number in range(200):
            page.show(replace(QUIET, seed=number))
        await until(lambda: page.of("seen")[-1].state.seed == 199)

    page = visit(QUIET, steps)
    assert len(page.of("seen")) <= 3
    content = page.files[page.of("picture")[-1].rpartition("/")[2]]
    decoded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.array_equal(decoded, catalogue.render(replace(QUIET, seed=199)).frame.image)
    names = [page._keep(bytes(3)).rpartition("/")[2] for _ in range(50)]
    assert [*page.files] == names[-6:]


def test_what_cannot_be_seen_is_said_and_the_page_goes_on(visit):
    wrong = {
        "camera = 'gone'": replace(QUIET, camera="gone"),
        "read_noise_e": QUIET.put("read_noise_e", -3.0),
        "gain": QUIET.put("gain_db", 99.0),
    }

    async def steps(page):
        await until(lambda: page.of("seen"))
        for place, state in enumerate(wrong.values()):
            page.show(state)
            await until(lambda place=place: len(page.of("fails")) > place)
        page.show(replace(QUIET, seed=5))
        await until(lambda: len(page.of("seen")) == 2)

    page = visit(QUIET, steps)
    for told, part in zip(page.of("fails"), wrong, strict=True):
        assert part in told


@pytest.mark.parametrize("other", [{"picture": "sign-2"}, {"camera": "ar0237"}, {"model": "built-in"}])
def test_another_picture_camera_or_model_is_another_page(other, visit, catalogue):
    """Also where a cell of a run asks for it: this page would show its own picture under the cell's address."""
    wanted = replace(QUIET, **other, seed=7)

    async def steps(page):
        page.change(lambda: wanted)
        page.change(lambda: replace(QUIET, seed=8))

    page = visit(QUIET, steps)
    (url,) = page.of("page")
    assert State.of_query(url.removeprefix("/?"), catalogue.base) == wanted
    assert page.state == replace(QUIET, seed=8)


@pytest.mark.parametrize(
    ("model", "kinds"), [("gone", ["picture", "fails", "seen"]), ("built-in", ["picture", "seen", "curve"])]
)
def test_the_picture_comes_first_with_its_model_or_without(model, kinds, visit):
    async def steps(page):
        await until(lambda: len(page.events) == 3)

    page = visit(State(model=model), steps)
    assert [kind for kind, _ in page.events] == kinds
    assert all("model = 'gone'" in told for told in page.of("fails"))
    assert all(len(curve["data"]) == POINTS for curve in page.of("curve"))
