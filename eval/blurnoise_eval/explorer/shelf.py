"""The shelf of the explorer: what pictures, cameras and models there are, by the names that states have for them.

A visitor names only what stands here, never a file: what was given on the command line, what is built in, and the
pictures and cameras that this visitor has uploaded, which are checked before they are taken. Uploads are named by
visitor and content, so that a URL goes on as long as they are held.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import gettempdir, mkdtemp
from typing import Any, TypeVar

import PIL.Image

from blurnoise.optics.camera import PRESETS, Camera
from blurnoise_eval.datasets import Picture, UnreadablePicture, read_picture, rendered_signs
from blurnoise_eval.detectors.detector import Detector, model_sha256
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.detectors.session import TIMEOUT_S
from blurnoise_eval.explorer.controls import control
from blurnoise_eval.explorer.looking import OWN, Subject
from blurnoise_eval.explorer.run_answer import answer_of
from blurnoise_eval.explorer.runs import Run
from blurnoise_eval.explorer.state import BUILT_IN, NO_MODEL, OF_RUN, State
from blurnoise_eval.explorer.told import Files, is_sign
from blurnoise_eval.grid.axes import MOVES
from blurnoise_eval.scoring.criterion import MATCHES, Criterion
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.system.files import write_whole

MOST_MEGAPIXELS = 24.0
"""Of a picture that is explored: a visitor waits for it, and some copies of it are held."""
MOST_UPLOADED_MB = {"picture": 128, "camera": 1}
_HELD, _HELD_MB = 12, 256
"""Uploads of a kind that a visitor has; then the oldest of this visitor goes."""
_HELD_BY_ALL_MB = 1024
_SUBJECTS = 2
_FOLDER = "blurnoise-explore-"
T = TypeVar("T")


@dataclass(frozen=True)
class _Item:
    """A file on the shelf. title: as menus show it; typed: as a command names it; visitor: who has uploaded it, ""
    for what was given at the start, which everybody sees; size: bytes of an upload."""

    path: Path
    title: str
    typed: str
    visitor: str = ""
    size: int = 0


class Shelf:
    """run: what is explored, or image; models, camera: files that were named at the start. built_in: the model
    that is there without any. timeout_s: of a model's first answer. visitor: whose uploads it shows."""

    visitor = ""

    def __init__(
        self,
        built_in: Path,
        *,
        image: Path | None = None,
        run: Run | None = None,
        model: Path | None = None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        self.run = run
        self._built_in, self._timeout_s = built_in, timeout_s
        self._folders: list[Path] = []  # of uploads: none, or one
        self._lock = threading.RLock()
        self._signs = rendered_signs()
        self._items: dict[str, OrderedDict[str, _Item]] = {
            kind: OrderedDict() for kind in ("picture", "camera", "model")
        }
        self._opened: OrderedDict[tuple[str, str], Any] = OrderedDict()
        self._making: dict[tuple[str, str], threading.Lock] = {}
        if image is not None:
            picture_of_file(image).load()
            self._place("picture", "given-picture", _Item(image, image.name, str(image)))
        if model is not None:
            open_models([model], timeout_s=timeout_s)
            self._place("model", "given-model", _Item(model, model.stem, str(model)))

    def of(self, visitor: str) -> Shelf:
        """The shelf as a visitor sees it: with the uploads of this visitor alone. All else is shared."""
        own = copy(self)
        own.visitor = visitor
        return own

    # -- what there is ---------------------------------------------------------------------------------------

    def cameras(self) -> dict[str, str]:
        """Names to titles: the run's, presets, files."""
        own = {OF_RUN: f"{self.run.camera.name} (of the run)"} if self.run else {}
        return own | {name: name for name in sorted(PRESETS)} | self._titles("camera")

    def pictures(self) -> dict[str, str]:
        """Names to titles: the run's, files, rendered signs."""
        own = {f"{OF_RUN}/{name}": name for name in self.run.pictures} if self.run else {}
        signs = {f"sign-{n}": f"Stop signs, scene {n}" for n in range(1, len(self._signs) + 1)}
        return own | self._titles("picture") | signs

    def models(self) -> dict[str, str]:
        """Names to titles: the run's, files, the built-in one, none."""
        own = {f"{OF_RUN}/{name}": f"{name} (of the run)" for name in self.run.models} if self.run else {}
        return own | self._titles("model") | {BUILT_IN: "built-in stop-sign detector", NO_MODEL: "no model"}

    def _titles(self, kind: str) -> dict[str, str]:
        return {name: item.title for name, item in self._seen(kind).items()}

    def _seen(self, kind: str) -> dict[str, _Item]:
        """What this visitor sees of a kind."""
        with self._lock:
            items = self._items[kind].items()
            return {name: item for name, item in items if item.visitor in ("", self.visitor)}

    def answer(self) -> tuple[str, str]:
        """The run's own, as :func:`~blurnoise_eval.explorer.run_answer.answer_of` has it. Raises ``ValueError``."""
        if self.run is None:
            raise ValueError("answer: goes with a run")
        return self._once(("answer", OF_RUN), partial(answer_of, self.run.folder), 1)

    # -- what a state names ----------------------------------------------------------------------------------

    def subject(self, state: State) -> Subject:
        """The state's picture, prepared. Raises ``ValueError`` for one that is not here."""
        return self._once(("picture", state.picture), self._picture(state.picture), _SUBJECTS)

    def camera(self, state: State) -> Camera:
        """The state's camera, with its figures. Raises ``ValueError``."""
        return state.camera_of(self.base_camera(state.camera))

    def base_camera(self, name: str) -> Camera:
        """The camera of that name as it is. Raises ``ValueError`` for one that is not here."""
        if name == OF_RUN and self.run:
            return self.run.camera
        if name in PRESETS:
            return PRESETS[name]
        return self._once(("camera", name), partial(Camera.load, self._item("camera", name).path), 32)

    def model(self, state: State) -> Model | None:
        """The state's model. Raises ``ValueError`` for one that is not here."""
        name = state.model
        if name == NO_MODEL:
            return None
        if name.startswith(f"{OF_RUN}/") and self.run:
            of_run, own = self.run, name.removeprefix(f"{OF_RUN}/")
            if own in of_run.models:
                return self._once(("model", name), partial(of_run.model, own, self._timeout_s), 6)
        path = self._built_in if name == BUILT_IN else self._item("model", name).path
        return self._once(("model", name), lambda: open_models([path], timeout_s=self._timeout_s)[0], 6)

    def criterion(self, state: State, model: Model | None) -> Criterion:
        """What is enough of a picture: the run's own, or a share of what the model reaches in the original."""
        if self.run and state.picture.startswith(f"{OF_RUN}/"):
            return self.run.criterion
        return OWN if model is None or isinstance(model, Detector) else replace(OWN, score=MATCHES)

    def files(self, state: State) -> Files:
        """What the state's names stand for on disk; an upload is the file that it was."""
        where, images, trusted = "", "", False
        if state.picture.startswith(f"{OF_RUN}/") and self.run:
            where, images, trusted = str(self.run.folder), str(self.run.images or ""), self.run.trusted
        elif not is_sign(state.picture):
            where = self._typed("picture", state.picture)
        camera = (
            "" if state.camera in PRESETS or state.camera == OF_RUN else self._typed("camera", state.camera)
        )
        return Files(where, images, trusted, camera, self._model_file(state))

    def _model_file(self, state: State) -> str:
        """ "" for what is looked through where no model is named: the run's first, the built-in one elsewhere."""
        of_run = self.run is not None and state.picture.startswith(f"{OF_RUN}/")
        if state.model == NO_MODEL:
            return ""
        if state.model == BUILT_IN:
            return BUILT_IN if of_run else ""
        if self.run is None or not state.model.startswith(f"{OF_RUN}/"):
            return self._typed("model", state.model)
        own = state.model.removeprefix(f"{OF_RUN}/")
        if of_run and own == self.run.models[0]:
            return ""
        if self._is_built_in(own):
            return BUILT_IN if of_run else ""
        return next((each["file"] for each in self.run.manifest["models"] if each["name"] == own), "")

    def _is_built_in(self, name: str) -> bool:
        """Whether a model of the run is the one that is built in, wherever that lay then."""
        if self.run is None:
            return False
        content = self._once(("content", BUILT_IN), lambda: model_sha256(self._built_in), 1)
        return any(each["name"] == name and each["sha256"] == content for each in self.run.manifest["models"])

    def _typed(self, kind: str, name: str) -> str:
        item = self._seen(kind).get(name)
        return item.typed if item else name

    def _picture(self, name: str) -> Callable[[], Subject]:
        """What opens a picture. Raises ``ValueError`` for one that is not here, whoever may have opened it."""
        run = self.run
        if name.startswith(f"{OF_RUN}/") and run:
            return lambda: Subject(run.picture(name.removeprefix(f"{OF_RUN}/")), run)
        if is_sign(name):
            number = int(name.removeprefix("sign-"))
            if not 1 <= number <= len(self._signs):
                raise ValueError(f"picture = {name!r}: signs are sign-1 to sign-{len(self._signs)}")
            return lambda: Subject(self._signs.pictures[number - 1])
        item = self._item("picture", name)
        return lambda: Subject(picture_of_file(item.path, item.title))

    def _item(self, kind: str, name: str) -> _Item:
        with self._lock:
            item = self._seen(kind).get(name)
            if item is None:
                upload = "" if kind == "model" else "; upload it again"
                raise ValueError(f"{kind} = {name[:60]!r}: is not held here (any more){upload}")
            self._items[kind].move_to_end(name)
            return item

    def _once(self, key: tuple[str, str], make: Callable[[], T], most: int) -> T:
        """What was made for a key, the last few of a kind kept. Visitors wait for each other's making, not
        twice; nobody waits for anything else."""
        with self._lock:
            making = self._making.setdefault(key, threading.Lock())
        with making:
            with self._lock:
                if key in self._opened:
                    self._opened.move_to_end(key)
                    return self._opened[key]  # type: ignore[no-any-return]
            made = make()
            with self._lock:
                self._opened[key] = made
                self._making.pop(key, None)
                alike = [each for each in self._opened if each[0] == key[0]]
                for oldest in alike[: max(0, len(alike) - most)]:
                    del self._opened[oldest]
            return made

    # -- uploads ---------------------------------------------------------------------------------------------

    def take(self, kind: str, file_name: str, content: bytes) -> str:
        """Take an upload; returns its name here. Raises ``ValueError`` of one line, that names the file, for what is
        no picture or camera, or is broken."""
        name = Path(file_name.replace("\\", "/")).name[-80:] or "file"
        said = self.visitor.encode() + name.encode(errors="replace")
        key = f"{kind}-{hashlib.blake2b(said + content, digest_size=6).hexdigest()}"
        with self._lock:
            if key in self._items[kind]:
                return key
        folder = self._uploads() / key
        folder.mkdir(parents=True, exist_ok=True)
        safe = re.sub(r"[^\w.+-]", "_", name).lstrip(".") or "file"
        path = folder / safe
        write_whole(path, content)
        try:
            with _named(path, name):
                _CHECKS[kind](path)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return self._place(kind, key, _Item(path, name, name, self.visitor, len(content)))

    def _place(self, kind: str, key: str, item: _Item) -> str:
        """Put a file on the shelf, and off it the oldest uploads of its visitor that are too many.

        Raises ``ValueError`` where those of others leave no room.
        """
        with self._lock:
            items = self._items[kind]
            items[key] = item
            own = [name for name, each in items.items() if each.size and each.visitor == item.visitor]
            while own:
                of_own, of_all = (sum(items[name].size for name in names) / 2**20 for names in (own, items))
                if len(own) <= _HELD and of_own <= _HELD_MB and of_all <= _HELD_BY_ALL_MB:
                    break
                oldest = own.pop(0)
                shutil.rmtree(items.pop(oldest).path.parent, ignore_errors=True)
                self._opened.pop((kind, oldest), None)
            if key not in items:
                raise ValueError(
                    f"{item.title}: no room beside the uploads of other visitors, {_HELD_BY_ALL_MB} MB in all"
                )
        return key

    def place_camera(self, path: Path) -> str:
        """Put a camera's file on the shelf; returns its name there. Raises ``ValueError``."""
        Camera.load(path)
        return self._place("camera", "given-camera", _Item(path, path.stem, str(path)))

    def _uploads(self) -> Path:
        with self._lock:
            if not self._folders:
                self._folders.append(Path(mkdtemp(prefix=f"{_FOLDER}{os.getpid()}-")))
            return self._folders[0]

    def close(self) -> None:
        """End the inferences that run, and remove what was uploaded."""
        with self._lock:
            models = [found for (kind, _), found in self._opened.items() if kind == "model"]
        for model in models:
            model.interrupt()
        for folder in self._folders:
            shutil.rmtree(folder, ignore_errors=True)


def clear_stale_uploads() -> None:
    """Remove this user's folders of uploads whose explorer was killed and could not."""
    for folder in Path(gettempdir()).glob(f"{_FOLDER}*"):
        process = folder.name.removeprefix(_FOLDER).partition("-")[0]
        with suppress(OSError):
            own = folder.lstat().st_uid == os.getuid() and folder.is_dir() and not folder.is_symlink()
            if own and process.isdecimal() and not _runs(int(process)):
                shutil.rmtree(folder)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def cell_state(shelf: Shelf, cell_id: str, state: State) -> State:
    """The state that is a run's cell. Raises ``ValueError`` for none, or the untouched picture's."""
    run = shelf.run
    if run is None:
        raise ValueError("cell: goes with a run")
    cell = run.cell(cell_id)
    if cell.conditions is None:
        raise ValueError(f"cell = {cell_id!r}: is an untouched picture")
    return replace(
        state,
        picture=f"{OF_RUN}/{cell.image}",
        camera=OF_RUN,
        at=cell.conditions,
        figures=(),
        seed=cell.seed,
        cell=cell_id,
    )


def held(shelf: Shelf, state: State, usual: State) -> tuple[State, list[str]]:
    """The state with a picture, a camera and a model that are here, those of ``usual`` in place of what is not, and
    without figures, a strip or a cell that cannot be; lines on all that."""
    told = []
    here = {"picture": shelf.pictures(), "camera": shelf.cameras(), "model": shelf.models()}
    if lacking := [kind for kind, names in here.items() if getattr(state, kind) not in names]:
        named = ", ".join(f"{kind} = {getattr(state, kind)[:60]!r}" for kind in lacking)
        told.append(f"{named}: not held here (any more); upload again")
        instead = {kind: getattr(usual, kind) for kind in lacking}
        if "picture" in lacking:
            instead |= {"at": state.put(MOVES.name, None).at}
        state = replace(state, **instead, cell="")
    try:
        shelf.camera(state)
    except (ValueError, TypeError) as error:
        told.append(str(error))
        state = replace(state, figures=())
    try:
        control(state.along, shelf.camera(state))
    except ValueError as error:
        told.append(str(error))
        state = replace(state, along=usual.along)
    try:
        return cell_state(shelf, state.cell, state) if state.cell else state, told
    except ValueError as error:
        return replace(state, cell=""), [*told, str(error)]


def picture_of_file(path: str | Path, name: str = "") -> Picture:
    """A picture's file, of at most ``MOST_MEGAPIXELS``, as the explorer sees it: its targets are what a model
    finds."""
    path = Path(path)
    return Picture(name or path.name, None, partial(read_picture, path, MOST_MEGAPIXELS), str(path), 1)


def _check_picture(path: Path) -> None:
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


_CHECKS: Mapping[str, Callable[[Path], Any]] = {
    "picture": _check_picture,
    "camera": Camera.load,
}


@contextmanager
def _named(path: Path, name: str) -> Iterator[None]:
    """Errors with the file's own name for where it lies here."""
    try:
        yield
    except (ValueError, TypeError, OSError) as error:
        raise ValueError(str(error).replace(str(path), name).replace(path.name, name)) from None
