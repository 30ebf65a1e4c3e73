"""Storage by URL: objects of S3, Google Cloud Storage and Hugging Face as files, through fsspec.

A :class:`Url` has what data sets, models and run folders need of a ``Path``; a ``Location`` is either.
What is read goes through this machine's :mod:`~blurnoise_eval.system.node_cache`; a ``stamp`` says which version is
meant. Endpoints and credentials come from the environment, as botocore (AWS_ENDPOINT_URL, AWS_PROFILE,
AWS_ACCESS_KEY_ID) and fsspec (FSSPEC_S3_ANON) read it; none is printed or kept.

What fails is an ``OSError`` of one line with the URL: ``FileNotFoundError`` for what is missing, ``PermissionError``
for what is denied. What may pass (no answer, a connection cut off, a server that is busy) is tried five times, after
0.5, 1, 2 and 4 s; one try waits at most 10 s for a connection, 30 s for the next bytes and 10 minutes in all. Storage
that does not answer is tried for a minute, and then once for each request until it answers.
"""

from __future__ import annotations

import errno
import hashlib
import re
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cache, partial
from pathlib import Path, PurePosixPath
from typing import Any, Protocol
from urllib.parse import urlsplit
from urllib.request import url2pathname

from blurnoise_eval.system.files import write_whole, written_whole
from blurnoise_eval.system.node_cache import node_cache
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.transport import OBJECT_S, SCHEMES, Changed, system_of, tried, without_secrets

_AT_ONCE = 16  # requests that only wait
_FEW = 200  # objects that are asked for one by one rather than by a listing of their folder
_VERSION = ("ETag", "etag", "generation", "md5Hash", "blob_id", "LastModified", "updated", "mtime", "created")
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")


class Location(Protocol):
    """A file or a folder, on this machine (a ``Path``) or by :class:`Url`."""

    @property
    def name(self) -> str:
        """The last part."""

    @property
    def stem(self) -> str:
        """The name without its suffix."""

    @property
    def suffix(self) -> str:
        """From the name's last dot on."""

    @property
    def parts(self) -> tuple[str, ...]:
        """From the root on."""

    @property
    def parent(self) -> Location:
        """The folder that it is in."""

    def __truediv__(self, name: str, /) -> Location:
        """What has that name in this folder."""

    def __hash__(self) -> int:
        """Equal places are one key."""

    def exists(self) -> bool:
        """Whether there is such a file or folder."""

    def is_file(self) -> bool:
        """Whether there is such a file."""

    def is_dir(self) -> bool:
        """Whether there is such a folder."""


@dataclass(frozen=True, slots=True)
class Url:
    """An object, or all those whose names it begins. stamp: which version of it, None for whichever is there.

    path: bucket and key. query: of the address; no part of what is shown.
    """

    scheme: str
    path: str
    query: str = field(default="", repr=False)
    stamp: str | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        """As it may be shown."""
        return f"{self.scheme}://{self.path}"

    @property
    def name(self) -> str:
        """The last part."""
        return PurePosixPath(self.path).name

    @property
    def stem(self) -> str:
        """The name without its suffix."""
        return PurePosixPath(self.path).stem

    @property
    def suffix(self) -> str:
        """From the name's last dot on."""
        return PurePosixPath(self.path).suffix

    @property
    def parts(self) -> tuple[str, ...]:
        """Bucket, folders and name."""
        return tuple(self.path.split("/"))

    @property
    def parent(self) -> Url:
        """The folder; a bucket's is the bucket."""
        return Url(self.scheme, self.path.rpartition("/")[0] or self.path)

    def __truediv__(self, name: str, /) -> Url:
        """What has that name in the folder. Raises ``ValueError`` for a name that leaves the bucket."""
        return Url(self.scheme, _within(f"{self.path}/{name}", str(self)))

    def exists(self) -> bool:
        """Whether there is such an object or folder. Raises ``OSError`` where that cannot be told."""
        return self._kind() is not None

    def is_file(self) -> bool:
        """Whether there is such an object. Raises ``OSError`` where that cannot be told."""
        return self._kind() == "file"

    def is_dir(self) -> bool:
        """Whether objects' names go on after this one. Raises ``OSError`` where that cannot be told."""
        return self._kind() == "directory"

    def _kind(self) -> str | None:
        try:
            return str(_info(self)["type"])
        except FileNotFoundError:
            return None

    def stamped(self) -> Url:
        """This with the stamp of the version that is there now. Raises ``FileNotFoundError``, ``OSError``."""
        if self.stamp is not None:
            return self
        found = _info(self)
        if found["type"] != "file":
            raise FileNotFoundError(errno.ENOENT, "is a folder, no object", str(self))
        return replace(self, stamp=_stamp(found))

    def read_bytes(self, largest: int | None = None) -> bytes:
        """All of the object, from the cache if it is there. Raises ``OSError``, also for another version, and
        ``ValueError`` for more than ``largest`` bytes."""
        version = self.stamped()
        size = (version.stamp or "").partition(" ")[0]
        if largest is not None and size.isdecimal() and int(size) > largest:
            raise ValueError(f"larger than {largest} bytes")
        return node_cache().read(
            version.key, partial(_download, version), int(size) if size.isdecimal() else None
        )

    def read_fresh(self) -> bytes:
        """All of the object as it is there now. Raises ``OSError``."""
        return _download(replace(self, stamp=None).stamped())

    def read_text(self, encoding: str = "utf-8") -> str:
        """All of the object as text. Raises ``OSError``, ``UnicodeDecodeError``."""
        return self.read_bytes().decode(encoding)

    def put(self, data: bytes) -> None:
        """Make the object, whole or not at all. Raises ``OSError``."""
        tried(str(self), lambda: system_of(self.scheme).pipe_file(_address(self), data))

    def put_new(self, data: bytes) -> bool:
        """Make the object unless there is one, and say whether it was made. Raises ``OSError``.

        data: of the caller alone, such as with a token in it: of a request whose answer was lost, nothing else tells
        that what is there already was made by it.
        """
        system = system_of(self.scheme)
        try:
            tried(str(self), lambda: system.pipe_file(_address(self), data, mode="create"))
        except FileExistsError:
            try:
                return self.read_fresh() == data
            except FileNotFoundError:  # gone meanwhile
                return False
        return True

    def unlink(self) -> None:
        """Remove the object, if there is one. Raises ``OSError``."""
        with suppress(FileNotFoundError):
            tried(str(self), lambda: system_of(self.scheme).rm_file(_address(self)))

    @property
    def key(self) -> str:
        """What the object is called in the cache."""
        return f"{self.scheme}://{_address(self)} {self.stamp}"


