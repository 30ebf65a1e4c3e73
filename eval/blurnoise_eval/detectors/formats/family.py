"""Signatures of graphs, and families of detectors: what the outputs of one look like, and how they are decoded.

A layout is a text, with an entry for each output in the order in which they are decoded: "dets: b n 5, labels: b n".
A name, in which * stands for anything, comes before the axes, without one any output fits. Axes: a number; b and n,
of any size; C, 4+C or C+1: classes; A: the cells of all strides, 3A: three of each, A8: those of stride 8; H16, W16:
rows and columns of its grid. A type may follow: int, or float, which is any other. "with NAME" or "without NAME": an
input beside the picture, or the picture's axes (nchw). "ordered": the graph's outputs are in this order. "..."
allows further outputs, which names do, too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import Contract, ModelError
from blurnoise_eval.detectors.formats import columns
from blurnoise_eval.detectors.formats.boxes import Candidates, blob_shape
from blurnoise_eval.detectors.model import OnnxModel, Shape, TensorInfo
from blurnoise_eval.detectors.outputs import parsed
from blurnoise_eval.detectors.records import FloatArray

STRIDES = (8, 16, 32)
STRIDES_64 = (8, 16, 32, 64)
Decode = Callable[[Sequence[FloatArray], tuple[int, int], float], Candidates]
_INTEGERS = {"tensor(int64)": np.int64, "tensor(int32)": np.int32}


@dataclass(frozen=True)
class Signature:
    """What a graph shows of itself.

    inputs: the picture first, then those of :func:`extra_feeds`.
    ``size_px``: the input's (height, width) at which the outputs have the shapes in ``outputs``. ``answer``: the
    outputs for a picture's input, to probe a graph whose shapes leave its family open. ``answers``: those for a grey
    picture, by name. ``notes``: what is false in the graph, in a sentence each.
    """

    inputs: tuple[TensorInfo, ...]
    outputs: tuple[TensorInfo, ...]
    metadata: Mapping[str, str]
    size_px: tuple[int, int]
    answer: Callable[[FloatArray], list[FloatArray]] | None = None
    answers: Mapping[str, FloatArray] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def describe(self) -> str:
        """Inputs, outputs, metadata keys and how to write a contract, over several lines."""
        lines = [f"  input {entry}" for entry in self.inputs]
        lines += [f"  output {entry}" for entry in self.outputs]
        lines += [f"  {note}" for note in self.notes]
        lines.append(f"  metadata keys: {', '.join(sorted(self.metadata)) or 'none'}")
        hint = "to set the contract, write <model>.contract.json beside the model, for example"
        return "\n".join([*lines, f"  {hint} {Contract.EXAMPLE}"])


def extra_feeds(
    inputs: Sequence[TensorInfo], size_px: tuple[int, int], batch: int
) -> dict[str, NDArray[np.generic]] | None:
    """What inputs beside the picture are fed, by their well-known names; None where one is not known.

    Each tells the graph that the picture has the input's own size, so that boxes come back in its px.
    """
    height, width = size_px
    known: dict[str, NDArray[np.generic]] = {
        "orig_target_sizes": np.array([[width, height]]),  # RT-DETR, D-FINE, DEIM
        "im_shape": np.array([[height, width]]),  # PaddleDetection
        "scale_factor": np.ones((1, 2)),  # (y, x)
        "pixel_mask": np.ones((1, height, width)),  # DETR
    }
    types = _INTEGERS | {"tensor(float)": np.float32}
    if any(entry.name not in known or entry.type not in types for entry in inputs):
        return None
    return {
        extra.name: np.repeat(known[extra.name].astype(types[extra.type]), batch, axis=0) for extra in inputs
    }


def read_signature(model: OnnxModel, size_px: tuple[int, int]) -> Signature:
    """Return the graph's signature.

    ``size_px``: the picture's (height, width) where the graph leaves it open. Raises :class:`ModelError` for
    a graph that leaves it open and fails at that size.
    """
    inputs, outputs = model.inputs, model.outputs
    known = inputs[0].size_px if model.axes else size_px
    height, width = (a if isinstance(a, int) else usual for a, usual in zip(known, size_px, strict=True))
    extras = extra_feeds(inputs[1:], (height, width), model.batch)
    if not model.axes or not outputs or extras is None:
        must = "must have one RGB picture as input, no other inputs but those with known names, and an output"
        unread = Signature(inputs, outputs, model.metadata, size_px)
        raise ModelError(f"the graph matches none of the known families: {must}\n{unread.describe()}")
    answer = partial(model.infer, extras=extras)
    blob = np.full(blob_shape(model.axes, (height, width), model.inputs[0].channels), 0.5, np.float32)
    try:
        answers = answer(blob)
    except ModelError as error:
        if known == (height, width):
            raise
        must = "set the size of the input, input_size_px, in the contract"
        raise ModelError(f"{error}; {must}") from None
    actual = tuple(TensorInfo(o.name, a.shape, o.type) for o, a in zip(outputs, answers, strict=True))
    notes = tuple(
        f"output {declared.name!r} gives {list(given.shape)} where the graph declares {list(declared.shape)}; the "
        "former is used"
        for declared, given in zip(outputs, actual, strict=True)
        if not _declared(declared.shape, given.shape)
    )
    by_name = {o.name: np.asarray(a, np.float32) for o, a in zip(outputs, answers, strict=True)}
    return Signature(inputs, actual, model.metadata, (height, width), answer, by_name, notes)


def _declared(declared: Shape, given: Shape) -> bool:
    """Whether an output has the shape that its graph declares."""
    open_axes = (None if isinstance(n, str) else n for n in declared)
    return not declared or (
        len(declared) == len(given) and all(n in (None, m) for n, m in zip(open_axes, given, strict=True))
    )


def cells(size_px: tuple[int, int], strides: Sequence[int] = STRIDES) -> int:
    """A = Σ ceil(H/s) ceil(W/s): the number of grid cells of an input (height, width) px."""
    return sum(-(-size_px[0] // s) * -(-size_px[1] // s) for s in strides)


@dataclass(frozen=True)
class OutputLayout:
    """How a family reads a graph.

    outputs: those to decode, by name, in decode's order. classes: how many the shapes show; 0 where they do
    not, because each answer carries the number of its class. why: what of the graph shows the family.
    """

    family: Family
    outputs: tuple[str, ...]
    classes: int
    why: str

    def bound(self, contract: Contract) -> OutputLayout:
        """With the columns that a contract states as its family's decoder."""
        if contract.outputs is None:
            return self
        outputs = parsed(contract.outputs)
        decoder = partial(columns.decode, outputs=outputs, classes=len(contract.classes))
        return replace(self, family=replace(self.family, decode=decoder))


