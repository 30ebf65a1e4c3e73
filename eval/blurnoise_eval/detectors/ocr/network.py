"""Network of one picture in and one tensor out, on the CPU."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import model_sha256
from blurnoise_eval.detectors.formats.candidates import FloatArray
from blurnoise_eval.detectors.formats.signature import check_input
from blurnoise_eval.detectors.non_finite import NonFinite
from blurnoise_eval.detectors.session import TIMEOUT_S, Session

_DTYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}


class Network:
    """An ONNX graph [N, 3, H, W] to one output. One instance serves any number of threads.

    ``threads``: cores that one inference may use. ``timeout_s``: how long loading and the first answer may take.
    Raises :class:`ModelError` for a file that is no model or a graph of another form, ``TimeoutError``.

    Attributes: ``path``, ``sha256`` of its files, ``metadata``, ``height_px`` and ``width_px`` of the input,
    None where dynamic, ``non_finite``: NaN and infinite output values seen so far.
    """

    def __init__(self, path: str | Path, threads: int = 1, timeout_s: float = TIMEOUT_S) -> None:
        self.path = Path(path)
        self._session = Session(self.path, threads, timeout_s)
        session = self._session.bare
        self.sha256 = model_sha256(self.path)
        self.metadata: dict[str, str] = dict(session.get_modelmeta().custom_metadata_map)
        inputs, outputs = session.get_inputs(), session.get_outputs()
        shape, kind = (inputs[0].shape, inputs[0].type) if inputs else ([], "no tensor")
        if len(inputs) != 1 or len(outputs) != 1 or len(shape) != 4 or shape[1] != 3 or kind not in _DTYPES:
            tensors = ", ".join(f"{t.name!r} {t.shape} {t.type}" for t in [*inputs, *outputs])
            raise ModelError(
                f"{self.path.name}: must take one picture [N, 3, height, width] of floats and give one answer; "
                f"has {len(inputs)} inputs and {len(outputs)} outputs: {tensors}"
            )
        batch, _, height, width = (size if isinstance(size, int) else None for size in shape)
        self.height_px, self.width_px = height, width
        self._batch = batch or 1
        check_input(self.path.name, self._batch, height or 1, width or 1)
        self._input_name, self._dtype = inputs[0].name, _DTYPES[kind]
        self.non_finite = NonFinite(self.path.name)

    def interrupt(self) -> None:
        """End the inferences that run, in other threads; the next ones run as before."""
        self._session.interrupt()

    def run(self, blob: FloatArray) -> FloatArray:
        """Return the answer to one input (1, 3, H, W) as float32, without the batch axis.

        A graph with a fixed larger batch gets the picture repeated; its first answer counts. NaN and infinite
        values are counted, and warned of once. Raises :class:`ModelError` where the graph fails.
        """
        feed = np.repeat(blob, self._batch, axis=0) if self._batch > 1 else blob
        (output,) = self._session.run(None, {self._input_name: feed.astype(self._dtype, copy=False)})
        if output.ndim < 1 or len(output) != self._batch:
            raise ModelError(
                f"{self.path.name}: answers {list(output.shape)} to {self._batch} picture(s): "
                "the first axis must be the batch"
            )
        answer: FloatArray = output[0].astype(np.float32, copy=False)
        self._count_non_finite(answer)
        return answer

    def _count_non_finite(self, answer: FloatArray) -> None:
        if np.isfinite(np.add.reduce(answer, axis=None)):  # a sum is finite where all its values are
            return
        if count := int(answer.size - np.isfinite(answer).sum()):
            self.non_finite.add(count, stacklevel=4)


def picture_size(image: NDArray[np.uint8]) -> tuple[int, int]:
    """Return (height, width). Raises ``TypeError`` or ``ValueError`` for anything but RGB (H, W, 3), uint8."""
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        kind = getattr(image, "dtype", type(image).__name__)
        raise TypeError(f"image: must be a numpy array of uint8, shape (H, W, 3), got {kind}")
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ValueError(f"image: shape must be (H, W, 3), none of them 0, got {image.shape}")
    return image.shape[0], image.shape[1]


def boxes_array(boxes_xyxy: object) -> NDArray[np.float64]:
    """Return boxes as (N, 4), px. Raises ``ValueError`` for another shape, NaN or Inf."""
    boxes = np.asarray(boxes_xyxy, np.float64)
    boxes = boxes.reshape(0, 4) if boxes.size == 0 else boxes
    if boxes.ndim != 2 or boxes.shape[1] != 4 or not np.isfinite(boxes).all():
        raise ValueError(f"boxes_xyxy: must be finite, shape (N, 4), got {boxes.shape}")
    return boxes
