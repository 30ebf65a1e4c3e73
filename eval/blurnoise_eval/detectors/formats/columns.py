"""Candidates from columns: decoding of outputs that a contract states, and the readings that values allow.

A graph does not show whether its boxes are corners or centres, px or shares, its scores logits, or which of two
columns is the class. Values often do: a class is a whole number, corners are in order, most queries see nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit, softmax

from blurnoise_eval.detectors.formats.boxes import Candidates, best_class, select, sigmoid
from blurnoise_eval.detectors.model import TensorInfo
from blurnoise_eval.detectors.outputs import BOXES, Column, Output, parsed, written
from blurnoise_eval.detectors.records import FloatArray

Answer = Sequence[FloatArray]
_INTEGERS = ("tensor(int64)", "tensor(int32)")
_FOUND = 0.05  # score from which on a box is judged; weaker ones lie anywhere
_MOST_ROWS = 100
_FEWEST_QUERIES = 20
_BELOW_PX = 1.5
"""Boxes that all end before are shares: no detector finds nothing but objects of one px in the first corner."""


def rows_of(array: FloatArray, output: Output, classes: int) -> FloatArray:
    """(N, columns) of one picture's output, which may be turned, or have further axes of one entry, or of a grid."""
    width = output.width(classes)
    if width == 1:
        return array.reshape(-1, 1)
    # Ultralytics' boxes are columns, also where there are as many.
    square = array.shape[0] == width and str(output.columns[0]) == "cxcywh" and len(output.columns) == 2
    if array.shape[-1] == width and not (square and array.ndim == 2):
        return array.reshape(-1, width)
    return array.reshape(width, -1).T


def _values(answer: Answer, outputs: Sequence[Output], classes: int) -> dict[str, FloatArray]:
    """By kind of column, its values (N, columns), of the answers that count."""
    batched = max(array.ndim for array in answer) >= 3
    count, values = None, dict[str, FloatArray]()
    for array, output in zip(answer, outputs, strict=True):
        if output.has("count"):
            count = int(array.flat[0])
            continue
        rows, start = rows_of(array[0] if batched else array, output, classes), 0
        for column in output.columns:
            width = Output("", (column,)).width(classes)
            values[column.kind] = rows[:, start : start + width]
            start += width
    if count is not None:
        values = {kind: rows_of_kind[:count] for kind, rows_of_kind in values.items()}
    if "picture" in values:
        first = values["picture"][:, 0] == 0
        values = {kind: rows_of_kind[first] for kind, rows_of_kind in values.items()}
    return values


def _how(outputs: Sequence[Output]) -> dict[str, str]:
    return {column.kind: column.how for output in outputs for column in output.columns}


def decode(
    answer: Answer, size_px: tuple[int, int], min_score: float, *, outputs: tuple[Output, ...], classes: int
) -> Candidates:
    """Candidates of what the columns of ``outputs`` are; ``answer``: one array for each.

    Score = score, or objectness · class, each activated as stated; of a softmax the background is a part. Answers of
    other pictures than the first, and those whose class is no number >= 0, are left out.
    """
    values, how = _values(answer, outputs, classes), _how(outputs)
    kind = next(kind for kind in BOXES if kind in values)
    if "scores" in values:
        scores, class_ids, class_scores, kept = _class_scores(values, how, min_score)
    else:
        numbers = values["class"][:, 0] if "class" in values else np.zeros(len(values["score"]), np.float32)
        numbers = numbers - (how.get("class") == "from 1")
        kept = np.flatnonzero(np.isfinite(numbers) & (numbers >= 0))
        scores = _activated(values["score"][kept, 0], how["score"])
        class_ids, class_scores = numbers[kept].astype(np.int64), None
    boxes = values[kind][kept]
    if kind == "yxyx":
        boxes = boxes[:, [1, 0, 3, 2]]
    if how[kind] == "in shares":
        boxes = boxes * np.array([size_px[1], size_px[0]] * 2, np.float32)
    if kind == "xywh":
        boxes = np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)
    return select(boxes, scores, class_ids, min_score, class_scores, corners=kind != "cxcywh")


