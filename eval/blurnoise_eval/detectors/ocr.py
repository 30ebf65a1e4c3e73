"""Text recognisers and their contracts: the text in known boxes, and its error rate.

A network takes one picture and gives class probabilities (T, C) float32, a row per step along the text; class 0 is
the blank of connectionist temporal classification (CTC), decoded greedily. Source: Graves et al. (2006); dictionary
and confidence as in PP-OCR.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import ArrayLike, NDArray
from rapidfuzz.distance import Levenshtein
from scipy.special import softmax

from blurnoise._core.fields import Characters
from blurnoise._core.files import read_text
from blurnoise_eval.detectors.contract import Colour, Contract, ModelError, PerChannel, Sourced, Spread
from blurnoise_eval.detectors.contract_files import Given, beside, settled, stated_contract
from blurnoise_eval.detectors.formats.boxes import lay_in, picture_size
from blurnoise_eval.detectors.model import TIMEOUT_S, OnnxModel, fetched_file
from blurnoise_eval.detectors.records import FloatArray
from blurnoise_eval.system.urls import Location

_Count = Annotated[int, Ge(1), Le(1 << 16), "must be an integer >= 1 and <= 65536"]
_NonNegative = Annotated[float, Ge(0)]


@dataclass(frozen=True)
class TextContract(Sourced):
    """How a crop becomes a recogniser's input, and what its classes are. Defaults are those of PP-OCR.

    family: "ppocr". colour: "rgb" or "bgr". mean, std: per channel in the network's order, of values 0-1.
    height_px: the input's; the crop keeps its aspect, and is padded with zeros on the right to min_width_px, but
    never wider than max_width_px. margin: what is read around a known box, in heights of that box. dictionary: a file
    with a character a line, relative to the contract's folder; None for the graph's metadata ``character``.
    output: "probabilities", or "logits", to which softmax is applied. Raises ``ValueError`` or ``TypeError``
    naming field, value and what is allowed.
    """

    EXAMPLE = "{'height_px': 32}"

    family: Literal["ppocr"] = "ppocr"
    colour: Colour = "bgr"
    mean: PerChannel = (0.5, 0.5, 0.5)
    std: Spread = (0.5, 0.5, 0.5)
    height_px: _Count = 48
    min_width_px: _Count = 320
    max_width_px: _Count = 3200
    margin: _NonNegative = 0.1
    dictionary: Annotated[Characters | None, "must be the name of a file, or nothing"] = None
    output: Literal["probabilities", "logits"] = "probabilities"

    def stretched(self) -> Contract:
        """The colours as a contract for laying a picture in, stretched to the input's size."""
        return Contract(self.family, ("text",), self.colour, mean=self.mean, std=self.std, resize="stretch")


TEXT_PRESETS = {"ppocr": TextContract()}


@dataclass(frozen=True)
class Reading:
    """A text, and how sure its reader is: 0 to 1, the mean of its characters' probabilities; 0 for no text.

    Confidence stays high on wrong text: judge the text beside it.
    """

    text: str
    confidence: float


NOTHING = Reading("", 0.0)


def characters(lines: str) -> list[str]:
    """Return the characters by class: the blank (""), one for each line, and the space.

    Only a line feed ends a line: dictionaries hold characters that Unicode counts among the line ends.
    """
    return ["", *lines.removesuffix("\n").split("\n"), " "]


def decode(probabilities: FloatArray, classes: Sequence[str]) -> Reading:
    """Return the likeliest class of each step, repeats and then blanks left out.

    Convention: a class that comes again after a blank is a second character. The confidence is the mean of
    the probabilities at the first step of each character.

    >>> steps = np.eye(4, dtype=np.float32)[[1, 1, 0, 1, 2]]  # S, S, blank, S, T
    >>> decode(steps, characters("S\\nT"))
    Reading(text='SST', confidence=1.0)
    """
    best = probabilities.argmax(axis=1)
    kept = best != 0
    # A class that goes on is the same character; CTC puts a blank between two equal ones.
    kept[1:] &= best[1:] != best[:-1]
    if not kept.any():
        return NOTHING
    confidence = float(probabilities[kept, best[kept]].mean())
    return Reading("".join(classes[index] for index in best[kept]), min(confidence, 1.0))


