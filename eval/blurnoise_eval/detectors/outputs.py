"""Outputs of a detector as a contract states them: columns, units, activations.

A text has an entry for each output, separated by semicolons, in any order: "boxes: xyxy; scores: score; labels:
class". A name of the graph before a colon selects an output; without one the output with so many columns is it. An
entry lists its columns in their order, separated by commas:

- xyxy (left, top, right, bottom), yxyx, cxcywh (centre, size) or xywh (left, top, size), in px of the input, or
  "in shares" of it;
- score and class, the best of a box; "class from 1" where numbers begin with 1;
- scores: a column for each class; background: one more, which is none; objectness: a factor of all scores;
- picture: the picture's place in the batch; count: an output of its own, how many answers count.

score, scores and objectness may be followed by "by sigmoid" or "by softmax", where the graph gives logits.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

BOXES = ("xyxy", "yxyx", "cxcywh", "xywh")
_SCORES = ("score", "scores", "objectness")
_SINGLE = ("score", "class", "picture", "count", "objectness", "background")
_FURTHER = {
    **dict.fromkeys(BOXES, ("in shares", "in px")),
    **dict.fromkeys(_SCORES, ("by sigmoid", "by softmax")),
    "class": ("from 1", "from 0"),
}
_USUAL = ("in px", "from 0")
EXAMPLE = "picture, xyxy, score, class"


@dataclass(frozen=True)
class Column:
    """Of an output, or several side by side: a box, or the scores of all classes. how: "in shares", "by sigmoid".

    >>> str(Column("xyxy", "in shares"))
    'xyxy in shares'
    """

    kind: str
    how: str = ""

    def __str__(self) -> str:
        return f"{self.kind} {self.how}".rstrip()


@dataclass(frozen=True)
class Output:
    """One output of a graph. name: "" where the number of its columns selects it.

    >>> Output("boxes", (Column("xyxy"), Column("scores"))).width(classes=80)
    84
    """

    name: str
    columns: tuple[Column, ...]

    def __str__(self) -> str:
        return f"{self.name}: " * bool(self.name) + ", ".join(map(str, self.columns))

    def width(self, classes: int) -> int:
        """How many columns it has with so many classes."""
        widths = {**dict.fromkeys(_SINGLE, 1), **dict.fromkeys(BOXES, 4), "scores": classes}
        return sum(widths[column.kind] for column in self.columns)

    def has(self, kind: str) -> bool:
        """Whether a column of it is of this kind."""
        return any(column.kind == kind for column in self.columns)


@cache
def parsed(text: str) -> tuple[Output, ...]:
    """The outputs that a text states. Raises ``ValueError``.

    >>> boxes, labels = parsed("boxes: xyxy in shares, score; labels: class from 1")
    >>> boxes.name, boxes.width(classes=80), str(labels)
    ('boxes', 5, 'labels: class from 1')
    """
    outputs = tuple(map(_output, filter(None, (entry.strip() for entry in text.split(";")))))
    kinds = [column.kind for output in outputs for column in output.columns]
    boxes = [kind for kind in kinds if kind in BOXES]
    if len(boxes) != 1 or len(set(kinds)) != len(kinds) or ("score" in kinds) == ("scores" in kinds):
        must = "must have a box (xyxy, yxyx, cxcywh or xywh), score or scores, and each column once"
        raise ValueError(f"outputs = {text!r}: {must}, for example {EXAMPLE!r}")
    if ("class" in kinds) and "scores" in kinds:
        raise ValueError(f"outputs = {text!r}: must have class or scores, not both")
    if ("objectness" in kinds or "background" in kinds) and "scores" not in kinds:
        raise ValueError(f"outputs = {text!r}: objectness and background need scores")
    if any(output.has("count") and len(output.columns) > 1 for output in outputs):
        raise ValueError(f"outputs = {text!r}: count must be an output of its own, after a semicolon")
    return outputs


def _output(text: str) -> Output:
    name, _, rest = text.rpartition(": ")
    return Output(name.strip(), tuple(_column(part.strip()) for part in re.split("[,/]", rest)))


def _column(text: str) -> Column:
    kind, _, how = " ".join(text.split()).partition(" ")
    if kind not in (*BOXES, *_SINGLE, "scores"):
        known = ", ".join((*BOXES, *_SINGLE, "scores"))
        raise ValueError(f"outputs: column {kind!r} is unknown; must be one of {known}")
    if how and how not in _FURTHER.get(kind, ()):
        allowed = " or ".join(map(repr, _FURTHER.get(kind, ()))) or "nothing"
        raise ValueError(f"outputs: {text!r}: after {kind!r} must come {allowed}")
    return Column(kind, "" if how in _USUAL else how)


def written(outputs: Iterable[Output]) -> str:
    """The text that :func:`parsed` reads.

    >>> written(parsed("labels: class from 1;boxes: xyxy in px, score"))
    'labels: class from 1; boxes: xyxy, score'
    """
    return "; ".join(map(str, outputs))


def checked(value: object) -> object:
    """A text in its usual form, for a field of a contract; other values as they are.

    >>> checked("xyxy, score,class"), checked(None)
    ('xyxy, score, class', None)
    """
    return written(parsed(value)) if isinstance(value, str) else value