def _undecided(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    raise ModelError(f"{len(outputs)} outputs: their columns must be stated by the contract")


@dataclass(frozen=True)
class Family:
    """One way in which detectors answer.

    preset: pre-processing and non-maximum suppression as in the family's own repository, with COCO's classes; its
    input size is for graphs of dynamic size. layouts: texts, see above, the first that fits counts. decode: from a
    layout's outputs, in its order, the input's (height, width) and the least score, the candidates that reach it,
    boxes in px of the input. strides: of the grids that A counts, the first that fit. unknown: what neither the graph
    nor a preset tells. several_classes: whether the family's own evaluator counts a box with every class that reaches
    its threshold. takes_head: whether the contract states anchors. fixed_resize: how pictures enter a graph of one
    size where the preset lets them enter at their own. by_shape: whether nothing but shapes shows the family, so that
    other readings of its columns are tried. background_last: whether own classes are followed by one for none.
    """

    preset: Contract
    layouts: tuple[str, ...]
    decode: Decode = _undecided
    strides: tuple[tuple[int, ...], ...] = (STRIDES,)
    unknown: str = ""
    several_classes: bool = False
    takes_head: bool = False
    fixed_resize: Literal["stretch", "letterbox-top-left"] = "letterbox-top-left"
    by_shape: bool = False
    background_last: bool = False

    @property
    def name(self) -> str:
        """Of the family and its preset."""
        return self.preset.family

    def describe(self, signature: Signature) -> OutputLayout | None:
        """How the family reads a graph's outputs; None if they have none of its layouts."""
        layouts = (_read(self, signature, text, strides) for text in self.layouts for strides in self.strides)
        return next(filter(None, layouts), None)


def _read(family: Family, signature: Signature, text: str, strides: tuple[int, ...]) -> OutputLayout | None:
    """How the layout ``text`` reads a graph; None where it does not fit, or one entry fits several outputs."""
    entries = text.split(", ")
    inputs = {signature.inputs[0].axes, *(entry.name for entry in signature.inputs[1:])}
    if any(e.startswith("with") and e.startswith("with ") != (e.split()[1] in inputs) for e in entries):
        return None
    wanted = [entry for entry in entries if not entry.startswith(("with", "...", "ordered"))]
    named = all(":" in entry and "*" not in entry for entry in wanted)
    if not (named or "..." in entries or len(signature.outputs) == len(wanted)):
        return None
    by_name: dict[str, TensorInfo] = {}
    classes = {0}
    for entry in sorted(
        wanted, key=lambda entry: "C" in entry
    ):  # what a number of classes cannot blur comes first
        name, _, axes = entry.rpartition(": ")
        left = [o for o in signature.outputs if o not in by_name.values()]
        left = [
            o for o in left if fnmatch(o.name.split(":")[0].lower(), name or "*")
        ]  # TensorFlow's end in ":0"
        counts = [_classes(output, axes.split(), signature.size_px, strides) for output in left]
        if len(counts) - counts.count(None) != 1:
            return None
        by_name[entry], count = next(pair for pair in zip(left, counts, strict=True) if pair[1] is not None)
        classes.add(count or 0)
    if len(classes) > 2:
        return None
    outputs = [by_name[entry] for entry in wanted]
    if "ordered" in entries and outputs != [one for one in signature.outputs if one in outputs]:
        return None
    shapes = ", ".join(f"{output.name!r} {list(output.shape)}" for output in outputs)
    why = f"output{'s' * (len(outputs) > 1)} {shapes}" + (f" as {text}" if not named else "")
    why += f": A, the cells of strides {', '.join(map(str, strides))}" if "A" in text else ""
    return OutputLayout(family, tuple(output.name for output in outputs), max(classes), why)


def _classes(
    output: TensorInfo, axes: list[str], size_px: tuple[int, int], strides: tuple[int, ...]
) -> int | None:
    """How many classes an output of these axes shows, 0 where none; None where it has other axes."""
    integers = output.type in _INTEGERS
    if axes[-1] in ("int", "float") and (axes.pop() == "int") != integers:
        return None
    if len(output.shape) != len(axes):
        return None
    classes = 0
    for size, axis in zip(output.shape, axes, strict=True):
        if "C" in axis:
            classes = size - int(axis.replace("C", "").strip("+") or 0) if isinstance(size, int) else 0
            if classes < 1:
                return None
        elif axis not in ("b", "n") and size != _size(axis, size_px, strides):
            return None
    return classes


def _size(axis: str, size_px: tuple[int, int], strides: tuple[int, ...]) -> int:
    """Of an axis that is a number, 3A, A8, H16 or W16."""
    times, letter, stride = re.findall(r"(\d*)([AHW]?)(\d*)", axis)[0]
    if letter == "A":
        return int(times or 1) * cells(size_px, (int(stride),) if stride else strides)
    return -(-size_px["HW".index(letter)] // int(stride)) if letter else int(axis)