def are_probabilities(rows: FloatArray) -> bool:
    """Whether no value is negative and each row sums to 1, within the rounding of half precision."""
    return bool(rows.min(initial=0.0) >= 0 and (abs(rows.sum(axis=-1) - 1) < 0.01).all())


def character_error_rate(read: str, truth: str) -> float:
    """Return the insertions, deletions and substitutions that turn ``read`` into ``truth``, per character of it.

    Upper and lower case differ. Convention: where there is no text, reading none is 0, and reading any is 1.

    >>> character_error_rate("ST0P", "STOP")
    0.25
    """
    return Levenshtein.distance(read, truth) / len(truth) if truth else float(bool(read))


DICTIONARY_KEY = "character"  # metadata of PP-OCR exports: a character a line


class Recogniser(OnnxModel):
    """An ONNX text recogniser with its contract. Threads and errors: see :class:`OnnxModel`.

    ``contract``: a :class:`TextContract`, a mapping, a contract file or "ppocr"; None looks beside the model and into
    its metadata, then assumes PP-OCR's. ``dictionary``: a file with a character a line; None takes the contract's,
    else the metadata's; a file becomes part of ``sha256``. Raises :class:`ModelError` for a contract that does not
    fit the graph, a graph that is no recogniser, or a dictionary of another length than its classes.
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
        self._fixed_size_px = self._input_size_px()
        stated: Any = {"contract": contract, "dictionary": dictionary, "timeout_s": self.timeout_s}
        self._opened_again = partial(Recogniser, self.source, **stated)
        suggests = f", which metadata {DICTIONARY_KEY} suggests" * (DICTIONARY_KEY in self.metadata)
        found = stated_contract(TEXT_PRESETS, self.path, self.metadata, contract)
        self.contract = found or TextContract.assumed(f"preset ppocr{suggests}")
        if (height := self._fixed_size_px[0]) is not None:
            self.contract = settled(
                self.contract, {"height_px": height}, "graph", "the graph takes this height"
            )
        self._characters = characters(self._dictionary(contract, dictionary))
        # Its answer to any picture says how many classes it has, and whether they are probabilities.
        rows = self._answer(self.prepare(np.full((48, 48, 3), 128, np.uint8)))
        if rows.ndim != 2 or rows.shape[1] != len(self._characters):
            raise ModelError(
                f"{self.path.name}: the output has {list(rows.shape)} steps and classes, but the "
                f"dictionary ({self.contract.dictionary or f'metadata {DICTIONARY_KEY}'}) makes "
                f"{len(self._characters)} classes: the blank, {len(self._characters) - 2} lines and the space"
            )
        if np.isfinite(rows).all():
            sure = are_probabilities(rows)
            why = "sum to 1" if sure else "do not sum to 1, so softmax is applied"
            why = f"the rows of the output for a grey picture {why}"
            output = "probabilities" if sure else "logits"
            self.contract = settled(self.contract, {"output": output}, f"graph: {why}", why)

    def _input_size_px(self) -> tuple[int | None, int | None]:
        """Height and width, None where dynamic. Raises :class:`ModelError` for other inputs or outputs."""
        inputs, outputs = self.inputs, self.outputs
        shape = inputs[0].shape if inputs else ()
        floats = [entry.type in ("tensor(float)", "tensor(float16)") for entry in inputs]
        if floats != [True] or len(outputs) != 1 or len(shape) != 4 or shape[1] != 3:
            raise ModelError(
                f"{self.path.name}: must have one input [N, 3, height, width] of floats and one output; "
                f"has {len(inputs)} inputs and {len(outputs)} outputs: {', '.join(map(str, [*inputs, *outputs]))}"
            )
        height, width = (side if isinstance(side, int) else None for side in shape[2:])
        return height, width

    def _dictionary(self, contract: object, given: Location | None) -> str:
        """The characters, a line each; those of a file become part of the model's identity."""
        name, source = self.contract.dictionary, self.contract.sources["dictionary"]
        if given is None and name is None:
            if DICTIONARY_KEY not in self.metadata:
                raise ModelError(
                    f"{self.path.name}: the characters of its classes are unknown; "
                    f"name a dictionary file, or set 'dictionary' in {self.path.stem}.contract.json beside it"
                )
            file, source = None, f"metadata {DICTIONARY_KEY}"
        elif given is not None:
            file, source = fetched_file(given), "given"
            name = file.name
        else:
            contract_path = Path(contract) if isinstance(contract, (str, Path)) else self.path
            file = (contract_path if contract_path.is_file() else self.path).parent / str(name)
        sources = {**self.contract.sources, "dictionary": source}
        self.contract = replace(self.contract, dictionary=name, sources=sources)
        if file is None:
            return self.metadata[DICTIONARY_KEY]
        try:
            lines = read_text(file)
        except (OSError, ValueError) as error:
            raise ModelError(f"dictionary = {file.name!r}: cannot be read: {error}") from None
        # With another dictionary the same network is another model: stored answers are found by this number.
        both = self.sha256 + hashlib.sha256(lines.encode()).hexdigest()
        self.sha256 = hashlib.sha256(both.encode()).hexdigest()
        return lines

    def prepare(self, crop: NDArray[np.uint8]) -> FloatArray:
        """Return the network's input (1, 3, H, W), float32, for an RGB crop (h, w, 3).

        The crop keeps its aspect unless it is too wide for the input; what it does not fill is 0.
        """
        contract = self.contract
        height, natural = contract.height_px, math.ceil(contract.height_px * crop.shape[1] / crop.shape[0])
        width = self._fixed_size_px[1] or min(max(contract.min_width_px, natural), contract.max_width_px)
        filled = min(natural, width)
        blob = np.zeros((1, 3, height, width), np.float32)
        lay_in(crop, contract.stretched(), (height, filled), blob[..., :filled])
        return blob

    def _answer(self, blob: FloatArray) -> FloatArray:
        """The answer to one input (1, 3, H, W) as float32, without the batch axis; what is not finite is counted."""
        (output,) = self.infer(blob)
        if output.ndim < 1 or len(output) != self.batch:
            answers = f"the output for {self.batch} picture(s) is {list(output.shape)}"
            raise ModelError(f"{self.path.name}: {answers}; its first axis must be the batch")
        answer = np.asarray(output[0], np.float32)
        self._count_non_finite([answer])
        return answer

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

        A box is read with the contract's margin around it, to whole pixels, inside the picture, on its own. One that
        is empty, or lies outside, reads as no text. Raises ``TypeError`` or ``ValueError`` for another picture.
        """
        height, width = picture_size(image)
        limit = np.array([width, height] * 2, np.float64)
        readings = []
        for box in np.asarray(boxes_xyxy, np.float64).reshape(-1, 4):
            x0, y0, x1, y1 = np.clip(box, 0, limit)
            if x1 <= x0 or y1 <= y0:
                readings.append(NOTHING)
                continue
            margin = self.contract.margin * (box[3] - box[1]) * np.array([-1, -1, 1, 1])
            left, top, right, bottom = np.clip(box + margin, 0, limit).tolist()
            crop = image[math.floor(top) : math.ceil(bottom), math.floor(left) : math.ceil(right)]
            readings.append(self.read_crop(crop))
        return readings


def is_recogniser(model: OnnxModel) -> bool:
    """Whether the model is a recogniser by its graph and what lies beside it, without running it.

    It takes one picture [N, 3, height, width], gives one answer [N, T, C], and a contract, in a file beside it or its
    metadata, is of family "ppocr", or no family is stated and its metadata holds a dictionary under ``character``.
    """
    ranks = [[len(entry.shape) for entry in entries] for entries in (model.inputs, model.outputs)]
    if ranks != [[4], [3]] or model.inputs[0].shape[1] != 3:
        return False
    family = "ppocr" if DICTIONARY_KEY in model.metadata else None
    with suppress(ModelError):
        fields, _ = beside(model.path, model.metadata) or ({}, "")
        family = fields.get("family", family) if isinstance(fields, dict) else family
    return family in TEXT_PRESETS


def rapidocr_recogniser() -> Path | None:
    """Return the text recogniser in the package ``rapidocr`` or, before it, ``rapidocr-onnxruntime``, of which
    nothing else is used; None where neither holds one.
    """
    for package in ("rapidocr", "rapidocr_onnxruntime"):
        spec = find_spec(package)
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            # The last by name is the newest: names begin with the version, such as ch_PP-OCRv4.
            if networks := sorted(Path(folder, "models").glob("*_rec_*.onnx")):
                return networks[-1]
    return None
