"""A visit: one visitor's state, and the loop that looks at it: the newest state counts, what is older is passed over.

The picture comes first and alone: while a slider moves a smaller one, each once the last has been painted; at rest
the full one, then what is told of it, then the strip. Nothing here knows of the page: what is seen is handed to a
``Shown``. Looking happens in a few threads that all visitors share, so that the server goes on answering.
"""

from __future__ import annotations

import asyncio
from bisect import insort
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Protocol, TypeVar
from uuid import uuid4

import cv2
import numpy as np

from blurnoise.optics.camera import Camera
from blurnoise_eval.explorer.controls import Control, control
from blurnoise_eval.explorer.judging import Stop
from blurnoise_eval.explorer.looking import Picture8, Seen, Subject, preview, seen, strip
from blurnoise_eval.explorer.shelf import Shelf
from blurnoise_eval.explorer.state import State
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.sweep.exposing import Frame

FIRST = ThreadPoolExecutor(2, thread_name_prefix="explorer-first")
REST = ThreadPoolExecutor(2, thread_name_prefix="explorer-rest")
"""Smaller pictures wait for no full one."""
_PICTURES = 6
_REST_S = 0.15
"""A slider that has not moved for so long is taken to rest."""
_TOLD = (ValueError, TypeError, OSError, MemoryError, RuntimeError)
Curve = list[Stop]
T = TypeVar("T")


class Shown(Protocol):
    """What a visitor is shown; pictures are files by their names."""

    async def preview(self, jpeg: bytes) -> None:
        """A smaller picture, of a state that may have passed; returns once it is painted."""

    def subject(self, subject: Subject, file: str) -> None:
        """Another picture, as it is."""

    def picture(self, file: str, width_px: int) -> None:
        """The picture in full."""

    def seen(self, seen: Seen) -> None:
        """What is told of the picture."""

    def strip(self, state: State, curve: Curve, along: Control, finished: bool) -> None:
        """The strip, as far as it is."""

    def fails(self, told: str) -> None:
        """A line on what cannot be seen."""


class Visit:
    """token: what the visitor's pictures are named by; nobody else can guess it."""

    def __init__(self, shelf: Shelf, state: State, shown: Shown) -> None:
        self.shelf, self.state, self.token = shelf, state, uuid4().hex
        self._shown = shown
        self._files: OrderedDict[str, bytes] = OrderedDict()
        self._changed = asyncio.Event()
        self._changed.set()
        self._subject: Subject | None = None
        self._ready: State | None = None  # what is to be seen in full

    def change(self, state: State) -> None:
        """Look at another state."""
        self.state = state
        self._changed.set()

    def file(self, name: str) -> bytes | None:
        """A picture's file that the visitor has been shown lately."""
        return self._files.get(name)

    async def loop(self) -> None:
        """Look at what changes, until cancelled."""
        full: asyncio.Task[None] | None = None
        try:
            while True:
                await self._changed.wait()
                self._changed.clear()
                state = self.state
                try:
                    await self._look_first(state)
                except _TOLD as error:
                    self._fails(state, error)
                    continue
                self._ready = state
                if full is None or full.done():
                    full = asyncio.create_task(self._look_in_full())
        finally:
            if full is not None:
                full.cancel()

    def _fails(self, state: State, error: BaseException) -> None:
        if state is self.state:
            self._shown.fails(" ".join(str(error).split())[:400] or type(error).__name__)

    async def _look_first(self, state: State) -> None:
        """At the untouched picture where it is another, else at the smaller twin of a large one."""
        subject, content = await _apart(FIRST, self._first, state)
        if subject is not self._subject:
            self._subject = subject
            self._shown.subject(subject, self._keep(content or b"", "png"))
        elif content is not None:
            await self._shown.preview(content)

    def _first(self, state: State) -> tuple[Subject, bytes | None]:
        subject = self.shelf.subject(state)
        if subject is not self._subject:
            return subject, png(subject.clean)
        camera = self.shelf.camera(state)
        if subject.smaller == 1:
            return subject, None
        try:
            return subject, jpeg(preview(state, subject, camera))
        except ValueError:  # it is told of the full size, or there is no smaller twin
            return subject, None

    async def _look_in_full(self) -> None:
        """At the newest state, as long as there is a newer one."""
        state = None
        while state is not self._ready and self._ready is not None:
            state = self._ready
            try:
                await self._look(state)
            except _TOLD as error:
                self._fails(state, error)

    async def _look(self, state: State) -> None:
        """What has passed meanwhile is dropped at every step, but a picture that is the only one."""
        subject = await _apart(REST, self.shelf.subject, state)
        if subject.smaller > 1:
            await asyncio.sleep(_REST_S)
        if state is not self.state:
            return
        camera = self.shelf.camera(state)
        frame, content = await _apart(REST, _in_full, state, subject, camera)
        if state is self.state or subject.smaller == 1:
            self._shown.picture(self._keep(content, "png"), subject.size[1])
        if state is not self.state:
            return
        model, failed = None, None
        try:
            model = await _apart(REST, self.shelf.model, state)
        except _TOLD as error:  # the picture can be told of without
            failed = error
        criterion = self.shelf.criterion(state, model)
        found = await _apart(REST, seen, state, subject, camera, model, frame, criterion)
        if state is not self.state:
            return
        self._shown.seen(found)
        if failed is not None:
            self._fails(state, failed)
        if subject.smaller > 1:
            await _apart(REST, subject.twin, subject.smaller)  # before a slider waits for it
        if model is not None and found.sight is not None and found.sight.targets and not found.sight.error:
            await self._strip(state, subject, model)

    async def _strip(self, state: State, subject: Subject, model: Model) -> None:
        base = self.shelf.base_camera(state.camera)
        along = control(state.along, state.camera_of(base))
        points = strip(state, subject, base, model, along, self.shelf.criterion(state, model))
        curve: Curve = []
        while state is self.state:
            point = await _apart(REST, next, points, None)
            if point is None:
                self._shown.strip(state, curve, along, True)
                return
            insort(curve, point)
            if len(curve) % 3 == 0:
                self._shown.strip(state, curve, along, False)

    def _keep(self, content: bytes, suffix: str) -> str:
        name = f"{uuid4().hex}.{suffix}"
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


def _in_full(state: State, subject: Subject, camera: Camera) -> tuple[Frame, bytes]:
    frame = subject.frame(state, camera)
    return frame, png(frame.image)


async def _apart(threads: ThreadPoolExecutor, work: Callable[..., T], *given: object) -> T:
    return await asyncio.get_running_loop().run_in_executor(threads, partial(work, *given))
