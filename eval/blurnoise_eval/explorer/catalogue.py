"""The catalogue of the explorer: which pictures, cameras and models there are, by the names that states use.

A visitor names only what is in it, never a file: what the command names, what is built in, a run's own, and uploaded
pictures. Uploads are kept in memory, under names that nobody can guess, the last few of them.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from uuid import uuid4

from blurnoise.optics.camera import PRESETS, Camera
from blurnoise_eval.datasets import Picture, read_picture, rendered_signs
from blurnoise_eval.default_camera import default_camera, is_grey
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.explorer.rendered import Rendered, Subject, rendered
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.script import script
from blurnoise_eval.explorer.state import BUILT_IN, GIVEN, NO_MODEL, OF_RUN, State, with_figures
from blurnoise_eval.grid.conditions import Cell
from blurnoise_eval.system.files import RUN_FILE, write_whole

MOST_MEGAPIXELS = 24.0
"""Of a picture that is explored: a visitor waits for it, and some copies of it are held."""
MOST_UPLOADED_MB = 128
_UPLOADS = 14
"""Of all visitors, 1 GB of pictures decoded at most; then the oldest goes."""
Entry = tuple[str, Callable[[], Any]]
"""A title, and what opens it."""


class Catalogue:
    """where: a picture's file, or a run's folder or file; None: rendered stop signs. images, trust: see
    :class:`~.run.Run`. model, camera: a file, a name of one that is here, or None for the usual one. timeout_s: of a
    model's first answer.

    base: the state that queries are relative to. Raises ``ValueError`` or ``OSError`` for what cannot be opened.
    """

    def __init__(
        self,
        where: str | Path | None = None,
        *,
        images: str | Path | None = None,
        trust: bool = False,
        model: str | Path | None = None,
        camera: str | Path | None = None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        given = {"where": where, "images": images, "trust": trust, "model": model, "camera": camera}
        self.arguments = {
            name: value if value is True else str(value) for name, value in given.items() if value
        }
        """The arguments of the catalogue."""
        self._uploads: dict[str, Picture] = {}
        self._subject: Callable[[str], Subject] = lru_cache(2)(lambda name: self._entry("picture", name)[1]())
        self._model: Callable[[str], Detector | None] = cache(lambda name: self._entry("model", name)[1]())
        path = None if where is None else Path(where)
        self.run: Run | None = None
        if path and (path.is_dir() or path.name == RUN_FILE):
            self.run = Run(path if path.is_dir() else path.parent, images, trusted=trust)
        elif images or trust:
            raise ValueError(f"{'images' if images else 'trust'}: needs a run")
        pictures, cameras, models = dict[str, Entry](), dict[str, Entry](), dict[str, Entry]()
        self._entries = {"picture": pictures, "camera": cameras, "model": models}
        if run := self.run:
            cameras[OF_RUN] = f"{run.camera.name} (of the run)", lambda: run.camera
            for name in run.pictures:
                pictures[f"{OF_RUN}/{name}"] = name, partial(_picture_of, run, name)
            for name in run.models:
                models[f"{OF_RUN}/{name}"] = f"{name} (of the run)", partial(run.model, name, timeout_s)
        elif path:
            load = partial(read_picture, path, MOST_MEGAPIXELS)
            pictures[GIVEN] = path.name, lambda: Subject(Picture(path.name, None, load, str(path), 1))
        for number, sign in enumerate(rendered_signs().pictures, 1):
            pictures[f"sign-{number}"] = f"Stop signs, scene {number}", partial(Subject, sign)
        cameras |= {name: (name, partial(PRESETS.__getitem__, name)) for name in sorted(PRESETS)}
        if camera is not None and str(camera) not in PRESETS:
            own = Camera.load(camera)
            cameras[GIVEN] = own.name, lambda: own
        from blurnoise_models.detector import STOP_SIGN

        models[BUILT_IN] = "built-in stop-sign detector", partial(_detector, STOP_SIGN, timeout_s)
        models[NO_MODEL] = "no model", lambda: None
        if model is not None and str(model) not in (BUILT_IN, NO_MODEL):
            models[GIVEN] = Path(model).stem, partial(_detector, Path(model), timeout_s)
            self._model(GIVEN)
        self.base = State(picture=next(iter(pictures)), camera=next(iter(cameras)), model=next(iter(models)))
        if model is not None:
            self.base = replace(self.base, model=GIVEN if GIVEN in models else str(model))
        if camera is not None:
            self.base = replace(self.base, camera=GIVEN if GIVEN in cameras else str(camera))
        elif not self.run:
            usual = default_camera(colour=not is_grey(self.subject(self.base).original))
            self.base = replace(self.base, camera=usual.name)

    def start(self, query: str | None = None) -> State:
        """The state of a query; without one ``base``, or the cell in the middle of a run's map. Raises
        ``ValueError`` or ``TypeError`` for what is not allowed, or not here."""
        if query is None and self.run and self.base.camera == OF_RUN:
            return self.of_cell(self.run.cell(image=self.run.pictures[0], repeat=0), self.base)
        state = State.of_query(query or "", self.base)
        for kind in self._entries:
            self._entry(kind, getattr(state, kind))
        self.camera(state)
        if not state.cell:
            return state
        if self.run is None:
            raise ValueError("cell: needs a run")
        return self.of_cell(self.run.cell(cell_id=state.cell), state)

    def of_cell(self, cell: Cell, state: State) -> State:
        """The state that is a run's cell."""
        own = {"picture": f"{OF_RUN}/{cell.image}", "camera": OF_RUN, "cell": cell.cell_id}
        return replace(state, **own, at=cell.conditions, figures=(), seed=cell.seed)  # type: ignore[arg-type]

    def titles(self, kind: str, name: str) -> dict[str, str]:
        """Names to titles of every "picture", "camera" or "model"; of uploads that which is named."""
        titles = {each: title for each, (title, _) in self._entries[kind].items()}
        return titles | {name: self._entry(kind, name)[0]}

    def subject(self, state: State) -> Subject:
        """The state's picture, prepared. Raises ``ValueError`` for one that is not here."""
        return self._subject(state.picture)

    def camera(self, state: State) -> Camera:
        """The state's camera, with the state's figures. Raises ``ValueError``."""
        return with_figures(self._entry("camera", state.camera)[1](), state.figures)

    def model(self, state: State) -> Detector | None:
        """The state's detector. Raises ``ValueError`` for one that is not here."""
        return self._model(state.model)

    def render(self, state: State) -> Rendered:
        """What a state shows. Raises ``ValueError`` for what is not here, or does not go together."""
        subject, camera = self.subject(state), self.camera(state)
        return rendered(state, subject, subject.frame(state, camera), self.model(state))

    def _entry(self, kind: str, name: str) -> Entry:
        if entry := self._entries[kind].get(name):
            return entry
        if kind == "picture" and (upload := self._uploads.get(name)):
            return upload.name, partial(Subject, upload)
        raise ValueError(f"{kind} = {name[:60]!r}: is not available (any more)")

    def take(self, title: str, content: bytes) -> str:
        """Take an uploaded picture; returns its name here. Raises ``ValueError`` that names the file, for what is no
        picture."""
        title = Path(title.replace("\\", "/")).name[-80:] or "file"
        with TemporaryDirectory(prefix="blurnoise-explore-") as folder:
            path = Path(folder) / f"picture{Path(title).suffix}"
            write_whole(path, content)
            try:
                value = read_picture(path, MOST_MEGAPIXELS)
            except (ValueError, OSError) as error:
                raise ValueError(str(error).replace(str(path), title).replace(path.name, title)) from None
        name = uuid4().hex
        self._uploads[name] = Picture(title, None, lambda: value, name, 1)
        for old in [*self._uploads][:-_UPLOADS]:
            self._uploads.pop(old, None)
        return name

    def command(self, state: State) -> str:
        """What to type for this picture. Raises ``ValueError`` for an upload."""
        query, words = self._query(state), ["blurnoise", "explore"]
        for name, value in self.arguments.items():
            words += [] if name == "where" else [f"--{name}"]
            words += [] if value is True else [str(value)]
        return shlex.join([*words, "--at", query, "-o", "seen.png"])

    def script(self, state: State) -> str:
        """A script for this picture, and for what the model finds in it. Raises ``ValueError`` for an upload."""
        self._query(state)
        return script(state, self._entry("camera", state.camera)[1](), self.run, self.arguments)

    def _query(self, state: State) -> str:
        if state.picture in self._uploads:
            raise ValueError(
                "picture: an uploaded picture has no command; start with `blurnoise explore FILE` instead"
            )
        return state.query(self.base)


def _picture_of(run: Run, name: str) -> Subject:
    return Subject(run.picture(name), run)


def _detector(path: Path, timeout_s: float) -> Detector:
    (found,) = open_models([path], timeout_s=timeout_s)
    if not isinstance(found, Detector):
        raise ValueError(f"model = {path.name!r}: must be a detector, not a text recogniser")
    return found
