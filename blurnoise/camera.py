"""Cameras in EMVA 1288 terms: presets, and files of one's own; every figure says where it comes from.

A camera file (.json, .yaml, .yml) maps the fields of :class:`Camera` to values. ``base: imx250`` takes what
it leaves out from a preset. ``quantum_efficiency`` is a number, {wavelengths_nm: [...], values: [...]} or
{csv: path, column: 1}, the path relative to the file.
"""

from __future__ import annotations

import csv
import json
import math
import numbers
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from blurnoise import presets
from blurnoise._core import rng
from blurnoise._core.checks import in_range, non_negative, one_of, positive
from blurnoise.spectra import Curve, Spectrum
from blurnoise.transfer import Optics


@dataclass(frozen=True)
class Camera:
    """A camera: lens, pixel, converter (EMVA 1288 release 4, linear model).

    pixel_pitch_um: square pixel. f_number: working f-number N. transmission: lens and atmosphere, 0-1.
    quantum_efficiency: electrons per photon, a number over 400-700 nm or a :class:`Curve`, IR-cut and colour
    filter included; all channels of a colour picture share it, as after a white balance.
    full_well_e: saturation capacity. system_gain_dn_per_e: K. read_noise_e: rms, temporal, in the dark.
    dark_current_e_s: at dark_reference_c, doubling every dark_doubling_c. prnu: fraction. dsnu_e: rms.
    black_level_dn: offset before rounding. bit_depth: of the converter.
    defocus_radius_px: of the lens's disc. defocus_counts_pixel: blur by the disc's areas in the pixels, as
    ``fspecial('disk', r)`` does, which counts the pixel's own aperture twice; for comparisons only.
    diffraction_wavelength_um: at which the lens's aperture spreads the light; 0: no diffraction.
    width_px, height_px, hfov_deg: the picture's size and the horizontal field of view.
    sources: field name -> where its figure comes from.

    Raises ``ValueError`` or ``TypeError`` naming the field and what is allowed.
    """

    name: str
    pixel_pitch_um: float
    f_number: float
    transmission: float
    quantum_efficiency: Spectrum
    full_well_e: float
    system_gain_dn_per_e: float
    read_noise_e: float
    dark_current_e_s: float = 0.0
    dark_reference_c: float = 20.0
    dark_doubling_c: float = 8.0
    prnu: float = 0.0
    dsnu_e: float = 0.0
    black_level_dn: float = 0.0
    bit_depth: int = 12
    defocus_radius_px: float = 0.0
    defocus_counts_pixel: bool = False
    diffraction_wavelength_um: float = 0.0
    width_px: int = 1920
    height_px: int = 1080
    hfov_deg: float = 60.0
    sources: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        for entry in fields(self):
            object.__setattr__(self, entry.name, _AS[str(entry.type)](entry.name, getattr(self, entry.name)))
        for name in ("pixel_pitch_um", "f_number", "full_well_e", "system_gain_dn_per_e", "dark_doubling_c"):
            positive(name, getattr(self, name))
        for name in ("read_noise_e", "dark_current_e_s", "prnu", "dsnu_e", "defocus_radius_px"):
            non_negative(name, getattr(self, name))
        non_negative("diffraction_wavelength_um", self.diffraction_wavelength_um)
        in_range("transmission", self.transmission, 0.0, 1.0)
        in_range("dark_reference_c", self.dark_reference_c, -273.15, 300.0)
        in_range("hfov_deg", self.hfov_deg, 1e-3, 360.0)
        curve = self.quantum_efficiency
        for value in curve.values if isinstance(curve, Curve) else (curve,):
            in_range("quantum_efficiency", value, 0.0, 1.0)
        for name, low, high in (("bit_depth", 1, 16), ("width_px", 1, 1 << 20), ("height_px", 1, 1 << 20)):
            in_range(name, getattr(self, name), low, high)
        in_range("black_level_dn", self.black_level_dn, 0.0, self.full_scale_dn - 1)

    @property
    def full_scale_dn(self) -> int:
        """Highest digital number, 2^bit_depth - 1."""
        return int(2**self.bit_depth) - 1

    @property
    def clip_dn(self) -> float:
        """Highest digital number a pixel can give: full scale, or the full well's if that is lower."""
        return min(
            self.full_scale_dn,
            round(self.full_well_e * self.system_gain_dn_per_e + self.black_level_dn),
        )

    @property
    def saturation_e(self) -> float:
        """Electrons at which the signal clips: the full well, or the converter's limit if that is lower."""
        return min(self.full_well_e, (self.full_scale_dn - self.black_level_dn) / self.system_gain_dn_per_e)

    @property
    def optics(self) -> Optics:
        """The lens's blur that acts through its transfer function."""
        return Optics(
            defocus_radius_px=0.0 if self.defocus_counts_pixel else self.defocus_radius_px,
            diffraction_lambda_n_px=self.diffraction_wavelength_um * self.f_number / self.pixel_pitch_um,
        )

    def fixed_pattern(self, shape: tuple[int, ...], seed: int) -> tuple[Tensor, Tensor]:
        """The camera's fixed pattern: (gain, offset_e), float32 on the CPU, both of ``shape`` (C, H, W).

        gain is 1 + prnu N(0, 1) and multiplies the photo signal; offset_e is dsnu_e N(0, 1). The same
        camera, shape and seed give the same pattern in every frame.
        """
        return _fixed_pattern(self.prnu, self.dsnu_e, tuple(shape), seed)

    def dark_variance_dn2(self, dark_e: float = 0.0) -> float:
        """Temporal variance without light, DN^2: K^2 (read^2 + dark_e) + 1/12 (rounding)."""
        return self.system_gain_dn_per_e**2 * (self.read_noise_e**2 + dark_e) + 1 / 12

    @property
    def snr_max_db(self) -> float:
        """Shot noise alone at saturation, 20 log10 sqrt(saturation_e): what EMVA 1288 quotes."""
        return 10 * math.log10(self.saturation_e)

    @property
    def threshold_e(self) -> float:
        """Photo-electrons at which the temporal SNR is 1, without dark current, rounding included."""
        return 0.5 + math.sqrt(0.25 + self.dark_variance_dn2() / self.system_gain_dn_per_e**2)

    @property
    def dynamic_range_db(self) -> float:
        """Saturation over :attr:`threshold_e`, 20 log10."""
        return 20 * math.log10(self.saturation_e / self.threshold_e)

    @classmethod
    def preset(cls, name: str) -> Camera:
        """A camera by name; see ``PRESETS`` for the names and ``camera.sources`` for where figures are from.

        Raises ``ValueError`` that lists the names for an unknown one.
        """
        if name not in PRESETS:
            raise ValueError(f"camera = {name!r}: unknown; presets are {', '.join(sorted(PRESETS))}")
        return PRESETS[name]

    @classmethod
    def from_dict(
        cls, values: Mapping[str, Any], *, source: str = "given", folder: str | Path = "."
    ) -> Camera:
        """The camera that ``values`` states as :meth:`to_dict` does; ``base`` names a preset for the rest.

        ``source`` is noted for every figure without one in ``values["sources"]``; ``folder`` is where a
        relative ``quantum_efficiency: {csv: path}`` starts. Raises ``TypeError`` or ``ValueError`` naming
        the field, its value and what is allowed.
        """
        return cls(**_completed(values, source, Path(folder)))

    @classmethod
    def load(cls, path: str | Path) -> Camera:
        """The camera of a .json, .yaml or .yml file; without ``name`` it is named after the file.

        Raises ``TypeError`` or ``ValueError`` naming the file and what is wrong in it, ``OSError`` where it
        cannot be read.
        """
        path = Path(path)
        suffix = _suffix(path)
        data = path.read_bytes()
        try:
            values = _parsed(data, suffix)
            if isinstance(values, dict):
                values = {"name": path.stem, **values}
            return cls.from_dict(values, source=f"from {path.name}", folder=path.parent)
        except (TypeError, ValueError) as error:
            raise _within(str(path), error) from None

    def save(self, path: str | Path) -> None:
        """Write a .json, .yaml or .yml file that :meth:`load` reads back, sources included.

        The file appears whole or not at all. Raises ``ValueError`` for another suffix, ``OSError`` where it
        cannot be written.
        """
        path = Path(path)
        text = _written(self.to_dict(), _suffix(path))
        unfinished = path.with_name(f".{path.name}.partial")
        try:
            unfinished.write_text(text, encoding="utf-8")
            unfinished.replace(path)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from None
        finally:
            with suppress(OSError):
                unfinished.unlink()

    def to_dict(self) -> dict[str, object]:
        """Plain values for JSON, sources included."""
        values: dict[str, object] = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        values["sources"] = dict(self.sources)
        if isinstance(self.quantum_efficiency, Curve):
            curve = self.quantum_efficiency
            values["quantum_efficiency"] = {
                "wavelengths_nm": list(curve.wavelengths_nm),
                "values": list(curve.values),
            }
        return values


