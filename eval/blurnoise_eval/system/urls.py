"""Files at URLs: objects of S3, Google Cloud Storage and Hugging Face, through fsspec and universal_pathlib.

A ``Location`` is a ``Path`` or, at a URL, a ``UPath``. Objects are copied whole into a cache on this machine before
they are read, under their version: in BLURNOISE_CACHE, by default ``blurnoise`` in XDG_CACHE_HOME or ~/.cache.
Endpoints and credentials come from the environment, as botocore (AWS_ENDPOINT_URL, AWS_PROFILE, AWS_ACCESS_KEY_ID)
and fsspec (FSSPEC_S3_ANON) read it; they are neither printed nor stored.

The libraries retry after temporary errors. Other errors are an ``OSError`` of one line with the URL:
``FileNotFoundError`` for missing objects, ``PermissionError`` for denied ones.
"""

from __future__ import annotations

import errno
import hashlib
import os
import posixpath
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit
from urllib.request import url2pathname

if TYPE_CHECKING:
    from upath import UPath

    Location = Path | UPath
else:
    Location = Path  # as options of commands are declared; a UPath takes 0.1 s to import

T = TypeVar("T")
_EXTRAS = {"s3": "s3", "gs": "gcs", "hf": "hf", "memory": "s3"}
"""Scheme, and the extra of this package that brings what it needs. ``memory`` is of this process, for tests."""
_S3_WAITS = {"connect_timeout": 10, "read_timeout": 20, "retries": {"max_attempts": 2}}  # s, s, tries again
_AT_ONCE = 32  # requests that only wait
_FEW = 200  # objects that are asked for one by one rather than by a listing of their folder
_VERSION = ("ETag", "etag", "generation", "md5Hash", "blob_id", "LastModified", "updated", "mtime", "created")
_MISSING = (FileNotFoundError, NotADirectoryError)


def is_url(text: object) -> bool:
    """Whether a text is meant as a URL.

    >>> is_url("s3://bucket/run"), is_url("C:/run")
    (True, False)
    """
    return isinstance(text, str) and re.match(r"[A-Za-z][A-Za-z0-9+.-]*://", text) is not None


def without_secrets(text: str) -> str:
    """A text without the users, passwords and queries of its URLs.

    >>> without_secrets("denied: s3://me:secret@bucket/run?token=1")
    'denied: s3://bucket/run'
    """
    text = re.sub(r"(\b[A-Za-z][A-Za-z0-9+.-]*://)[^/\s@]*@", r"\1", text)
    return re.sub(r"(\b[A-Za-z][A-Za-z0-9+.-]*://[^\s?'\"]*)\?[^\s'\"]*", r"\1", text)


def location(text: str | Location) -> Any:
    """The ``Path`` or ``UPath`` of a text; ``file://`` is a path.

    Raises ``ValueError`` for an unknown scheme, an address outside any bucket, a password or a query; ``OSError``
    where a package is missing.
    """
    if not isinstance(text, str):
        return text
    if text == "":
        raise ValueError("'': must be the name of a file or folder")
    if not is_url(text):
        return Path(text)
    scheme, _, rest = text.partition("://")
    scheme, shown = scheme.lower(), without_secrets(text)
    if scheme == "file" and urlsplit(text).netloc in ("", "localhost"):
        return Path(url2pathname(rest.removeprefix("localhost")))
    if scheme not in _EXTRAS:
        raise ValueError(f"{shown}: must begin with s3://, gs://, hf:// or file:///")
    bucket, path = rest.partition("/")[0], posixpath.normpath(rest)
    if "@" in bucket or "?" in rest:
        raise ValueError(
            f"{shown}: must not contain a user, password or query; set credentials in the environment"
        )
    if "\0" in rest or not bucket.strip(".") or path.partition("/")[0] != bucket:
        raise ValueError(f"{shown!r}: must be a path in a bucket, such as {scheme}://bucket/folder")
    with explained(f"{scheme}://{path}"):
        from fsspec.config import conf
        from upath import UPath

        options: dict[str, Any] = {} if scheme == "hf" else {"use_listings_cache": False}
        if scheme == "s3":  # a server that is silent is given up
            options["config_kwargs"] = {**_S3_WAITS, **conf.get("s3", {}).get("config_kwargs", {})}
        return UPath(f"{scheme}://{path}", **options)


@contextmanager
def explained(url: object) -> Iterator[None]:
    """Turn the exceptions of a storage, which differ by service, into an ``OSError`` of one line with the URL."""
    try:
        yield
    except Exception as error:
        raise _os_error(error, str(url)) from None


def _os_error(error: Exception, url: str) -> OSError:
    kind = type(error).__name__
    why = " ".join(without_secrets(str(error)).split())[:200] or kind
    status = getattr(error, "status", getattr(error, "code", None))
    if isinstance(error, OSError) and error.filename == url:
        return error
    if isinstance(error, ImportError):
        install = f"pip install 'blurnoise[{_EXTRAS[url.partition(':')[0]]}]'"
        return OSError(errno.ENOPKG, f"needs more packages: {install} ({why})", url)
    if isinstance(error, (FileNotFoundError, IsADirectoryError)) or status == 404:
        return FileNotFoundError(errno.ENOENT, "no such object, folder or bucket", url)
    if isinstance(error, PermissionError) or status in (401, 403):
        return PermissionError(errno.EACCES, f"denied ({why})", url)
    if "Credential" in kind or "TokenRetrieval" in kind:
        hint = "set AWS_PROFILE or AWS_ACCESS_KEY_ID, or FSSPEC_S3_ANON=true for a public bucket"
        return PermissionError(errno.EACCES, f"no credentials{f': {hint}' * url.startswith('s3:')}", url)
    return OSError(getattr(error, "errno", None) or errno.EIO, f"failed: {kind} ({why})", url)


