"""Signature of a graph, what it shows of itself, and families, which read graphs by their signatures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import Contract, ModelError
from blurnoise_eval.detectors.formats.candidates import Candidates
from blurnoise_eval.detectors.formats.placement import blob_shape
from blurnoise_eval.detectors.model import OnnxModel, TensorInfo
from blurnoise_eval.detectors.records import FloatArray

SIZES = "orig_target_sizes"
"""The input by which RT-DETR, D-FINE and DEIM ask for the pictures' width and height."""


@dataclass(frozen=True)
class Signature:
    """A graph's inputs, outputs and metadata.

    inputs: the picture first, then those of :func:`extra_feeds`.
    ``size_px``: the input's (height, width) at which the outputs have the shapes in ``outputs``. ``answer``: the
    outputs for a picture's input, to probe a graph whose shapes leave its family open.
    """

    inputs: tuple[TensorInfo, ...]
    outputs: tuple[TensorInfo, ...]
    metadata: Mapping[str, str]
    size_px: tuple[int, int]
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
        lines = [f"  input {entry}" for entry in self.inputs]
        lines += [f"  output {entry}" for entry in self.outputs]
        lines.append(f"  metadata keys: {', '.join(sorted(self.metadata)) or 'none'}")
        stated = "to state what it is, write <model>.contract.json beside it, for example"
        return "\n".join([*lines, f"  {stated} {Contract.EXAMPLE}"])


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
    def of_form(
        cls, outputs: Sequence[TensorInfo] | None, ranks: Sequence[int], widths: str, classes: int = 0
    ) -> Layout | None:
        """The layout of outputs of these ranks and last axes, a digit each, 0 for any; else None."""
        if outputs is None or [len(output.shape) for output in outputs] != [*ranks]:
            return None
        pairs = zip(outputs, map(int, widths), strict=True)
        fits = all(width in (0, output.shape[-1]) for output, width in pairs)
        return cls.by_name(outputs, classes) if fits else None

    @classmethod
    def by_name(cls, outputs: Sequence[TensorInfo], classes: int = 0) -> Layout:
        """The layout of outputs that are known by their names."""
        names = tuple(output.name for output in outputs)
        shapes = ", ".join(f"{output.name!r} {list(output.shape)}" for output in outputs)
        return cls(names, classes, f"outputs {shapes}")


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


def read_signature(model: OnnxModel, size_px: tuple[int, int]) -> Signature:
    """Return the graph's signature.

    ``size_px``: the picture's (height, width) where the graph leaves it open. Raises :class:`ModelError` for
    a graph that leaves it open and fails at that size.
    """
    inputs, outputs = model.inputs, model.outputs
    unread = Signature(inputs, outputs, model.metadata, size_px)
    known = inputs[0].size_px if model.axes else ()
    height, width = (
        side if isinstance(side, int) else usual
        for side, usual in zip(known or size_px, size_px, strict=True)
    )
    extras = extra_feeds(inputs[1:], (height, width), model.batch)
    if not model.axes or not outputs or extras is None:
        must = "must take one RGB picture, beside it inputs of known names alone, and give an answer"
        raise ModelError(f"the graph fits no output family known here: {must}\n{unread.describe()}")
    grey = np.full(blob_shape(model.axes, (height, width)), 0.5, np.float32)
    answer = partial(model.infer, extras=extras)
    stated = [o.shape for o in outputs]
    if known != (height, width) or not all(s and all(isinstance(n, int) for n in s[1:]) for s in stated):
        try:
            stated = [value.shape for value in answer(grey)]
        except ModelError as error:
            raise ModelError(
                f"{error}; state the size that it takes, input_size_px, in its contract"
            ) from None
        outputs = tuple(TensorInfo(o.name, s, o.type) for o, s in zip(outputs, stated, strict=True))
    return Signature(inputs, outputs, model.metadata, (height, width), answer)


@dataclass(frozen=True)
class Family:
    """One output layout.

    preset: pre-processing and non-maximum suppression as in the family's own repository, with COCO's classes; its
    input size is for graphs of dynamic size. describe: how the family reads a graph's outputs, None if they do not
    have its layout. decode: from the layout's outputs, in its order, the input's (height, width) and the least
    score, the candidates that reach it, boxes in px of the input. unknown: what neither the graph nor a preset
    tells. several_classes: whether the family's own evaluator counts a box with every class that reaches its
    threshold. takes_head: whether the contract states anchors. fixed_resize: how pictures enter a graph of one size
    where the preset lets them enter at their own.
    """

    preset: Contract
    describe: Callable[[Signature], Layout | None]
    decode: Callable[[Sequence[FloatArray], tuple[int, int], float], Candidates]
    unknown: str = ""
    several_classes: bool = False
    takes_head: bool = False
    fixed_resize: Literal["stretch", "letterbox-top-left"] = "letterbox-top-left"

    @property
    def name(self) -> str:
        """Of the family and its preset."""
        return self.preset.family
