"""A session: the newest state counts, what fails is said and the session goes on, what is kept is bounded."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval.datasets import encode
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.rendered import POINTS
from blurnoise_eval.explorer.state import State

pytest.importorskip("nicegui")
from blurnoise_eval.explorer.page import Session  # needs NiceGUI

QUIET = State(model="none")


class Told:
    def __init__(self) -> None:
        self.events: list[tuple[str, Any]] = []
        self.painted = asyncio.Event()
        self.painted.set()

    async def preview(self, jpeg: bytes) -> None:
        self.events.append(("preview", jpeg))
        await self.painted.wait()

    def subject(self, subject: Any, file: str) -> None:
        self.events.append(("subject", file))

    def picture(self, file: str) -> None:
        self.events.append(("picture", file))

    def rendered(self, found: Any) -> None:
        self.events.append(("seen", found))

    def curve(self, curve: Any, along: Any, finished: bool) -> None:
        self.events.append(("curve", ([*curve], finished)))

    def fails(self, told: str) -> None:
        self.events.append(("fails", told))

    def of(self, kind: str) -> list[Any]:
        return [what for each, what in self.events if each == kind]


@pytest.fixture(scope="module")
def catalogue() -> Catalogue:
    return Catalogue()


def shown(catalogue: Catalogue, state: State, steps: Callable[[Session, Told], Any]) -> tuple[Session, Told]:
    told = Told()

    async def go() -> Session:
        session = Session(catalogue, state, told)  # type: ignore[arg-type]  # for a page
        loop = asyncio.create_task(session.run())
        await steps(session, told)
        loop.cancel()
        return session

    return asyncio.run(asyncio.wait_for(go(), 60)), told


async def until(ready: Callable[[], Any]) -> None:
    while not ready():
        await asyncio.sleep(0.01)


def test_what_is_shown_is_the_state_exactly(catalogue: Catalogue) -> None:
    async def steps(session: Session, told: Told) -> None:
        await until(lambda: told.of("seen"))

    session, told = shown(catalogue, QUIET, steps)
    (file,) = told.of("picture")
    content = session.files[file.rpartition("/")[2]]
    decoded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.array_equal(decoded, catalogue.render(QUIET).image)


def test_of_many_changes_the_last_is_seen_and_few_between(catalogue: Catalogue) -> None:
    async def steps(session: Session, told: Told) -> None:
        await until(lambda: told.of("seen"))
        for number in range(200):
            session.change(replace(QUIET, seed=number))
        await until(lambda: told.of("seen")[-1].state.seed == 199)

    session, told = shown(catalogue, QUIET, steps)
    assert len(told.of("seen")) <= 3
    names = [session._keep(bytes(3)) for _ in range(50)]
    assert len(session.files) <= 6
    assert session.files[names[-1].rpartition("/")[2]] == bytes(3)
    assert names[0].rpartition("/")[2] not in session.files


def test_a_large_picture_is_seen_smaller_first(catalogue: Catalogue) -> None:
    name = catalogue.take("large.png", encode(np.full((600, 700, 3), 90, np.uint8)))
    state = replace(QUIET, picture=name)

    async def steps(session: Session, told: Told) -> None:
        await until(lambda: told.of("seen"))
        session.change(replace(state, seed=4))
        await until(lambda: len(told.of("seen")) == 2)

    _, told = shown(catalogue, state, steps)
    full = ["picture", "seen"]
    assert [kind for kind, _ in told.events] == ["subject", *full, "preview", *full]


def test_while_a_smaller_picture_is_not_painted_no_other_is_sent(catalogue: Catalogue) -> None:
    name = catalogue.take("large.png", encode(np.full((600, 700, 3), 90, np.uint8)))
    state = replace(QUIET, picture=name)

    async def steps(session: Session, told: Told) -> None:
        await until(lambda: told.of("seen"))
        told.painted.clear()
        for number in range(1, 9):
            session.change(replace(state, seed=number))
            await until(lambda: told.of("preview"))
            await asyncio.sleep(0)
        told.painted.set()
        await until(lambda: len(told.of("seen")) == 2)

    _, told = shown(catalogue, state, steps)
    assert len(told.of("preview")) == 2  # the first, and the newest once that is painted
    assert len(told.of("picture")) == 2
    assert told.of("seen")[-1].state.seed == 8


def test_what_cannot_be_seen_is_said_and_the_session_goes_on(catalogue: Catalogue) -> None:
    async def steps(session: Session, told: Told) -> None:
        await until(lambda: told.of("seen"))
        for wrong in (
            replace(QUIET, camera="gone"),
            QUIET.put_figure("f_number", -3.0),
            QUIET.put("gain_db", 99.0),
        ):
            before = len(told.of("fails"))
            session.change(wrong)
            await until(lambda: len(told.of("fails")) > before)  # noqa: B023  # awaited within the loop
        session.change(replace(QUIET, seed=5))
        await until(lambda: len(told.of("seen")) == 2)

    _, told = shown(catalogue, QUIET, steps)
    first, second, third = told.of("fails")
    assert "camera = 'gone'" in first
    assert "f_number" in second
    assert "gain" in third


def test_without_its_model_a_picture_is_seen_and_the_model_told(catalogue: Catalogue) -> None:
    async def steps(session: Session, told: Told) -> None:
        await until(lambda: told.of("fails"))

    _, told = shown(catalogue, State(model="gone"), steps)
    assert [kind for kind, _ in told.events] == ["subject", "picture", "fails", "seen"]
    assert "model = 'gone'" in told.of("fails")[0]


def test_the_curve_comes_after_the_picture_and_ends(catalogue: Catalogue) -> None:
    async def steps(session: Session, told: Told) -> None:
        await until(lambda: told.of("curve") and told.of("curve")[-1][1])

    _, told = shown(catalogue, State(), steps)
    kinds = [kind for kind, _ in told.events]
    assert kinds[:3] == ["subject", "picture", "seen"]
    assert set(kinds[3:]) == {"curve"}
    curve = told.of("curve")[-1][0]
    assert len(curve) == POINTS
    assert curve == sorted(curve)
