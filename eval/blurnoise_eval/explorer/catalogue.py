"""The catalogue of the explorer: pictures, cameras and models, by the names that states have for them.

A URL names only entries of the catalogue, never a file: what the command names, what is built in, what a run has, and
pictures that were dropped into the page.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache, partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from blurnoise.camera import PRESETS, Camera
from blurnoise_eval.datasets import Picture, read_picture, rendered_signs
from blurnoise_eval.default_camera import default_camera, is_grey
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.explorer.state import (
    BUILT_IN,
    GIVEN,
    NO_MODEL,
    OF_RUN,
    Control,
    State,
    controls,
    with_figures,
)
from blurnoise_eval.explorer.subject import Rendered, Subject
from blurnoise_eval.plan.axes import EGO, HEADLAMP, MOVES, NAMES
from blurnoise_eval.plan.conditions import Cell
from blurnoise_eval.plan.question import Question
from blurnoise_eval.run.exposing import Frame
from blurnoise_eval.run.run import Run
from blurnoise_eval.store import queries
from blurnoise_eval.store.rows import CellRow
from blurnoise_eval.system.files import RUN_FILE, write_whole

MOST_MEGAPIXELS = 24.0
"""Of a picture that is explored: larger ones take too long for a slider."""
KINDS = ("picture", "camera", "model")
_DROPPED, _MOST_DROPPED = "dropped-", 4
"""Dropped pictures that are kept, each up to ``MOST_MEGAPIXELS`` in memory."""
_MOST_TRIED, _NEARLY = 20, 0.95
"""Pictures of a run among which one is opened, and the part of the best confidence that is nearly as sure."""


class Entry(NamedTuple):
    """A picture, camera or model: its title in lists, and what opens it."""

    title: str
    open: Callable[[], Any]


class Catalogue:
    """What can be explored, and the state at the start.

    where: a picture's file, or a run's folder or file; None: rendered stop signs. images, trust: see
    :meth:`~blurnoise_eval.run.run.Run.open`. model, camera: a file, a name in the catalogue, or None for the usual
    one. grey_anchor: the part of photographs that reflects 18 %; None: brightness is reflectance. timeout_s: of a
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
        grey_anchor: str | None = None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        path = None if where is None else Path(where)
        options = {"--images": images, "--model": model, "--camera": camera, "--grey-anchor": grey_anchor}
        self.grey_anchor = grey_anchor
        self._words = ["blurnoise", "explore"] + ([] if path is None else [str(path)]) + ["--trust"] * trust
        for option, value in options.items():
            self._words += [] if value is None else [option, str(value)]
        self._numbers = count(1)
        self._subject: Callable[[str], Subject] = lru_cache(2)(
            lambda name: self._entry("picture", name).open()
        )
        self._model: Callable[[str], Detector | None] = cache(lambda name: self._entry("model", name).open())
        # The page asks for a frame, then for the detections in it.
        self.frame: Callable[[State], Frame] = lru_cache(2)(
            lambda state: self.subject(state).frame(state, self.camera(state))
        )
        self._run: Run | None = None
        if path and (path.is_dir() or path.name == RUN_FILE):
            self._run = _run_of_detectors(path if path.is_dir() else path.parent, images, trust=trust)
        elif images or trust:
            raise ValueError(f"{'images' if images else 'trust'}: needs a run")
        if grey_anchor is not None and (self._run is not None or path is None):
            raise ValueError(f"grey_anchor = {grey_anchor!r}: needs a picture; runs have that of their plan")
        self._tested = tested_values(self._run) if self._run else None
        self._entries = {
            "picture": _pictures(self._run, path, grey_anchor),
            "camera": _cameras(self._run, camera),
            "model": _models(self._run, model, timeout_s),
        }
        if GIVEN in self._entries["model"]:
            # A model that cannot be opened is refused at the start, not when the page asks for it.
            self._model(GIVEN)
        chosen = {kind: next(iter(entries)) for kind, entries in self._entries.items()}
        for kind, name in (("model", model), ("camera", camera)):
            if name is not None:
                chosen[kind] = GIVEN if GIVEN in self._entries[kind] else str(name)
        if self._run is None and camera is None:
            original = self._subject(chosen["picture"]).original
            chosen["camera"] = default_camera(colour=not is_grey(original)).name
        self.base = State(chosen["picture"], chosen["camera"], chosen["model"])

    def start(self, query: str | None = None, *, cell: str | None = None) -> State:
        """The state at the start: that of a query, of the run's cell of an id, or else of the hardest that works.

        Raises ``ValueError`` or ``TypeError`` for what is not allowed, or not in the catalogue.
        """
        base, run = self.base, self._run
        if cell is not None:
            if run is None:
                raise ValueError("cell: needs a run")
            base = self._of_cell(run.cell(cell_id=cell))
        elif query is None and run and base.camera == OF_RUN:
            base = self._of_cell(_hardest_that_works(run, base.model.removeprefix(f"{OF_RUN}/")))
        state = State.of_query(query or "", base)
        for kind in KINDS:
            self._entry(kind, getattr(state, kind))
        self.camera(state)
        return state

    def _of_cell(self, cell: Cell) -> State:
        """The state that is a cell of the run; ``base`` without conditions."""
        picture, at = f"{OF_RUN}/{cell.image}", cell.conditions or self.base.at
        return replace(self.base, picture=picture, camera=OF_RUN, at=at, repeat=cell.repeat)

    def titles(self, kind: str) -> dict[str, str]:
        """Names to titles of every "picture", "camera" or "model"."""
        return {name: entry.title for name, entry in self._entries[kind].items()}

    def subject(self, state: State) -> Subject:
        """The state's picture, prepared. Raises ``ValueError`` for one that is not in the catalogue."""
        return self._subject(state.picture)

    def camera(self, state: State) -> Camera:
        """The state's camera, with the state's figures. Raises ``ValueError``."""
        return with_figures(self._entry("camera", state.camera).open(), state.figures)

    def model(self, state: State) -> Detector | None:
        """The state's detector. Raises ``ValueError`` for one that is not in the catalogue."""
        return self._model(state.model)

    def controls(self, state: State) -> dict[str, Control]:
        """The controls of a state's camera and picture; a run's sliders have the values that it tested."""
        camera = self.camera(replace(state, figures=()))
        every = controls(camera, self._tested)
        if not state.picture.startswith(("sign-", f"{OF_RUN}/")):  # the targets of others are unknown
            del every[MOVES.name], every[HEADLAMP.name]
        return every

    def render(self, state: State) -> Rendered:
        """The picture of a state, with what the detector finds in it. Raises ``ValueError``."""
        return self.subject(state).rendered(self.frame(state), self.model(state))

    def command(self, state: State) -> str:
        """The command that writes the picture of a state. Raises ``ValueError`` for one that was dropped."""
        if state.picture.startswith(_DROPPED):
            title = self._entry("picture", state.picture).title
            must = "start with its file instead: blurnoise explore FILE"
            raise ValueError(f"picture = {title!r}: was dropped, which no command can do; {must}")
        return shlex.join([*self._words, "--at", state.query(self.base), "-o", "out.png"])

    def _entry(self, kind: str, name: str) -> Entry:
        if entry := self._entries[kind].get(name):
            return entry
        raise ValueError(f"{kind} = {name[:60]!r}: is not available (any more)")

    def take(self, title: str, content: bytes) -> str:
        """Take a dropped picture in place of the oldest; returns its name in the catalogue.

        Raises ``ValueError`` that names the file for what is no picture.
        """
        with TemporaryDirectory(prefix="blurnoise-explore-") as folder:
            path = Path(folder) / "picture"
            write_whole(path, content)
            try:
                image = read_picture(path, MOST_MEGAPIXELS)
            except (ValueError, OSError) as error:
                raise ValueError(str(error).replace(str(path), title)) from None
        name, entries = f"{_DROPPED}{next(self._numbers)}", self._entries["picture"]
        old = [known for known in entries if known.startswith(_DROPPED)][: 1 - _MOST_DROPPED]
        new = Entry(
            title, lambda: Subject(Picture(title, None, lambda: image, name, 1), None, self.grey_anchor)
        )
        rest = {known: entry for known, entry in entries.items() if known not in old}
        self._entries["picture"] = {**rest, name: new}
        return name


