"""Text networks, of one picture in and one tensor out, and the recogniser of the text in known boxes."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import softmax

from blurnoise._core.files import read_text
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.contract_files import Given, beside, settled, stated_contract
from blurnoise_eval.detectors.formats.placement import lay_in, picture_size
from blurnoise_eval.detectors.model import TIMEOUT_S, OnnxModel, fetched_file
from blurnoise_eval.detectors.ocr.contract import TEXT_PRESETS, TextContract
from blurnoise_eval.detectors.ocr.ctc import NOTHING, Reading, are_probabilities, characters, decode
from blurnoise_eval.detectors.records import FloatArray
from blurnoise_eval.system.urls import Location

DICTIONARY_KEY = "character"  # metadata of PP-OCR exports: a character a line


class TextNetwork(OnnxModel):
    """A graph that takes floats [N, 3, height, width] and gives one answer.

    Raises :class:`ModelError` for another. ``fixed_size_px``: height and width of the input, None where dynamic.
    """

    def __init__(self, source: str | Location | OnnxModel, timeout_s: float) -> None:
        super().__init__(source, timeout_s)
        inputs, outputs = self.inputs, self.outputs
        shape = inputs[0].shape if inputs else ()
        floats = [entry.type in ("tensor(float)", "tensor(float16)") for entry in inputs]
        if floats != [True] or len(outputs) != 1 or len(shape) != 4 or shape[1] != 3:
            raise ModelError(
                f"{self.path.name}: must take one picture [N, 3, height, width] of floats and give one answer; "
                f"has {len(inputs)} inputs and {len(outputs)} outputs: {', '.join(map(str, [*inputs, *outputs]))}"
            )
        height, width = (side if isinstance(side, int) else None for side in shape[2:])
        self.fixed_size_px = height, width

    def _answer(self, blob: FloatArray) -> FloatArray:
        """The answer to one input (1, 3, H, W) as float32, without the batch axis; what is not finite is counted.

        Raises :class:`ModelError` where the graph fails.
        """
        (output,) = self.infer(blob)
        if output.ndim < 1 or len(output) != self.batch:
            answers = f"answers {list(output.shape)} to {self.batch} picture(s)"
            raise ModelError(f"{self.path.name}: {answers}: the first axis must be the batch")
        found = np.asarray(output[0], np.float32)
        self._count_non_finite([found])
        return found


class Recogniser(TextNetwork):
    """An ONNX text recogniser with its contract; what holds of every :class:`OnnxModel` holds of it.

    ``contract``: a :class:`TextContract`, a mapping, a contract file or "ppocr"; None looks beside the model and into
    its metadata, then assumes PP-OCR's. ``dictionary``: a file with a character a line; None takes the contract's,
    else the metadata's; a file becomes part of ``sha256``. Raises :class:`ModelError` for a contract that does not
    fit the graph, or a dictionary of another length than its classes.
    """

    contract: TextContract

    def __init__(
        self,
        path: str | Location | OnnxModel,
        *,
        contract: TextContract | Given | None = None,
        dictionary: Location | None = None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        super().__init__(path, timeout_s)
        stated: Any = {"contract": contract, "dictionary": dictionary, "timeout_s": self.timeout_s}
        self._opened_again = partial(Recogniser, self.source, **stated)
        suggests = f", which metadata {DICTIONARY_KEY} suggests" * (DICTIONARY_KEY in self.metadata)
        sources = dict.fromkeys(TextContract.names(), f"assumed: preset ppocr{suggests}")
        found = stated_contract(TEXT_PRESETS, self.path, self.metadata, contract)
        self.contract = found or TextContract(sources=sources)
        if (height := self.fixed_size_px[0]) is not None:
            self.contract = settled(
                self.contract, {"height_px": height}, "graph", "the graph takes this height"
            )
        self._characters = characters(self._dictionary(contract, dictionary))
        self._check_answer()

    def _dictionary(self, contract: object, given: Location | None) -> str:
        """The characters, a line each; those of a file become part of the model's identity."""
        stated, whence, file = self.contract.dictionary, self.contract.sources["dictionary"], None
        if given is not None:
            file, whence = fetched_file(given), "given"
            stated = file.name
        elif stated is not None:
            own = Path(contract) if isinstance(contract, (str, Path)) else self.path
            file = (own if own.is_file() else self.path).parent / stated
        elif DICTIONARY_KEY in self.metadata:
            whence = f"metadata {DICTIONARY_KEY}"
        else:
            raise ModelError(
                f"{self.path.name}: nothing says which characters its classes are: "
                f"give a dictionary file, or state 'dictionary' in {self.path.stem}.contract.json beside it"
            )
        sources = {**self.contract.sources, "dictionary": whence}
        self.contract = replace(self.contract, dictionary=stated, sources=sources)
        if file is None:
            return self.metadata[DICTIONARY_KEY]
        try:
            lines = read_text(file)
        except (OSError, ValueError) as error:
            raise ModelError(f"dictionary {file.name}: cannot be read: {error}") from None
        both = self.sha256 + hashlib.sha256(lines.encode()).hexdigest()
        self.sha256 = hashlib.sha256(both.encode()).hexdigest()
        return lines

    def prepare(self, crop: NDArray[np.uint8]) -> FloatArray:
        """Return the network's input (1, 3, H, W), float32, for an RGB crop (h, w, 3).

        The crop keeps its aspect unless it is too wide for the input; what it does not fill is 0.
        """
        contract = self.contract
        height, natural = contract.height_px, math.ceil(contract.height_px * crop.shape[1] / crop.shape[0])
        width = self.fixed_size_px[1] or min(max(contract.min_width_px, natural), contract.max_width_px)
        filled = min(natural, width)
        blob = np.zeros((1, 3, height, width), np.float32)
        lay_in(crop, contract.stretched(), (height, filled), blob[..., :filled])
        return blob

    def read_crop(self, crop: NDArray[np.uint8]) -> Reading:
        """Return the text of an RGB crop (h, w, 3), uint8, that holds one line.

        An answer with NaN or infinite values is no text; they are counted in ``non_finite_values_here``.
        """
        rows = self._answer(self.prepare(crop))
        if not np.isfinite(rows).all():
            return NOTHING
        return decode(softmax(rows, axis=1) if self.contract.output == "logits" else rows, self._characters)

    def read(
        self, image: NDArray[np.uint8], boxes_xyxy: ArrayLike | Sequence[Sequence[float]]
    ) -> list[Reading]:
        """Return the text in each box (left, top, right, bottom), px, of an RGB picture (h, w, 3), uint8.

        A box is read with the contract's margin around it, to whole pixels, inside the picture, on its own: its
        reading depends on no other box. A box that is empty, or lies outside, reads as no text.
        Raises ``TypeError`` or ``ValueError`` for a picture of another type or shape.
        """
        height, width = picture_size(image)
        limit = np.array([width, height], np.float64)
        readings = []
        for box in np.asarray(boxes_xyxy, np.float64).reshape(-1, 4):
            x0, y0, x1, y1 = np.clip(box, 0, np.tile(limit, 2))
            if x1 <= x0 or y1 <= y0:
                readings.append(NOTHING)
                continue
            margin = self.contract.margin * (box[3] - box[1])
            left, top = np.floor(np.clip(box[:2] - margin, 0, limit)).astype(int)
            right, bottom = np.ceil(np.clip(box[2:] + margin, 0, limit)).astype(int)
            readings.append(self.read_crop(image[top:bottom, left:right]))
        return readings

    def _check_answer(self) -> None:
        """Check classes against dictionary, and see what the values are, on a grey crop."""
        rows = self._answer(self.prepare(np.full((48, 48, 3), 128, np.uint8)))
        if rows.ndim != 2 or rows.shape[1] != len(self._characters):
            raise ModelError(
                f"{self.path.name}: answers {list(rows.shape)}, steps and classes, to a picture, but the "
                f"dictionary ({self.contract.dictionary or f'metadata {DICTIONARY_KEY}'}) makes "
                f"{len(self._characters)} classes: the blank, {len(self._characters) - 2} lines and the space"
            )
        if np.isfinite(rows).all():
            seen, how = "logits", "do not sum to 1, so softmax is applied"
            if are_probabilities(rows):
                seen, how = "probabilities", "sum to 1"
            why = f"the rows of its answer to a grey picture {how}"
            self.contract = settled(self.contract, {"output": seen}, f"graph: {why}", why)


def is_recogniser(model: OnnxModel) -> bool:
    """Whether the model is a recogniser by its graph and what lies beside it, without running it.

    It takes one picture [N, 3, height, width], gives one answer [N, T, C], and either its metadata holds a
    dictionary under ``character`` or a contract, in a file beside it or its metadata, is of family "ppocr".
    """
    ranks = [[len(entry.shape) for entry in entries] for entries in (model.inputs, model.outputs)]
    if ranks != [[4], [3]] or model.inputs[0].shape[1] != 3:
        return False
    family = "ppocr" if DICTIONARY_KEY in model.metadata else None
    with suppress(ModelError):
        if (found := beside(model.path, model.metadata)) and isinstance(found[0], dict):
            family = found[0].get("family", family)
    return family in TEXT_PRESETS
