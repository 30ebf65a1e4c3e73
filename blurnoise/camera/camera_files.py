"""Camera files (.json, .yaml, .yml): they map the fields of :class:`blurnoise.Camera` to values.

``base: imx250`` fills in missing figures from a preset. Curves are {wavelengths_nm: [...], values: [...]}, or
{csv: path, column: 1} of a table beside the file; a quantum efficiency is a number, a curve, or one of them for each
filter, {red: ..., green: ..., blue: ..., clear: ...}. The presets are such files in ``data/cameras``.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import yaml

from blurnoise._core.checks import integer, known, one_of, shown
from blurnoise._core.files import read_document, read_samples
from blurnoise._core.writing import write_whole
from blurnoise.camera.colour import FilterCurves, marked
from blurnoise.camera.figures import figures_of
from blurnoise.camera.isp import Isp
from blurnoise.camera.lens import Lens
from blurnoise.camera.sensor import Sensor

PRESETS = (
    "imx250", "imx250c", "imx250m", "imx249", "mt9m034", "blackfly", "ar0132at", "ar0132c", "ar0132m", "ar0237",
    "imx219", "imx296", "imx477", "imx500", "imx708", "ov5647", "lin2024", "ar0132x3", "ovsplit",
)  # fmt: skip
_HEAD = "# A camera for blurnoise. Units are in the names; sources says where each figure comes from.\n"
_hints = lru_cache(get_type_hints)
RECORDS: Mapping[str, Any] = {"lens": Lens, "sensor": Sensor, "isp": Isp}
"""Fields of the camera to the records that they hold."""
RECORD_OF = {entry.name: part for part, kind in RECORDS.items() for entry in fields(kind)}
"""Names of all figures to the field of the camera that holds them."""
FIGURES = {name: entry for kind in RECORDS.values() for name, entry in figures_of(kind).items()}
"""Figures that are numbers, with their limits, titles and units."""
_FLAT = (
    "pixel_pitch_um", "f_number", "transmission", "infrared_cut_nm", "quantum_efficiency", "full_well_e",
    "system_gain_dn_per_e", "read_noise_e", "read_noise_post_share", "analogue_gain_max_db", "gain_max_db",
    "conversion_gains", "gains", "photon_transfer", "captures", "dark_current_e_s", "dark_reference_c",
    "dark_doubling_c", "row_noise_e", "column_noise_e", "parity_noise_e", "row_gain_noise", "row_gain_rows",
    "black_level_drift_dn", "prnu", "prnu_row", "prnu_column", "dsnu_e", "dsnu_row_e", "dsnu_column_e",
    "black_level_dn", "bit_depth", "defocus_radius_px", "diffraction_wavelength_um", "cfa",
    "white_balance", "demosaic", "ccm", "tone", "noise_reduction", "local_tone", "sharpening", "jpeg_quality",
    "jpeg_subsampling", "width_px", "height_px", "hfov_deg", "row_time_s", "shutter", "scan",
)  # fmt: skip
# Files list the figures as people look for them, pixel and lens first. A figure that is not listed here still has its
# place: one of the lens in the mapping, any other after those listed.
OVER_THE_FIELD = tuple(name for name, part in RECORD_OF.items() if part == "lens" and name not in _FLAT)
"""Figures of the lens that files have in the mapping ``lens``; the others are flat."""
KEYS = (
    "name",
    *dict.fromkeys((*_FLAT, *(name for name in RECORD_OF if name not in OVER_THE_FIELD))),
    "lens",
    "sources",
)
"""Keys of files, in their order."""
_NO_FIGURES = ("name", "captures", "white_balance", "demosaic", "tone", "jpeg_quality",
               "jpeg_subsampling", "sources")  # fmt: skip


def preset(name: str) -> Any:
    """The file of a preset.

    >>> preset("imx250")["pixel_pitch_um"]
    3.45
    """
    path = Path(__file__).parent / "data" / "cameras" / f"{name}.yaml"
    return yaml.load(path.read_bytes(), getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def read(path: Path) -> Any:
    """Read a camera file; a camera without ``name`` is named after the file. Raises ``ValueError`` or ``OSError``.

    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "mine.yaml"
    >>> written = file.write_text("{base: imx250, f_number: 2.8}")
    >>> read(file)
    {'name': 'mine', 'base': 'imx250', 'f_number': 2.8}
    """
    # The suffix is checked first: a wrong one should be the message even where the file is missing.
    kind = _kind(path)
    try:
        values = read_document(path)
    except ValueError as error:
        raise ValueError(f"is no {kind}: {error}") from None
    return {"name": path.stem, **values} if isinstance(values, dict) else values


def completed(given: object, presets: Mapping[str, Any], source: str, folder: Path) -> dict[str, Any]:
    """The fields of a camera from ``given`` and its base preset, each figure with a source.

    source: of figures without one. folder: where the paths of tables start. Raises ``TypeError`` or ``ValueError``.

    >>> from blurnoise import Camera
    >>> presets = {"imx250": Camera.preset("imx250")}
    >>> values = completed({"name": "mine", "base": "imx250", "f_number": 2.8}, presets, "measured", Path("."))
    >>> values["lens"].f_number, values["sources"]["f_number"]
    (2.8, 'measured')
    """
    if not isinstance(given, Mapping):
        raise TypeError(f"camera: must map fields to values, got {type(given).__name__}")
    for name in given:
        if name in OVER_THE_FIELD:
            raise ValueError(f"field {name!r}: must be in the mapping lens, as lens: {{{name}: ...}}")
        known("field", name, ("base", *KEYS))
    figures = [name for name in KEYS if name not in _NO_FIGURES]
    base: Mapping[str, Any] = {"sources": dict.fromkeys(figures, "assumed: the default, none was stated")}
    if (of := given.get("base")) is not None:
        if not isinstance(of, str):
            raise TypeError(f"base = {shown(of)}: must be text")
        base = flat(presets[one_of("base", of, sorted(presets))])
    values = {**base, **{name: value for name, value in given.items() if name != "base"}}
    needed = [name for kind in RECORDS.values() for name in _needed(kind)]
    if missing := ", ".join(name for name in KEYS if name in ("name", *needed) and name not in values):
        raise ValueError(f"missing {missing}; give them, or a base: one of {', '.join(sorted(presets))}")
    values |= _over_the_field(values.pop("lens", {}), folder)
    for name in RECORD_OF.keys() & values.keys():
        values[name] = _value(RECORDS[RECORD_OF[name]], name, values[name], folder)
    if isinstance(own := given.get("sources", {}), Mapping):  # Camera refuses anything else
        sources = base["sources"] | {name: source for name in figures if name in given} | dict(own)
        own, curves = sources["quantum_efficiency"], given.get("quantum_efficiency")
        # Beyond its ends a curve counts as 0: readers of the source should know what that may cost.
        mark = marked(values["quantum_efficiency"]) if isinstance(curves, Mapping) else ""
        if mark and isinstance(own, str) and mark not in own:
            sources["quantum_efficiency"] = f"{own}; marked: {mark}"
        values["sources"] = sources
    records = {
        part: kind(**{name: values[name] for name in RECORD_OF if RECORD_OF[name] == part and name in values})
        for part, kind in RECORDS.items()
    }
    return {"name": values["name"], **records, "sources": values["sources"]}


def flat(camera: Any) -> dict[str, Any]:
    """The camera's values by their keys in files.

    >>> from blurnoise import Camera
    >>> flat(Camera.preset("imx250"))["pixel_pitch_um"]
    3.45
    """
    lens = {name: getattr(camera.lens, name) for name in OVER_THE_FIELD}
    named = {"name": camera.name, "lens": lens, "sources": camera.sources}
    return {key: named[key] if key in named else camera.figure(key) for key in KEYS}


def write(path: Path, values: Mapping[str, object]) -> None:
    """Write a camera file, whole or not at all. Raises ``ValueError`` for another suffix, ``OSError``.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "mine.json"
    >>> write(path, {"name": "mine"})
    >>> path.read_text()
    '{\\n "name": "mine"\\n}\\n'
    """
    if _kind(path) == "JSON":
        text = json.dumps(values, indent=1, ensure_ascii=False) + "\n"
    else:
        text = _HEAD + yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=110)
    write_whole(path, text.encode("utf-8"))


def within(where: str, error: Exception) -> Exception:
    """The same error with ``where`` before its message.

    >>> within("camera.yaml", ValueError("f_number = -1: must be at least 0.5"))
    ValueError('camera.yaml: f_number = -1: must be at least 0.5')
    """
    return (TypeError if isinstance(error, TypeError) else ValueError)(f"{where}: {error}")


def plain(value: Any) -> Any:
    """A camera, or a part of it, as plain JSON values that :func:`completed` reads.

    >>> plain(Lens(f_number=2.8, transmission=0.9))["f_number"], plain((1.0, 2.0))
    (2.8, [1.0, 2.0])
    """
    if isinstance(value, FilterCurves):
        return {name: plain(curve) for name, curve in value.items()}
    if is_dataclass(value):
        return {entry.name: plain(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    return {name: plain(each) for name, each in value.items()} if isinstance(value, Mapping) else value


def _over_the_field(given: object, folder: Path) -> dict[str, Any]:
    """Figures of the lens from the mapping of a file, those of the default where it has none."""
    if not isinstance(given, Mapping):
        raise TypeError(f"lens = {shown(given)}: must map figures to values")
    try:
        for name in given:
            known("figure", name, OVER_THE_FIELD)
        values = {name: _value(Lens, name, value, folder) for name, value in given.items()}
        # Checked before the flat figures are there, so that messages name ``lens``.
        alone = Lens(f_number=0.5, transmission=1.0, **values)
    except (TypeError, ValueError, csv.Error) as error:
        raise within("lens", error) from None
    return {name: getattr(alone, name) for name in OVER_THE_FIELD}


def _value(kind: Any, name: str, given: Any, folder: Path) -> Any:
    """The value of a record's field: mappings become the records of its annotation; errors begin with its name."""
    hint = _hints(kind)[name]
    records = _records(hint)
    try:
        if records and get_origin(hint) is tuple and isinstance(given, list):
            return tuple(_record(records[0], row, folder) for row in given)
        if records and isinstance(given, Mapping):
            by_filter = given.keys() & {entry.name for entry in fields(records[-1])}
            return _record(records[-1] if by_filter else records[0], given, folder)
    except (TypeError, ValueError, csv.Error) as error:
        raise within(name, error) from None
    return given