def _run_of_detectors(folder: Path, images: str | Path | None, *, trust: bool) -> Run:
    """A run, without its clusters: the explorer shows single pictures, and the pattern of a run may be anybody's.
    Raises ``ValueError`` for a run of text recognisers."""
    run = Run.open(folder, Question(cluster=""), trust=trust, images=images)
    if any(note["kind"] != "detector" for note in run.setup.models.values()):
        raise ValueError(f"run = {str(folder)!r}: must be a run of detectors, not of text recognisers")
    return run


def _hardest_that_works(run: Run, model: str) -> Cell:
    """Of a picture's cells in which the model is nearly as sure as in its best one, the fastest and then the darkest;
    of the first picture in which it finds something."""
    for image in list(run.pictures)[:_MOST_TRIED]:
        with run.store as store:
            rows = [*queries.cells_with(store, clean=0, image=image, repeat=0)]
        own = [row for row in rows if row.model == model and (row.detection_rate or 0.0) > 0]
        best = max((row.target_confidence or 0.0 for row in own), default=0.0)
        if best > 0:
            sure = (row for row in own if (row.target_confidence or 0.0) >= _NEARLY * best)
            return run.setup.cell_of(max(sure, key=_hardness))
    return run.cell(image=run.pictures[0], repeat=0)


