"""The catalogue of the explorer: which pictures, cameras and models there are, by the names that states use.

A visitor names only what is in it, never a file: what the command names, what is built in, a run's own, and uploaded
pictures. Uploads are kept in memory, under names that nobody can guess, the last few of them.
"""

from __future__ import annotations

import shlex
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from uuid import uuid4

from blurnoise.optics.camera import PRESETS, Camera
from blurnoise_eval.answers.criterion import KEPT, MATCHES, Criterion
from blurnoise_eval.datasets import Picture, read_picture, rendered_signs
from blurnoise_eval.default_camera import default_camera, is_grey
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.explorer.rendered import Rendered, Subject, rendered
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.state import BUILT_IN, GIVEN, NO_MODEL, OF_RUN, State, control, with_figures
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.system.files import RUN_FILE, write_whole

MOST_MEGAPIXELS = 24.0
"""Of a picture that is explored: a visitor waits for it, and some copies of it are held."""
MOST_UPLOADED_MB = 128
_UPLOADED_MB = 1024
"""Of all visitors, pictures decoded; then the oldest goes."""
_OWN = Criterion(KEPT, kept=True)
"""The criterion of a picture that is of no run."""


class Entry(NamedTuple):
    """Something in the catalogue: its title, and what opens it."""

    title: str
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
        from blurnoise_models.detector import STOP_SIGN

        path = None if where is None else Path(where)
        is_run = path is not None and (path.is_dir() or path.name == RUN_FILE)
        for name, value in (("images", images), ("trust", trust)):
            if value and not is_run:
                raise ValueError(f"{name}: goes with a run")
        self.run: Run | None = None
        self.arguments: dict[str, Any] = {
            "where": where,
            "images": images,
            "trust": trust,
            "model": model,
            "camera": camera,
        }
        """What the catalogue was made with."""
        self._uploads: OrderedDict[str, Picture] = OrderedDict()
        self._lock = threading.Lock()
        self._subject = lru_cache(2)(lambda name: self._entry("picture", name).open())
        self._model = cache(lambda name: self._entry("model", name).open())
        pictures, cameras, models = dict[str, Entry](), dict[str, Entry](), dict[str, Entry]()
        self._entries = {"picture": pictures, "camera": cameras, "model": models}
        if path is not None and is_run:
            self.run = run = Run(path if path.is_dir() else path.parent, images, trusted=trust)
            for name in run.pictures:
                pictures[f"{OF_RUN}/{name}"] = Entry(name, partial(_of_run, run, name))
            cameras[OF_RUN] = Entry(f"{run.camera.name} (of the run)", lambda: run.camera)
            for name in run.models:
                models[f"{OF_RUN}/{name}"] = Entry(
                    f"{name} (of the run)", partial(run.model, name, timeout_s)
                )
        elif path is not None:
            load = partial(read_picture, path, MOST_MEGAPIXELS)
            pictures[GIVEN] = Entry(path.name, lambda: Subject(Picture(path.name, None, load, str(path), 1)))
        for number, sign in enumerate(rendered_signs().pictures, 1):
            pictures[f"sign-{number}"] = Entry(f"Stop signs, scene {number}", partial(Subject, sign))
        if camera is not None and str(camera) not in PRESETS:
            given = Camera.load(camera)
            cameras[GIVEN] = Entry(given.name, lambda: given)
        cameras |= {name: Entry(name, partial(PRESETS.__getitem__, name)) for name in sorted(PRESETS)}
        if model is not None and str(model) not in (BUILT_IN, NO_MODEL):
            models[GIVEN] = Entry(
                Path(model).stem, lambda: open_models([Path(model)], timeout_s=timeout_s)[0]
            )
            self._model(GIVEN)
        models[BUILT_IN] = Entry(
            "built-in stop-sign detector", lambda: open_models([STOP_SIGN], timeout_s=timeout_s)[0]
        )
        models[NO_MODEL] = Entry("no model", lambda: None)
        names = {kind: next(iter(entries)) for kind, entries in self._entries.items()}
        if model is not None:
            names["model"] = GIVEN if GIVEN in models else str(model)
        if camera is not None:
            names["camera"] = GIVEN if GIVEN in cameras else str(camera)
        elif not self.run:
            built_in = names["model"] == BUILT_IN
            grey = not built_in and is_grey(self._subject(names["picture"]).original)
            names["camera"] = default_camera(colour=not grey, built_in=built_in).name
        self.base = State(**names)  # type: ignore[arg-type]  # names are texts

    def start(self, query: str | None = None) -> State:
        """The state of a query; without one ``base``, or the cell in the middle of a run's map. Raises
        ``ValueError`` for what is not allowed, or not here."""
        if query is None and self.run and self.base.camera == OF_RUN:
            return self.of_cell(self.run.start(), self.base)
        state, wrong = self.resolved(query or "")
        if wrong:
            raise ValueError("; ".join(wrong))
        return state

    def resolved(self, query: str) -> tuple[State, tuple[str, ...]]:
        """The state of a query, with ``base``'s part in place of what is not here or not allowed; a line on each of
        these."""
        state, wrong = State.of_query(query, self.base)
        lines = list(wrong)
        checks: dict[str, Callable[[State], object]] = {
            "picture": lambda state: self._entry("picture", state.picture),
            "camera": lambda state: self._entry("camera", state.camera),
            "model": lambda state: self._entry("model", state.model),
            "figures": self.camera,
            "along": lambda state: control(state.along, self.camera(state)),
            "cell": lambda state: state.cell and self.of_cell(state.cell, state),
        }
        for part, check in checks.items():
            try:
                check(state)
            except (ValueError, TypeError) as error:
                lines.append(str(error))
                state = replace(state, **{part: getattr(self.base, part)})
        return self.of_cell(state.cell, state) if state.cell else state, tuple(lines)

    def of_cell(self, cell_id: str, state: State) -> State:
        """The state that is a run's cell. Raises ``ValueError`` for none, or the original picture's."""
        if self.run is None:
            raise ValueError("cell: goes with a run")
        cell = self.run.cell(cell_id)
        own = {"picture": f"{OF_RUN}/{cell.image}", "camera": OF_RUN, "cell": cell_id}
        return replace(state, **own, at=cell.conditions, figures=(), seed=cell.seed)  # type: ignore[arg-type]

    def titles(self, kind: str, name: str) -> dict[str, str]:
        """Names to titles of every "picture", "camera" or "model"; of uploads that which is named."""
        titles = {each: entry.title for each, entry in self._entries[kind].items()}
        return titles | {name: self._entry(kind, name).title}

    def subject(self, state: State) -> Subject:
        """The state's picture, prepared. Raises ``ValueError`` for one that is not here."""
        found: Subject = self._subject(state.picture)
        return found

    def camera(self, state: State, *, figures: bool = True) -> Camera:
        """The state's camera, with its figures or without. Raises ``ValueError``."""
        camera: Camera = self._entry("camera", state.camera).open()
        return with_figures(camera, state.figures) if figures else camera

    def model(self, state: State) -> Model | None:
        """The state's model. Raises ``ValueError`` for one that is not here."""
        found: Model | None = self._model(state.model)
        return found

    def criterion(self, state: State, model: Model | None) -> Criterion:
        """What is enough of a picture: the run's own, or a share of what the model reaches in the original."""
        if self.run and state.picture.startswith(f"{OF_RUN}/"):
            return self.run.criterion
        return _OWN if model is None or isinstance(model, Detector) else replace(_OWN, score=MATCHES)

    def render(self, state: State) -> Rendered:
        """What a state shows. Raises ``ValueError`` for what is not here, or does not go together."""
        subject, camera, model = self.subject(state), self.camera(state), self.model(state)
        frame = subject.frame(state, camera)
        return rendered(state, subject, camera, frame, model, self.criterion(state, model))

    def _entry(self, kind: str, name: str) -> Entry:
        if entry := self._entries[kind].get(name):
            return entry
        if kind == "picture" and (upload := self.uploaded(name)):
            return Entry(upload.name, partial(Subject, upload))
        raise ValueError(f"{kind} = {name[:60]!r}: is not here (any more)")

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
        with self._lock:
            self._uploads[name] = Picture(title, None, lambda: value, name, 1)
            while sum(each.load().nbytes for each in self._uploads.values()) > _UPLOADED_MB << 20:
                self._uploads.popitem(last=False)
        return name

    def uploaded(self, name: str) -> Picture | None:
        """The upload of this name; None of what is none."""
        return self._uploads.get(name)


