"""An ONNX file on the CPU: loading and first answer have a time limit; inferences can be interrupted."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import onnx
import onnxruntime as ort
from numpy.typing import NDArray

from blurnoise._core.checks import in_range
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.model_files import external_files, fetched, model_sha256, named_as
from blurnoise_eval.detectors.records import FloatArray, all_finite
from blurnoise_eval.system.urls import Location, location

TIMEOUT_S = 60.0
_MOST_S = 86_400.0
_POLL_S = 0.2
_GRACE_S = 1.0
"""An inference ends at its next node, loading not at all: after so long it is left to end with the process."""

Shape = tuple[int | str | None, ...]
DTYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
}
"""The types that a picture's input may have."""
MOST_INPUT_PIXELS = 1 << 28
"""Of what a network takes at once, all pictures of its batch: 3 GiB of numbers."""


@dataclass(frozen=True)
class TensorInfo:
    """One input or output: name, shape (a name or None where it is dynamic) and onnxruntime's type."""

    name: str
    shape: Shape
    type: str

    def __str__(self) -> str:
        return f"{self.name!r} {list(self.shape)} {self.type}"

    @property
    def axes(self) -> str | None:
        """ "nchw", "nhwc" or "chw" of an input that takes a picture of three channels; None of another.

        Where no axis says 3, a dynamic one may be the channels', which then come before height and width.
        """
        if self.type not in DTYPES or len(self.shape) not in (3, 4):
            return None
        channels = self.shape[-3]
        if channels == 3:
            return "nchw" if len(self.shape) == 4 else "chw"
        if len(self.shape) == 4 and self.shape[3] == 3:
            return "nhwc"
        return None if isinstance(channels, int) else "nchw" if len(self.shape) == 4 else "chw"

    @property
    def size_px(self) -> Shape:
        """Height and width of an input that takes a picture."""
        return self.shape[1:3] if self.axes == "nhwc" else self.shape[-2:]


class OnnxModel:
    """A model's file, opened on ``threads`` cores that never wait by spinning. It serves any number of threads.

    ``timeout_s``: how long loading may take, and the first answer; later ones take what they take. On the main thread
    an interrupt ends them; from elsewhere :meth:`interrupt` does.

    Raises :class:`ModelError`, in one line, for a file that is missing, empty, text, a web page, a git-lfs
    pointer, damaged, too new, or without its external data, and ``TimeoutError``.

    Attributes: ``source``, the file as it was named; ``path``, the file on this machine; ``sha256`` of its files;
    ``session``, onnxruntime's; ``metadata``; ``inputs``, the picture first, and ``outputs``; ``axes`` of the picture,
    None where the model takes none; ``batch``, how many pictures it takes at once.
    """

    def __init__(self, source: str | Location, threads: int = 1, timeout_s: float = TIMEOUT_S) -> None:
        if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
            raise ValueError(f"threads = {threads!r}: must be an integer >= 1")
        self.source, self.threads = location(source), threads
        self.timeout_s = in_range("timeout_s", timeout_s, 0, _MOST_S, above=True)
        self.path = fetched(source)
        with named_as(source, self.path):
            self.session = self._loaded()
        self.sha256 = model_sha256(self.path)
        self.metadata: dict[str, str] = dict(self.session.get_modelmeta().custom_metadata_map)
        infos = [
            tuple(TensorInfo(entry.name, tuple(entry.shape), entry.type) for entry in entries)
            for entries in (self.session.get_inputs(), self.session.get_outputs())
        ]
        self.inputs = tuple(sorted(infos[0], key=lambda entry: entry.axes is None))
        self.outputs = infos[1]
        self.axes = self.inputs[0].axes if self.inputs else None
        first = self.inputs[0].shape[0] if self.axes in ("nchw", "nhwc") else 1
        self.batch = first if isinstance(first, int) else 1
        self._answered = False
        self._running: set[ort.RunOptions] = set()

    def _loaded(self) -> ort.InferenceSession:
        if problem := _not_a_model(self.path):
            raise ModelError(f"{self.path}: {problem}")
        options = ort.SessionOptions()
        options.intra_op_num_threads = self.threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        load = partial(ort.InferenceSession, str(self.path), options, providers=["CPUExecutionProvider"])
        try:
            return _apart(load, lambda: None, self.timeout_s)
        except TimeoutError:
            raise self._too_slow("does not load") from None
        except Exception as error:  # onnxruntime's exceptions share no base class of their own
            raise ModelError(f"{self.path}: {_load_problem(self.path, error)}") from None

    def check_size(self, size_px: tuple[int, int]) -> None:
        """Raise :class:`ModelError` for an input (height, width) of more than ``MOST_INPUT_PIXELS``."""
        height, width = size_px
        if self.batch * height * width > MOST_INPUT_PIXELS:
            raise ModelError(
                f"{self.path.name}: takes {self.batch} picture(s) of {height} x {width} px; "
                f"must be at most {MOST_INPUT_PIXELS} px"
            )

    def run(
        self,
        blob: NDArray[Any],
        outputs: Sequence[str] | None = None,
        extras: Mapping[str, NDArray[Any]] = MappingProxyType({}),
    ) -> list[NDArray[Any]]:
        """Return the outputs of these names, all for None, for one picture in the form of the first input.

        A graph with a fixed larger batch gets the picture repeated. extras: what the other inputs are fed. Raises
        :class:`ModelError` where the graph fails, ``TimeoutError``, and ``InterruptedError``.
        """
        feed = np.repeat(blob, self.batch, axis=0) if self.batch > 1 else blob
        picture = self.inputs[0]
        feeds = {picture.name: np.ascontiguousarray(feed, DTYPES[picture.type]), **extras}
        options = ort.RunOptions()
        options.log_severity_level = 4  # failures are raised
        infer = partial(self.session.run, outputs, feeds, options)
        end = partial(setattr, options, "terminate", True)
        self._running.add(options)
        try:
            if self._answered and threading.current_thread() is not threading.main_thread():
                found: list[Any] = infer()
            else:
                found = _apart(infer, end, None if self._answered else self.timeout_s)
        except TimeoutError:
            raise self._too_slow("gives no answer") from None
        except Exception as error:  # as above
            if options.terminate:
                raise InterruptedError(f"{self.path.name}: interrupted") from None
            raise ModelError(f"{self.path.name}: fails on a picture ({str(error).splitlines()[0]})") from None
        finally:
            self._running.discard(options)
        self._answered = True
        return [np.asarray(value) for value in found]

    def interrupt(self) -> None:
        """End the inferences that run, in other threads; the next ones run as before."""
        for options in list(self._running):
            options.terminate = True

    def _too_slow(self, what: str) -> TimeoutError:
        return TimeoutError(f"{self.path.name}: {what} within {self.timeout_s:g} s; timeout_s allows more")


