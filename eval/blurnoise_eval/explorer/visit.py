"""A visit: one visitor's state, and the loop that looks at it: the newest state counts, what is older is passed over.

Nothing here knows of the page: what is seen is handed to a ``Shown``. Looking happens in a few threads that all
visitors share, so that the server goes on answering.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Protocol, TypeVar
from uuid import uuid4

import cv2
import numpy as np

from blurnoise.camera import Camera
from blurnoise_eval.explorer.controls import Control, control
from blurnoise_eval.explorer.looking import Picture8, Seen, Stop, Subject, preview, seen, strip
from blurnoise_eval.explorer.shelf import Shelf
from blurnoise_eval.explorer.state import State
from blurnoise_eval.scoring.on_picture import Model

THREADS = ThreadPoolExecutor(3, thread_name_prefix="explorer")
_PICTURES = 6
Curve = list[Stop]
T = TypeVar("T")


class Shown(Protocol):
    """What a visitor is shown; pictures are files by their names."""

    def previewed(self, file: str) -> None:
        """A smaller picture, of a state that may have passed."""

    def subject(self, subject: Subject, file: str) -> None:
        """Another picture, as it is."""

    def seen(self, seen: Seen, file: str) -> None:
        """The picture in full."""

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

    def change(self, state: State) -> None:
        """Look at another state."""
        self.state = state
        self._changed.set()

    def file(self, name: str) -> bytes | None:
        """A picture's file that the visitor has been shown lately."""
        return self._files.get(name)

    async def loop(self) -> None:
        """Look at what changes, until cancelled."""
        while True:
            await self._changed.wait()
            self._changed.clear()
            state = self.state
            try:
                await self._look(state)
            except (ValueError, TypeError, OSError, MemoryError, RuntimeError) as error:
                if state is self.state:
                    self._shown.fails(" ".join(str(error).split())[:400] or type(error).__name__)

    async def _look(self, state: State) -> None:
        camera = await _apart(self.shelf.camera, state)
        subject: Subject = await _apart(self.shelf.subject, state)
        if subject is not self._subject:
            self._subject = subject
            self._shown.subject(subject, self._keep(await _apart(png, subject.clean), "png"))
        elif subject.smaller > 1:
            await self._preview(state, subject, camera)
            await asyncio.sleep(0.03)  # a moving slider has moved on by then
            if self._changed.is_set():
                return
        model = await _apart(self.shelf.model, state)
        found = await _apart(seen, state, subject, camera, model)
        self._shown.seen(found, self._keep(await _apart(png, found.image), "png"))
        if model is not None and found.sight is not None and found.sight.targets and not found.sight.error:
            await self._strip(state, subject, model)

    async def _preview(self, state: State, subject: Subject, camera: Camera) -> None:
        try:
            image = await _apart(preview, state, subject, camera)
        except ValueError:  # it is told of the full size, or there is no smaller twin
            return
        self._shown.previewed(self._keep(await _apart(jpeg, image), "jpg"))

    async def _strip(self, state: State, subject: Subject, model: Model) -> None:
        base = await _apart(self.shelf.base_camera, state.camera)
        along = control(state.along, state.camera_of(base))
        points = strip(state, subject, base, model, along)
        curve: Curve = []
        while not self._changed.is_set():
            point = await _apart(next, points, None)
            if point is None:
                self._shown.strip(state, curve, along, True)
                return
            curve.append(point)
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


async def _apart(work: Callable[..., T], *given: object) -> T:
    return await asyncio.get_running_loop().run_in_executor(THREADS, partial(work, *given))