def version(file: Location) -> str:
    """A text that changes whenever the file does: size and times of a file, size and tag of an object. Raises
    ``OSError``."""
    if isinstance(file, Path):
        found = file.stat()
        return f"{found.st_size} {found.st_mtime_ns} {found.st_ctime_ns} {found.st_ino}"
    with explained(file):
        file.fs.invalidate_cache(file.path)
        info = file.fs.info(file.path)
        if info["type"] != "file":
            raise FileNotFoundError
    return _version_in(info)


def _version_in(info: Mapping[str, Any]) -> str:
    tag = next((info[name] for name in _VERSION if info.get(name)), "")
    tag = tag.timestamp() if isinstance(tag, datetime) else tag  # listings have it as either
    return f"{info.get('size')} {str(tag).strip(chr(34))}"


def listing(folder: Location) -> dict[str, str]:
    """The versions of all files in the folder and below it, by names such as sub/picture.png. Raises ``OSError``.

    Links to folders are not followed. Objects whose names lead elsewhere, or mark a folder, are left out.
    """

    def stop(error: OSError) -> None:
        raise error

    if isinstance(folder, Path):
        every = (Path(root, name) for root, _, names in os.walk(folder, onerror=stop) for name in names)
        return {file.relative_to(folder).as_posix(): version(file) for file in every if file.is_file()}
    with explained(folder):
        folder.fs.invalidate_cache(folder.path)
        found = folder.fs.find(folder.path, detail=True)
        start = len(folder.fs._strip_protocol(str(folder)).rstrip("/")) + 1
    files = ((name[start:], info) for name, info in found.items() if info["type"] == "file")
    return {name: _version_in(info) for name, info in files if _is_below(name)}


def for_each(files: Mapping[str, Location], do: Callable[[Location], T]) -> dict[str, T]:
    """Call ``do`` for files and return the results by their keys; for objects, in several threads.

    Missing files are left out, and so are denied objects: S3 denies missing ones to users that must not list them.
    Raises ``OSError`` if all are denied, or if the storage does not answer.
    """
    here = all(isinstance(file, Path) for file in files.values())
    missing = _MISSING if here else (*_MISSING, PermissionError)

    def attempt(file: Location) -> T | OSError:
        try:
            return do(file)
        except missing as error:
            return error

    with ThreadPoolExecutor(_AT_ONCE) as pool:
        answers = (map if here else pool.map)(attempt, files.values())
        found = dict(zip(files, answers, strict=True))
    denied = [each for each in found.values() if isinstance(each, PermissionError)]
    if denied and len(denied) == len(found):
        raise denied[0]
    return {name: each for name, each in found.items() if not isinstance(each, OSError)}


def versions(folder: Location, names: Collection[str]) -> dict[str, str]:
    """The versions of the files with these names in a folder, as by :func:`for_each`."""
    if not isinstance(folder, Path) and len(names) > _FEW:
        with suppress(PermissionError):
            every = listing(folder)
            return {name: every[name] for name in names if name in every}
    return for_each({name: folder / name for name in names}, version)


def local_file(file: Location, beside: Sequence[str] = (), known: str | None = None) -> Path:
    """The file on this machine: a ``Path`` unchanged; of an object, a copy, with copies of others from its folder.

    beside: the names of the others; missing ones are left out. known: the version of the object, if it has been
    looked up. Raises ``OSError``, also for an object that has changed.
    """
    if isinstance(file, Path):
        return file
    wanted = {file.name: known or version(file)}
    with suppress(PermissionError):
        wanted |= versions(file.parent, [name for name in beside if _is_below(name)])
    key = hashlib.blake2b(f"{file.parent} {sorted(wanted.items())}".encode(), digest_size=20)
    folder = cache_folder() / "objects" / key.hexdigest()
    for name, of_it in wanted.items():
        if not (folder / name).exists():
            _download(file.parent / name, of_it, folder / name)
    return folder / file.name


def _download(url: UPath, known: str, copy: Path) -> None:
    from blurnoise_eval.system.files import written_whole  # with blurnoise comes torch

    copy.parent.mkdir(parents=True, exist_ok=True)
    with explained(url), written_whole(copy) as unfinished:
        url.fs.get_file(url.path, str(unfinished))
        if version(url) != known:
            raise OSError(errno.ESTALE, "has changed while it was read", str(url))
        if known.partition(" ")[0] not in (str(unfinished.stat().st_size), "None"):
            raise OSError(errno.EIO, "was incomplete when it was read", str(url))


def cache_folder() -> Path:
    """The folder of the copies. They are not removed automatically."""
    usual = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "blurnoise"
    return Path(os.environ.get("BLURNOISE_CACHE") or usual)


def _is_below(name: str) -> bool:
    return not any(part in ("", ".", "..") for part in name.split("/"))
