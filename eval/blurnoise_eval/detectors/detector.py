"""An ONNX detector on the CPU: file, session, contract, and the way from a picture to detections."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.detectors.contract import Contract, ModelError
from blurnoise_eval.detectors.contract_files import Given, stated_contract
from blurnoise_eval.detectors.formats import PRESETS
from blurnoise_eval.detectors.formats.boxes import Blob, Candidates, Placement, lay_in, suppress
from blurnoise_eval.detectors.formats.columns import named, readings
from blurnoise_eval.detectors.formats.family import OutputLayout, extra_feeds, read_signature
from blurnoise_eval.detectors.model import DTYPES, TIMEOUT_S, OnnxModel
from blurnoise_eval.detectors.recognition import exported_fields, resolve
from blurnoise_eval.detectors.records import Detections, FloatArray
from blurnoise_eval.system.urls import Location

MIN_SCORE, MOST_DETECTIONS = 0.001, 300  # as Ultralytics evaluates
MOST_OF_CLASS, OWN_SCORE = 100, 0.01
"""The most boxes of one class that are matched with a target, as in COCO, and their lowest score."""
OwnScores = Callable[[ArrayLike, FloatArray], Detections]
_PROBE_SIZE_PX = (640, 640)  # for graphs of dynamic size while their family is still unknown


class Detector(OnnxModel):
    """An ONNX detector with its contract. Threads and errors: see :class:`OnnxModel`.

    ``contract``: a :class:`Contract`, a mapping, a contract file or the name of a preset; None looks beside the model
    and into its metadata, then recognises the family from the graph (see ``contract.assumptions``). Raises
    :class:`ModelError` for a graph of no known family, or a contract that does not fit it.

    Attributes: ``contract``, ``family``, ``input_size_px`` (height, width; for "resize" none only what dynamic shapes
    were measured at), ``why`` it is this family, ``takes_bytes``: whether the input is uint8, ``false_shapes``: a
    sentence for each output that has another shape than the graph declares.

    >>> from blurnoise_eval import STOP_SIGN, Detector, datasets
    >>> detector = Detector(STOP_SIGN)
    >>> sign = datasets.rendered_signs((80,), count=1).pictures[0]
    >>> detector.contract.classes, bool(detector.detect(sign.load()).scores.max() > 0.5)
    (('stop sign',), True)
    """

    contract: Contract

    def __init__(
        self,
        path: str | Location | OnnxModel,
        *,
        contract: Contract | Given | None = None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        super().__init__(path, timeout_s)
        self._opened_again = partial(Detector, self.source, contract=contract, timeout_s=self.timeout_s)
        stated = stated_contract(PRESETS, self.path, self.metadata, contract)
        size_px = stated.input_size_px if stated else exported_fields(self.metadata).get("input_size_px")
        signature = read_signature(self, size_px or _PROBE_SIZE_PX)
        self.contract, layout = resolve(signature, stated)
        self.input_size_px = self.contract.input_size_px or _PROBE_SIZE_PX
        # Shapes of outputs depend on the size of the input.
        if signature.size_px != self.input_size_px:  # dynamic graph, recognised at another size
            signature = read_signature(self, self.input_size_px)
            _, layout = resolve(signature, self.contract)
        self._signature, self.false_shapes = signature, signature.notes
        self._read_by(layout)
        self.takes_bytes = DTYPES[self.inputs[0].type] is np.uint8
        self._extras = extra_feeds(self.inputs[1:], self.input_size_px, self.batch) or {}
        self._buffers = threading.local()

    def _read_by(self, layout: OutputLayout) -> None:
        self.family, self._decoded, self.why = layout.family, list(layout.outputs), layout.why

    def with_contract(self, contract: Contract) -> Detector:
        """The same session read by another contract of the same family and input size."""
        other = object.__new__(Detector)  # a copy would open the file again
        other.__dict__.update(self.__dict__, contract=contract)
        if contract.outputs != self.contract.outputs:
            other._read_by(resolve(self._signature, contract)[1])
        other._opened_again = partial(self._opened_again, contract=contract)  # type: ignore[call-arg]  # of Detector
        other._non_finite, other._buffers = threading.local(), threading.local()
        return other

    def readings(
        self, images: Sequence[NDArray[np.uint8]], inputs: Sequence[Contract], *, others: bool
    ) -> tuple[list[str], str]:
        """What the outputs' columns may be by their values for RGB pictures, and why they are not what the contract
        says, or "". inputs: contracts by which the pictures enter, the first by which something is found. others:
        whether to try other readings also where its own is possible."""
        answers, sizes = list[list[FloatArray]](), list[tuple[int, int]]()
        for contract in inputs:
            placed = [self.prepare(image, contract=contract) for image in images]
            answers = [self.run(blob) for blob, _ in placed]
            sizes = [(placement.height_px, placement.width_px) for _, placement in placed]
            if any(np.abs(output).max(initial=0) > 0 for answer in answers for output in answer):
                break
        own_size = self.contract.resize == "none" and sizes
        size_px = (max(h for h, _ in sizes), max(w for _, w in sizes)) if own_size else self.input_size_px
        text = named(self.contract.outputs or "", self._decoded)
        return readings(text, answers, size_px, len(self.contract.classes), others=others)

    def prepare(
        self, image: NDArray[np.uint8], out: Blob | None = None, *, contract: Contract | None = None
    ) -> tuple[Blob, Placement]:
        """Return the network's input for an RGB picture (h, w, 3), and the picture's placement in it.

        It holds one picture in the graph's own shape: (1, 3, H, W), (1, H, W, 3) or (3, H, W); float32, or
        uint8 where the graph takes bytes. ``out``: a buffer of that shape to fill instead of a new one.
        ``contract``: to see the picture enter in another way. Raises ``TypeError`` or ``ValueError`` for a
        picture of another type or shape.
        """
        dtype = np.uint8 if self.takes_bytes else np.float32
        contract = contract or self.contract
        return lay_in(image, contract, self.input_size_px, out, axes=self.axes or "nchw", dtype=dtype)

    def run(self, blob: Blob) -> list[FloatArray]:
        """Return the outputs that the family decodes, float32, for one input as :meth:`prepare` makes it.

        A graph with a fixed larger batch gets the picture repeated; its first answer counts.
        """
        outputs = self.infer(blob, self._decoded, self._extras)
        alone = (output if output.ndim < 3 else output[:1] for output in outputs)
        return [output.astype(np.float32, copy=False) for output in alone]

    def decode(
        self,
        outputs: Sequence[FloatArray],
        placement: Placement,
        *,
        min_score: float = MIN_SCORE,
        max_detections: int = MOST_DETECTIONS,
    ) -> Detections:
        """Return detections in the picture's own px, clipped to it, after suppression within each class.

        Where the family's own evaluator counts a box with several classes, so do these; ``leading`` has the first of
        each. Candidates with NaN are dropped, counted in ``non_finite_values_here`` and warned of once. Raises
        :class:`ModelError` if scores exceed 1, which no family's do, or for a class without a name.
        """
        return self._found(outputs, placement, min_score, max_detections)[1]

    def _found(
        self, outputs: Sequence[FloatArray], placement: Placement, min_score: float, most: int
    ) -> tuple[Candidates, Detections]:
        self._count_non_finite(outputs)
        own_size = self.contract.resize == "none"
        size_px = (placement.height_px, placement.width_px) if own_size else self.input_size_px
        candidates = self.family.decode(outputs, size_px, min_score)
        # Half precision may round a score of 1 up a little; logits read as scores are far beyond.
        if candidates.scores.max(initial=0) > 1.01:
            raise ModelError(
                f"{self.path.name}: score = {candidates.scores.max():g}: must be <= 1; the family "
                f"{self.contract.family} ({self.contract.sources['family']}) may be wrong"
            )
        if candidates.class_ids.max(initial=0) >= len(self.contract.classes):
            raise ModelError(
                f"{self.path.name}: class = {candidates.class_ids.max()} (from 0), but the contract has "
                f"{len(self.contract.classes)} classes ({self.contract.sources['classes']}); a background counts, too"
            )
        counted = candidates.with_classes(min_score) if self.family.several_classes else candidates
        return candidates, self._kept(counted, placement, most)

    def _kept(
        self, candidates: Candidates, placement: Placement, most: int, per_class: int | None = None
    ) -> Detections:
        kept = suppress(candidates, self.contract.nms_iou, most, per_class=per_class)
        boxes = placement.to_picture(kept.boxes_xyxy)
        inside = np.all(boxes[:, 2:] > boxes[:, :2], axis=1)  # not wholly in the padding
        boxes, kept = boxes[inside], kept[inside]
        return Detections(boxes, np.minimum(kept.scores, 1), kept.class_ids, kept.leads)

    def top_score(self, outputs: Sequence[FloatArray]) -> float:
        """Return the highest score of any candidate, however low; 0.0 if there is none above 0.

        Exactly 0.0 for picture after picture is the mark of an int8 export whose one output scale, made for
        box coordinates, has rounded every score away.
        """
        scores = self.family.decode(outputs, self.input_size_px, 0.0).scores
        return float(scores.max(initial=0.0))

    def detect(
        self, image: NDArray[np.uint8], *, min_score: float = MIN_SCORE, max_detections: int = MOST_DETECTIONS
    ) -> Detections:
        """Return the detections in an RGB picture (h, w, 3), uint8."""
        outputs, placement = self._answers(image)
        return self.decode(outputs, placement, min_score=min_score, max_detections=max_detections)

    def _answers(self, image: NDArray[np.uint8]) -> tuple[list[FloatArray], Placement]:
        """The outputs for a picture, which is copied to a buffer of this thread."""
        blob, placement = self.prepare(image, getattr(self._buffers, "blob", None))
        self._buffers.blob = blob
        return self.run(blob), placement

    def detect_all(self, image: NDArray[np.uint8]) -> tuple[Detections, OwnScores | None]:
        """Return the detections of :meth:`detect`, and a function that returns those of classes that lead no box.

        The function takes class ids and, for each, what its scores must exceed; it returns scores from ``OWN_SCORE``
        on, suppressed within each class. It is None where the graph has one score per box, or one class.
        """
        outputs, placement = self._answers(image)
        candidates, detections = self._found(outputs, placement, MIN_SCORE, MOST_DETECTIONS)
        class_scores = candidates.class_scores
        if class_scores is None or class_scores.shape[1] == 1:
            return detections, None
        return detections, partial(self._own, candidates, placement)

    def _own(
        self, candidates: Candidates, placement: Placement, class_ids: ArrayLike, above: FloatArray
    ) -> Detections:
        asked, whose = np.unique(np.asarray(class_ids, np.int64), return_inverse=True)
        least = np.full(len(asked), np.inf, np.float32)
        np.minimum.at(least, whose, above)
        # Weaker candidates are left out: they could suppress none of these.
        of_classes = candidates.with_classes(OWN_SCORE, asked, least)
        return self._kept(of_classes, placement, MOST_OF_CLASS * len(asked), MOST_OF_CLASS)
