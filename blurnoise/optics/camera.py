"""The camera: figures, derived figures, presets and files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import torch
from annotated_types import Ge, Le
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import (
    LIMITS,
    Figure,
    Text,
    check_fields,
    in_range,
    integer,
    known,
    picture_size,
    shown,
    within,
)
from blurnoise._core.writing import writing
from blurnoise.optics import camera_files, colour, gain
from blurnoise.optics.captures import Capture
from blurnoise.optics.colour import Cfa, FilterCurves, Matrix, ToneCurve, WhiteBalance
from blurnoise.optics.gain import ConversionGain as ConversionGain
from blurnoise.optics.gain import MeasuredGain as MeasuredGain
from blurnoise.optics.lens import SAME_EVERYWHERE, Field, Lens, farthest_px
from blurnoise.optics.spectra import Curve
from blurnoise.optics.transfer import Optics

_Side = Annotated[int, Ge(1), Le(1 << 20)]
_Share = Annotated[float, Ge(0), Le(1)]
_VarianceFactor = Annotated[float, Ge(0), Le(100)]
PhotonTransfer = tuple[tuple[_Share, _VarianceFactor], ...]
DARK_NOISE = ("read_noise_e", "row_noise_e", "column_noise_e")
"""Figures of temporal noise that every pixel has whatever its charge, e- rms: what threshold and range rest on."""
PRNU = ("prnu", "prnu_row", "prnu_column")
DSNU = ("dsnu_e", "dsnu_row_e", "dsnu_column_e")
"""Figures of the fixed pattern, of single pixels, whole rows and whole columns."""


@dataclass(frozen=True)
class Camera:
    """A camera: lens, pixel, converter (EMVA 1288 release 4, linear model).

    pixel_pitch_um: square pixel. f_number: working. transmission: lens and atmosphere, 0-1. quantum_efficiency:
    electrons per photon, IR-cut included, over 400-700 nm or a :class:`Curve`; of a mosaic
    :class:`blurnoise.optics.colour.FilterCurves`. full_well_e: saturation capacity. system_gain_dn_per_e: K.
    read_noise_e: rms, temporal, in the dark, at 0 dB; read_noise_post_share: share of its variance that arises after
    the amplifier. analogue_gain_max_db: largest gain before the converter; gain_max_db: largest total gain.
    gains: figures measured at increasing gains, in place of conversion_gains and read_noise_post_share; a row at 0 dB
    repeats the camera's own figures. photon_transfer: points (signal_share, variance_factor), shares increasing: mean
    signal above black over clip_dn - black_level_dn, and the temporal variance of photo noise relative to the linear
    model; constant beyond the first and last point. row_noise_e, column_noise_e: rms, temporal, at 0 dB, one value
    for each row (column) and frame, added to the read noise of each pixel. black_level_drift_dn: rms, one offset for
    each frame. dark_current_e_s: at dark_reference_c, doubling every dark_doubling_c. prnu, prnu_row, prnu_column:
    fractions, of single pixels, whole rows and whole columns; dsnu_e, dsnu_row_e, dsnu_column_e: rms, likewise.
    black_level_dn: offset before rounding. defocus_radius_px: of the lens's disc. defocus_counts_pixel: blur by the
    disc's areas in the pixels, which counts the pixel's own aperture twice; for comparisons only.
    diffraction_wavelength_um: of the light whose diffraction the lens adds, at the f-number; 0: none. cfa: the
    mosaic. "none": a sensor for each colour of a picture, all with the same quantum efficiency; "mono": one plane
    of light, which comes out grey. white_balance: "auto" follows the light; or gains of red, green or clear, and
    blue. ccm: camera colours after white balance to linear sRGB, rows sum to 1; None: they are the same. width_px,
    height_px, hfov_deg: of the sensor; a picture of another size is the sensor's largest part of its shape.
    shutter: "rolling": each row is exposed row_time_s after the one before, from the top "down" or "up" (scan);
    "global-reset": all begin together, and each ends row_time_s after the one before, hence is brighter. sources:
    field name -> where its figure comes from. Raises ``ValueError`` or ``TypeError`` naming the field.
    """

    name: Text
    pixel_pitch_um: Annotated[Figure, within("pixel_pitch_um")]
    f_number: Annotated[Figure, within("f_number")]
    transmission: Annotated[Figure, Ge(0), Le(1)]
    quantum_efficiency: Figure | Curve | FilterCurves
    full_well_e: Annotated[Figure, within("full_well_e")]
    system_gain_dn_per_e: Annotated[Figure, within("system_gain_dn_per_e")]
    read_noise_e: Annotated[Figure, within("read_noise_e")]
    read_noise_post_share: Annotated[Figure, Ge(0), Le(1)] = 0.0
    analogue_gain_max_db: Annotated[Figure, within("analogue_gain_max_db")] = 0.0
    gain_max_db: Annotated[Figure, within("gain_max_db")] = 48.0
    conversion_gains: tuple[ConversionGain, ...] = ()
    gains: tuple[MeasuredGain, ...] = ()
    photon_transfer: Annotated[
        PhotonTransfer, "must be points (signal_share from 0 to 1, variance_factor from 0 to 100)"
    ] = ()
    captures: tuple[Capture, ...] = ()
    dark_current_e_s: Annotated[Figure, within("dark_current_e_s")] = 0.0
    dark_reference_c: Annotated[Figure, within("dark_reference_c")] = 20.0
    dark_doubling_c: Annotated[Figure, within("dark_doubling_c")] = 8.0
    row_noise_e: Annotated[Figure, within("row_noise_e")] = 0.0
    column_noise_e: Annotated[Figure, within("column_noise_e")] = 0.0
    black_level_drift_dn: Annotated[Figure, within("black_level_drift_dn")] = 0.0
    prnu: Annotated[Figure, within("prnu")] = 0.0
    prnu_row: Annotated[Figure, within("prnu_row")] = 0.0
    prnu_column: Annotated[Figure, within("prnu_column")] = 0.0
    dsnu_e: Annotated[Figure, within("dsnu_e")] = 0.0
    dsnu_row_e: Annotated[Figure, within("dsnu_row_e")] = 0.0
    dsnu_column_e: Annotated[Figure, within("dsnu_column_e")] = 0.0
    black_level_dn: Figure = 0.0
    bit_depth: Annotated[int, Ge(1), Le(16)] = 12
    defocus_radius_px: Annotated[Figure, within("defocus_radius_px")] = 0.0
    defocus_counts_pixel: bool = False
    diffraction_wavelength_um: Annotated[Figure, within("diffraction_wavelength_um")] = 0.0
    cfa: Cfa = "none"
    white_balance: Annotated[WhiteBalance, "must be 'auto' or three gains from 0.01 to 100"] = "auto"
    demosaic: Literal["bilinear", "edge"] = "bilinear"
    ccm: Annotated[Matrix | None, "must be three rows of three finite numbers"] = None
    tone: Annotated[ToneCurve, "must be 'srgb', 'filmic' or points (light, value), at least two"] = "srgb"
    jpeg_quality: Annotated[int | None, Ge(1), Le(100)] = None
    width_px: _Side = 1920
    height_px: _Side = 1080
    hfov_deg: Annotated[Figure, within("hfov_deg")] = 60.0
    row_time_s: Annotated[Figure, within("row_time_s")] = 0.0
    shutter: Literal["global", "rolling", "global-reset"] = "global"
    scan: Literal["down", "up"] = "down"
    lens: Annotated[Lens, "must be a Lens, in a file a mapping of its figures"] = SAME_EVERYWHERE
    sources: Mapping[str, Text] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        check_fields(self)
        colour.check(self.cfa, self.quantum_efficiency, self.ccm, self.white_balance, self.tone)
        for level_dn in (self.black_level_dn, *(row.black_level_dn for row in self.gains)):
            in_range("black_level_dn", level_dn, 0.0, self.full_scale_dn - 1)
        for name in sorted(self.sources.keys() - vars(self).keys()):
            known("sources: field", name, [entry.name for entry in fields(self)])
        _ = self.optics  # whose figures have limits of their own
        shares, rows = [share for share, _ in self.photon_transfer], (self.gains, self.conversion_gains)
        last_db, lens = self.analogue_gain_max_db, self.lens
        pinhole = lens.falloff_power or (
            lens.displaces and not (lens.distortion and lens.distortion.focal_px)
        )
        fault = gain.fault(self.at_0_db, *rows, last_db)
        if last_db > self.gain_max_db:
            fault = f"analogue_gain_max_db = {last_db!r}: must be <= gain_max_db, {self.gain_max_db:g}"
        elif sorted({*shares}) != shares:
            fault = f"photon_transfer: signal_share are {shown(shares)}; must increase"
        elif lens.mtf and (self.defocus_radius_px or self.diffraction_wavelength_um):
            must = "defocus_radius_px and diffraction_wavelength_um must be 0 beside it"
            fault = f"lens.mtf: is measured with defocus and diffraction, at its own f-number; {must}"
        elif lens.field_curvature_px and self.defocus_counts_pixel:
            fault = "lens.field_curvature_px: must be 0 where defocus_counts_pixel is true"
        elif self.hfov_deg >= 180 and pinhole:
            must = "must be < 180 for the field angles of lens.falloff_power and lens.distortion"
            fault = f"hfov_deg = {self.hfov_deg:g}: {must}, or lens.distortion states its focal_px"
        elif self.row_time_s and self.shutter == "global":
            must = "must be 0 where shutter is 'global'; 'rolling' and 'global-reset' take it"
            fault = f"row_time_s = {self.row_time_s!r}: {must}"
        if fault:
            raise ValueError(fault)
        if lens.displaces:
            farthest_px(self.field)

    def __hash__(self) -> int:
        """Hash of the fields in which cameras mostly differ: caches look cameras up several times a frame."""
        light = self.name, self.f_number, self.defocus_radius_px, self.diffraction_wavelength_um
        return hash((*light, self.system_gain_dn_per_e, self.read_noise_e, self.dark_current_e_s, self.prnu))

    @property
    def full_scale_dn(self) -> int:
        """Highest digital number, 2^bit_depth - 1."""
        return int(2**self.bit_depth) - 1

    @property
    def clip_dn(self) -> float:
        """Mean digital number of saturated pixels, before read noise: full scale, or the full well's if lower."""
        well_dn = round(self.full_well_e * self.system_gain_dn_per_e + self.black_level_dn)
        return min(self.full_scale_dn, well_dn)

    @property
    def well_limit_e(self) -> float:
        """Full well in electrons if it is below the converter's range; else infinite."""
        return self.full_well_e if self.clip_dn < self.full_scale_dn else math.inf

    @property
    def saturated_dn(self) -> float:
        """Digital number from which a pixel counts as saturated: full scale, or a lower full well less 3 sigma."""
        if self.clip_dn == self.full_scale_dn:
            return self.clip_dn
        noise_e = 3 * math.hypot(self.dark_noise_e, self.dsnu_total_e)
        least_e = max(self.full_well_e - noise_e, self.full_well_e / 2)
        return float(math.floor(least_e * self.system_gain_dn_per_e + self.black_level_dn))

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
            measured=self.lens.mtf.per_px(self.pixel_pitch_um) if self.lens.mtf else None,
        )

    def at_gain(self, gain_db: float) -> Amplified:
        """The camera at an analogue gain up to ``analogue_gain_max_db``, and the remaining digital gain.

        The figures are measured if the camera has ``gains``, else computed (:mod:`.gain`). Row and column noise
        follow read noise; ``photon_transfer`` keeps its place in electrons; ``black_level_drift_dn`` does not change.
        Raises ``ValueError`` beyond ``gain_max_db``.
        """
        in_range("gain_db", gain_db, LIMITS["gain_db"].low, self.gain_max_db)
        return _at_gain(self, float(gain_db))

    @property
    def at_0_db(self) -> MeasuredGain:
        """The camera's own figures that gain changes."""
        return MeasuredGain(0.0, self.system_gain_dn_per_e, self.read_noise_e, self.black_level_dn)

    @property
    def gain_law(self) -> str:
        """How K and read noise follow the gain, in a few words."""
        if self.gains:
            return f"measured at {', '.join(f'{row.gain_db:g}' for row in self.gains)} dB, interpolated"
        return "K times 10^(dB/20), read noise of two terms" + " for each conversion gain" * bool(
            self.conversion_gains
        )

    def variance_factor(self, charge_e: float) -> float:
        """Variance of shot noise over the mean charge, electrons, by ``photon_transfer``."""
        shares, factors = zip(*self.photon_transfer or [(0.0, 1.0)], strict=True)
        return float(np.interp(in_range("charge_e", charge_e) / self.saturation_e, shares, factors))

    @property
    def field(self) -> Field:
        """The lens's field on the sensor."""
        return Field(self.lens, self.width_px, self.height_px, self.hfov_deg, self.pixel_pitch_um)

    def fixed_pattern(self, shape: tuple[int, ...], seed: int) -> tuple[Tensor, Tensor]:
        """The camera's fixed pattern: (gain, offset_e), float32 on the CPU, both of ``shape`` (C, H, W).

        gain is 1 + prnu N(0, 1) and multiplies the photo signal; offset_e is dsnu_e N(0, 1). Values of whole rows
        and columns of each plane of C are added likewise.
        """
        if not isinstance(shape, (tuple, list)) or len(shape) != 3:
            raise TypeError(f"shape = {shown(shape)}: must be (C, H, W)")
        planes = integer("shape, C", shape[0], 1, 3), *picture_size("shape, (H, W)", shape[1:])
        figures = tuple(getattr(self, name) for name in (*PRNU, *DSNU))
        return _fixed_pattern(figures, planes, *rng.item_seeds(seed, 1))

    @property
    def dark_noise_e(self) -> float:
        """A pixel's temporal noise without light or dark current, e- rms: of all ``DARK_NOISE``."""
        return self._total(DARK_NOISE)

    @property
    def prnu_total(self) -> float:
        """PRNU of pixels, rows and columns together, a fraction."""
        return self._total(PRNU)

    @property
    def dsnu_total_e(self) -> float:
        """DSNU of pixels, rows and columns together, e- rms."""
        return self._total(DSNU)

    def _total(self, figures: Sequence[str]) -> float:
        return math.hypot(*(getattr(self, name) for name in figures))

    def dark_variance_dn2(self, dark_e: float = 0.0) -> float:
        """Temporal variance without light, DN^2: K^2 (dark_noise_e^2 + dark_e) + 1/12 (rounding)."""
        return self.system_gain_dn_per_e**2 * (self.dark_noise_e**2 + in_range("dark_e", dark_e)) + 1 / 12

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
        """A camera of ``PRESETS`` by name. Raises ``ValueError`` that lists the names for an unknown one."""
        known("camera", name, sorted(PRESETS))
        return PRESETS[name]

    @classmethod
    def from_dict(
        cls, values: Mapping[str, Any], *, source: str = "given", folder: str | Path = "."
    ) -> Camera:
        """The camera of ``values`` as :meth:`to_dict` gives them; ``base`` names a preset for missing values.

        source: for figures without one in ``values["sources"]``. folder: base of relative paths of tables. Raises
        ``TypeError`` or ``ValueError`` naming the field, its value and what is allowed.
        """
        return cls(**camera_files.completed(values, cls, PRESETS, source, Path(folder)))

    @classmethod
    def load(cls, path: str | Path) -> Camera:
        """Load a camera from a .json, .yaml or .yml file; without ``name`` it is named after the file.

        Raises ``TypeError`` or ``ValueError`` naming the file and the invalid field, ``OSError``.
        """
        if not isinstance(path, (str, PathLike)):
            raise TypeError(f"path = {shown(path)}: must be a path")
        path = Path(path)
        try:
            values = camera_files.read(path)
            return cls.from_dict(values, source=f"from {path.name}", folder=path.parent)
        except (TypeError, ValueError) as error:
            raise camera_files.within(str(path), error) from None

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Save the camera to a .json, .yaml or .yml file, atomically.

        overwrite: also replace a file that this did not write, or that was changed since. Raises ``ValueError`` or
        ``OSError``.
        """
        with writing(overwrite=overwrite):
            camera_files.write(Path(path), self.to_dict())

    def to_dict(self) -> dict[str, object]:
        """Plain values for JSON, sources included."""
        return dict(camera_files.plain(self))


class Amplified(NamedTuple):
    """A camera with its figures at an analogue gain, and the remaining digital gain, dB."""

    camera: Camera
    digital_db: float


@lru_cache(maxsize=512)
def _at_gain(camera: Camera, gain_db: float) -> Amplified:
    analogue_db = min(max(gain_db, 0.0), camera.analogue_gain_max_db)
    if analogue_db == 0:
        return Amplified(camera, gain_db)
    own = camera.at_0_db
    base = ConversionGain(0.0, camera.full_well_e, camera.read_noise_e, camera.read_noise_post_share)
    switched = [row for row in (base, *camera.conversion_gains) if row.from_db <= analogue_db][-1]
    found = gain.by_law(own, switched, analogue_db)
    if camera.gains:
        found = gain.measured(own, camera.gains, analogue_db)
    quieter = found.read_noise_e / own.read_noise_e if own.read_noise_e else 1.0
    amplified = replace(
        camera,
        system_gain_dn_per_e=found.system_gain_dn_per_e,
        full_well_e=switched.full_well_e,
        read_noise_e=found.read_noise_e,
        black_level_dn=found.black_level_dn,
        row_noise_e=camera.row_noise_e * quieter,
        column_noise_e=camera.column_noise_e * quieter,
        read_noise_post_share=0.0,
        analogue_gain_max_db=0.0,
        conversion_gains=(),
        gains=(replace(found, gain_db=0.0),) if camera.gains else (),
    )
    if camera.photon_transfer:  # the bend is the pixel's: it stays with the charge
        more = camera.saturation_e / amplified.saturation_e
        inside = [(share * more, factor) for share, factor in camera.photon_transfer if share * more < 1]
        last = (1.0, camera.variance_factor(amplified.saturation_e))
        amplified = replace(amplified, photon_transfer=(*inside, last))
    return Amplified(amplified, gain_db - analogue_db)


@lru_cache(maxsize=4)
@torch.inference_mode(False)  # it is kept, and must serve derivatives whoever asked first
def _fixed_pattern(figures: tuple[float, ...], shape: tuple[int, ...], seed: int) -> tuple[Tensor, Tensor]:
    like = torch.empty(1, *shape, dtype=torch.float32, device="cpu")
    of_parts = (("", like), (" of rows", like[..., :1]), (" of columns", like[..., :1, :]))
    fields = []
    for mean, name, sizes in ((1.0, "prnu", figures[:3]), (0.0, "dsnu", figures[3:])):
        field = torch.full_like(like, mean)
        for size, (part, of_part) in zip(sizes, of_parts, strict=True):
            if size:
                field += size * rng.standard_normal([seed], of_part, name + part)
        fields.append(field[0])
    return fields[0], fields[1]


PRESETS: dict[str, Camera] = {}
for _name in camera_files.PRESETS:
    PRESETS[_name] = Camera.from_dict(camera_files.preset(_name))