def _class_scores(
    values: dict[str, FloatArray], how: dict[str, str], min_score: float
) -> tuple[FloatArray, NDArray[np.int64], FloatArray, NDArray[np.int64]]:
    """Of the rows that may reach ``min_score``: highest score, its class, scores of all classes; and which rows."""
    scores, objectness = values["scores"], values.get("objectness")
    if how["scores"] == "by softmax":
        logits = np.concatenate([scores, values.get("background", scores[:, :0])], axis=1)
        scores = softmax(logits, axis=1)[:, : scores.shape[1]]
    leads, lead = (scores, "scores") if objectness is None else (objectness, "objectness")
    with np.errstate(divide="ignore"):
        least = logit(min_score) if how[lead] == "by sigmoid" else min_score
    kept = np.flatnonzero(leads.max(axis=1) >= least)  # a NaN makes the maximum NaN, which drops the row
    raw = scores[kept]
    of_classes = sigmoid(raw) if how["scores"] == "by sigmoid" else raw
    if objectness is not None:
        of_classes = of_classes * _activated(objectness[kept], how["objectness"])
    best, class_ids = best_class(of_classes)
    if objectness is None and how["scores"] == "by sigmoid":
        class_ids = best_class(raw)[1]  # large logits all give a sigmoid of 1
    strong = np.flatnonzero(best >= min_score)
    return best[strong], class_ids[strong], of_classes[strong], kept[strong]


def _activated(values: FloatArray, how: str) -> FloatArray:
    return sigmoid(values) if how == "by sigmoid" else values


# --- which outputs of a graph are meant ---


def matched(outputs: Sequence[Output], infos: Sequence[TensorInfo], classes: int) -> list[TensorInfo] | None:
    """The graph's outputs in the order of those stated, by name, else by shape and type; None if one is missing."""
    by_place: dict[int, TensorInfo] = {}
    order = sorted(range(len(outputs)), key=lambda n: (not outputs[n].name, -outputs[n].width(classes)))
    for number in order:
        output = outputs[number]
        left = [info for info in infos if info not in by_place.values()]
        if output.name:
            left = [info for info in left if _named(info.name, output.name)]
        left = [info for info in left if fits(output, info, classes)]
        whole = output.has("class") or output.has("count")
        typed = [info for info in left if (info.type in _INTEGERS) == whole]
        if not left:
            return None
        by_place[number] = (typed if len(output.columns) == 1 and typed else left)[0]
    return [by_place[number] for number in range(len(outputs))]


def _named(name: str, pattern: str) -> bool:
    """TensorFlow's names end in ":0"."""
    return name == pattern or fnmatch(name.split(":")[0].lower(), pattern.split(":")[0].lower())


def fits(output: Output, info: TensorInfo, classes: int) -> bool:
    """Whether a graph's output has so many columns."""
    width, shape = output.width(classes), info.shape
    if not shape or (output.has("scores") and info.type in _INTEGERS):
        return False
    if output.has("count"):
        return (len(shape) <= 2 and shape[-1:] in ((1,), (None,), ())) or len(shape) == 1
    if width == 1:
        return len(shape) <= 2 or (len(shape) == 3 and 1 in shape[1:])
    return len(shape) >= 2 and (width in (shape[-1], shape[-2]) or (len(shape) == 4 and shape[1] == width))


# --- which readings the values allow ---


def refuted(answers: Sequence[Answer], text: str, size_px: tuple[int, int], classes: int) -> str:
    """Why no detector gives these answers if its outputs are ``text``; "" where one may.

    answers: for each picture the outputs in the order of ``text``.
    """
    outputs = parsed(text)
    how = _how(outputs)
    for check in (_no_class, _no_score, _no_activation, _no_box):
        parts = [_values(answer, outputs, classes) for answer in answers]
        values = {kind: np.concatenate([part[kind] for part in parts]) for kind in parts[0]}
        if reason := check(_finite(values), how, size_px, classes):
            return reason
    return ""