@lru_cache(maxsize=4)
def _fixed_pattern(prnu: float, dsnu_e: float, shape: tuple[int, ...], seed: int) -> tuple[Tensor, Tensor]:
    like = torch.empty(1, *shape)
    gain = 1.0 + prnu * rng.standard_normal([seed], like, "prnu")[0]
    offset_e = dsnu_e * rng.standard_normal([seed], like, "dsnu")[0]
    return gain, offset_e


def _number(name: str, value: object) -> float:
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise ValueError(f"{name}: must be finite, got an integer beyond 1e308") from None
    hint = ", not text (YAML takes 1e4 for text; write 1.0e+4)" if isinstance(value, str) else ""
    raise TypeError(f"{name} = {value!r}: must be a number{hint}")


def _integer(name: str, value: object) -> int:
    if not isinstance(value, numbers.Integral) or isinstance(value, bool):
        raise TypeError(f"{name} = {value!r}: must be an integer")
    return int(value)


def _text(name: str, value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{name} = {value!r}: must be text")
    if not value.strip():
        raise ValueError(f"{name} = {value!r}: must not be empty")
    return value


def _switch(name: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"{name} = {value!r}: must be true or false")
    return value


def _spectrum(name: str, value: object) -> Spectrum:
    return value if isinstance(value, Curve) else _number(name, value)


def _sources(name: str, value: object) -> dict[str, str]:
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} = {value!r}: must map fields to where their figures come from")
    for key in value:
        _known(f"{name}: field", key, _FIELDS)
    return {key: _text(f"{name}.{key}", text) for key, text in value.items()}


