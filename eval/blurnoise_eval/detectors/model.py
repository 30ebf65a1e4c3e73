"""An ONNX model on the CPU: its files and its session, with a time limit for loading and the first inference."""

from __future__ import annotations

import hashlib
import math
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import onnx
import onnxruntime as ort
from numpy.typing import NDArray
from onnx import external_data_helper as external

from blurnoise._core.checks import in_range
from blurnoise._core.files import check_regular, read_document
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.records import FloatArray
from blurnoise_eval.system.urls import Location, local_file, location, version

TIMEOUT_S = 60.0
_MOST_S = 86_400.0
_POLL_S = 0.2
_GRACE_S = 1.0
"""An inference ends at its next node, loading not at all: after so long it is left to end with the process."""
_CONTRACTS = ("json", "yaml", "yml")
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
    """One input or output: name, shape (a name or None where it is dynamic) and onnxruntime's type.

    >>> TensorInfo("images", (1, 3, 640, 480), "tensor(float)").axes
    'nchw'
    """

    name: str
    shape: Shape
    type: str

    def __str__(self) -> str:
        return f"{self.name!r} {list(self.shape)} {self.type}"

    @property
    def axes(self) -> str | None:
        """ "nchw", "nhwc" or "chw" of an input that takes a picture of three channels, or one; None of another.

        Where no axis says so, a dynamic one may be the channels', which then come before height and width.
        """
        if self.type not in DTYPES or len(self.shape) not in (3, 4):
            return None
        batch, channels = "n" * (len(self.shape) == 4), self.shape[-3]
        if batch and channels not in (1, 3) and self.shape[3] in (1, 3):
            return "nhwc"
        return None if isinstance(channels, int) and channels not in (1, 3) else f"{batch}chw"

    @property
    def channels(self) -> int:
        """Of an input that takes a picture: 1 or 3."""
        return 1 if self.shape[-1 if self.axes == "nhwc" else -3] == 1 else 3

    @property
    def size_px(self) -> Shape:
        """Height and width of an input that takes a picture."""
        return self.shape[1:3] if self.axes == "nhwc" else self.shape[-2:]


