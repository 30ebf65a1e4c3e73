"""What a run says of itself as JSON: the form that is relied on, whoever made the run."""

from __future__ import annotations

import json
import math
from typing import Any

from pydantic import BaseModel, Field, TypeAdapter, ValidationError, model_validator

MOST_CONDITIONS = 10_000_000
"""Of a run's grid."""


class _Model(BaseModel):
    name: str
    kind: str
    file: str
    sha256: str
    contract: dict[str, Any]
    unknown_labels: list[str]
    latency: dict[str, Any] = {}

    @model_validator(mode="after")
    def _detects_classes(self) -> _Model:
        classes = self.contract.get("classes", [])
        if not isinstance(classes, list) or not all(isinstance(name, str) for name in classes):
            raise ValueError("the classes of its contract must be texts")
        if self.kind == "detector" and not classes:
            raise ValueError("its contract names no classes")
        return self


class _Images(BaseModel):
    kind: str
    source: str
    count: int
    labelled: bool
    notes: list[str]


class _Manifest(BaseModel):
    title: str
    models: list[_Model] = Field(min_length=1)
    camera: dict[str, Any]
    images: _Images
    trajectory: dict[str, Any] | None = None


class _Plan(BaseModel):
    repeats: int
    grid: dict[str, list[float]] = {}

    @model_validator(mode="after")
    def _can_be_computed(self) -> _Plan:
        if math.prod(map(len, self.grid.values())) > MOST_CONDITIONS:
            raise ValueError(f"grid: has more than {MOST_CONDITIONS} conditions")
        return self


class _Identity(BaseModel):
    model: list[dict[str, Any]]
    camera: dict[str, Any]
    plan: _Plan
    pictures: str
    targets: str = Field(alias="choice of targets")


class _Learnt(BaseModel):
    wall_s: float = 0.0
    non_finite_values: dict[str, int] = {}


class _Batch(BaseModel):
    n_pictures: int
    places: list[tuple[float, float]]
    conditions: list[dict[str, Any]]


_FORMS: dict[str, TypeAdapter[Any]] = {
    "manifest": TypeAdapter(_Manifest),
    "identity": TypeAdapter(_Identity),
    "learnt": TypeAdapter(_Learnt),
    "asked": TypeAdapter(list[_Batch]),
    "versions": TypeAdapter(dict[str, Any]),
}


class Stated(dict[str, Any]):
    """An object that says which key it has not, where that is one that not every run has."""

    def __missing__(self, key: str) -> Any:
        raise ValueError(f"run: was made by other software (states no {key!r})")


def read(key: str, text: str) -> Any:
    """The document of that name. Raises ``ValueError`` for text that is no JSON, or of another form."""
    try:
        value = json.loads(text, object_hook=Stated if key in _FORMS else None)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    if key not in _FORMS:
        return value
    try:
        _FORMS[key].validate_python(value)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise ValueError(f"{place or 'value'}: {first['msg'][:1].lower()}{first['msg'][1:]}") from None
    return value