def is_url(text: object) -> bool:
    """Whether it is meant as a URL."""
    return isinstance(text, str) and _URL.match(text) is not None


def location(text: str | Location) -> Any:
    """The ``Path`` or :class:`Url` that is named; ``file://`` is a path.

    Raises ``ValueError`` for no text, a scheme that is not known, an address without a bucket, one that leaves it,
    and one with a password in it.
    """
    if text == "":
        raise ValueError("'': must name a file or folder")
    if not isinstance(text, str) or not is_url(text):
        return Path(text) if isinstance(text, str) else text
    scheme, _, rest = text.partition("://")
    scheme = {"gcs": "gs", "s3a": "s3"}.get(scheme.lower(), scheme.lower())
    if scheme == "file":
        return _local(text)
    path, _, query = rest.partition("?")
    if scheme not in {known for known, *_ in SCHEMES}:
        known = ", ".join(f"{known}://" for known, *_ in SCHEMES if known != "memory")
        raise ValueError(f"{without_secrets(text)}: must begin with {known} or file://")
    if "@" in path.partition("/")[0]:
        raise ValueError(
            f"{without_secrets(text)}: must hold no user or password; state them in the environment, as "
            "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
        )
    shown = f"{scheme}://{path}"
    if "\0" in path or not path.partition("/")[0].strip("."):
        raise ValueError(f"{shown!r}: must name a bucket, as {scheme}://bucket/folder")
    return Url(scheme, _within(path, shown), query)


def _local(text: str) -> Path:
    found = urlsplit(text)
    if found.netloc not in ("", "localhost"):
        raise ValueError(f"{without_secrets(text)}: must be of this machine, as file:///folder")
    return Path(url2pathname(text.partition("://")[2].removeprefix(found.netloc)))


def _within(path: str, shown: str) -> str:
    """The path without detours."""
    bucket, *parts = path.split("/")
    kept: list[str] = []
    for part in parts:
        if part == ".." and not kept:
            raise ValueError(f"{shown!r}: {path!r} leaves the bucket")
        if part == "..":
            kept.pop()
        elif part not in ("", "."):
            kept.append(part)
    return "/".join([bucket, *kept])


def listing(folder: Url) -> dict[str, str]:
    """Stamps of all objects in the folder and below, by their names in it. Raises ``OSError``.

    Objects whose names lead elsewhere, or mark a folder, are left out.
    """
    system, address = system_of(folder.scheme), _address(folder)
    anew = {"refresh": True} if folder.scheme == "hf" else {}
    found = tried(str(folder), lambda: system.find(address, detail=True, **anew))
    start = len(system._strip_protocol(f"{folder.scheme}://{address}").rstrip("/")) + 1
    names = ((name[start:], info) for name, info in found.items() if info["type"] == "file")
    return {name: _stamp(info) for name, info in names if _is_below(name)}


def stamps(folder: Url, names: Sequence[str]) -> dict[str, str]:
    """Stamps of the objects of these names in a folder, without those that are missing or denied.

    Many are listed; few, or those of a folder that must not be listed, are asked for one by one. Raises ``OSError``
    where all of them are denied, or storage does not answer.
    """
    if len(names) > _FEW:
        try:
            return listing(folder)
        except PermissionError:
            pass
        except FileNotFoundError:
            return {}
    if not names:
        return {}
    system_of(folder.scheme)  # what is not installed is told once
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        found = dict(zip(names, pool.map(lambda name: _stamp_or_error(folder / name), names), strict=True))
    denied = [each for each in found.values() if isinstance(each, PermissionError)]
    if len(denied) == len(names):
        raise denied[0]
    return {name: each for name, each in found.items() if isinstance(each, str)}


