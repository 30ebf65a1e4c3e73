"""Camera files (.json, .yaml, .yml): they map the fields of :class:`blurnoise.Camera` to values.

``base: imx250`` takes what a file leaves out from a preset. ``quantum_efficiency`` is a number,
{wavelengths_nm: [...], values: [...]} or {csv: path, column: 1}, the path relative to the file; one that is cut
short within the visible band is marked in its source (:func:`blurnoise.optics.spectra.cut_short`). Behind a mosaic
it is {red: ..., green: ..., blue: ..., clear: ...}, each of these. ``lens`` maps the figures of
:class:`blurnoise.optics.lens.Lens`, whose curves may be {csv: path, column: 1, unit: ...}. The presets are such files
in ``data/cameras``.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import yaml
from annotated_types import Ge, Le

from blurnoise._core.checks import known, one_of, shown
from blurnoise._core.files import read_document, read_samples, write_whole
from blurnoise._core.validation import Text, check_fields
from blurnoise.optics.colour import FilterCurves, marked
from blurnoise.optics.gains import Capture, ConversionGain
from blurnoise.optics.lens import Distortion, Lens, Mtf, RelativeIllumination
from blurnoise.optics.spectra import Curve

PRESETS = ("imx250", "imx250c", "imx250m", "imx249", "mt9m034", "blackfly", "ar0132at", "ar0237", "lin2024")
_HEAD = "# A camera for blurnoise. Units are in the names; sources says where each figure comes from.\n"
_SETTINGS = ("captures", "defocus_counts_pixel", "white_balance", "demosaic", "tone", "jpeg_quality")
_NO_FIGURES = ("name", *_SETTINGS, "sources")
_ROWS: Mapping[str, Any] = {"conversion_gains": ConversionGain, "captures": Capture}
_PARTS: Mapping[str, Any] = {
    "lens": Lens,
    "mtf": Mtf,
    "relative_illumination": RelativeIllumination,
    "distortion": Distortion,
}
_CURVES = (Curve, Mtf, RelativeIllumination)


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


def preset(name: str) -> Any:
    """What the file of a preset states."""
    text = resources.files("blurnoise.optics").joinpath("data", "cameras", f"{name}.yaml").read_text("utf-8")
    return yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))


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


def completed(
    stated: object, entries: Sequence[Field[Any]], presets: Mapping[str, Any], source: str, folder: Path
) -> dict[str, Any]:
    """The fields ``entries`` of the camera that ``stated`` and its base make, with a source for each figure.

    presets: cameras by name. ``source`` is noted for every figure without one in ``stated["sources"]``; ``folder``
    is where the path of a curve's table starts. Raises ``TypeError`` or ``ValueError`` naming the field.
    """
    if not isinstance(stated, Mapping):
        raise TypeError(f"camera: must map fields to values, got {type(stated).__name__}")
    names = [entry.name for entry in entries]
    for name in stated:
        known("field", name, ("base", *names))
    own = _Stated(**{name: stated[name] for name in ("base", "sources") if name in stated})
    check_fields(own)
    figures = [name for name in names if name not in _NO_FIGURES]
    base: Mapping[str, Any] = {"sources": dict.fromkeys(figures, "assumed: the default, none was stated")}
    if own.base is not None:
        base = vars(presets[one_of("base", own.base, sorted(presets))])
    values = {**base, **{name: value for name, value in stated.items() if name != "base"}}
    required = [entry.name for entry in entries if entry.default is entry.default_factory is MISSING]
    if missing := [name for name in required if name not in values]:
        raise ValueError(
            f"missing {', '.join(missing)}; state them, or a base: one of {', '.join(sorted(presets))}"
        )
    values["sources"] = base["sources"] | {name: source for name in figures if name in stated} | own.sources
    if isinstance(values["quantum_efficiency"], Mapping):
        curves = values["quantum_efficiency"] = _spectra(values["quantum_efficiency"], folder)
        told = values["sources"].get("quantum_efficiency", "")
        if (mark := marked(curves)) and mark not in told:
            values["sources"]["quantum_efficiency"] = f"{told}; marked: {mark}"
    return {name: _records(name, value, folder) for name, value in values.items()}


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


def plain(value: Any) -> Any:
    """A camera, or a part of it, as :func:`completed` takes it: mappings, lists and what JSON has."""
    if isinstance(value, FilterCurves):
        return {name: plain(curve) for name, curve in value.stated()}
    if is_dataclass(value):
        return {entry.name: plain(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    return dict(value) if isinstance(value, Mapping) else value


def _spectra(stated: Mapping[str, Any], folder: Path) -> Any:
    """A quantum efficiency: a curve, or one for each filter."""
    name = "quantum_efficiency"
    filters = [entry.name for entry in fields(FilterCurves)]
    if not stated.keys() & {*filters}:
        return _record(name, Curve, stated, folder)
    for key in stated:
        known(f"{name}: filter", key, filters)
    each = {
        key: _record(f"{name}.{key}", Curve, curve, folder) if isinstance(curve, Mapping) else curve
        for key, curve in stated.items()
    }
    return FilterCurves(**each)


def _records(name: str, stated: Any, folder: Path) -> Any:
    """The value of a field: mappings of it become the records they stand for."""
    if name in _ROWS and isinstance(stated, list):
        return tuple(_record(name, _ROWS[name], each, folder) for each in stated)
    if name in _PARTS and stated is not None and not isinstance(stated, _PARTS[name]):
        return _record(name, _PARTS[name], stated, folder)
    return stated


def _record(name: str, kind: Any, stated: object, folder: Path) -> Any:
    """A record of the figures that a file states. Raises as the record does, with its name before it."""
    try:
        if not isinstance(stated, Mapping):
            raise TypeError(f"must map figures to values, got {type(stated).__name__}")
        names = [entry.name for entry in fields(kind)]
        for key in stated:
            known("figure", key, [*names, *(("csv", "column") if kind in _CURVES else ())])
        if kind in _CURVES and "csv" in stated:
            stated = _tabulated(stated, names[0], folder)
        needed = [entry.name for entry in fields(kind) if entry.default is MISSING]
        if missing := [each for each in needed if each not in stated]:
            raise ValueError(f"missing {', '.join(missing)}")
        if kind is Curve:
            check_fields(_Samples(**stated))
        return kind(**{key: _records(key, value, folder) for key, value in stated.items()})
    except (TypeError, ValueError, csv.Error) as error:
        raise within(name, error) from None


def _tabulated(stated: Mapping[str, Any], positions: str, folder: Path) -> Mapping[str, Any]:
    """What a curve states, with the samples of its CSV file in the place of the file's name."""
    if stated.keys() & {positions, "values"}:
        raise ValueError(f"csv: holds {positions} and values; they must not stand beside it")
    table = _Table(**{name: stated[name] for name in ("csv", "column") if name in stated})
    check_fields(table)
    try:
        at, values = read_samples(folder / table.csv, table.column, f"one of {positions}")
    except OSError as error:
        raise ValueError(f"csv {shown(table.csv)} cannot be read: {error.strerror}") from None
    unit = {"unit": stated["unit"]} if "unit" in stated else {}
    return {positions: at, "values": values, **unit}


def _kind(path: Path) -> str:
    suffix = one_of(f"suffix of {path}", path.suffix.lower(), (".json", ".yaml", ".yml"))
    return "JSON" if suffix == ".json" else "YAML"
