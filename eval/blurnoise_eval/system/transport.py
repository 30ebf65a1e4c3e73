"""Transport to storage: fsspec's file systems, and requests that are tried again and fail in one line.

Endpoints and credentials come from the environment, as botocore (AWS_ENDPOINT_URL, AWS_PROFILE) and
fsspec (FSSPEC_S3_ANON) read it; none is printed.
"""

from __future__ import annotations

import errno
import re
import socket
import time
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any, TypeVar

SCHEMES = (
    ("s3", "s3", "s3fs"),
    ("gs", "gcs", "gcsfs"),
    ("hf", "hf", "huggingface_hub"),
    ("memory", "", "fsspec"),  # of this process: for tests
)
"""Scheme, the extra of this package that brings what it needs, and the module by which that shows."""
WAITS_S = (0.5, 1.0, 2.0, 4.0)
CONNECT_S, READ_S, OBJECT_S = 10, 30, 600
PATIENCE_S = 60.0
"""With storage that does not answer, from the first try of a request on."""
_silent: set[str] = set()  # buckets that have not answered since they last did: they are asked once
_CUT = (
    "IncompleteRead",
    "ClientPayloadError",
    "ResponseStreamingError",
    "ConnectionClosedError",
    "ServerDisconnectedError",
)
T = TypeVar("T")


def without_secrets(text: str) -> str:
    """A word of a command, or a message, without the users, passwords and queries of URLs in it."""
    text = re.sub(r"(\b[A-Za-z][A-Za-z0-9+.-]*://)[^/\s@]*@", r"\1", text)
    return re.sub(r"(\b[A-Za-z][A-Za-z0-9+.-]*://[^\s?'\"]*)\?[^\s'\"]*", r"\1", text)


class Changed(Exception):
    """Another version is there by now."""


def tried(shown: str, request: Callable[[], T]) -> T:
    """What a request answers, tried again where that may help. Raises ``OSError`` with the URL."""
    began, bucket = time.monotonic(), "/".join(shown.split("/")[:3])
    for wait_s in (*WAITS_S, None):
        try:
            answer = request()
        except Exception as error:  # each storage has exceptions of its own
            passing, explained = _explained(error, shown)
            silent = explained.errno in (errno.ETIMEDOUT, errno.EHOSTUNREACH)
            if not passing or wait_s is None or (silent and _given_up(bucket, began)):
                if silent:
                    _silent.add(bucket)
                raise explained from None
        else:
            _silent.discard(bucket)
            return answer
        time.sleep(wait_s)
    raise AssertionError  # the last try returns or raises


def _given_up(bucket: str, began_s: float) -> bool:
    return bucket in _silent or time.monotonic() - began_s >= PATIENCE_S


def _explained(error: Exception, shown: str) -> tuple[bool, OSError]:
    """Whether it may pass, and what failed in one line."""
    told, kind = _one_line(error), type(error).__name__
    status = getattr(error, "status", getattr(error, "code", None))
    if isinstance(error, OSError) and error.errno == errno.ENOPKG:
        return False, OSError(error.errno, error.strerror, shown)
    if isinstance(error, Changed):
        return False, OSError(errno.ESTALE, "has changed since it was looked up", shown)
    if isinstance(error, (FileNotFoundError, IsADirectoryError)) or status == 404:
        return False, FileNotFoundError(errno.ENOENT, "no such object, folder or bucket", shown)
    if isinstance(error, PermissionError) or status in (401, 403):
        return False, PermissionError(errno.EACCES, f"denied ({told})", shown)
    if isinstance(error, FileExistsError) or kind == "PreconditionFailed" or "PreconditionFailed" in told:
        return False, FileExistsError(errno.EEXIST, "is there already", shown)
    if "Credential" in kind or "TokenRetrieval" in kind:
        why = (
            "no credentials: set AWS_PROFILE or AWS_ACCESS_KEY_ID, or FSSPEC_S3_ANON=true for a public bucket"
        )
        return False, PermissionError(
            errno.EACCES, why if shown.startswith("s3:") else "no credentials", shown
        )
    if isinstance(error, EOFError) or kind in _CUT:
        return True, OSError(errno.EIO, f"cut off while it was read ({told})", shown)
    if isinstance(error, socket.gaierror) or "Connect" in kind:
        return True, OSError(errno.EHOSTUNREACH, f"no such host, or it does not answer ({told})", shown)
    if isinstance(error, TimeoutError) or "Timeout" in kind:
        return True, TimeoutError(errno.ETIMEDOUT, f"no answer within {READ_S} s", shown)
    if isinstance(error, OSError) and error.errno == errno.EINVAL:
        return False, OSError(errno.EINVAL, f"refused ({told})", shown)
    if isinstance(error, OSError) and getattr(error, "filename", None) == shown:
        return False, error
    return True, OSError(errno.EIO, f"failed ({told})", shown)


def _one_line(error: Exception) -> str:
    told = " ".join(without_secrets(str(error)).split())[:200]
    return told or type(error).__name__


@cache
def system_of(scheme: str) -> Any:
    """fsspec's file system, without caches of its own. Raises ``OSError`` where its package is missing."""
    extra, module = next((extra, module) for known, extra, module in SCHEMES if known == scheme)
    try:
        import fsspec

        import_module(module)
        options: dict[str, Any] = {"use_listings_cache": False, "skip_instance_cache": True}
        if scheme == "s3":
            stated = fsspec.config.conf.get("s3", {}).get("config_kwargs", {})
            waits = {"connect_timeout": CONNECT_S, "read_timeout": READ_S, "retries": {"max_attempts": 0}}
            options |= {"max_concurrency": 1, "config_kwargs": {**waits, **stated}}
        system = fsspec.filesystem(scheme, **options)
    except ImportError:
        raise OSError(
            errno.ENOPKG, f"needs {module}: pip install 'blurnoise[{extra}]'", f"{scheme}://"
        ) from None
    system.retries = 1  # s3fs and gcsfs: those here are the only ones
    return system