class OnnxModel:
    """A model's file and its session, on one core for each thread that asks it. It serves any number of threads.

    ``source``: a file, here or at a URL, or a model that is open. ``timeout_s``: how long loading may take, and the
    first answer. On the main thread an interrupt ends any answer; from elsewhere :meth:`interrupt` does. Subclasses
    pickle as what opened them, ``_opened_again``, and their name: in another process the file is opened again.

    Raises ``TimeoutError``, and :class:`ModelError`, in one line, for a file that is no model, damaged, too new, or
    without its external data.

    Attributes: ``name``, the file's without suffix; ``source``, the file as it was named; ``path``, the file on this
    machine; ``sha256`` of its files; ``session``, onnxruntime's; ``metadata``; ``inputs``, the picture first, and
    ``outputs``; ``axes`` of the picture, None where the model takes none; ``batch``, how many pictures it takes at
    once; ``contract``, of a subclass.
    """

    contract: Any
    _opened_again: Callable[[], OnnxModel]

    def __init__(self, source: str | Location | OnnxModel, timeout_s: float = TIMEOUT_S) -> None:
        self._non_finite, self._warned = threading.local(), False
        if isinstance(source, OnnxModel):
            self.__dict__ = {**source.__dict__, **self.__dict__}
            return
        self.source = location(source)
        self.timeout_s = in_range("timeout_s", timeout_s, 0, _MOST_S, above=True)
        self.path = fetched(source)
        self.name = self.path.stem
        self.session = self.load()
        self.sha256 = model_sha256(self.path)
        self.metadata: dict[str, str] = dict(self.session.get_modelmeta().custom_metadata_map)
        inputs, self.outputs = (
            tuple(TensorInfo(entry.name, tuple(entry.shape), entry.type) for entry in entries)
            for entries in (self.session.get_inputs(), self.session.get_outputs())
        )
        self.inputs = tuple(
            sorted(inputs, key=lambda entry: (entry.axes is None, entry.axes and -entry.channels))
        )
        self.axes = self.inputs[0].axes if self.inputs else None
        first = self.inputs[0].shape[0] if self.axes in ("nchw", "nhwc") else 1
        self.batch = first if isinstance(first, int) else 1
        sides = [side for side in (self.inputs[0].size_px if self.inputs else ()) if isinstance(side, int)]
        if self.batch * math.prod(sides) > MOST_INPUT_PIXELS:
            takes = f"its input is {self.batch} picture(s) of {' x '.join(map(str, sides))} px"
            raise ModelError(f"{self.path.name}: {takes}; must be at most {MOST_INPUT_PIXELS} px")
        self._answered = False
        self._running: set[ort.RunOptions] = set()

    def __reduce__(self) -> tuple[Any, ...]:
        return self._opened_again, (), {"name": self.name}

    def load(self, *, optimised: Path | None = None) -> ort.InferenceSession:
        """Open a session. optimised: where it writes the graph that it executes. Raises as the class does."""
        options = ort.SessionOptions()
        if optimised is not None:
            options.optimized_model_filepath = str(optimised)
        # One core: the workers of a sweep are the threads, and each asks the session for a picture of its own.
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        # Waiting threads would spin, which takes the core from a worker that has something to do.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        load = partial(ort.InferenceSession, str(self.path), options, providers=["CPUExecutionProvider"])
        try:
            check_regular(self.path)
            return _apart(load, self.timeout_s)
        except TimeoutError:
            raise self._too_slow("was not loaded") from None
        except OSError as error:
            raise ModelError(f"{self.source}: {str(error.strerror).lower()}") from None
        except Exception as error:  # onnxruntime's exceptions share no base class of their own
            raise ModelError(f"{self.source}: {_load_problem(self.path, error)}") from None

    def infer(
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
        # A worker's thread asks directly once the model is known to answer; the main thread must stay interruptible.
        direct = self._answered and threading.current_thread() is not threading.main_thread()
        limit_s = math.inf if self._answered else self.timeout_s
        self._running.add(options)
        try:
            answers: list[Any] = infer() if direct else _apart(infer, limit_s, options)
        except TimeoutError:
            raise self._too_slow("did not finish an inference") from None
        except Exception as error:  # onnxruntime's exceptions share no base class of their own
            if options.terminate:
                raise InterruptedError(f"{self.path.name}: interrupted") from None
            raise ModelError(
                f"{self.path.name}: the inference of a picture failed ({str(error).splitlines()[0]})"
            ) from None
        finally:
            self._running.discard(options)
        self._answered = True
        return [np.asarray(value) for value in answers]

    def interrupt(self) -> None:
        """End the inferences that run, in other threads; the next ones run as before."""
        for options in list(self._running):
            options.terminate = True

    def _too_slow(self, what: str) -> TimeoutError:
        return TimeoutError(f"{self.path.name}: {what} within {self.timeout_s:g} s; timeout_s allows more")

    @property
    def non_finite_values_here(self) -> int:
        """NaN and infinite output values that the calling thread has seen so far."""
        return int(getattr(self._non_finite, "count", 0))

    def _count_non_finite(self, outputs: Iterable[FloatArray]) -> None:
        """Count NaN and infinite values; the first ones are warned of."""
        count = sum(output.size - np.count_nonzero(np.isfinite(output)) for output in outputs)
        self._non_finite.count = self.non_finite_values_here + count
        if count and not self._warned:
            self._warned = True
            text = f"{self.path.name}: the outputs contain NaN or infinite values, which are ignored"
            warnings.warn(text, RuntimeWarning, stacklevel=4)


def _apart(call: Callable[[], Any], limit_s: float, options: ort.RunOptions | None = None) -> Any:
    """What ``call`` returns or raises in a thread of its own, for native code lets no interrupt through to Python.

    Past the limit, on an interrupt, and where the process ends, an inference of these options is ended, and the
    thread left. Raises ``TimeoutError``.
    """
    answer: Future[Any] = Future()

    def work() -> None:
        try:
            answer.set_result(call())
        except BaseException as error:
            answer.set_exception(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    until_s = time.monotonic() + limit_s
    try:
        while not answer.done():
            left_s = until_s - time.monotonic()
            if left_s <= 0 or not threading.main_thread().is_alive():
                raise TimeoutError
            thread.join(min(left_s, _POLL_S))
    except BaseException:
        if options is not None:
            options.terminate = True
        thread.join(_GRACE_S)
        raise
    return answer.result()


def _load_problem(path: Path, error: Exception) -> str:
    """Why onnxruntime refused the file, in one line."""
    with path.open("rb") as file:
        head = file.read(1024)
    if not head.strip():
        return "is an empty file"
    if head.startswith(b"version https://git-lfs"):
        return "is a git-lfs pointer, not a model; fetch the model with `git lfs pull`"
    if all(byte in b"\t\n\r\f" or byte >= 32 for byte in head):
        return f"is a text file or a web page, not a model; it begins with {head[:30]!r}"
    reason = " ".join(str(error).split())
    reason = reason if len(reason) <= 300 else f"... {reason[-300:]}"
    return f"is not an ONNX model that onnxruntime {ort.__version__} can load: {reason}"


def fetched(path: str | Location) -> Path:
    """The model's file on this machine, beside it its contract, external weights and dictionary, if it has them.

    Raises :class:`ModelError` for an object at a URL that cannot be fetched.
    """
    model = location(path)
    if isinstance(model, Path):
        return model
    contracts = [f"{model.stem}.contract.{end}" for end in _CONTRACTS]
    try:
        known = version(model)
        copy = local_file(model, contracts, known)
        contract = contract_file(copy)
        values = None if contract is None else read_mapping(contract)
        dictionary = values.get("dictionary") if isinstance(values, dict) else None
        files = [*external_files(copy), *([dictionary] if isinstance(dictionary, str) else [])]
        return local_file(model, [*contracts, *files], known) if files else copy
    except OSError as error:
        raise ModelError(f"{error.filename}: {error.strerror}") from None


def fetched_file(path: str | Location) -> Path:
    """A single file, as :func:`fetched`."""
    try:
        return local_file(location(path))
    except OSError as error:
        raise ModelError(f"{error.filename}: {error.strerror}") from None


def external_files(path: Path) -> list[str]:
    """Names of the files, beside a model's own, that hold tensors of it, in branches and functions, too."""
    try:
        model = onnx.load(str(path), load_external_data=False)
    except (
        Exception
    ):  # no model, which opening it says; a format of onnxruntime's own, which is a single file
        return []
    tensors = filter(external.uses_external_data, external._get_all_tensors(model))
    return sorted({external.ExternalDataInfo(tensor).location for tensor in tensors})


def contract_file(model_path: Path) -> Path | None:
    """Return ``model.contract.json``, ``.yaml`` or ``.yml`` beside the model, else None."""
    candidates = (model_path.with_name(f"{model_path.stem}.contract.{end}") for end in _CONTRACTS)
    return next((path for path in candidates if path.is_file()), None)


def read_mapping(path: Path) -> object:
    """Return what a JSON or YAML file holds. Raises :class:`ModelError` if it cannot be read."""
    try:
        return read_document(path)
    except (OSError, ValueError) as error:
        raise ModelError(f"contract file {path.name} cannot be read: {error}") from None


def model_sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a model's file; where its weights are in files beside it, of all of them."""
    sums = [
        _file_sha256(path),
        *(f"{name} {_file_sha256(path.parent / name)}" for name in external_files(path)),
    ]
    return sums[0] if len(sums) == 1 else hashlib.sha256("\n".join(sums).encode()).hexdigest()


def _file_sha256(path: Path) -> str:
    check_regular(path)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
