"""The catalogue of the explorer: pictures, cameras and models, by the names that states have for them.

A URL names only what is in it, never a file: what the command names, what is built in, what a run has, and pictures
that were dropped into the page. A state can be written as a command and as a script.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache, partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from blurnoise.camera import PRESETS, Camera
from blurnoise.camera.camera_files import RECORD_OF
from blurnoise_eval.datasets import Picture, read_picture, rendered_signs
from blurnoise_eval.default_camera import default_camera, is_grey
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.explorer.rendered import Rendered, Subject, rendered
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.state import BUILT_IN, GIVEN, NO_MODEL, OF_RUN, State, with_figures
from blurnoise_eval.grid.axes import AUTOMATIC, CHOICES
from blurnoise_eval.grid.conditions import Cell
from blurnoise_eval.system.files import RUN_FILE, write_whole

MOST_MEGAPIXELS = 24.0
"""Of a picture that is explored: larger ones take too long for a slider."""
_DROPPED, _MOST_DROPPED = "dropped-", 4
"""Dropped pictures that are kept, each up to ``MOST_MEGAPIXELS`` in memory."""


class Entry(NamedTuple):
    """A picture, camera or model. title: in lists. code: Python that opens it, for scripts; "" where none does."""

    title: str
    code: str
    open: Callable[[], Any]


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
        path = None if where is None else Path(where)
        given = {"where": path, "images": images, "trust": trust, "model": model, "camera": camera}
        self._arguments = {
            name: value if value is True else str(value) for name, value in given.items() if value
        }
        self._numbers = count(1)
        self._subject: Callable[[str], Subject] = lru_cache(2)(
            lambda name: self._entry("picture", name).open()
        )
        self._model: Callable[[str], Detector | None] = cache(lambda name: self._entry("model", name).open())
        self.run: Run | None = None
        if path and (path.is_dir() or path.name == RUN_FILE):
            self.run = Run(path if path.is_dir() else path.parent, images, trusted=trust)
        elif images or trust:
            raise ValueError(f"{'images' if images else 'trust'}: needs a run")
        self._entries = {
            "picture": _pictures(self.run, path),
            "camera": _cameras(self.run, camera),
            "model": _models(self.run, model, timeout_s),
        }
        if GIVEN in self._entries["model"]:
            self._model(GIVEN)
        chosen = {kind: next(iter(entries)) for kind, entries in self._entries.items()}
        for kind, name in (("model", model), ("camera", camera)):
            if name is not None:
                chosen[kind] = GIVEN if GIVEN in self._entries[kind] else str(name)
        if self.run is None and camera is None:
            original = self._subject(chosen["picture"]).original
            chosen["camera"] = default_camera(colour=not is_grey(original)).name
        self.base = State(chosen["picture"], chosen["camera"], chosen["model"])

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

    def titles(self, kind: str) -> dict[str, str]:
        """Names to titles of every "picture", "camera" or "model"."""
        return {name: entry.title for name, entry in self._entries[kind].items()}

    def subject(self, state: State) -> Subject:
        """The state's picture, prepared. Raises ``ValueError`` for one that is not here."""
        return self._subject(state.picture)

    def camera(self, state: State) -> Camera:
        """The state's camera, with the state's figures. Raises ``ValueError``."""
        return with_figures(self._entry("camera", state.camera).open(), state.figures)

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
        raise ValueError(f"{kind} = {name[:60]!r}: is not available (any more)")

    def take(self, title: str, content: bytes) -> str:
        """Take a dropped picture, in place of the oldest of many; returns its name here. Raises ``ValueError`` that
        names the file, for what is no picture."""
        with TemporaryDirectory(prefix="blurnoise-explore-") as folder:
            path = Path(folder) / "picture"
            write_whole(path, content)
            try:
                image = read_picture(path, MOST_MEGAPIXELS)
            except (ValueError, OSError) as error:
                raise ValueError(str(error).replace(str(path), title)) from None
        name, entries = f"{_DROPPED}{next(self._numbers)}", self._entries["picture"]
        old = [each for each in entries if each.startswith(_DROPPED)][: 1 - _MOST_DROPPED]
        new = Entry(title, "", lambda: Subject(Picture(title, None, lambda: image, name, 1)))
        kept = {each: entry for each, entry in entries.items() if each not in old}
        self._entries["picture"] = {**kept, name: new}
        return name

    def command(self, state: State) -> str:
        """What to type for this picture. Raises ``ValueError`` for one that was dropped."""
        self._code("picture", state)
        words = ["blurnoise", "explore"]
        for name, value in self._arguments.items():
            words += [] if name == "where" else [f"--{name}"]
            words += [] if value is True else [str(value)]
        return shlex.join([*words, "--at", state.query(self.base), "-o", "seen.png"])

    def script(self, state: State) -> str:
        """A script that writes this picture, and prints what the model finds in it, in names that blurnoise and
        blurnoise_eval export. Raises ``ValueError`` for a picture that was dropped."""
        picture, by, model = (self._code(kind, state) for kind in self._entries)
        taken = [f"seed={state.seed}", *["run=run"] * state.picture.startswith(f"{OF_RUN}/")]
        taken += [f"{name}={_value(name, value)!r}" for name, value in state.at.stated.items() if value]
        own, camera = self.camera(replace(state, figures=())), self.camera(state)
        both = {name: (own.figure(name), camera.figure(name)) for name in RECORD_OF}
        figures = _keywords({name: new for name, (old, new) in both.items() if new != old})
        body = [
            f"picture = {picture}",
            f"camera = {by}",
            *[f"camera = camera.with_figures({figures})"] * bool(figures),
            "seen = expose(",
            *(f"    {each}," for each in ("picture", "camera", *taken)),
            ")",
            "datasets.write_picture('seen.png', seen.image)",
            *[f"print({model}.detect(seen.image))"] * bool(model),
        ]
        if self.run:
            names = {"images": "images", "trusted": "trust"}
            options = {name: self._arguments[of] for name, of in names.items() if of in self._arguments}
            body[:0] = [
                f"run = Run({', '.join(filter(None, (repr(str(self.run.folder)), _keywords(options))))})"
            ]
        names_used = ("STOP_SIGN", "Detector", "Run", "datasets", "expose")
        used = [name for name in names_used if any(f"{name}{end}" in line for line in body for end in "(.)")]
        head = ["from dataclasses import replace", ""] if figures else []
        head += ["from blurnoise import Camera"] * any("Camera." in line for line in body)
        return "\n".join([*head, f"from blurnoise_eval import {', '.join(used)}", "", *body, ""])

    def _code(self, kind: str, state: State) -> str:
        entry = self._entry(kind, getattr(state, kind))
        if kind == "picture" and not entry.code:
            must = "start with its file instead: blurnoise explore FILE"
            raise ValueError(f"picture = {entry.title!r}: was dropped, which no command can do; {must}")
        return entry.code


