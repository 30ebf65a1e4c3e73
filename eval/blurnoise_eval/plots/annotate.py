"""Example pictures with boxes: detected, missed and other objects.

Pictures are files of 8 bits; boxes are (left, top, right, bottom), px of the picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.datasets import eight_bit, read_picture
from blurnoise_eval.datasets.folder import MAX_MEGAPIXELS
from blurnoise_eval.scoring.boxes import iou
from blurnoise_eval.scoring.matching import MATCH_IOU
from blurnoise_eval.store.rows import LabelledBox, TargetAnswer
from blurnoise_eval.system.files import LARGEST_EXAMPLE_BYTES
from blurnoise_eval.system.terminal import plain

OTHER_SCORE = 0.3  # detections that belong to no target are drawn from this score on

FOUND_RGB = (0, 200, 90)
MISSED_RGB = (255, 140, 0)
OTHER_RGB = (110, 190, 255)
FONT_SCALE = 0.45
MOST_BOXES = 300
"""The most targets that are drawn in a picture; more could not be distinguished."""


def drawn_example(
    path: Path,
    detections: Iterable[LabelledBox],
    targets: Iterable[TargetAnswer],
    size_px: int,
    threshold: float,
) -> NDArray[np.uint8] | None:
    """A picture file, RGB uint8, longest side ``size_px``, with boxes; None where it cannot be read.

    Detections that overlap a target of their own label (IoU >= 0.5) are that target's and not drawn again. Of more
    than ``MOST_BOXES`` targets the largest are drawn.
    """
    try:
        if path.stat().st_size > LARGEST_EXAMPLE_BYTES:
            return None
        whole = eight_bit(read_picture(path, MAX_MEGAPIXELS))
    except (OSError, ValueError):
        return None
    scale = size_px / max(whole.shape[:2])
    width, height = max(1, round(whole.shape[1] * scale)), max(1, round(whole.shape[0] * scale))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    picture = cv2.resize(whole, (width, height), interpolation=method)
    known = list(targets)
    for other in detections:
        if other.score < OTHER_SCORE:
            continue
        alike = [target.box_xyxy for target in known if target.label == other.label]
        if not (iou([other.box_xyxy], alike) >= MATCH_IOU).any():
            _draw_box(picture, other.box_xyxy, scale, OTHER_RGB, 1, f"{other.label} {other.score:.2f}")
    largest = sorted(known, key=lambda target: -target.width_px * target.height_px)
    for target in largest[:MOST_BOXES]:
        found = target.confidence >= threshold
        colour = FOUND_RGB if found else MISSED_RGB
        text = f"{target.confidence:.2f}" if target.text is None else f'"{target.text}"'
        _draw_box(picture, target.box_xyxy, scale, colour, 2, text, dashed=not found)
    return np.asarray(picture, np.uint8)


def short_text(text: str, length: int = 34) -> str:
    """The text in printable characters, at most ``length`` of them.

    >>> short_text("a  rather long name", 9)
    'a rather…'
    """
    clean = plain(" ".join(text.split()))
    return clean if len(clean) <= length else clean[: length - 1] + "…"


def _draw_box(
    picture: NDArray[Any], box_xyxy: Sequence[float], scale: float, colour: tuple[int, int, int], width: int,
    text: str, dashed: bool = False,
) -> None:  # fmt: skip
    """Draw one box and its text on ``picture`` in place; dashes are 7 px long."""
    beyond = max(picture.shape[:2])  # a box may leave the picture by any length
    x_px, y_px = (np.clip(np.array(box_xyxy[axis::2], float) * scale, -beyond, 2 * beyond) for axis in (0, 1))
    (left, right), (top, bottom) = (edges.round().astype(int).tolist() for edges in (x_px, y_px))
    corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)]
    for start, end in pairwise(corners):
        steps = max(1, math.ceil(math.dist(start, end) / 7)) if dashed else 1
        stops = np.linspace(start, end, steps + 1).round().astype(int)
        for a, b in list(pairwise(stops))[:: 2 if dashed else 1]:
            cv2.line(picture, tuple(map(int, a)), tuple(map(int, b)), colour, width, cv2.LINE_AA)
    shown = short_text(text, 24).encode("ascii", "replace").decode()
    (text_width, text_height), _ = cv2.getTextSize(shown, cv2.FONT_HERSHEY_SIMPLEX, FONT_SCALE, 1)
    x = max(0, min(left, picture.shape[1] - text_width - 4))
    y = top - 3 if top > text_height + 6 else min(bottom + text_height + 4, picture.shape[0] - 3)
    cv2.rectangle(picture, (x, y - text_height - 3), (x + text_width + 3, y + 3), (20, 20, 20), cv2.FILLED)
    cv2.putText(picture, shown, (x + 2, y), cv2.FONT_HERSHEY_SIMPLEX, FONT_SCALE, colour, 1, cv2.LINE_AA)
