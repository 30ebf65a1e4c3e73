"""An ONNX session on the CPU: loading and first answer have a time limit; inferences can be interrupted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import onnx
import onnxruntime as ort

from blurnoise._core.checks import in_range
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.model_files import external_files

TIMEOUT_S = 60.0
_MOST_S = 86_400.0
_POLL_S = 0.2
_GRACE_S = 1.0
"""An inference ends at its next node, loading not at all: after so long it is left to end with the process."""


class Session:
    """A CPU session on ``threads`` cores that never waits by spinning. One instance serves any number of threads.

    ``timeout_s``: how long loading may take, and the first answer; later ones take what they take. On the main thread
    an interrupt ends them; from elsewhere :meth:`interrupt` does.

    Raises :class:`ModelError`, in one line, for a file that is missing, empty, text, a web page, a git-lfs
    pointer, damaged, too new, or without its external data, and ``TimeoutError``.

    Attributes: ``bare``, onnxruntime's session.
    """

    def __init__(self, path: Path, threads: int = 1, timeout_s: float = TIMEOUT_S) -> None:
        if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
            raise ValueError(f"threads = {threads!r}: must be an integer >= 1")
        self._timeout_s = in_range("timeout_s", timeout_s, 0, _MOST_S, above=True)
        if problem := _not_a_model(path):
            raise ModelError(f"{path}: {problem}")
        options = ort.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        load = partial(ort.InferenceSession, str(path), options, providers=["CPUExecutionProvider"])
        try:
            self.bare: ort.InferenceSession = _apart(load, lambda: None, self._timeout_s)
        except TimeoutError:
            raise self._too_slow(path, "does not load") from None
        except Exception as error:  # onnxruntime's exceptions share no base class of their own
            raise ModelError(f"{path}: {_load_problem(path, error)}") from None
        self._path = path
        self._answered = False
        self._running: set[ort.RunOptions] = set()

    def run(self, outputs: Sequence[str] | None, feeds: Mapping[str, Any]) -> list[Any]:
        """The outputs of these names, all for None.

        Raises :class:`ModelError` where the graph fails, ``TimeoutError``, and ``InterruptedError``.
        """
        options = ort.RunOptions()
        options.log_severity_level = 4  # failures are raised
        infer = partial(self.bare.run, outputs, feeds, options)
        end = partial(setattr, options, "terminate", True)
        self._running.add(options)
        try:
            if self._answered and threading.current_thread() is not threading.main_thread():
                found: list[Any] = infer()
            else:
                found = _apart(infer, end, None if self._answered else self._timeout_s)
        except TimeoutError:
            raise self._too_slow(self._path, "gives no answer") from None
        except Exception as error:  # as above
            if options.terminate:
                raise InterruptedError(f"{self._path.name}: interrupted") from None
            raise ModelError(
                f"{self._path.name}: fails on a picture ({str(error).splitlines()[0]})"
            ) from None
        finally:
            self._running.discard(options)
        self._answered = True
        return found

    def interrupt(self) -> None:
        """End the inferences that run, in other threads; the next ones run as before."""
        for options in list(self._running):
            options.terminate = True

    def _too_slow(self, path: Path, what: str) -> TimeoutError:
        return TimeoutError(f"{path.name}: {what} within {self._timeout_s:g} s; timeout_s allows more")


def _apart(call: Callable[[], Any], end: Callable[[], None], limit_s: float | None) -> Any:
    """What ``call`` returns or raises in a thread of its own, for native code lets no interrupt through to Python.

    Past the limit, on an interrupt, and where the process ends, ``end`` is called, and the thread left.
    Raises ``TimeoutError``.
    """
    answers: list[Any] = []
    errors: list[BaseException] = []

    def work() -> None:
        try:
            answers.append(call())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    until_s = None if limit_s is None else time.monotonic() + limit_s
    try:
        while thread.is_alive():
            left_s = _POLL_S if until_s is None else until_s - time.monotonic()
            if left_s <= 0 or not threading.main_thread().is_alive():
                raise TimeoutError
            thread.join(min(left_s, _POLL_S))
    except BaseException:
        end()
        thread.join(_GRACE_S)
        raise
    if errors:
        raise errors[0]
    return answers[0]


def _not_a_model(path: Path) -> str | None:
    """What the file is instead of a model, from its first bytes; None if it may be one."""
    if not path.is_file():
        if path.is_dir():
            return "is a folder, not a model file"
        return "a device or pipe, no file" if path.exists() else "no such file"
    with path.open("rb") as file:
        head = file.read(1024)
    if not head.strip():
        return "the file is empty"
    if head.startswith(b"version https://git-lfs"):
        return "is a git-lfs pointer, not the model: fetch it with `git lfs pull`"
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").lower().startswith((b"<!doctype", b"<html", b"<?xml", b"<head")):
        return "is a web page, not a model: the download saved a page instead of the file"
    if all(byte in b"\t\n\r\f" or byte >= 32 for byte in head):
        return f"is a text file, not a model; it begins {head[:30]!r}"
    return None


def _load_problem(path: Path, error: Exception) -> str:
    """Why onnxruntime refused the file, in one line."""
    reason = " ".join(str(error).split())
    try:
        model = onnx.load(str(path), load_external_data=False)
    except Exception:  # protobuf's DecodeError, without importing protobuf
        return f"is not an ONNX model, or a damaged one ({reason[:200]})"
    if "IR version" in reason:
        return (
            f"has IR version {model.ir_version}, newer than onnxruntime {ort.__version__} reads: "
            f"update onnxruntime or export again ({reason[:200]})"
        )
    if missing := [name for name in external_files(model) if not (path.parent / name).is_file()]:
        return f"its weights are in {', '.join(missing)}, which must lie beside it and does not"
    return f"onnxruntime cannot load it: {reason[:300]}"
