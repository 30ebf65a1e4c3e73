"""The catalogue of the explorer: what pictures, cameras and models there are, by the names that states have for them.

A visitor names only what is in it, never a file: what the command names, what is built in, a run's own, and uploaded
pictures and cameras. These are kept in memory, under names that nobody can guess, the last few of them.
"""

from __future__ import annotations

import hashlib
import re
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Generic, NamedTuple, TypeVar

import PIL.Image

from blurnoise.optics.camera import PRESETS, Camera
from blurnoise_eval.answers.criterion import KEPT, MATCHES, Criterion
from blurnoise_eval.datasets import Picture, UnreadablePicture, read_picture, rendered_signs
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.explorer.controls import control
from blurnoise_eval.explorer.rendered import Rendered, Subject, rendered
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.state import BUILT_IN, GIVEN, NO_MODEL, OF_RUN, State, with_figures
from blurnoise_eval.grid.axes import MOVES
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.sweep.default_camera import default_camera, is_grey
from blurnoise_eval.system.files import RUN_FILE, write_whole

MOST_MEGAPIXELS = 24.0
"""Of a picture that is explored: a visitor waits for it, and some copies of it are held."""
MOST_UPLOADED_MB = {"picture": 128, "camera": 1}
_MOST_UPLOADS, _UPLOADED_MB = 24, 1024
"""Of all visitors, pictures decoded; then the oldest goes."""
_OWN = Criterion(KEPT, kept=True)
"""What is enough of a picture that is of no run."""
T = TypeVar("T")


class Upload(NamedTuple):
    """kind: "picture" or "camera"; title: the file's name; value: the picture or the camera; megabytes: in memory."""

    kind: str
    title: str
    value: Any
    megabytes: float


