"""Checks of the fields of dataclasses, by pydantic, against their annotations.

An annotation has limits by annotated_types (``Ge(0)``) and, where a message is of the whole field, its words:
``Annotated[..., "must be three numbers"]``. Messages are those of :mod:`blurnoise._core.checks`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from functools import lru_cache
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np
from annotated_types import GroupedMetadata, Interval
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from blurnoise._core.checks import LIMITS, Limit, OutOfRange, bounds_text, shown

Characters = Annotated[str, Field(pattern="")]
"""Text of any kind; the pattern rejects lone surrogates, which no file can hold."""
Text = Annotated[str, Field(pattern=r"\S")]
"""Text that is not blank."""
Figure = Annotated[float, float]
"""A number that messages show as a float, as it is kept."""
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


def within(limit: str | Limit) -> Interval:
    """A limit, or that of an argument's name, for the annotation of a field.

    >>> within("lamp_duty")
    Interval(gt=0.0, ge=None, lt=None, le=1.0)
    """
    low, high, above = LIMITS[limit] if isinstance(limit, str) else limit
    return Interval(gt=low, le=high) if above else Interval(ge=low, le=high)


def check_fields(record: Any, but: frozenset[str] = frozenset()) -> None:
    """Check a dataclass's fields against their annotations, and make NumPy's numbers and lists plain ones.

    Types are strict, numbers finite. but: fields that are left as they are. Raises ``TypeError`` or ``ValueError`` of
    one line.

    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Record:
    ...     share: Annotated[float, Interval(ge=0, le=1)]
    >>> check_fields(Record(2.0))
    Traceback (most recent call last):
    blurnoise._core.checks.OutOfRange: share = 2.0: must be finite and >= 0 and <= 1
    """
    given = {entry.name: getattr(record, entry.name) for entry in fields(record) if entry.name not in but}
    kind: Any = type(record)
    model = _model(kind, but)
    plain = {}
    for name, value in given.items():
        try:
            plain[name] = _plain(value)
        except RecursionError:
            raise ValueError(f"{name}: must not be nested so deeply") from None
    try:
        validated = model.model_validate(plain)
    except ValidationError as error:
        raise _first_fault(error, given, model) from None
    for name in given:
        object.__setattr__(record, name, getattr(validated, name))


@lru_cache
def _model(kind: Any, but: frozenset[str]) -> type[BaseModel]:
    hints = get_type_hints(kind, include_extras=True)
    config = ConfigDict(strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)
    checked = [entry.name for entry in fields(kind) if entry.name not in but]
    entries: dict[str, Any] = {name: (hints[name], ...) for name in checked}
    return create_model(kind.__name__, __config__=config, **entries)


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, np.longdouble):  # is no Python number as it stands
        return float(value)
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if type(value) in (list, tuple):  # of many floats, mostly
        return tuple(item if type(item) is float else _plain(item) for item in value)  # type: ignore[attr-defined]
    return value


def _first_fault(error: ValidationError, given: Mapping[str, object], model: type[BaseModel]) -> Exception:
    fault = error.errors(include_url=False)[0]
    name, *below = map(str, fault["loc"])
    entry, rule, context = model.model_fields[name], fault["type"], fault.get("ctx", {})
    value = fault["input"] if below else given[name]
    of_entries = [limit for kind in get_args(entry.annotation) for limit in getattr(kind, "__metadata__", ())]
    limits = [
        limit
        for group in (of_entries if below else entry.metadata)
        for limit in (group if isinstance(group, GroupedMetadata) else [group])
    ]
    if rule == "value_error":  # of a validator of ours, whose message is complete, or begins with "must"
        text = str(context["error"])
        return ValueError(f"{name} = {shown(given[name])}: {text}" if text.startswith("must") else text)
    if rule == "float_type" and type(value) is int:  # beyond 1e308
        rule = "finite_number"
    elif float in limits and type(value) is int:
        value = float(value)
    field_words = [text for text in entry.metadata if isinstance(text, str) and rule != "string_unicode"]
    if field_words:
        value, must, below = given[name], field_words[0], []
    elif rule == "literal_error":
        must = f"must be one of {context['expected'].replace(' or ', ', ')}"
    elif rule == "float_type" and isinstance(value, str):
        must = "must be a number, not text (YAML takes 1e4 for text; write 1.0e+4)"
    elif rule in _MUST:
        must = _MUST[rule]
    elif "class_name" in context:  # of a tuple of records
        must = f"must be a {context['class_name']}"
    else:
        bounds = ((key, getattr(limit, key, None)) for limit in limits for key in ("gt", "ge", "le"))
        ends = {key: end for key, end in bounds if end is not None}
        low, high = ends.get("gt", ends.get("ge", -math.inf)), ends.get("le", math.inf)
        if not below and isinstance(value, float):
            return OutOfRange(name, value, low, high, "gt" in ends)
        must = f"must be finite{bounds_text(low, high, 'gt' in ends)}"
    if isinstance(given[name], Mapping):
        name = ".".join([name, *(shown(part)[1:-1] for part in below if part != "[key]")])
    return (TypeError if rule.endswith("_type") else ValueError)(f"{name} = {shown(value)}: {must}")
