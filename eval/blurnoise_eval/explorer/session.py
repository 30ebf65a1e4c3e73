"""A session: one visitor's state, and the loops that show it: the newest state counts, older ones are passed over.

The picture comes first and alone: while a slider moves a smaller one, each once the last has been painted; at rest
the full one, then what is measured and found in it, then the curve. Nothing here knows of the page: what there is
to show is handed to a ``Shown``. The work is done in a few threads that all visitors share, so that the server
goes on answering.
"""

from __future__ import annotations

import asyncio
from bisect import insort
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Protocol, TypeVar
from uuid import uuid4

import cv2
import numpy as np

from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.controls import Control, control
from blurnoise_eval.explorer.judging import Point
from blurnoise_eval.explorer.rendered import Picture8, Rendered, Subject, curve_points, rendered
from blurnoise_eval.explorer.state import State

FIRST = ThreadPoolExecutor(2, thread_name_prefix="explorer-first")
REST = ThreadPoolExecutor(2, thread_name_prefix="explorer-rest")
"""Smaller pictures wait for no full one."""
_PICTURES = 6
_REST_S = 0.15
"""A slider that has not moved for so long is taken to rest."""
_EXPECTED = (ValueError, TypeError, OSError, MemoryError, RuntimeError)
T = TypeVar("T")


class Shown(Protocol):
    """What a visitor is shown; pictures are files by their names."""

    async def preview(self, jpeg: bytes) -> None:
        """A smaller picture, of a state that may have passed; returns once it is painted."""

    def subject(self, subject: Subject, file: str) -> None:
        """Another picture, as it is."""

    def picture(self, file: str) -> None:
        """The picture in full."""

    def rendered(self, found: Rendered) -> None:
        """What is measured and found in the picture."""

    def curve(self, curve: list[Point], along: Control, finished: bool) -> None:
        """Scores along a control, as far as they are known."""

    def fails(self, message: str) -> None:
        """A line on what cannot be shown."""


class Session:
    """token: what the visitor's pictures are named by; nobody else can guess it."""

    def __init__(self, catalogue: Catalogue, state: State, shown: Shown) -> None:
        self.catalogue, self.state, self.token = catalogue, state, uuid4().hex
        self._shown = shown
        self._files: OrderedDict[str, bytes] = OrderedDict()
        self._changed, self._previewed = asyncio.Event(), asyncio.Event()
        self._changed.set()
        self._subject: Subject | None = None

    def change(self, state: State) -> None:
        """Show another state."""
        self.state = state
        self._changed.set()

    def file(self, name: str) -> bytes | None:
        """A picture's file that the visitor has been shown lately."""
        return self._files.get(name)

    async def run(self) -> None:
        """Show what changes, until cancelled."""
        async with asyncio.TaskGroup() as both:
            both.create_task(self._loop(self._changed, self._show_first))
            both.create_task(self._loop(self._previewed, self._show_all))

    async def _loop(self, event: asyncio.Event, show: Callable[[State], Awaitable[None]]) -> None:
        while True:
            await event.wait()
            event.clear()
            state = self.state
            try:
                await show(state)
            except _EXPECTED as error:
                self._fails(state, error)

    def _fails(self, state: State, error: BaseException) -> None:
        if state is self.state:
            self._shown.fails(" ".join(str(error).split())[:400] or type(error).__name__)

    async def _show_first(self, state: State) -> None:
        """The original picture where it is another, else the smaller twin of a large one."""
        subject, content = await _in(FIRST, self._first, state)
        if subject is not self._subject:
            self._subject = subject
            self._shown.subject(subject, self._keep(content or b""))
        elif content is not None:
            await self._shown.preview(content)
        self._previewed.set()

    def _first(self, state: State) -> tuple[Subject, bytes | None]:
        subject = self.catalogue.subject(state)
        if subject is not self._subject:
            return subject, png(subject.original)
        camera = self.catalogue.camera(state)
        try:
            return subject, jpeg(subject.preview(state, camera)) if subject.smaller > 1 else None
        except ValueError:  # the full size says why, or there is no smaller twin
            return subject, None

    async def _show_all(self, state: State) -> None:
        """What has passed meanwhile is dropped at every step, but a picture that is the only one."""
        subject = await _in(REST, self.catalogue.subject, state)
        if subject.smaller > 1:
            await asyncio.sleep(_REST_S)
        if state is not self.state:
            return
        camera = self.catalogue.camera(state)
        frame, content = await _in(REST, lambda: (frame := subject.frame(state, camera), png(frame.image)))
        if state is self.state or subject.smaller == 1:
            self._shown.picture(self._keep(content))
        if state is not self.state:
            return
        model, failed = None, None
        try:
            model = await _in(REST, self.catalogue.model, state)
        except _EXPECTED as error:  # the rest is shown without
            failed = error
        criterion = self.catalogue.criterion(state, model)
        found = await _in(REST, rendered, state, subject, camera, frame, model, criterion)
        if state is not self.state:
            return
        self._shown.rendered(found)
        if failed is not None:
            self._fails(state, failed)
        if subject.smaller > 1:
            await _in(REST, subject.twin)  # before a slider waits for it
        if model is None or found.standard is None or not found.sight or not found.sight.targets:
            return
        base = self.catalogue.camera(state, figures=False)
        along = control(state.along, camera)
        points, curve = curve_points(state, subject, base, model, along, found.standard), list[Point]()
        while state is self.state:
            point = await _in(REST, next, points, None)
            if point is not None:
                insort(curve, point)
            if point is None or len(curve) % 3 == 0:
                self._shown.curve(curve, along, point is None)
            if point is None:
                return

    def _keep(self, content: bytes) -> str:
        name = uuid4().hex
        self._files[name] = content
        while len(self._files) > _PICTURES:
            self._files.popitem(last=False)
        return name


def png(image: Picture8) -> bytes:
    """As PNG, exactly, and not packed: that takes longer than the simulation."""
    flags = [cv2.IMWRITE_PNG_COMPRESSION, 0, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]
    return _encoded(".png", image, flags)


def jpeg(image: Picture8) -> bytes:
    """As JPEG of quality 92, for as long as a slider moves."""
    return _encoded(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])


def _encoded(suffix: str, image: Picture8, flags: list[int]) -> bytes:
    _, data = cv2.imencode(suffix, np.ascontiguousarray(image[..., ::-1]), flags)
    return bytes(data.tobytes())


async def _in(threads: ThreadPoolExecutor, work: Callable[..., T], *given: object) -> T:
    return await asyncio.get_running_loop().run_in_executor(threads, partial(work, *given))
