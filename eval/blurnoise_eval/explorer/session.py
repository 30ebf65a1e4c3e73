"""A session: one visitor's state, and the loop that shows it: the newest state counts, older ones are passed over.

The picture comes first and alone: while a slider moves a smaller one, each once the last has been painted; at rest
the full one, then what is measured and found in it, then the curve. The work is done in a few threads that all
visitors share, so that the server goes on answering.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, TypeVar
from uuid import uuid4

import cv2

from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.rendered import Picture8, Point, Subject, curve_points, rendered
from blurnoise_eval.explorer.state import State, control
from blurnoise_eval.sweep.exposing import Frame

if TYPE_CHECKING:
    from blurnoise_eval.explorer.page import Page

FIRST = ThreadPoolExecutor(2, thread_name_prefix="explorer-first")
REST = ThreadPoolExecutor(2, thread_name_prefix="explorer-rest")
"""Smaller pictures wait for no full one."""
_PICTURES = 6
_REST_S = 0.15
"""A slider that has not moved for so long is taken to rest."""
_EXPECTED = (ValueError, TypeError, OSError, MemoryError, RuntimeError)
T = TypeVar("T")


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