def _pictures(run: Run | None, path: Path | None) -> dict[str, Entry]:
    found = dict[str, Entry]()
    if run is not None:
        for name in run.pictures:
            found[f"{OF_RUN}/{name}"] = Entry(name, f"run.picture({name!r})", partial(_picture_of, run, name))
    elif path is not None:
        load = partial(read_picture, path, MOST_MEGAPIXELS)
        given = Picture(path.name, None, load, str(path), 1)
        found[GIVEN] = Entry(path.name, f"datasets.read_picture({str(path)!r})", partial(Subject, given))
    for place, sign in enumerate(rendered_signs().pictures):
        code = f"datasets.rendered_signs().pictures[{place}]"
        found[f"sign-{place + 1}"] = Entry(f"Stop signs, scene {place + 1}", code, partial(Subject, sign))
    return found


def _picture_of(run: Run, name: str) -> Subject:
    return Subject(run.picture(name), run)


def _cameras(run: Run | None, camera: str | Path | None) -> dict[str, Entry]:
    found = dict[str, Entry]()
    if run is not None:
        found[OF_RUN] = Entry(f"{run.camera.name} (of the run)", "run.camera", lambda: run.camera)
    for name in sorted(PRESETS):
        found[name] = Entry(name, f"Camera.preset({name!r})", partial(PRESETS.__getitem__, name))
    if camera is not None and str(camera) not in PRESETS:
        own = Camera.load(camera)
        found[GIVEN] = Entry(own.name, f"Camera.load({str(camera)!r})", lambda: own)
    return found


def _models(run: Run | None, model: str | Path | None, timeout_s: float) -> dict[str, Entry]:
    from blurnoise_models.detector import STOP_SIGN

    found = dict[str, Entry]()
    for name in run.models if run is not None else ():
        opened = partial(run.model, name, timeout_s)  # type: ignore[union-attr]
        found[f"{OF_RUN}/{name}"] = Entry(f"{name} (of the run)", f"run.model({name!r})", opened)
    built_in = partial(_detector, STOP_SIGN, timeout_s)
    found[BUILT_IN] = Entry("built-in stop-sign detector", "Detector(STOP_SIGN)", built_in)
    found[NO_MODEL] = Entry("no model", "", lambda: None)
    if model is not None and str(model) not in (BUILT_IN, NO_MODEL):
        own = partial(_detector, Path(model), timeout_s)
        found[GIVEN] = Entry(Path(model).stem, f"Detector({str(model)!r})", own)
    return found


def _detector(path: Path, timeout_s: float) -> Detector:
    (found,) = open_models([path], timeout_s=timeout_s)
    if not isinstance(found, Detector):
        raise ValueError(f"model = {path.name!r}: must be a detector, not a text recogniser")
    return found


def _value(name: str, value: float) -> float | str:
    """A value of an axis as :func:`blurnoise_eval.expose` takes it."""
    if value == AUTOMATIC:
        return "auto"
    return CHOICES[name][int(value)] if name in CHOICES else value


def _keywords(values: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in values.items())