def _finite(values: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Without rows that hold NaN, and without padding: rows of one value."""
    rows = np.concatenate(list(values.values()), axis=1)
    kept = np.isfinite(rows).all(axis=1) & (np.ptp(rows, axis=1) > 0) if rows.shape[1] > 1 else slice(None)
    return {kind: rows_of_kind[kept] for kind, rows_of_kind in values.items()}


Values = dict[str, FloatArray]


def _no_class(values: Values, how: dict[str, str], size_px: tuple[int, int], classes: int) -> str:
    numbers = values.get("class", np.zeros((0, 1), np.float32))
    first = how.get("class") == "from 1"
    if (numbers != np.round(numbers)).any():
        return "the column read as class holds fractions"
    live = numbers[values["score"] > 0] if "score" in values else numbers
    if live.max(initial=first) > classes - 1 + first:
        return f"the column read as class goes to {live.max():g} with {classes} classes"
    return "the class is 0, and numbers are read from 1" if live.min(initial=first) < first else ""


def _no_score(values: Values, how: dict[str, str], size_px: tuple[int, int], classes: int) -> str:
    for kind in ("score", "objectness", "scores"):
        if kind not in values or not values[kind].size:
            continue
        low, high = float(values[kind].min()), float(values[kind].max())
        logits = "sigmoid" in how[kind] or "softmax" in how[kind]
        padding = values[kind][values[kind] < 0]
        if not logits and (high > 1.01 or (padding != -1).any()):
            return f"the column read as {kind} goes from {low:.3g} to {high:.3g}"
        if logits and low >= 0 and high <= 1:
            return f"the column read as {kind}, logits, stays within 0 and 1"
    return ""


def _no_activation(values: Values, how: dict[str, str], size_px: tuple[int, int], classes: int) -> str:
    """Most queries of a transformer see nothing: in a softmax the background leads, of sigmoids all are low."""
    scores = values.get("scores")
    if scores is None or len(scores) < _FEWEST_QUERIES or "objectness" in values:
        return ""
    with_background = np.concatenate([scores, values.get("background", scores[:, :0])], axis=1)
    if how["scores"] == "by softmax":
        nothing = 1 - softmax(with_background, axis=1)[:, : scores.shape[1]].sum(axis=1)
        return "" if np.median(nothing) > 0.5 else "most rows would show an object, by softmax"
    probabilities = sigmoid(scores) if how["scores"] == "by sigmoid" else scores
    if "background" in values and not how["scores"]:
        return ""
    sums = with_background.sum(axis=1)
    if not how["scores"] and with_background.shape[1] > 1 and np.allclose(sums, 1, atol=2e-3):
        return "the scores of each row are a softmax: their sum is 1"
    if np.median(probabilities.max(axis=1)) >= 0.3:
        return "most rows would show an object" + ", by sigmoid" * bool(how["scores"])
    return ""


def _no_box(values: Values, how: dict[str, str], size_px: tuple[int, int], classes: int) -> str:
    kind = next(kind for kind in BOXES if kind in values)
    best = _best(values, how)
    order = np.argsort(-best, kind="stable")[:_MOST_ROWS]
    boxes = values[kind].astype(np.float64)[order[best[order] > 0]]
    shares = how[kind] == "in shares"
    largest = np.abs(boxes).max(initial=0)
    if len(boxes) and shares != (largest <= _BELOW_PX):
        return f"the largest number of a box is {largest:.4g}, " + ("which is no share" if shares else "px")
    boxes = values[kind].astype(np.float64)[order[best[order] >= _FOUND]]
    height, width = (1.0, 1.0) if shares else size_px
    sides = np.array([height, width] * 2 if kind == "yxyx" else [width, height] * 2)
    if kind in ("xyxy", "yxyx"):
        if (boxes[:, 2:] < boxes[:, :2]).any():
            return f"boxes read as {kind} end before they begin"
        corners = boxes
    else:
        if (boxes[:, 2:] < 0).any():
            return f"boxes read as {kind} have negative sizes"
        first = boxes[:, :2] - (boxes[:, 2:] / 2 if kind == "cxcywh" else 0)
        corners = np.concatenate([first, first + boxes[:, 2:]], axis=1)
    outside = ((corners < -0.06 * sides) | (corners > 1.06 * sides)).any(axis=1)
    return f"most boxes read as {kind} end outside of the input" if 2 * outside.sum() > len(boxes) else ""


def _best(values: Values, how: dict[str, str]) -> FloatArray:
    """The score of each row, of a softmax as if by sigmoid."""
    if "scores" not in values:
        return _activated(values["score"][:, 0], how["score"])
    best = values["scores"].max(axis=1, initial=-np.inf)
    best = sigmoid(best) if how["scores"] else best
    return (
        best * _activated(values["objectness"][:, 0], how["objectness"]) if "objectness" in values else best
    )


def alternatives(text: str) -> Iterator[str]:
    """Other readings of the columns: box, px or shares, order, activation; the nearest first."""
    outputs = parsed(text)
    columns = [column for output in outputs for column in output.columns]
    box = next(column for column in columns if column.kind in BOXES)
    boxes = [Column(kind, how) for kind, how in product(BOXES[:3], ("", "in shares"))]
    boxes.sort(key=lambda other: (other.kind != box.kind) + (other.how != box.how))
    kinds = {column.kind for column in columns}
    activation = next(column.how for column in columns if column.kind in ("score", "scores"))
    hows = [activation] + [
        how for how in ("", "by sigmoid", "by softmax") if how != activation and "scores" in kinds
    ]
    if "objectness" in kinds or "background" not in kinds:
        hows.remove("by softmax") if "by softmax" in hows else None
    for how, order, other in product(hows, _orders(outputs), boxes):
        changed = written(
            Output(output.name, tuple(other if c == box else _by(c, how) for c in output.columns))
            for output in order
        )
        if changed != text:
            yield changed


def _by(column: Column, how: str) -> Column:
    return Column(column.kind, how) if column.kind in ("scores", "objectness") else column


def _orders(outputs: Sequence[Output]) -> list[tuple[Output, ...]]:
    """Orders of the columns of a box, its score and its class, the nearest first."""
    columns = [column for output in outputs for column in output.columns]
    pair = [column for column in columns if column.kind in ("score", "class")]
    orders = [tuple(outputs)]
    if len(pair) < 2:
        return orders
    other = {pair[0]: pair[1], pair[1]: pair[0]}
    orders.append(tuple(Output(o.name, tuple(other.get(c, c) for c in o.columns)) for o in outputs))
    if len(outputs) == 1:
        first = [column for column in columns if column.kind == "picture"]
        box = [column for column in columns if column.kind in BOXES]
        for one, two in permutations(pair):
            orders += [
                (Output("", tuple(order)),) for order in ([*first, one, two, *box], [*first, *box, one, two])
            ]
    return list(dict.fromkeys(orders))


def readings(
    text: str, answers: Sequence[Answer], size_px: tuple[int, int], classes: int, *, others: bool
) -> tuple[list[str], str]:
    """The readings of the columns that the answers allow, ``text`` first if it is one; and why it is none, else "".

    others: whether to try them also where ``text`` is allowed.
    """
    why = refuted(answers, text, size_px, classes)
    allowed = [] if why else [text]
    if why or others:
        allowed += [
            reading for reading in alternatives(text) if not refuted(answers, reading, size_px, classes)
        ]
    return allowed, why


def named(text: str, names: Sequence[str]) -> str:
    """The text with the names of the graph's outputs, in its order, where there are several."""
    outputs = parsed(text)
    pairs = zip(outputs, names, strict=True)
    return written(replace(output, name=name) for output, name in pairs) if len(outputs) > 1 else text