_AS: Mapping[str, Callable[[str, object], object]] = {
    "str": _text,
    "float": _number,
    "int": _integer,
    "bool": _switch,
    "Spectrum": _spectrum,
    "Mapping[str, str]": _sources,
}
_FIELDS = tuple(entry.name for entry in fields(Camera))
_REQUIRED = tuple(entry.name for entry in fields(Camera) if entry.default is entry.default_factory is MISSING)
_FIGURES = tuple(name for name in _FIELDS if name not in ("name", "defocus_counts_pixel", "sources"))


def _within(where: str, error: Exception) -> Exception:
    """The same complaint with the place it concerns before it."""
    return (TypeError if isinstance(error, TypeError) else ValueError)(f"{where}: {error}")


def _known(what: str, name: object, known: tuple[str, ...]) -> None:
    if name in known:
        return
    near = get_close_matches(str(name), known, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ValueError(f"{what} {name!r} is unknown; {hint}Known are {', '.join(known)}")


def _completed(stated: object, source: str, folder: Path) -> dict[str, Any]:
    """All fields of the camera that ``stated`` and its base make, with a source for each figure."""
    if not isinstance(stated, Mapping):
        raise TypeError(f"camera: must map fields to values, got {type(stated).__name__}")
    for name in stated:
        _known("field", name, ("base", *_FIELDS))
    base: dict[str, Any] = {"sources": dict.fromkeys(_FIGURES, "assumed: the default, none was stated")}
    if "base" in stated:
        base = PRESETS[one_of("base", _text("base", stated["base"]), sorted(PRESETS))].to_dict()
    values = {**base, **{name: value for name, value in stated.items() if name != "base"}}
    if missing := [name for name in _REQUIRED if name not in values]:
        raise ValueError(
            f"missing {', '.join(missing)}; state them, or a base: one of {', '.join(sorted(PRESETS))}"
        )
    given = {name: source for name in _FIGURES if name in stated}
    values["sources"] = {**base["sources"], **given, **_sources("sources", stated.get("sources", {}))}
    if isinstance(values["quantum_efficiency"], Mapping):
        values["quantum_efficiency"] = _curve(values["quantum_efficiency"], folder)
    return values


def _curve(stated: Mapping[str, Any], folder: Path) -> Curve:
    name = "quantum_efficiency"
    try:
        if "csv" in stated and set(stated) <= {"csv", "column"}:
            column = _integer("column", stated.get("column", 1))
            in_range("column", column, 1, 1 << 16)
            return Curve.from_csv(folder / _text("csv", stated["csv"]), column)
        if set(stated) == {"wavelengths_nm", "values"}:
            return Curve(*(_samples(key, stated[key]) for key in ("wavelengths_nm", "values")))
    except OSError as error:
        raise ValueError(f"{name}: csv {stated['csv']!r} cannot be read: {error.strerror}") from None
    except (TypeError, ValueError, csv.Error) as error:
        raise _within(name, error) from None
    raise ValueError(
        f"{name} = {dict(stated)!r}: must be a number, {{wavelengths_nm, values}} or {{csv, column}}"
    )


def _samples(name: str, values: object) -> tuple[float, ...]:
    if not isinstance(values, (list, tuple)):
        raise TypeError(f"{name} = {values!r}: must be a list of numbers")
    return tuple(_number(name, value) for value in values)


def _suffix(path: Path) -> str:
    return one_of(f"suffix of {path}", path.suffix.lower(), (".json", ".yaml", ".yml"))


def _parsed(data: bytes, suffix: str) -> Any:
    """What a camera file holds. Raises ``ValueError`` of one line."""
    import yaml  # late: the presets need none

    try:
        text = data.decode("utf-8-sig")
        return json.loads(text) if suffix == ".json" else yaml.safe_load(text)
    except (ValueError, yaml.YAMLError, RecursionError) as error:
        kind = "JSON" if suffix == ".json" else "YAML"
        raise ValueError(f"is no {kind}: {' '.join(str(error).split())}") from None


def _written(values: dict[str, object], suffix: str) -> str:
    if suffix == ".json":
        return json.dumps(values, indent=1, ensure_ascii=False) + "\n"
    import yaml  # late: the presets need none

    return (
        "# A camera for blurnoise. Units are in the names; sources says where each figure comes from.\n"
        + yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=110)
    )


PRESETS: Mapping[str, Camera] = {figures["name"]: Camera(**figures) for figures in presets.FIGURES}
"""Cameras by name."""