def _records(hint: Any) -> list[Any]:
    return [hint] if is_dataclass(hint) else [record for part in get_args(hint) for record in _records(part)]


def _record(kind: Any, given: object, folder: Path) -> Any:
    """A record of the figures in a file."""
    if not isinstance(given, Mapping):
        raise TypeError(f"must map figures to values, got {type(given).__name__}")
    names = [entry.name for entry in fields(kind)]
    for key in given:
        known("figure", key, [*names, *(("csv", "column") if "values" in names else ())])
    if "csv" in given:
        given = _tabulated(given, names[0], folder)
    if missing := ", ".join(name for name in _needed(kind) if name not in given):
        raise ValueError(f"missing {missing}")
    return kind(**{key: _value(kind, key, value, folder) for key, value in given.items()})


def _needed(kind: Any) -> list[str]:
    """Names of a record's fields that have no default."""
    return [entry.name for entry in fields(kind) if entry.default is entry.default_factory is MISSING]


def _tabulated(given: Mapping[str, Any], positions: str, folder: Path) -> Mapping[str, Any]:
    """A curve's description, with its CSV file's name replaced by the samples."""
    if given.keys() & {positions, "values"}:
        raise ValueError(f"csv: holds {positions} and values; give either the file or the numbers")
    name, column = given["csv"], integer("column", given.get("column", 1), 1, 1 << 16)
    if not isinstance(name, str) or not name.strip():
        raise TypeError(f"csv = {shown(name)}: must be the path of a file")
    try:
        at, values = read_samples(folder / name, column, f"one of {positions}")
    except OSError as error:
        raise ValueError(f"csv {shown(name)} cannot be read: {error.strerror}") from None
    return {positions: at, "values": values, **({"unit": given["unit"]} if "unit" in given else {})}


def _kind(path: Path) -> str:
    kinds = {".json": "JSON", ".yaml": "YAML", ".yml": "YAML"}
    return kinds[one_of(f"suffix of {path}", path.suffix.lower(), kinds)]
