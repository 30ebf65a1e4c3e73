"""Settings: frozen records that Python, a file (YAML, JSON) and options of the command line make alike.

A field is a :func:`setting`: its annotation says what is allowed, and a line of text describes it in help, files and
the guide. A field that is a record of settings itself is :func:`nested`; in files and options its settings have
their own names, beside the others. Nothing heavy is imported above, because the command line's help is made from
these records; types from heavy modules stand in annotations as :func:`late` ones.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args, get_origin, get_type_hints

from pydantic import BeforeValidator, ValidationInfo

_IN_PLACE_OF = {"light": "lux", "lux": "light"}
"""Settings of a file that give way to an option which says the same in another way."""


class SettingInfo(NamedTuple):
    """A setting as files and options have it. kind: int, float, a tuple of texts, or anything else; default: None
    where it follows from others.

    about: a line for help, files and the guide. metavar, panel, names: of its option, where it has one; names are
    further ones.
    """

    name: str
    kind: Any
    default: Any
    about: str
    metavar: str = ""
    panel: str = ""
    names: tuple[str, ...] = ()

    @property
    def option(self) -> str:
        """Its option on the command line."""
        return f"--{self.name.replace('_', '-')}"


def setting(default: Any, about: str, metavar: str = "", *, names: tuple[str, ...] = ()) -> Any:
    """A field of :class:`Settings`, see :class:`SettingInfo`."""
    return field(default=default, metadata={"about": about, "metavar": metavar, "names": names})


def nested(kind: type[Settings], *, optional: bool = False) -> Any:
    """A field that is a record of settings itself. optional: None where none of its settings has a value."""
    made: Any = {"default": None} if optional else {"default_factory": lambda: kind.of({})}
    return field(**made, metadata={"nested": kind, "optional": optional})


def late(module: str, name: str) -> Any:
    """The type of a field whose value is a dataclass of a module that is imported once there is a value.

    A file has the fields of the dataclass, as a mapping.
    """

    def made(value: Any, info: ValidationInfo) -> Any:
        from blurnoise._core.checks import known

        kind = getattr(import_module(module), name)
        if value is None or isinstance(value, kind):
            return value
        names = [each.name for each in fields(kind)]
        if not isinstance(value, Mapping):
            raise ValueError(f"must be a mapping of {', '.join(names)}")
        try:
            for key in value:
                known("field", key, names)
            return kind(**value)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{info.field_name}.{error}") from None

    return Annotated[Any, BeforeValidator(made), LateType(module, name)]


class LateType(NamedTuple):
    """Where the type of a :func:`late` annotation is."""

    module: str
    name: str


def as_text(value: Any) -> Any:
    """YAML reads 5 and 0.5 as numbers where text is meant.

    >>> as_text(2.5), as_text("auto")
    ('2.5', 'auto')
    """
    return f"{value}" if type(value) in (int, float) else value


def _texts(value: Any) -> Any:
    """One text alone stands for a list of it."""
    return (value,) if isinstance(value, str) else value


Text = Annotated[str, BeforeValidator(as_text)]
Texts = Annotated[tuple[str, ...], BeforeValidator(_texts)]


def _plain_type(hint: Any) -> Any:
    """The type of an annotation, without its limits and without None."""
    if get_origin(hint) is Annotated:
        return _plain_type(get_args(hint)[0])
    kinds = [each for each in get_args(hint) if each is not type(None)]
    return _plain_type(kinds[0]) if type(None) in get_args(hint) else hint


@dataclass(frozen=True)
class Settings:
    """A record of settings, which are checked where it is made; further fields are checked by its class.

    Raises ``TypeError`` or ``ValueError`` of one line: the setting, its value, and what is allowed.
    """

    KIND: ClassVar[str] = "settings"

    def __post_init__(self) -> None:
        from blurnoise._core.fields import check_fields

        check_fields(self, frozenset(entry.name for entry in fields(self) if not entry.metadata))

    @classmethod
    def settings(cls) -> dict[str, SettingInfo]:
        """Every setting by its name in files, those of nested records included."""
        return {each.name: each for each in cls._settings()}

    @classmethod
    def _settings(cls) -> Iterator[SettingInfo]:
        hints = get_type_hints(cls, include_extras=True)
        for entry in fields(cls):
            if kind := entry.metadata.get("nested"):
                yield from kind.settings().values()
            elif entry.metadata:
                yield SettingInfo(entry.name, _plain_type(hints[entry.name]), entry.default, **entry.metadata)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """The record from settings by their names in files. None stands for the default.

        Raises as the constructor does, and ``ValueError`` for an unknown setting.
        """
        from blurnoise._core.checks import known

        names = cls.settings()
        for name in values:
            known("setting", name, names)
        return cls(**cls._arguments({name: value for name, value in values.items() if value is not None}))

    @classmethod
    def _arguments(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        """The constructor's arguments, from settings by name."""
        arguments = {}
        for entry in fields(cls):
            if kind := entry.metadata.get("nested"):
                own = {name: values[name] for name in kind.settings() if name in values}
                if own or not entry.metadata["optional"]:
                    arguments[entry.name] = kind.of(own)
            elif entry.metadata and entry.name in values:
                arguments[entry.name] = values[entry.name]
        return arguments

    @classmethod
    def read(cls, path: Path, options: Mapping[str, Any] = {}) -> Self:
        """The record from a YAML or JSON file, whose settings ``options`` override.

        Raises ``OSError``; ``ValueError`` and ``TypeError`` name the file where a setting of it is at fault.
        """
        from blurnoise._core.checks import known
        from blurnoise._core.files import read_document

        try:
            values = read_document(path)
            example = f"such as '{next(iter(cls.settings()))}: ...'"
            if not values:
                raise ValueError(f"contains no setting; must have at least one, {example}")
            if not isinstance(values, Mapping):
                raise ValueError(f"must be a mapping of settings, {example}")
            for name in values:
                known("setting", name, cls.settings())
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        values = {name: value for name, value in values.items() if _IN_PLACE_OF.get(name) not in options}
        try:
            return cls.of({**values, **options})
        except (TypeError, ValueError) as error:
            subject = re.split(r"\W", str(error), maxsplit=1)[0]
            if subject not in values or subject in options:
                raise
            kind = (
                TypeError if isinstance(error, TypeError) else ValueError
            )  # subclasses are made of other arguments
            raise kind(f"{path}: {error}") from None

    @classmethod
    def document(cls) -> str:
        """A YAML file of the defaults, each with a comment above; settings without a default are commented out."""
        import yaml

        lines = [f"# {cls.KIND}. Settings that are left out have these defaults. Options override them."]
        for each in cls.settings().values():
            about = textwrap.wrap(each.about, 98, break_on_hyphens=False)
            no_value = each.default in (None, (), MISSING)
            entry = f"# {each.name}:" if no_value else yaml.safe_dump({each.name: each.default}).rstrip()
            lines += ["", *(f"# {line}" for line in about), entry]
        return "\n".join([*lines, ""])

    @classmethod
    def records(cls) -> Iterator[type]:
        """The types of settings that are mappings in a file."""
        hints = get_type_hints(cls, include_extras=True)
        for entry in fields(cls):
            if kind := entry.metadata.get("nested"):
                yield from kind.records()
                continue
            hint = hints[entry.name]
            for kind in (hint, *get_args(hint)):
                for each in getattr(kind, "__metadata__", ()):
                    if isinstance(each, LateType):
                        yield getattr(import_module(each.module), each.name)


def default_text(value: str, names: str = "") -> str:
    """A default at the end of a line of help: ' (default: 1,10)', or '' without one."""
    return f" (default: {value}{names})" if value else ""