class PictureModel:
    """What detectors and text readers have in common. One instance serves any number of threads.

    It pickles as what opened it, ``opened_again``, and its name: in another process the file is opened again.

    Attributes: ``name`` (file name without suffix), ``source``, the file as it was named, ``path``, the file on this
    machine, ``sha256`` of its files, ``contract``.
    """

    contract: Any

    def __init__(self, model: OnnxModel, opened_again: Callable[[], PictureModel]) -> None:
        self._model, self._opened_again = model, opened_again
        self.name, self.sha256 = model.path.stem, model.sha256
        self.source, self.path = model.source, model.path
        self._non_finite = NonFinite(model.path.name)

    def __reduce__(self) -> tuple[Any, ...]:
        return self._opened_again, (), {"name": self.name}

    @property
    def assumptions(self) -> list[str]:
        """One sentence per field of the contract that nothing stated."""
        assumed: list[str] = self.contract.assumptions
        return assumed

    @property
    def non_finite_values(self) -> int:
        """NaN and infinite output values seen so far."""
        return self._non_finite.total

    @property
    def non_finite_values_here(self) -> int:
        """Those of the calling thread."""
        return self._non_finite.here

    def interrupt(self) -> None:
        """End the inferences that run, in other threads; the next ones run as before."""
        self._model.interrupt()


class NonFinite:
    """How many NaN and infinite values a file's network has answered with so far: in ``total``, and ``here``."""

    def __init__(self, file: str) -> None:
        self.total = 0
        self._file = file
        self._lock = threading.Lock()
        self._own = threading.local()

    @property
    def here(self) -> int:
        """Those of the calling thread."""
        return int(getattr(self._own, "count", 0))

    def count(self, outputs: Iterable[FloatArray]) -> None:
        """Add those of ``outputs``; the first ones are warned of."""
        count = sum(
            int(output.size - np.isfinite(output).sum()) for output in outputs if not all_finite(output)
        )
        if not count:
            return
        self._own.count = self.here + count
        with self._lock:
            first = self.total == 0
            self.total += count
        if first:
            warnings.warn(f"{self._file}: outputs contain NaN or Inf; dropped", RuntimeWarning, stacklevel=4)


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
    if missing := [name for name in external_files(path) if not (path.parent / name).is_file()]:
        return f"its weights are in {', '.join(missing)}, which must lie beside it and does not"
    return f"onnxruntime cannot load it: {reason[:300]}"
