"""Files of settings: a frozen dataclass, read from YAML or JSON, checked by pydantic, written to begin with.

A field is a :func:`setting` with a line about it; options of the command line and the page of the guide are made from
the same line. Fields that are records of the simulator (a vehicle, objects) are mappings in the file.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, get_args, get_origin, get_type_hints


def setting(
    default: Any,
    about: str,
    metavar: str = "",
    *,
    panel: str = "",
    names: tuple[str, ...] = (),
    complete: str = "",
    check: Callable[[Any], object] | None = None,
) -> Any:
    """A field with its default, and a line about it for help, file and guide.

    Of its option, where it has one: metavar, panel, further names, and what completes it. check: raises
    ``ValueError`` for a value that is not allowed.
    """
    option = {"metavar": metavar, "panel": panel, "names": names, "complete": complete}
    return field(default=default, metadata={"about": about, "check": check, **option})


@dataclass(frozen=True)
class Settings:
    """What a file of settings may hold. Raises ``ValueError`` naming the field, its value and what is allowed."""

    KIND: ClassVar[str] = "settings"

    @classmethod
    def records(cls) -> dict[str, Any]:
        """Types of fields that are imported when a file is read."""
        return {}

    @classmethod
    def names(cls) -> dict[str, str]:
        """Every name that a file may state, with a line about it."""
        return {each.name: each.metadata["about"] for each in fields(cls)}

    @classmethod
    def read(cls, path: Path) -> Self:
        """Of a YAML or JSON file. Raises ``OSError``, or ``ValueError`` that names file and field."""
        from blurnoise._core.files import read_document

        try:
            return cls().stating(read_document(path) or {})
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    def stating(self, stated: object) -> Self:
        """With these values in place of its own. Raises ``ValueError`` naming the field."""
        if not isinstance(stated, Mapping):
            raise ValueError(f"must be a mapping of settings, such as {{{next(iter(self.names()))}: ...}}")
        check_names(stated, self.names())
        return replace(self, **_checked(type(self), stated))

    def document(self) -> str:
        """As YAML, a comment above each field; what has no value stands as a comment, too."""
        lines = [f"# {self.KIND}: what is left out is as here; an option on the command line overrides it."]
        for each in fields(self):
            about = textwrap.wrap(each.metadata["about"], 98, break_on_hyphens=False)
            lines += ["", *(f"# {line}" for line in about), _entry(each.name, getattr(self, each.name))]
        return "\n".join([*lines, ""])

    def save(self, path: Path) -> None:
        """Write :meth:`document`."""
        from blurnoise._core.files import write_whole

        write_whole(path, self.document().encode())


def check_names(stated: Mapping[Any, object], known: Mapping[str, object]) -> None:
    """Raise ``ValueError`` for a name that is not known, with those that are like it."""
    for name in stated:
        if name not in known:
            near = get_close_matches(str(name), known) or known
            raise ValueError(f"{name}: no such setting; must be one of {', '.join(near)}")


def _entry(name: str, value: object) -> str:
    import yaml

    if is_dataclass(value) and not isinstance(value, type):
        value = {key: each for key, each in asdict(value).items() if each not in (None, (), {})}
    if value is None or value == () or value == {}:
        return f"# {name}:"
    return str(yaml.safe_dump({name: _plain(value)}, sort_keys=False, width=100)).rstrip()


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, (list, tuple)) else value


def _checked(kind: Any, stated: Mapping[str, object]) -> dict[str, Any]:
    from pydantic import ValidationError

    for each in fields(kind):
        if isinstance(value := stated.get(each.name), bool) and each.type != "bool":
            raise ValueError(f"{each.name} = {value}: must not be true or false")
    try:
        found = _model(kind).model_validate(dict(stated))
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        name, text = str(fault["loc"][0]), fault["msg"].removeprefix("Value error, ")
        text = text.replace("Input should", "must")
        if fault["type"] == "value_error" and not text.startswith("must"):
            raise ValueError(f"{name}.{text}") from None  # of a record, which names its field
        raise ValueError(f"{name} = {fault['input']!r}: {text}") from None
    return {name: getattr(found, name) for name in stated}


@lru_cache
def _model(kind: Any) -> Any:
    """The pydantic model of the fields."""
    from pydantic import ConfigDict, create_model

    hints = get_type_hints(kind, localns=kind.records())
    entries: dict[str, Any] = {
        each.name: (_validated(hints[each.name], each.metadata["check"]), None) for each in fields(kind)
    }
    return create_model(kind.__name__, __config__=ConfigDict(coerce_numbers_to_str=True), **entries)


def _validated(hint: Any, check: Callable[[Any], Any] | None) -> Any:
    from pydantic import AfterValidator, BeforeValidator, PlainValidator

    if check is not None:
        return Annotated[hint, AfterValidator(partial(_passed, check))]
    for kind in (hint, *get_args(hint)):
        if is_dataclass(kind):
            return Annotated[Any, PlainValidator(partial(_record, kind))]
        if get_origin(kind) is Literal:  # such as "50", which YAML reads as a number
            return Annotated[hint, BeforeValidator(lambda value: str(value) if type(value) is int else value)]
    if str(hint).startswith("tuple[str"):
        return Annotated[hint, BeforeValidator(lambda value: (value,) if isinstance(value, str) else value)]
    return hint


def _passed(check: Callable[[Any], object], value: object) -> object:
    """The value as it is, if the check raises nothing; None, for nothing stated, needs none."""
    if value is not None:
        check(value)
    return value


def _record(kind: Any, value: object) -> Any:
    """A record of the simulator from its fields."""
    if isinstance(value, kind):
        return value
    known = {each.name: each for each in fields(kind)}
    if not isinstance(value, Mapping):
        raise ValueError(f"must be a mapping of {', '.join(known)}")
    check_names(value, known)
    try:
        return kind(**value)
    except TypeError as error:
        raise ValueError(str(error)) from None
