"""Files of settings: a frozen dataclass, read from YAML or JSON and checked; a template has every default.

A field is a :func:`setting` with a line about it; options of the command line and the page of the guide are made from
the same line. Fields that are records (a vehicle, objects) are mappings in the file.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Self, get_args, get_origin, get_type_hints


def setting(
    default: Any,
    about: str,
    metavar: str = "",
    *,
    panel: str = "",
    names: tuple[str, ...] = (),
    read: Callable[[Any], object] | None = None,
) -> Any:
    """A field with its default, and a line about it for help, file and guide.

    metavar, panel, names: of its option, where it has one; further names. read: makes the field's value of what the
    file or option has; raises ``ValueError``. Without it the field's type decides.
    """
    option = {"metavar": metavar, "panel": panel, "names": names}
    return field(default=default, metadata={"about": about, "read": read, **option})


@dataclass(frozen=True)
class Settings:
    """The settings of a file. Raises ``ValueError`` with the name of the setting, its value and what is allowed."""

    KIND: ClassVar[str] = "settings"

    @staticmethod
    def records() -> dict[str, Any]:
        """Types of fields that are imported only when a file is read, by name."""
        from blurnoise.camera.colour import PictureTone
        from blurnoise.motion.ego import Vehicle
        from blurnoise.scene.metering import AutoExposure
        from blurnoise_eval.plan.objects import Objects

        records = {"Objects": Objects, "Vehicle": Vehicle, "AutoExposure": AutoExposure}
        return records | {"PictureTone": PictureTone}

    @classmethod
    def names(cls) -> dict[str, str]:
        """The settings, each with a line about it."""
        return {each.name: each.metadata["about"] for each in fields(cls)}

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a YAML or JSON file. Raises ``OSError``, or ``ValueError`` that names the file and the setting."""
        from blurnoise._core.files import read_document

        try:
            return cls().stating(read_document(path) or {})
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    def stating(self, stated: object) -> Self:
        """A copy with these values of a file or of options. Raises ``ValueError`` that names the setting."""
        from blurnoise._core.checks import known

        if not isinstance(stated, Mapping):
            raise ValueError(f"must be a mapping of settings, such as {{{next(iter(self.names()))}: ...}}")
        for name in stated:
            known("setting", name, self.names())
        types = get_type_hints(type(self), localns=self.records())
        held = [each for each in fields(self) if each.name in stated]
        return replace(self, **{each.name: _read(each, types[each.name], stated[each.name]) for each in held})

    @classmethod
    def document(cls) -> str:
        """A YAML file of the defaults, each with a comment above; settings without a default are commented out."""
        import yaml

        lines = [f"# {cls.KIND}. Settings that are left out have these defaults. Options override them."]
        for each in fields(cls):
            about = textwrap.wrap(each.metadata["about"], 98, break_on_hyphens=False)
            no_value = each.default is None or each.default == ()
            entry = f"# {each.name}:" if no_value else yaml.safe_dump({each.name: each.default}).rstrip()
            lines += ["", *(f"# {line}" for line in about), entry]
        return "\n".join([*lines, ""])


def _read(entry: Any, kind: Any, value: Any) -> Any:
    """The value of a field. Raises ``ValueError`` that names the field, or a field of a record in it."""
    if value is None:
        return entry.default
    try:
        if isinstance(value, bool) and kind is not bool:
            raise ValueError("must be a value, not true or false")
        return (entry.metadata["read"] or partial(_of_type, kind))(value)
    except (TypeError, ValueError) as error:
        text = str(error)
        if text.startswith("must"):
            text = f"{entry.name} = {value!r}: {text}"
        raise ValueError(text if text.startswith(entry.name) else f"{entry.name}.{text}") from None


def _of_type(kind: Any, value: Any) -> Any:
    from pydantic import ConfigDict, TypeAdapter, ValidationError

    for each in (kind, *get_args(kind)):
        if is_dataclass(each):
            return _record(each, value)
    if get_origin(kind) is tuple and isinstance(value, str):
        value = (value,)
    if "Literal" in str(kind) and type(value) is int:  # such as "50", which YAML reads as a number
        value = str(value)
    try:
        return TypeAdapter(kind, config=ConfigDict(coerce_numbers_to_str=True)).validate_python(value)
    except ValidationError as error:
        raise ValueError(error.errors()[0]["msg"].replace("Input should", "must")) from None


def _record(kind: Any, value: object) -> Any:
    from blurnoise._core.checks import known

    if isinstance(value, kind):
        return value
    names = [each.name for each in fields(kind)]
    if not isinstance(value, Mapping):
        raise ValueError(f"must be a mapping of {', '.join(names)}")
    for name in value:
        known("field", name, names)
    return kind(**value)