def _of_run(run: Run, name: str) -> Subject:
    return Subject(run.picture(name), run)


def command(catalogue: Catalogue, state: State) -> str:
    """What to type for this picture."""
    arguments, query = _repeated(catalogue, state)
    words = ["blurnoise", "explore"]
    for name, value in arguments.items():
        words += [] if name == "where" else [f"--{name}"]
        words += [] if value is True else [str(value)]
    return shlex.join([*words, "--at", query, "-o", "seen.png"])


def python(catalogue: Catalogue, state: State) -> str:
    """A script for this picture, and for what the model finds in it."""
    arguments, query = _repeated(catalogue, state)
    given = ", ".join(
        f"{name}={value if value is True else str(value)!r}" for name, value in arguments.items()
    )
    lines = [
        "from pathlib import Path",
        "",
        "from blurnoise_eval.datasets import write_picture",
        "from blurnoise_eval.explorer.catalogue import Catalogue",
        "",
        f"catalogue = Catalogue({given})",
        f"found = catalogue.render(catalogue.start({query!r}))",
        "write_picture(Path('seen.png'), found.image)",
    ]
    if state.model != NO_MODEL:
        lines += ['print([round(target["confidence"], 3) for target in found.sight.targets])']
    return "\n".join([*lines, ""])


def _repeated(catalogue: Catalogue, state: State) -> tuple[dict[str, Any], str]:
    """What a catalogue elsewhere is made with, and the query of the state in it: an upload is the file that it was.
    Raises ``ValueError`` for an upload with a run's camera or model."""
    arguments, base = catalogue.arguments, catalogue.base
    if picture := catalogue.uploaded(state.picture):
        if state.camera == OF_RUN or state.model.startswith(f"{OF_RUN}/"):
            raise ValueError("picture: an uploaded one has no command with a run's camera or model")
        arguments = {"where": picture.name, **{name: arguments[name] for name in ("model", "camera")}}
        state = replace(state, picture=GIVEN)
        base = replace(base, picture=GIVEN, camera="", model="")
    return {name: value for name, value in arguments.items() if value}, state.query(base)
