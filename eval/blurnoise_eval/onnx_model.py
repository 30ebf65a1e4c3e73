"""Runs anybody's ONNX detector on the CPU: file, session, contract, picture in, detections out."""

from __future__ import annotations

import hashlib
import threading
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort
from numpy.typing import NDArray

from blurnoise_eval.contract import Contract, ModelError, exported_fields, stated_contract
from blurnoise_eval.formats import resolve
from blurnoise_eval.formats.candidates import FloatArray, best, suppress
from blurnoise_eval.formats.placement import Placement, lay_in
from blurnoise_eval.formats.signature import Shape, Signature, TensorInfo, extra_feeds
from blurnoise_eval.records import Detections

_DTYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(double)": np.float64}
_PROBE_SIZE_PX = (640, 640)  # for graphs of dynamic size while their family is still unknown


class Detector:
    """An ONNX detector with its contract. One instance serves any number of threads.

    ``contract``: a :class:`Contract`, a contract file or the name of a preset; None looks beside the model
    and into its metadata, then recognises the family from the graph (see ``contract.assumptions``).
    ``threads``: cores that one inference may use. Raises :class:`ModelError` for a file that is no model, a
    graph of no known family, or a contract that does not fit it.

    Attributes: ``name`` (file name without suffix), ``path``, ``sha256`` of the file, ``contract``,
    ``input_size_px`` (height, width), ``non_finite_values``: NaN and infinite output values seen so far.
    """

    def __init__(
        self, path: str | Path, *, contract: Contract | str | Path | None = None, threads: int = 1
    ) -> None:
        self.path = Path(path)
        self.name = self.path.stem
        self.session = open_session(self.path, threads)
        self.sha256 = _sha256(self.path)
        metadata = dict(self.session.get_modelmeta().custom_metadata_map)
        stated = stated_contract(self.path, metadata, contract)
        size_px = stated.input_size_px if stated else exported_fields(metadata).get("input_size_px")
        signature = _signature(self.session, metadata, size_px or _PROBE_SIZE_PX)
        self.family, self.contract = resolve(self.path, signature, stated)
        self.input_size_px = self.contract.input_size_px or _PROBE_SIZE_PX
        if signature.size_px != self.input_size_px:  # dynamic graph, recognised at another size
            resolve(self.path, _signature(self.session, metadata, self.input_size_px), self.contract)
        image_input = signature.inputs[0]
        self._input_name = image_input.name
        self._outputs = list(self.family.OUTPUTS) or None
        self._dtype = _DTYPES[image_input.type]
        self._batch = image_input.shape[0] if isinstance(image_input.shape[0], int) else 1
        self._extras = extra_feeds(signature.inputs[1:], self.input_size_px, self._batch) or {}
        self.non_finite_values = 0
        self._count_lock = threading.Lock()
        self._buffers = threading.local()

    def prepare(
        self, image: NDArray[np.uint8], out: FloatArray | None = None
    ) -> tuple[FloatArray, Placement]:
        """Return the network's input (1, 3, H, W), float32, for an RGB picture (h, w, 3), and its placement.

        ``out``: a buffer of that shape to fill instead of a new one. Raises ``TypeError`` or ``ValueError``
        for a picture of another type or shape.
        """
        return lay_in(image, self.contract, self.input_size_px, out)

    def run(self, blob: FloatArray) -> list[FloatArray]:
        """Return the network's outputs for one input (1, 3, H, W) as float32, batch size 1.

        A graph with a fixed larger batch gets the picture repeated; its first answer counts.
        """
        feed = np.repeat(blob, self._batch, axis=0) if self._batch > 1 else blob
        try:
            feeds = {self._input_name: feed.astype(self._dtype, copy=False), **self._extras}
            outputs = self.session.run(self._outputs, feeds)
        except Exception as error:  # onnxruntime's exceptions share no base class of their own
            raise ModelError(f"{self.path.name}: fails on a picture ({str(error).splitlines()[0]})") from None
        alone = (output if output.ndim < 3 else output[:1] for output in outputs)
        return [output.astype(np.float32, copy=False) for output in alone]

    def decode(
        self,
        outputs: Sequence[FloatArray],
        placement: Placement,
        *,
        min_score: float = 0.001,
        max_detections: int = 300,
    ) -> Detections:
        """Return detections in the picture's own px, clipped to it, after suppression within each class.

        Candidates with NaN are dropped, counted in ``non_finite_values`` and warned of once. Raises
        :class:`ModelError` if scores exceed 1, which no family's do, or for a class without a name.
        """
        self._count_non_finite(outputs)
        candidates = self.family.decode(outputs, self.input_size_px, min_score)
        if len(candidates) and candidates.scores.max() > 1.01:
            raise ModelError(
                f"{self.path.name}: score {candidates.scores.max():g} > 1; "
                f"is the family {self.contract.family} right ({self.contract.sources['family']})?"
            )
        if len(candidates) and candidates.class_ids.max() >= len(self.contract.classes):
            raise ModelError(
                f"{self.path.name}: finds class {candidates.class_ids.max()}, counted from 0, but the contract "
                f"names {len(self.contract.classes)} ({self.contract.sources['classes']})"
            )
        nms_iou = self.contract.nms_iou
        kept = (
            best(candidates, max_detections)
            if nms_iou is None
            else suppress(candidates, nms_iou, max_detections)
        )
        boxes = placement.to_picture(kept.boxes_xyxy)
        inside = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)  # not wholly in the padding
        return Detections(boxes[inside], np.minimum(kept.scores[inside], 1), kept.class_ids[inside])

    def top_score(self, outputs: Sequence[FloatArray]) -> float:
        """Return the highest score of any candidate, however low; 0.0 if there is none above 0.

        Exactly 0.0 for picture after picture is the mark of an int8 export whose one output scale, made for
        box coordinates, has rounded every score away.
        """
        scores = self.family.decode(outputs, self.input_size_px, 0.0).scores
        return float(scores.max(initial=0.0))

    def detect(
        self, image: NDArray[np.uint8], *, min_score: float = 0.001, max_detections: int = 300
    ) -> Detections:
        """Return what the network finds in an RGB picture (h, w, 3), uint8."""
        if not hasattr(self._buffers, "blob"):
            self._buffers.blob = np.empty((1, 3, *self.input_size_px), np.float32)
        blob, placement = self.prepare(image, self._buffers.blob)
        return self.decode(self.run(blob), placement, min_score=min_score, max_detections=max_detections)

    def _count_non_finite(self, outputs: Sequence[FloatArray]) -> None:
        # A sum is finite where all its values are: one pass without a temporary.
        count = sum(
            int(output.size - np.isfinite(output).sum())
            for output in outputs
            if not np.isfinite(np.add.reduce(output, axis=None))
        )
        if count == 0:
            return
        with self._count_lock:
            first = self.non_finite_values == 0
            self.non_finite_values += count
        if first:
            warnings.warn(
                f"{self.path.name}: outputs contain NaN or Inf; dropped", RuntimeWarning, stacklevel=3
            )