class _Once(Generic[T]):
    """Something that is made when it is first asked for, by one thread while others wait."""

    def __init__(self, make: Callable[[], T]) -> None:
        self._make, self._made, self._lock = make, list[T](), threading.Lock()

    def __call__(self) -> T:
        with self._lock:
            if not self._made:
                self._made.append(self._make())
            return self._made[0]


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
        if path is not None and is_run:
            self.run = Run(path if path.is_dir() else path.parent, images, trusted=trust)
        self.arguments: dict[str, Any] = {
            "where": where,
            "images": images,
            "trust": trust,
            "model": model,
            "camera": camera,
        }
        """What the catalogue was made with."""
        self._where = None if path is None or self.run else path
        self._timeout_s, self._files = timeout_s, {BUILT_IN: Path(STOP_SIGN)}
        self._signs = rendered_signs()
        self._uploads: OrderedDict[str, Upload] = OrderedDict()
        self._key = secrets.token_bytes(16)
        self._subjects = lru_cache(2)(lambda name: _Once(self._subject(name)))
        self._models = cache(lambda name: _Once(partial(self._model, name)))
        self._opened: list[Any] = []
        self._lock = threading.Lock()
        names: dict[str, str] = {"model": str(model or BUILT_IN)}
        if model is not None and str(model) not in (BUILT_IN, NO_MODEL):
            names["model"], self._files[GIVEN] = GIVEN, Path(model)
            self._models(GIVEN)()
        if self.run:
            names |= {"picture": f"{OF_RUN}/{self.run.pictures[0]}", "camera": OF_RUN}
            names |= {} if model else {"model": f"{OF_RUN}/{self.run.models[0]}"}
        elif path is not None:
            names["picture"] = GIVEN
        self._camera = None if camera is None or str(camera) in PRESETS else Camera.load(camera)
        if camera is not None:
            names["camera"] = GIVEN if self._camera else str(camera)
        elif not self.run:
            built_in = names["model"] == BUILT_IN
            grey = not built_in and is_grey(self.subject(State(**names)).original)  # type: ignore[arg-type]
            names["camera"] = default_camera(colour=not grey, built_in=built_in).name
        self.base = State(**names)  # type: ignore[arg-type]  # names are texts

    def start(self, query: str | None = None) -> State:
        """The state of a query; without one ``base``, or the cell in the middle of a run's map. Raises
        ``ValueError`` for what is not allowed, or not here."""
        if query is not None:
            state, wrong = self.resolved(query)
            if wrong:
                raise ValueError("; ".join(wrong))
            return state
        if self.run is None or self.base.camera != OF_RUN:
            return self.base
        middle = self.run.heat_map(self.run.models[0]).middle
        return self.of_cell(self.run.cell_at(middle, self.run.pictures[0]), self.base)

    def resolved(self, query: str) -> tuple[State, tuple[str, ...]]:
        """The state of a query, with ``base``'s picture, camera and model in place of those that are not here, and
        without figures, a curve or a cell that cannot be; a line on each of these."""
        base = self.base
        state, told = State.of_query(query, base)
        lines = list(told)
        for kind in ("picture", "camera", "model"):
            name = getattr(state, kind)
            if name not in self.titles(kind, (name,)):
                lines.append(f"{kind} = {name[:60]!r}: is not here (any more); upload it again")
                at = state.put(MOVES.name, None).at if kind == "picture" else state.at
                state = replace(state, **{kind: getattr(base, kind)}, at=at)
        for part in ("figures", "along", "cell"):
            try:
                if part == "figures":
                    self.camera(state)
                elif part == "along":
                    control(state.along, self.camera(state))
                elif state.cell:
                    state = self.of_cell(state.cell, state)
            except (ValueError, TypeError) as error:
                lines.append(str(error))
                state = replace(state, **{part: getattr(base, part)})
        return state, tuple(lines)

    def of_cell(self, cell_id: str, state: State) -> State:
        """The state that is a run's cell. Raises ``ValueError`` for none, or the untouched picture's."""
        if self.run is None:
            raise ValueError("cell: goes with a run")
        cell = self.run.cell(cell_id)
        own = {"picture": f"{OF_RUN}/{cell.image}", "camera": OF_RUN, "cell": cell_id}
        return replace(state, **own, at=cell.conditions, figures=(), seed=cell.seed)  # type: ignore[arg-type]

    # -- what there is ---------------------------------------------------------------------------------------

    def titles(self, kind: str, uploads: Collection[str] = ()) -> dict[str, str]:
        """Names to titles of every "picture", "camera" or "model"; of uploads those that are named."""
        run, found = self.run, dict[str, str]()
        if kind == "picture":
            found |= {f"{OF_RUN}/{name}": name for name in run.pictures} if run else {}
            found |= {GIVEN: self._where.name} if self._where else {}
            found |= {f"sign-{n}": f"Stop signs, scene {n}" for n in range(1, len(self._signs) + 1)}
        elif kind == "camera":
            found |= {OF_RUN: f"{run.camera.name} (of the run)"} if run else {}
            found |= {GIVEN: self._camera.name} if self._camera else {}
            found |= {name: name for name in sorted(PRESETS)}
        else:
            found |= {f"{OF_RUN}/{name}": f"{name} (of the run)" for name in run.models} if run else {}
            found |= {GIVEN: self._files[GIVEN].stem} if GIVEN in self._files else {}
            found |= {BUILT_IN: "built-in stop-sign detector", NO_MODEL: "no model"}
        own = {name: self._uploads.get(name) for name in uploads}
        return found | {name: upload.title for name, upload in own.items() if upload and upload.kind == kind}

    def subject(self, state: State) -> Subject:
        """The state's picture, prepared. Raises ``ValueError`` for one that is not here."""
        return self._subjects(state.picture)()

    def camera(self, state: State, *, figures: bool = True) -> Camera:
        """The state's camera, with its figures or without. Raises ``ValueError``."""
        name = state.camera
        if name == OF_RUN and self.run:
            camera = self.run.camera
        elif name == GIVEN and self._camera:
            camera = self._camera
        else:
            camera = PRESETS.get(name) or self._upload("camera", name).value
        return with_figures(camera, state.figures) if figures else camera

    def model(self, state: State) -> Model | None:
        """The state's model. Raises ``ValueError`` for one that is not here."""
        return None if state.model == NO_MODEL else self._models(state.model)()

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

    def _subject(self, name: str) -> Callable[[], Subject]:
        run = self.run
        if run and name.startswith(f"{OF_RUN}/"):
            return lambda: Subject(run.picture(name.removeprefix(f"{OF_RUN}/")), run)
        if name == GIVEN and self._where:
            path = self._where
            return lambda: Subject(
                Picture(path.name, None, partial(read_picture, path, MOST_MEGAPIXELS), str(path), 1)
            )
        sign = name.removeprefix("sign-")
        if name.startswith("sign-") and sign.isdecimal() and 1 <= int(sign) <= len(self._signs):
            return lambda: Subject(self._signs.pictures[int(sign) - 1])
        upload = self._upload("picture", name)
        return lambda: Subject(Picture(upload.title, None, lambda: upload.value, name, 1))

    def _model(self, name: str) -> Model:
        own = name.removeprefix(f"{OF_RUN}/")
        model: Model
        if self.run and own != name and own in self.run.models:
            model = self.run.model(own, self._timeout_s)
        elif name in self._files:
            model = open_models([self._files[name]], timeout_s=self._timeout_s)[0]
        else:
            raise ValueError(f"model = {name[:60]!r}: is not here")
        self._opened.append(model)
        return model

    # -- uploads ---------------------------------------------------------------------------------------------

    def take(self, kind: str, title: str, content: bytes) -> str:
        """Take an upload, a "picture" or a "camera"; returns its name here, the same for the same file. Raises
        ``ValueError`` of one line, that names the file, for what is no such thing, or is broken."""
        title = Path(title.replace("\\", "/")).name[-80:] or "file"
        name = hashlib.blake2b(
            title.encode(errors="replace") + content, key=self._key, digest_size=16
        ).hexdigest()
        if name not in self._uploads:
            with TemporaryDirectory(prefix="blurnoise-explore-") as folder:
                path = Path(folder) / (re.sub(r"[^\w.+-]", "_", title).lstrip(".") or "file")
                write_whole(path, content)
                try:
                    value = _checked_picture(path) if kind == "picture" else Camera.load(path)
                except (ValueError, TypeError, OSError) as error:
                    message = str(error).replace(str(path), title).replace(path.name, title)
                    raise ValueError(message) from None
            with self._lock:
                self._uploads[name] = Upload(kind, title, value, getattr(value, "nbytes", 0) / 2**20)
                megabytes = sum(each.megabytes for each in self._uploads.values())
                while len(self._uploads) > _MOST_UPLOADS or megabytes > _UPLOADED_MB:
                    megabytes -= self._uploads.popitem(last=False)[1].megabytes
        return name

    def uploaded(self, name: str) -> Upload | None:
        """The upload of this name; None of what is none."""
        return self._uploads.get(name)

    def _upload(self, kind: str, name: str) -> Upload:
        upload = self._uploads.get(name)
        if upload is None or upload.kind != kind:
            raise ValueError(f"{kind} = {name[:60]!r}: is not here (any more); upload it again")
        return upload

    def close(self) -> None:
        """End the inferences that run."""
        for model in self._opened:
            model.interrupt()


def _checked_picture(path: Path) -> Any:
    """All of it can be read: OpenCV makes grey of what is cut off, Pillow says so."""
    picture = read_picture(path, MOST_MEGAPIXELS)
    if min(picture.shape[:2]) < 16:
        height, width = picture.shape[:2]
        raise UnreadablePicture(f"{path}: {width} x {height} px; must be at least 16 x 16")
    try:
        with PIL.Image.open(path) as file:
            file.load()
    except (OSError, SyntaxError, ValueError) as error:
        raise UnreadablePicture(f"{path}: is damaged or cut short ({error})") from None
    return picture
