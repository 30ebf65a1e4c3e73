"""Fields of a dataclass, checked by pydantic against their annotations; every fault one line.

Types are strict, numbers finite. An annotation states what else must hold with annotated_types (``Ge(0)``) and,
where a fault is told in words of its own for the whole field, with these: ``"must be three numbers"``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from functools import lru_cache
from typing import Annotated, Any, get_type_hints

import numpy as np
from annotated_types import Gt
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from blurnoise._core.checks import OutOfRange, shown

Characters = Annotated[str, Field(pattern="")]
"""Text of any kind; the pattern has halves of characters found, which cannot be written to a file."""
Text = Annotated[str, Field(pattern=r"\S")]
"""Text that is not blank."""
Figure = Annotated[float, float]
"""A number that messages show as a float, as it is kept."""
Positive = Annotated[Figure, Gt(0)]

_NUMBER_AS_TEXT = ", not text (YAML takes 1e4 for text; write 1.0e+4)"
_MUST = {
    "float_type": "must be a number",
    "int_type": "must be an integer",
    "string_type": "must be text",
    "string_unicode": "must be text, without halves of characters",
    "string_pattern_mismatch": "must not be empty",
    "too_short": "must not be empty",
    "bool_type": "must be true or false",
    "dict_type": "must map names to text",
    "tuple_type": "must be a list",
}
_SIGNS = {"gt": ">", "ge": ">=", "le": "<="}


def check_fields(record: Any) -> None:
    """Check a dataclass's fields against their annotations, and make NumPy's numbers and lists plain ones.

    Raises ``TypeError`` or ``ValueError`` naming the field, its value and what is allowed.
    """
    stated = {entry.name: getattr(record, entry.name) for entry in fields(record)}
    kind: Any = type(record)
    try:
        found = _model(kind).model_validate({name: _plain(value) for name, value in stated.items()})
    except ValidationError as error:
        raise _complaint(error, stated, kind) from None
    for name in stated:
        object.__setattr__(record, name, getattr(found, name))


@lru_cache
def _model(kind: Any) -> type[BaseModel]:
    hints = get_type_hints(kind, include_extras=True)
    config = ConfigDict(strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)
    entries: dict[str, Any] = {entry.name: (hints[entry.name], ...) for entry in fields(kind)}
    return create_model(kind.__name__, __config__=config, **entries)


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, (list, tuple)):
        return tuple(item.item() if isinstance(item, np.generic) else item for item in value)
    return value.item() if isinstance(value, np.generic) else value


def _complaint(error: ValidationError, stated: Mapping[str, object], kind: Any) -> Exception:
    """The first fault in one line."""
    fault = error.errors(include_url=False)[0]
    name, *below = map(str, fault["loc"])
    value, rule = fault["input"] if below else stated[name], fault["type"]
    if rule == "value_error":  # of a validator of ours, whose message is whole
        return ValueError(str(fault["ctx"]["error"]))
    about = _model(kind).model_fields[name].metadata
    if rule == "float_type" and type(value) is int:
        return ValueError(f"{name}: must be finite, got an integer beyond 1e308")
    if float in about and type(value) is int:
        value = float(value)
    if rule == "literal_error":
        must = f"must be one of {fault['ctx']['expected'].replace(' or ', ', ')}"
    elif own := [text for text in about if isinstance(text, str) and rule != "string_unicode"]:
        value, must, below = stated[name], own[0], []
    elif rule in _MUST:
        must = _MUST[rule] + (_NUMBER_AS_TEXT if rule == "float_type" and isinstance(value, str) else "")
    else:
        ends = {
            key: end for limit in about for key in _SIGNS if (end := getattr(limit, key, None)) is not None
        }
        if not below and isinstance(value, float) and "lt" not in ends:
            low = ends.get("gt", ends.get("ge", -math.inf))
            return OutOfRange(name, value, low, ends.get("le", math.inf), "gt" in ends)
        limits = [f"{_SIGNS[key]} {end:g}" for key, end in ends.items()]
        must = f"must be finite{' and '.join(['', *limits]) if limits else ''}"
    if isinstance(stated[name], Mapping):
        name = ".".join([name, *(shown(part)[1:-1] for part in below if part != "[key]")])
    return (TypeError if rule.endswith("_type") else ValueError)(f"{name} = {shown(value)}: {must}")
