"""Recogniser of the text in known boxes: crop, normalise, network, CTC."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.contract_files import Given, metadata_mapping, stated_contract
from blurnoise_eval.detectors.formats.placement import lay_in, picture_size
from blurnoise_eval.detectors.model import TIMEOUT_S, OnnxModel, PictureModel
from blurnoise_eval.detectors.model_files import contract_file, fetched_file, read_mapping
from blurnoise_eval.detectors.ocr.contract import TEXT_PRESETS, TextContract
from blurnoise_eval.detectors.ocr.ctc import NOTHING, Reading, are_probabilities, characters, decode, softmax
from blurnoise_eval.detectors.ocr.network import answer, boxes_array, check_form, fixed_size_px
from blurnoise_eval.detectors.records import FloatArray
from blurnoise_eval.system.files import check_regular
from blurnoise_eval.system.urls import Location

DICTIONARY_KEY = "character"  # metadata of PP-OCR exports: a character a line


class Recogniser(PictureModel):
    """An ONNX text recogniser with its contract. One instance serves any number of threads.

    It pickles as what opened it: in another process the file is opened again.

    ``path``: a file, here or at a URL, or a model that is open. ``contract``: a :class:`TextContract`, a mapping, a
    contract file or "ppocr"; None looks beside the model and into its metadata, then assumes PP-OCR's (see
    ``assumptions``). ``dictionary``: a file with a character a line; None takes the contract's, else the metadata's.
    ``threads``: cores that one inference may use. ``timeout_s``: how long loading and the first answer may take.
    Raises :class:`ModelError` for a file that is no recogniser, a contract that does not fit it, or a dictionary of
    another length than its classes, ``TimeoutError``.

    Attributes: ``name`` (file name without suffix), ``path``, ``contract``, ``sha256`` of the file; where the
    dictionary is a file, of both.
    """

    contract: TextContract

    def __init__(
        self,
        path: str | Location | OnnxModel,
        *,
        contract: TextContract | Given | None = None,
        dictionary: Location | None = None,
        threads: int = 1,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        model = path if isinstance(path, OnnxModel) else OnnxModel(path, threads, timeout_s)
        stated: Any = {"contract": contract, "dictionary": dictionary}
        further: Any = {"threads": model.threads, "timeout_s": model.timeout_s}
        super().__init__(model, partial(Recogniser, model.source, **stated, **further))
        check_form(model)
        self.contract = _sized(model, contract)
        file = None if dictionary is None else fetched_file(dictionary)
        if file is not None:
            sources = {**self.contract.sources, "dictionary": "given"}
            self.contract = replace(self.contract, dictionary=file.name, sources=sources)
        elif self.contract.dictionary is not None:
            given = contract if isinstance(contract, (str, Path)) else None
            file = (contract_file(self.path, given) or self.path).parent / self.contract.dictionary
        elif DICTIONARY_KEY in model.metadata:
            sources = {**self.contract.sources, "dictionary": f"metadata {DICTIONARY_KEY}"}
            self.contract = replace(self.contract, sources=sources)
        if file is not None:
            lines = _read_dictionary(file)
            both = self.sha256 + hashlib.sha256(lines.encode()).hexdigest()
            self.sha256 = hashlib.sha256(both.encode()).hexdigest()
        elif DICTIONARY_KEY in model.metadata:
            lines = model.metadata[DICTIONARY_KEY]
        else:
            raise ModelError(
                f"{self.path.name}: nothing says which characters its classes are: "
                f"give a dictionary file, or state 'dictionary' in {self.path.stem}.contract.json beside it"
            )
        self._characters = characters(lines)
        self._look_at_answer()

    def prepare(self, crop: NDArray[np.uint8]) -> FloatArray:
        """Return the network's input (1, 3, H, W), float32, for an RGB crop (h, w, 3).

        The crop keeps its aspect unless it is too wide for the input; what it does not fill is 0.
        """
        contract = self.contract
        height, natural = contract.height_px, math.ceil(contract.height_px * crop.shape[1] / crop.shape[0])
        width = fixed_size_px(self._model)[1] or min(
            max(contract.min_width_px, natural), contract.max_width_px
        )
        filled = min(natural, width)
        blob = np.zeros((1, 3, height, width), np.float32)
        lay_in(crop, contract.stretched(), (height, filled), blob[..., :filled])
        return blob

    def read_crop(self, crop: NDArray[np.uint8]) -> Reading:
        """Return the text of an RGB crop (h, w, 3), uint8, that holds one line.

        An answer with NaN or infinite values is no text; they are counted in ``non_finite_values``.
        """
        rows = self._answer(crop)
        if not np.isfinite(rows).all():
            return NOTHING
        return decode(softmax(rows) if self.contract.output == "logits" else rows, self._characters)

    def read(
        self, image: NDArray[np.uint8], boxes_xyxy: ArrayLike | Sequence[Sequence[float]]
    ) -> list[Reading]:
        """Return the text in each box (left, top, right, bottom), px, of an RGB picture (h, w, 3), uint8.

        A box is read with the contract's margin around it, to whole pixels, inside the picture, on its own: its
        reading depends on no other box. A box that is empty, or lies outside, reads as no text.
        Raises ``TypeError`` or ``ValueError`` for a picture or boxes of another type or shape.
        """
        height, width = picture_size(image)
        limit = np.array([width, height, width, height], np.float64)
        readings = []
        for box in boxes_array(boxes_xyxy):
            x0, y0, x1, y1 = np.clip(box, 0, limit)
            if x1 <= x0 or y1 <= y0:
                readings.append(NOTHING)
                continue
            margin = self.contract.margin * (box[3] - box[1])
            left, top = np.floor(np.clip(box[:2] - margin, 0, limit[:2])).astype(int)
            right, bottom = np.ceil(np.clip(box[2:] + margin, 0, limit[2:])).astype(int)
            readings.append(self.read_crop(image[top:bottom, left:right]))
        return readings

    def _answer(self, crop: NDArray[np.uint8]) -> FloatArray:
        """Values (steps, classes)."""
        rows = answer(self._model, self.prepare(crop))
        self._non_finite.count([rows])
        return rows

    def _look_at_answer(self) -> None:
        """Check classes against dictionary, and see what the values are, on a grey crop."""
        rows = self._answer(np.full((48, 48, 3), 128, np.uint8))
        if rows.ndim != 2 or rows.shape[1] != len(self._characters):
            raise ModelError(
                f"{self.path.name}: answers {list(rows.shape)}, steps and classes, to a picture, but the "
                f"dictionary ({self.contract.dictionary or f'metadata {DICTIONARY_KEY}'}) makes "
                f"{len(self._characters)} classes: the blank, {len(self._characters) - 2} lines and the space"
            )
        if not np.isfinite(rows).all():
            return
        seen: Literal["probabilities", "logits"] = "probabilities" if are_probabilities(rows) else "logits"
        stated = not self.contract.sources["output"].startswith(("assumed", "preset"))
        if stated and self.contract.output != seen:
            raise ModelError(
                f"{self.path.name}: output = {self.contract.output!r} ({self.contract.sources['output']}), but its "
                f"answer to a grey picture is {seen}: rows of probabilities sum to 1"
            )
        how = "sum to 1" if seen == "probabilities" else "do not sum to 1, so softmax is applied"
        sources = {
            **self.contract.sources,
            "output": f"graph: the rows of its answer to a grey picture {how}",
        }
        self.contract = replace(self.contract, output=seen, sources=sources)


def is_recogniser(model: OnnxModel) -> bool:
    """Whether the model is a recogniser by its graph and what lies beside it, without running it.

    It takes one picture [N, 3, height, width], gives one answer [N, T, C], and either its metadata holds a
    dictionary under ``character`` or a contract, in a file beside it or its metadata, is of family "ppocr".
    """
    if [len(entry.shape) for entry in model.inputs] != [4] or model.inputs[0].shape[1] != 3:
        return False
    if [len(entry.shape) for entry in model.outputs] != [3]:
        return False
    if (beside := contract_file(model.path)) is None and DICTIONARY_KEY in model.metadata:
        return True
    with suppress(ModelError):
        stated = read_mapping(beside) if beside else metadata_mapping(model.metadata)
        return isinstance(stated, dict) and stated.get("family") in TEXT_PRESETS
    return False


def _sized(model: OnnxModel, given: TextContract | Given | None) -> TextContract:
    """Return the contract, PP-OCR's where nobody states one, with the graph's height where that is fixed."""
    contract = stated_contract(TEXT_PRESETS, model.path, model.metadata, given)
    if contract is None:
        why = "assumed: preset ppocr"
        if DICTIONARY_KEY in model.metadata:
            why += f", which metadata {DICTIONARY_KEY} suggests"
        contract = TextContract(sources=dict.fromkeys(TextContract.names(), why))
    height, _ = fixed_size_px(model)
    if height is None:
        return contract
    source = contract.sources["height_px"]
    if contract.height_px != height and not source.startswith(("assumed", "preset")):
        raise ModelError(
            f"{model.path.name}: height_px = {contract.height_px} ({source}), but the graph takes only {height}"
        )
    return replace(contract, height_px=height, sources={**contract.sources, "height_px": "graph"})


def _read_dictionary(path: Path) -> str:
    try:
        check_regular(path)
        return path.read_bytes().decode("utf-8-sig")
    except (OSError, ValueError) as error:
        raise ModelError(f"dictionary {path.name}: cannot be read: {error}") from None
