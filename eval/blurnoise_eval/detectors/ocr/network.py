"""Text networks, of one picture in and one tensor out, and what they are asked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.model import OnnxModel
from blurnoise_eval.detectors.records import FloatArray


def check_form(model: OnnxModel) -> None:
    """Raise :class:`ModelError` for a graph of another form than floats [N, 3, height, width] to one output."""
    inputs, outputs = model.inputs, model.outputs
    floats = [entry.type in ("tensor(float)", "tensor(float16)") for entry in inputs]
    shape = inputs[0].shape if inputs else ()
    if floats != [True] or len(outputs) != 1 or len(shape) != 4 or shape[1] != 3:
        raise ModelError(
            f"{model.path.name}: must take one picture [N, 3, height, width] of floats and give one answer; "
            f"has {len(inputs)} inputs and {len(outputs)} outputs: {', '.join(map(str, [*inputs, *outputs]))}"
        )
    height, width = fixed_size_px(model)
    model.check_size((height or 1, width or 1))


def fixed_size_px(model: OnnxModel) -> tuple[int | None, int | None]:
    """Height and width of the input, None where dynamic."""
    height, width = (side if isinstance(side, int) else None for side in model.inputs[0].size_px)
    return height, width


def answer(model: OnnxModel, blob: FloatArray) -> FloatArray:
    """Return the answer to one input (1, 3, H, W) as float32, without the batch axis.

    Raises :class:`ModelError` where the graph fails.
    """
    (output,) = model.run(blob)
    if output.ndim < 1 or len(output) != model.batch:
        raise ModelError(
            f"{model.path.name}: answers {list(output.shape)} to {model.batch} picture(s): "
            "the first axis must be the batch"
        )
    return np.asarray(output[0], np.float32)


def boxes_array(boxes_xyxy: object) -> NDArray[np.float64]:
    """Return boxes as (N, 4), px. Raises ``ValueError`` for another shape, NaN or Inf."""
    boxes = np.asarray(boxes_xyxy, np.float64)
    boxes = boxes.reshape(0, 4) if boxes.size == 0 else boxes
    if boxes.ndim != 2 or boxes.shape[1] != 4 or not np.isfinite(boxes).all():
        raise ValueError(f"boxes_xyxy: must be finite, shape (N, 4), got {boxes.shape}")
    return boxes
