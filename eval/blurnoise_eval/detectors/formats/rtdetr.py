"""RT-DETR, D-FINE and DEIM: ``labels`` [1, Q], ``boxes`` [1, Q, 4], ``scores`` [1, Q], none doubled.

Some exports of DEIMv2 have no batch axis, as torchvision's have none; there the input that asks for sizes decides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, select_corners
from blurnoise_eval.detectors.formats.signature import Layout, Signature

NAME = "rtdetr"
UNKNOWN = "whether it takes mean and std of ImageNet, as DEIMv2 does where its backbone is DINOv3"
SEVERAL_CLASSES = False  # one a box is all that the graph tells


def describe(signature: Signature) -> Layout | None:
    """These three outputs; ``orig_target_sizes`` is fed the input's own size.

    Without a batch axis, by their ranks and types where sizes are asked for, else by their names.
    """
    if signature.size_px is None:
        return None
    found = signature.named(("labels", "boxes", "scores"))
    alone = signature.of_one_picture()
    if alone is not None and (signature.asks_for_size or (found and signature.inputs[0].axes != "chw")):
        boxes, labels, scores = alone
        return Layout.by_name([labels, boxes, scores])
    if found is None:
        return None
    ranks = [len(output.shape) for output in found]
    return Layout.by_name(found) if ranks == [2, 3, 2] and found[1].shape[2] == 4 else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Class numbers; left, top, right, bottom in px; scores."""
    labels, boxes, scores = outputs if outputs[1].ndim == 2 else (output[0] for output in outputs)
    return select_corners(boxes, scores, labels.astype(np.int64), min_score)
