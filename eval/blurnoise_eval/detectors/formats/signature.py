"""Signature of a graph, what it shows of itself, and what every output family answers about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import EXAMPLE, ModelError
from blurnoise_eval.detectors.formats.candidates import Candidates, FloatArray

Shape = tuple[int | str | None, ...]

DTYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
}
"""The types that a picture's input may have."""
SIZES = "orig_target_sizes"
"""The input by which RT-DETR, D-FINE and DEIM ask for the pictures' width and height."""


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


@dataclass(frozen=True)
class Signature:
    """A graph's inputs, outputs and metadata.

    inputs: the picture first, then those of :func:`extra_feeds`.
    ``size_px``: the input's (height, width) at which the outputs have the shapes in ``outputs``; None where
    the graph does not take one picture of three channels, or other inputs that are not known.
    ``answer``: the outputs for a picture's input, to probe a graph whose shapes leave its family open.
    """

    inputs: tuple[TensorInfo, ...]
    outputs: tuple[TensorInfo, ...]
    metadata: Mapping[str, str]
    size_px: tuple[int, int] | None
    answer: Callable[[FloatArray], list[FloatArray]] | None = None

    def named(self, names: Sequence[str]) -> list[TensorInfo] | None:
        """The outputs ``names``, in that order, among any others; None unless all of them are there.

        A name's end as TensorFlow writes it (":0") does not count.
        """
        found = {output.name.split(":")[0]: output for output in self.outputs}
        return [found[name] for name in names] if found.keys() >= set(names) else None

    @property
    def asks_for_size(self) -> bool:
        """Whether a second input asks for the pictures' sizes, as RT-DETR's deployment and its heirs do."""
        return any(entry.name == SIZES for entry in self.inputs[1:])

    def of_one_picture(self) -> list[TensorInfo] | None:
        """Boxes [N, 4], integer labels [N] and other scores [N], without a batch; None where these are not all."""
        boxes = [output for output in self.outputs if len(output.shape) == 2 and output.shape[1] == 4]
        flat = [output for output in self.outputs if len(output.shape) == 1]
        labels = [output for output in flat if output.type in ("tensor(int64)", "tensor(int32)")]
        scores = [output for output in flat if output not in labels]
        return [*boxes, *labels, *scores] if len(boxes) == len(labels) == len(scores) == 1 else None

    def describe(self) -> str:
        """Inputs, outputs, metadata keys and how to write a contract, over several lines."""
        lines = [f"  input {entry}" for entry in self.inputs] + [
            f"  output {entry}" for entry in self.outputs
        ]
        lines.append(f"  metadata keys: {', '.join(sorted(self.metadata)) or 'none'}")
        lines.append(f"  to state what it is, write <model>.contract.json beside it, for example {EXAMPLE}")
        return "\n".join(lines)


@dataclass(frozen=True)
class Layout:
    """How a family reads a graph.

    outputs: those to decode, by name, in decode's order. classes: how many the shapes show; 0 where they do
    not, because each answer carries the number of its class. why: what of the graph shows the family.
    """

    outputs: tuple[str, ...]
    classes: int
    why: str

    @classmethod
    def of(cls, output: TensorInfo, shows: str, classes: int = 0) -> Layout:
        """The layout of one output, which ``shows`` it by its shape."""
        return cls((output.name,), classes, f"output {output.name!r} {list(output.shape)}: {shows}")

    @classmethod
    def by_name(cls, outputs: Sequence[TensorInfo], classes: int = 0) -> Layout:
        """The layout of outputs that are known by their names."""
        names = tuple(output.name for output in outputs)
        shapes = ", ".join(f"{output.name!r} {list(output.shape)}" for output in outputs)
        return cls(names, classes, f"outputs {shapes}")


class Family(Protocol):
    """One output layout. Its module is the implementation."""

    NAME: str
    UNKNOWN: str  # what neither the graph nor a preset tells; empty if nothing
    SEVERAL_CLASSES: (
        bool  # whether the family's own evaluator counts a box with every class that reaches its threshold
    )

    def describe(self, signature: Signature) -> Layout | None:
        """Return how this family reads the graph's outputs; None if they do not have its layout."""

    def decode(
        self, outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float
    ) -> Candidates:
        """Return the candidates that reach ``min_score``, boxes in px of the network's input.

        outputs: those of the layout, in its order. ``size_px``: the input's (height, width).
        """


MOST_INPUT_PIXELS = 1 << 28
"""Of what a network takes at once, all pictures of its batch: 3 GiB of numbers."""


def check_input(name: str, batch: int, height: int, width: int) -> None:
    """Raise :class:`ModelError` for an input of more than ``MOST_INPUT_PIXELS``."""
    if batch * height * width > MOST_INPUT_PIXELS:
        raise ModelError(
            f"{name}: takes {batch} picture(s) of {height} x {width} px; must be at most {MOST_INPUT_PIXELS} px"
        )


def extra_feeds(
    inputs: Sequence[TensorInfo], size_px: tuple[int, int], batch: int
) -> dict[str, NDArray[np.generic]] | None:
    """What inputs beside the picture are fed, by their well-known names; None where one is not known.

    Each tells the graph that the picture has the input's own size, so that boxes come back in its px.
    """
    height, width = size_px
    known: dict[str, NDArray[np.generic]] = {
        SIZES: np.array([[width, height]], np.int64),  # RT-DETR
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

BAKED = "the score threshold and the overlap that are baked into the graph: weaker answers never leave it"
"""What families that suppress double answers themselves leave unsaid."""
BACKGROUND_FIRST = (
    f"{BAKED}; whether 'classes' begins with a name for 0, which its numbers keep for the background"
)
"""The same of those that count classes from 1."""