def _stamp_or_error(url: Url) -> str | OSError:
    try:
        return url.stamped().stamp or ""
    except (FileNotFoundError, PermissionError) as error:
        return error


class Finder:
    """Finds files by their names, those of a folder at a URL by one listing of it."""

    def __init__(self) -> None:
        self._listed = cache(listing)

    def __call__(self, file: Location) -> Location | None:
        """The file, an object with its stamp; None where there is none. Raises ``OSError``."""
        if not isinstance(file, Url):
            return file if file.exists() else None
        try:
            stamp = self._listed(file.parent).get(file.name)
            return None if stamp is None else replace(file, stamp=stamp)
        except FileNotFoundError:
            return None
        except PermissionError:  # of the listing, perhaps not of the object
            return file.stamped() if file.is_file() else None

    def fetch_ahead(self, files: Iterable[Location]) -> None:
        """Have those of them that are objects in the cache before they are read one by one."""
        urls = [file for file in files if isinstance(file, Url)]
        if urls:
            fetch_ahead([found for found in map(self, urls) if isinstance(found, Url)])


def fetch_ahead(urls: Sequence[Url]) -> None:
    """Read objects into the cache, several at a time; what fails does so again when it is wanted."""

    if not urls:
        return

    def fetch(url: Url) -> None:
        with suppress(OSError):
            url.read_bytes()

    with ThreadPoolExecutor(_AT_ONCE) as pool, ProgressBar("fetch files", len(urls)) as advance:
        for _ in pool.map(fetch, urls):
            advance(1)


def local_file(given: Location | str, beside: Sequence[str] = ()) -> Path:
    """The file on this machine, together with others of its folder; it stays as long as this process runs.

    Of a ``Path`` that is what it is. beside: names that are left out where they are missing, or lead elsewhere.
    Raises ``OSError``.
    """
    found = location(given)
    if isinstance(found, Path):
        return found
    file: Url = found.stamped()
    names = [name for name in beside if _is_below(name)]
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        looked = pool.map(lambda name: (name, _stamp_or_error(file.parent / name)), names)
        company = {name: stamp for name, stamp in looked if isinstance(stamp, str)}
    versions = [file, *(replace(file.parent / name, stamp=stamp) for name, stamp in company.items())]

    def fill(folder: Path) -> None:
        for name, version in zip([file.name, *company], versions, strict=True):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_whole(folder / name, version.read_bytes())

    return node_cache().folder("\n".join(version.key for version in versions), fill) / file.name


def get_file(url: Url, file: Path) -> None:
    """Write an object to a file, whole or not at all. Raises ``OSError``."""
    with written_whole(file) as unfinished:
        tried(str(url), lambda: system_of(url.scheme).get_file(_address(url), str(unfinished)))
        size = _stamp(_info(url)).partition(" ")[0]
        if size != str(unfinished.stat().st_size):
            raise OSError(errno.EIO, "was cut off, or has changed, while it was read", str(url))


def put_file(file: Path, url: Url) -> None:
    """Make an object of a file, whole or not at all. Raises ``OSError``."""
    tried(str(url), lambda: system_of(url.scheme).put_file(str(file), _address(url)))


def _is_below(name: str) -> bool:
    return not any(part in ("", ".", "..") for part in name.split("/"))


def _address(url: Url) -> str:
    """As fsspec takes it."""
    return f"{url.path}?{url.query}" if url.query else url.path


def _stamp(info: dict[str, Any]) -> str:
    version = next((info[name] for name in _VERSION if info.get(name)), "")
    version = version.timestamp() if isinstance(version, datetime) else version  # listings tell it so or so
    return f"{info.get('size')} {str(version).strip(chr(34))}"


def _info(url: Url) -> dict[str, Any]:
    system = system_of(url.scheme)
    found: dict[str, Any] = tried(str(url), lambda: system.info(_address(url), **_fresh(url)))
    return found


def _fresh(url: Url) -> dict[str, Any]:
    """What makes a file system ask anew: Hugging Face's remembers what it was told, and leaves out the version."""
    return {"refresh": True, "expand_info": True} if url.scheme == "hf" else {}


def _download(version: Url) -> bytes:
    """The object of that stamp. Raises ``OSError`` where another is there by now, or part of it."""
    system = system_of(version.scheme)
    waits: dict[str, Any] = {"timeout": OBJECT_S} if system.async_impl else {}

    def whole() -> bytes:
        data: bytes = system.cat_file(_address(version), **waits)
        size, _, tag = (version.stamp or "").partition(" ")
        if tag == hashlib.md5(data, usedforsecurity=False).hexdigest():
            return data
        if (
            _stamp(system.info(_address(version), **_fresh(version))) != version.stamp
        ):  # S3's tag need not be the sum of the bytes
            raise Changed
        if size not in (str(len(data)), "None"):
            raise EOFError(f"{len(data)} of {size} bytes")
        return data

    return tried(str(version), whole)
