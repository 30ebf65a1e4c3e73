"""Camera files (.json, .yaml, .yml): they map the fields of :class:`blurnoise.Camera` to values.

``base: imx250`` takes what a file leaves out from a preset. ``quantum_efficiency`` is a number,
{wavelengths_nm: [...], values: [...]} or {csv: path, column: 1}, the path relative to the file; one that is cut
short within the visible band is marked in its source (:func:`blurnoise.spectra.cut_short`). Behind a mosaic it is
{red: ..., green: ..., blue: ..., clear: ...}, each of these. ``lens`` maps the
figures of :class:`blurnoise.lens.Lens`.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from annotated_types import Ge, Le

from blurnoise import presets
from blurnoise._core.checks import known, one_of, shown
from blurnoise._core.documents import read_document
from blurnoise._core.files import write_whole
from blurnoise._core.validation import Text, check_fields
from blurnoise.capture import Capture
from blurnoise.colour import FilterCurves, marked
from blurnoise.gain import ConversionGain
from blurnoise.lens import Lens
from blurnoise.spectra import Curve

_HEAD = "# A camera for blurnoise. Units are in the names; sources says where each figure comes from.\n"
_SETTINGS = ("captures", "defocus_counts_pixel", "white_balance", "demosaic", "tone", "jpeg_quality")
_NO_FIGURES = ("name", *_SETTINGS, "sources")
_ROWS = (("conversion_gains", ConversionGain), ("captures", Capture))
T = TypeVar("T")
_BASES = {figures["name"]: figures for figures in presets.FIGURES}


@dataclass
class _Stated:
    base: Text | None = None
    sources: Mapping[str, Text] = field(default_factory=dict)


@dataclass
class _Samples:
    wavelengths_nm: tuple[float, ...]
    values: tuple[float, ...]


@dataclass
class _Table:
    csv: Text
    column: Annotated[int, Ge(1), Le(1 << 16)] = 1


def read(path: Path) -> Any:
    """What a camera file states, named after the file where it states no ``name``.

    Raises ``ValueError`` for another suffix or what is no JSON or YAML, ``OSError`` where it cannot be read.
    """
    kind = _kind(path)
    try:
        values = read_document(path)
    except ValueError as error:
        raise ValueError(f"is no {kind}: {error}") from None
    return {"name": path.stem, **values} if isinstance(values, dict) else values


def completed(stated: object, entries: Sequence[Field[Any]], source: str, folder: Path) -> dict[str, Any]:
    """The fields ``entries`` of the camera that ``stated`` and its base make, with a source for each figure.

    ``source`` is noted for every figure without one in ``stated["sources"]``; ``folder`` is where the path of
    a quantum efficiency's table starts. Raises ``TypeError`` or ``ValueError`` naming the field.
    """
    if not isinstance(stated, Mapping):
        raise TypeError(f"camera: must map fields to values, got {type(stated).__name__}")
    names = [entry.name for entry in entries]
    for name in stated:
        known("field", name, ("base", *names))
    own = _checked(_Stated, {name: stated[name] for name in ("base", "sources") if name in stated})
    figures = [name for name in names if name not in _NO_FIGURES]
    base: Mapping[str, Any] = {"sources": dict.fromkeys(figures, "assumed: the default, none was stated")}
    if own.base is not None:
        base = _BASES[one_of("base", own.base, sorted(_BASES))]
    values = {**base, **{name: value for name, value in stated.items() if name != "base"}}
    required = [entry.name for entry in entries if entry.default is entry.default_factory is MISSING]
    if missing := [name for name in required if name not in values]:
        raise ValueError(
            f"missing {', '.join(missing)}; state them, or a base: one of {', '.join(sorted(_BASES))}"
        )
    values["sources"] = base["sources"] | {name: source for name in figures if name in stated} | own.sources
    if isinstance(values["quantum_efficiency"], Mapping):
        curves = values["quantum_efficiency"] = _curves(values["quantum_efficiency"], folder)
        told = values["sources"].get("quantum_efficiency", "")
        if (mark := marked(curves)) and mark not in told:
            values["sources"]["quantum_efficiency"] = f"{told}; marked: {mark}"
    for name, kind in _ROWS:
        if isinstance(values.get(name), Sequence):
            values[name] = tuple(_row(name, kind, stated) for stated in values[name])
    if isinstance(values.get("lens"), Mapping):
        values["lens"] = _lens(values["lens"], folder)
    return values


def write(path: Path, values: Mapping[str, object]) -> None:
    """Write a camera file, whole or not at all. Raises ``ValueError`` for another suffix, ``OSError``."""
    if _kind(path) == "JSON":
        text = json.dumps(values, indent=1, ensure_ascii=False) + "\n"
    else:
        text = _HEAD + yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=110)
    write_whole(path, text.encode("utf-8"))


def within(where: str, error: Exception) -> Exception:
    """The same complaint with the place it concerns before it."""
    return (TypeError if isinstance(error, TypeError) else ValueError)(f"{where}: {error}")


def plain(value: object) -> object:
    """A camera's field as :func:`completed` takes it, of mappings, lists and what JSON has."""
    if isinstance(value, FilterCurves):
        return {name: plain(curve) for name, curve in value.stated()}
    if isinstance(value, (Capture, ConversionGain, Curve)):
        return {entry.name: plain(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    return dict(value) if isinstance(value, Mapping) else value


def _curves(stated: Mapping[str, Any], folder: Path) -> Curve | FilterCurves:
    names = [entry.name for entry in fields(FilterCurves)]
    if not stated.keys() & {*names}:
        return _curve(stated, folder)
    name = "quantum_efficiency"
    for key in stated:
        known(f"{name}: filter", key, names)
    each = {
        key: _curve(curve, folder, f"{name}.{key}") if isinstance(curve, Mapping) else curve
        for key, curve in stated.items()
    }
    return FilterCurves(**each)


def _curve(stated: Mapping[str, Any], folder: Path, name: str = "quantum_efficiency") -> Curve:
    try:
        if "csv" in stated and stated.keys() <= {"csv", "column"}:
            table = _checked(_Table, stated)
            return Curve.from_csv(folder / table.csv, table.column)
        if stated.keys() == {"wavelengths_nm", "values"}:
            samples = _checked(_Samples, stated)
            return Curve(samples.wavelengths_nm, samples.values)
    except OSError as error:
        raise ValueError(f"{name}: csv {shown(stated['csv'])} cannot be read: {error.strerror}") from None
    except (TypeError, ValueError, csv.Error) as error:
        raise within(name, error) from None
    raise ValueError(
        f"{name} = {shown(stated)}: must be a number, {{wavelengths_nm, values}} or {{csv, column}}"
    )


def _row(of: str, kind: type[Any], stated: object) -> object:
    """A row of the field ``of`` that states its own fields; anything else is left for the camera to refuse."""
    if not isinstance(stated, Mapping):
        return stated
    names = [entry.name for entry in fields(kind)]
    required = [entry.name for entry in fields(kind) if entry.default is MISSING]
    try:
        for name in stated:
            known("field", name, names)
        if missing := [name for name in required if name not in stated]:
            raise ValueError(f"missing {', '.join(missing)}")
        return kind(**stated)
    except (TypeError, ValueError) as error:
        raise within(of, error) from None


def _lens(stated: Mapping[str, Any], folder: Path) -> Lens:
    try:
        return Lens.from_dict(stated, folder)
    except (TypeError, ValueError) as error:
        raise within("lens", error) from None


def _checked(kind: type[T], stated: Mapping[str, Any]) -> T:
    record = kind(**stated)
    check_fields(record)
    return record


def _kind(path: Path) -> str:
    suffix = one_of(f"suffix of {path}", path.suffix.lower(), (".json", ".yaml", ".yml"))
    return "JSON" if suffix == ".json" else "YAML"
