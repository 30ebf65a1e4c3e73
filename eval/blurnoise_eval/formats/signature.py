"""What a graph shows of itself, and what every output family answers about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.contract import EXAMPLE
from blurnoise_eval.formats.candidates import Candidates

Shape = tuple[int | str | None, ...]


@dataclass(frozen=True)
class TensorInfo:
    """One input or output: name, shape (a name or None where it is dynamic) and onnxruntime's type."""

    name: str
    shape: Shape
    type: str


@dataclass(frozen=True)
class Signature:
    """A graph's inputs, outputs and metadata.

    inputs: the picture first, then those of :func:`extra_feeds`.
    ``size_px``: the input's (height, width) at which the outputs have the shapes in ``outputs``; None where
    the graph does not take one picture of three channels, or other inputs that are not known.
    """

    inputs: tuple[TensorInfo, ...]
    outputs: tuple[TensorInfo, ...]
    metadata: Mapping[str, str]
    size_px: tuple[int, int] | None

    def named(self, names: Sequence[str]) -> list[Shape] | None:
        """The shapes of the outputs ``names``, in that order; None unless the graph has exactly these."""
        shapes = {output.name: output.shape for output in self.outputs}
        return [shapes[name] for name in names] if sorted(shapes) == sorted(names) else None

    def describe(self) -> str:
        """Inputs, outputs, metadata keys and how to write a contract, over several lines."""
        lines = [
            f"  {kind} {t.name!r} {list(t.shape)} {t.type}"
            for kind, tensors in (("input", self.inputs), ("output", self.outputs))
            for t in tensors
        ]
        lines.append(f"  metadata keys: {', '.join(sorted(self.metadata)) or 'none'}")
        lines.append(f"  to state what it is, write <model>.contract.json beside it, for example {EXAMPLE}")
        return "\n".join(lines)


class Family(Protocol):
    """One output layout. Its module is the implementation."""

    NAME: str
    LOOKALIKES: str  # other families with this signature but another contract; empty if there are none
    OUTPUTS: tuple[str, ...]  # the outputs to decode, by name and in this order; empty: all, in the graph's

    def class_count(self, signature: Signature) -> int | None:
        """Return the number of classes if the graph's outputs have this layout, else None.

        0 where the layout does not show it, because each answer carries the number of its class.
        """

    def decode(
        self, outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float
    ) -> Candidates:
        """Return the candidates that reach ``min_score``, boxes in px of the network's input."""


def extra_feeds(
    inputs: Sequence[TensorInfo], size_px: tuple[int, int], batch: int
) -> dict[str, NDArray[np.generic]] | None:
    """What inputs beside the picture are fed, by their well-known names; None where one is not known.

    Each tells the graph that the picture has the input's own size, so that boxes come back in its px.
    """
    height, width = size_px
    known: dict[str, NDArray[np.generic]] = {
        "orig_target_sizes": np.array([[width, height]], np.int64),  # RT-DETR
        "im_shape": np.array([[height, width]], np.float32),  # PaddleDetection
        "scale_factor": np.ones((1, 2), np.float32),  # (y, x)
        "pixel_mask": np.ones((1, height, width), np.int64),  # DETR
    }
    if any(entry.name not in known or entry.type not in _EXTRA_TYPES for entry in inputs):
        return None
    return {
        entry.name: np.repeat(known[entry.name].astype(_EXTRA_TYPES[entry.type]), batch, axis=0)
        for entry in inputs
    }


_EXTRA_TYPES = {"tensor(int64)": np.int64, "tensor(int32)": np.int32, "tensor(float)": np.float32}


def cells(size_px: tuple[int, int], strides: Sequence[int] = (8, 16, 32)) -> int:
    """A = Σ ceil(H/s) ceil(W/s): the number of grid cells of an input (height, width) px."""
    return sum(-(-size_px[0] // s) * -(-size_px[1] // s) for s in strides)