def _hardness(row: CellRow) -> tuple[float, ...]:
    at = row.conditions
    return (
        at[EGO.name] or 0.0,
        math.hypot(*at.velocity_px_s),
        -at.illuminance_lux,
        row.target_confidence or 0.0,
    )


def tested_values(run: Run) -> dict[str, list[float]]:
    """The values that a run tested, by axis; none where it left the axis to the camera."""
    conditions = run.plan.conditions()
    values = {name: {at[name] for at in conditions} for name in NAMES}
    return {name: sorted(value for value in of if value is not None) for name, of in values.items()}


def _pictures(run: Run | None, path: Path | None, grey_anchor: str | None) -> dict[str, Entry]:
    entries = dict[str, Entry]()
    if run is not None:
        for name in run.pictures:
            opened = partial(lambda run, name: Subject(run.picture(name), run), run, name)
            entries[f"{OF_RUN}/{name}"] = Entry(name, opened)
    elif path is not None:
        load = partial(read_picture, path, MOST_MEGAPIXELS)
        picture = Picture(path.name, None, load, str(path), 1)
        entries[GIVEN] = Entry(path.name, partial(Subject, picture, None, grey_anchor))
    for number, sign in enumerate(rendered_signs().pictures, 1):
        entries[f"sign-{number}"] = Entry(f"Stop signs, scene {number}", partial(Subject, sign))
    return entries


def _cameras(run: Run | None, camera: str | Path | None) -> dict[str, Entry]:
    entries = dict[str, Entry]()
    if run is not None:
        entries[OF_RUN] = Entry(f"{run.camera.name} (of the run)", lambda: run.camera)
    for name in sorted(PRESETS):
        entries[name] = Entry(name, partial(PRESETS.__getitem__, name))
    if camera is not None and str(camera) not in PRESETS:
        loaded = Camera.load(camera)
        entries[GIVEN] = Entry(loaded.name, lambda: loaded)
    return entries


def _models(run: Run | None, model: str | Path | None, timeout_s: float) -> dict[str, Entry]:
    from blurnoise_models.detector import STOP_SIGN

    entries = dict[str, Entry]()
    if run is not None:
        for name in run.setup.models:
            entries[f"{OF_RUN}/{name}"] = Entry(f"{name} (of the run)", partial(run.model, name, timeout_s))
    entries[BUILT_IN] = Entry("built-in stop-sign detector", partial(_detector, STOP_SIGN, timeout_s))
    entries[NO_MODEL] = Entry("no model", lambda: None)
    if model is not None and str(model) not in (BUILT_IN, NO_MODEL):
        entries[GIVEN] = Entry(Path(model).stem, partial(_detector, Path(model), timeout_s))
    return entries


def _detector(path: Path, timeout_s: float) -> Detector:
    (model,) = open_models([path], timeout_s=timeout_s)
    if not isinstance(model, Detector):
        raise ValueError(f"model = {path.name!r}: must be a detector, not a text recogniser")
    return model