def open_session(path: Path, threads: int = 1) -> ort.InferenceSession:
    """Return a CPU session on ``threads`` cores that never waits by spinning.

    Raises :class:`ModelError`, in one line, for a file that is missing, empty, text, a web page, a git-lfs
    pointer, damaged, too new, or without its external data.
    """
    if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
        raise ValueError(f"threads = {threads!r}: must be an integer >= 1")
    if problem := _not_a_model(path):
        raise ModelError(f"{path}: {problem}")
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        return ort.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions share no base class of their own
        raise ModelError(f"{path}: {_load_problem(path, error)}") from None


def _not_a_model(path: Path) -> str | None:
    """What the file is instead of a model, from its first bytes; None if it may be one."""
    if not path.is_file():
        return "is a folder, not a model file" if path.is_dir() else "no such file"
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
    locations = {
        entry.value
        for tensor in model.graph.initializer
        for entry in tensor.external_data
        if entry.key == "location"
    }
    if missing := sorted(name for name in locations if not (path.parent / name).is_file()):
        return f"its weights are in {', '.join(missing)}, which must lie beside it and does not"
    return f"onnxruntime cannot load it: {reason[:300]}"


def _signature(
    session: ort.InferenceSession, metadata: dict[str, str], size_px: tuple[int, int]
) -> Signature:
    """Return the graph's signature, its outputs measured on a grey picture where they are dynamic.

    ``size_px``: the picture's (height, width) where the graph leaves it open.
    """
    inputs = tuple(TensorInfo(t.name, tuple(t.shape), t.type) for t in session.get_inputs())
    outputs = tuple(TensorInfo(t.name, tuple(t.shape), t.type) for t in session.get_outputs())
    inputs = tuple(sorted(inputs, key=lambda entry: len(entry.shape) != 4))  # the picture first
    shape = inputs[0].shape if inputs else ()
    if len(shape) != 4 or shape[1] != 3 or inputs[0].type not in _DTYPES:
        return Signature(inputs, outputs, metadata, None)
    batch, height, width = (
        known if isinstance(known, int) else default
        for known, default in zip((shape[0], *shape[2:]), (1, *size_px), strict=True)
    )
    extras = extra_feeds(inputs[1:], (height, width), batch)
    if extras is None:
        return Signature(inputs, outputs, metadata, None)
    fixed = shape[2:] == (height, width)
    if not fixed or not all(t.shape and all(isinstance(n, int) for n in t.shape[1:]) for t in outputs):
        probe = np.full((batch, 3, height, width), 0.5, _DTYPES[inputs[0].type])
        try:
            answers = session.run(None, {inputs[0].name: probe, **extras})
        except Exception as error:  # onnxruntime's exceptions share no base class of their own
            raise ModelError(
                f"the graph claims a dynamic size but fails on a picture of {height} x {width} px; "
                f"state input_size_px in its contract ({' '.join(str(error).split())[:200]})"
            ) from None
        measured: list[Shape] = [np.shape(answer) for answer in answers]
        outputs = tuple(TensorInfo(t.name, s, t.type) for t, s in zip(outputs, measured, strict=True))
    return Signature(inputs, outputs, metadata, (height, width))


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
