"""Names of pictures in the folder of a set, from labels that were written elsewhere.

A label names its picture by a path of the machine that wrote it. Backslashes are Windows' separators. A path that
leaves the folder is used only where its end is a file in the folder; so nothing outside is ever opened.
"""

from __future__ import annotations

import posixpath
from collections.abc import Sequence
from pathlib import Path, PureWindowsPath

from blurnoise._core.checks import shown
from blurnoise_eval.system.files import inside
from blurnoise_eval.system.urls import Location, listing, versions

_BESIDE = ("images", "data", "JPEGImages")
_FIRST = 20  # names that show where a set's pictures are


class Places:
    """Names in a folder. ``notes``: what was assumed."""

    def __init__(self, folder: Location) -> None:
        self.folder = folder
        self._moved = 0
        self._listed: frozenset[str] | None = None

    @property
    def notes(self) -> list[str]:
        """How many paths were found by their ends."""
        text = "paths of another folder, whose ends are files of this one and are read"
        return [f"{text}: {self._moved}"] if self._moved else []

    def names(self, written: Sequence[str]) -> list[str]:
        """The names in the folder, as sub/picture.png. Of several paths with one start, one has to be found.

        Raises ``ValueError`` for a path that leaves the folder and is not found in it, or in several places.
        """
        names = [self._name(path) for path in written]
        starts = {
            _slashed(path).removesuffix(name)
            for path, name in zip(written, names, strict=True)
            if name and _leaves(_slashed(path))
        }
        for index, (path, name) in enumerate(zip(written, names, strict=True)):
            if name is None:
                start = next((start for start in starts if start and _slashed(path).startswith(start)), None)
                if start is None:
                    raise ValueError(f"{_fault(path)}, and its end is not one file of {str(self.folder)!r}")
                names[index] = inside(_slashed(path).removeprefix(start))
        return [name or "" for name in names]

    def name(self, written: str) -> str:
        """One name, as :meth:`names`."""
        return self.names([written])[0]

    def _name(self, written: str) -> str | None:
        path = _slashed(written)
        if not _leaves(path):
            return inside(path)
        if "\0" in path:
            return None
        if isinstance(self.folder, Path) and path.startswith("/"):
            # A path of this machine may be written as it is, or with the folder's links followed.
            for root in {str(self.folder.absolute()), str(self.folder.resolve())}:
                if path.startswith(f"{root.rstrip('/')}/"):
                    return inside(path[len(root.rstrip("/")) + 1 :])
        matches = [end for end in ends(path) if end in self._files()]
        self._moved += len(matches) == 1
        return matches[0] if len(matches) == 1 else None

    def _files(self) -> frozenset[str]:
        if self._listed is None:
            self._listed = frozenset(listing(self.folder))
        return self._listed


def ends(path: str) -> list[str]:
    """The ends of a path, longest first, without what leads to its first folder.

    >>> ends("/home/me/photos/a.jpg")
    ['home/me/photos/a.jpg', 'me/photos/a.jpg', 'photos/a.jpg', 'a.jpg']
    """
    parts = [part for part in path.split("/") if part not in ("", ".", "..")]
    first = 0 if path.startswith(("/", "../")) else 1
    return ["/".join(parts[start:]) for start in range(first, len(parts))]


def found_in(names: Sequence[str], folder: Location) -> tuple[Location, str]:
    """The folder with the pictures of these names, and what their paths begin with beside it, by the first of them.

    It is ``folder``, or the only one beside the labels where tools put pictures, with "", or ``folder`` with a start
    that all names have and none needs; ``folder`` with "" where they are nowhere.
    """
    first = [*names[:_FIRST]]
    if not first or versions(folder, first):
        return folder, ""
    above = folder.parent if folder.name in ("annotations", "Annotations", "labels") else folder
    candidates = [above / name for name in _BESIDE] + [above] * (above != folder)
    complete = [candidate for candidate in candidates if len(versions(candidate, first)) == len(first)]
    if len(complete) == 1:
        return complete[0], ""
    # An archive may have lost its first folders: names then begin with folders that are not there.
    parts = first[0].split("/")
    for count in range(1, len(parts)):
        start = "/".join(parts[:count]) + "/"
        short = [name.removeprefix(start) for name in first]
        if all(name.startswith(start) for name in names) and len(versions(folder, short)) == len(first):
            return folder, start
    return folder, ""


def _slashed(written: str) -> str:
    path = written.replace("\\", "/").removeprefix("file://")
    return posixpath.normpath(path) if path else path


def _leaves(path: str) -> bool:
    windows = PureWindowsPath(path)
    return path in ("", ".", "..") or path.startswith(("/", "../")) or bool(windows.drive) or "\0" in path


def _fault(written: str) -> str:
    return f"file name {shown(written[:200])} leaves the folder"
