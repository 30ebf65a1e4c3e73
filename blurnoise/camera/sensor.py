"""The sensor: pixels and converter by the linear model of EMVA 1288 release 4.

Electrons are photo-electrons in a pixel, DN digital numbers; noise is an rms value and temporal unless it is called
fixed. Figures hold at 0 dB of gain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
import torch
from annotated_types import Ge, Le
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import Figure, check_fields, in_range, integer, picture_size, shown, within
from blurnoise.camera import colour, gain
from blurnoise.camera.captures import Capture
from blurnoise.camera.colour import Cfa, FilterCurves
from blurnoise.camera.gain import ConversionGain, MeasuredGain
from blurnoise.camera.spectra import Curve

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
class Sensor:
    """Pixels and converter of a camera.

    pixel_pitch_um: side of the square pixel.
    quantum_efficiency: electrons per photon, IR-cut included: a number over 400-700 nm or a :class:`Curve`; of a
        mosaic :class:`blurnoise.camera.colour.FilterCurves`.
    full_well_e: saturation capacity.
    system_gain_dn_per_e: K, digital numbers per electron.
    read_noise_e: rms in the dark.
    read_noise_post_share: share of its variance that arises after the amplifier.
    analogue_gain_max_db, gain_max_db: largest gain before the converter, and in all.
    conversion_gains: figures from the gain on at which the pixel switches to another conversion gain.
    gains: figures measured at increasing gains, in place of conversion_gains and read_noise_post_share; a row at 0 dB
        repeats the sensor's own figures.
    photon_transfer: points (signal_share, variance_factor), shares increasing: mean signal above black over clip_dn -
        black_level_dn, and the variance of photo noise relative to the linear model; constant beyond the ends.
    captures: of an HDR picture; none: one exposure.
    dark_current_e_s: at dark_reference_c, doubling every dark_doubling_c.
    row_noise_e, column_noise_e: rms, one value for each row (column) and frame, added to every pixel's read noise.
    black_level_drift_dn: rms, one offset for each frame.
    prnu, prnu_row, prnu_column: fixed gain of single pixels, whole rows and whole columns, a fraction.
    dsnu_e, dsnu_row_e, dsnu_column_e: fixed offset, rms, likewise.
    black_level_dn: offset before rounding.
    bit_depth: of the converter.
    cfa: the mosaic. "none": a sensor for each colour of a picture, all with the same quantum efficiency; "mono": one
        plane of light, which comes out grey.
    width_px, height_px: a picture of another size is the sensor's largest part of its shape.
    row_time_s: between the exposures of two rows.
    shutter: "rolling": each row is exposed row_time_s after the one before, from the top "down" or "up" (scan);
        "global-reset": all begin together, and each ends row_time_s after the one before, hence is brighter.

    Raises ``ValueError`` or ``TypeError`` naming the field.
    """

    pixel_pitch_um: Annotated[Figure, within("pixel_pitch_um")]
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
    cfa: Cfa = "none"
    width_px: _Side = 1920
    height_px: _Side = 1080
    row_time_s: Annotated[Figure, within("row_time_s")] = 0.0
    shutter: Literal["global", "rolling", "global-reset"] = "global"
    scan: Literal["down", "up"] = "down"

    def __post_init__(self) -> None:
        check_fields(self)
        colour.check_filters(self.cfa, self.quantum_efficiency)
        for level_dn in (self.black_level_dn, *(row.black_level_dn for row in self.gains)):
            in_range("black_level_dn", level_dn, 0.0, self.full_scale_dn - 1)
        shares, last_db = [share for share, _ in self.photon_transfer], self.analogue_gain_max_db
        fault = gain.fault(self.at_0_db, self.gains, self.conversion_gains, last_db)
        if last_db > self.gain_max_db:
            fault = f"analogue_gain_max_db = {last_db!r}: must be <= gain_max_db, {self.gain_max_db:g}"
        elif sorted({*shares}) != shares:
            fault = f"photon_transfer: signal_share are {shown(shares)}; must increase"
        elif self.row_time_s and self.shutter == "global":
            must = "must be 0 where shutter is 'global'; 'rolling' and 'global-reset' take it"
            fault = f"row_time_s = {self.row_time_s!r}: {must}"
        if fault:
            raise ValueError(fault)

    def __hash__(self) -> int:
        """Hash of the figures in which sensors mostly differ: caches look cameras up several times a frame."""
        return hash((self.system_gain_dn_per_e, self.read_noise_e, self.dark_current_e_s, self.prnu))

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

    def variance_factor(self, charge_e: float) -> float:
        """Variance of shot noise over the mean charge, electrons, by ``photon_transfer``."""
        shares, factors = zip(*self.photon_transfer or [(0.0, 1.0)], strict=True)
        return float(np.interp(in_range("charge_e", charge_e) / self.saturation_e, shares, factors))

    @property
    def at_0_db(self) -> MeasuredGain:
        """The sensor's own figures that gain changes."""
        return MeasuredGain(0.0, self.system_gain_dn_per_e, self.read_noise_e, self.black_level_dn)

    @property
    def gain_law(self) -> str:
        """How K and read noise follow the gain, in a few words."""
        if self.gains:
            return f"measured at {', '.join(f'{row.gain_db:g}' for row in self.gains)} dB, interpolated"
        return "K times 10^(dB/20), read noise of two terms" + " for each conversion gain" * bool(
            self.conversion_gains
        )

    def amplified(self, analogue_db: float) -> Sensor:
        """The sensor with its figures at an analogue gain, from 0 to ``analogue_gain_max_db``.

        They are measured if the sensor has ``gains``, else computed (:mod:`.gain`). Row and column noise follow read
        noise; ``photon_transfer`` keeps its place in electrons; ``black_level_drift_dn`` does not change.
        """
        if analogue_db == 0:
            return self
        own = self.at_0_db
        base = ConversionGain(0.0, self.full_well_e, self.read_noise_e, self.read_noise_post_share)
        switched = [row for row in (base, *self.conversion_gains) if row.from_db <= analogue_db][-1]
        found = gain.by_law(own, switched, analogue_db)
        if self.gains:
            found = gain.measured(own, self.gains, analogue_db)
        quieter = found.read_noise_e / own.read_noise_e if own.read_noise_e else 1.0
        amplified = replace(
            self,
            system_gain_dn_per_e=found.system_gain_dn_per_e,
            full_well_e=switched.full_well_e,
            read_noise_e=found.read_noise_e,
            black_level_dn=found.black_level_dn,
            row_noise_e=self.row_noise_e * quieter,
            column_noise_e=self.column_noise_e * quieter,
            read_noise_post_share=0.0,
            analogue_gain_max_db=0.0,
            conversion_gains=(),
            gains=(replace(found, gain_db=0.0),) if self.gains else (),
        )
        if self.photon_transfer:  # the bend is the pixel's: it stays with the charge
            more = self.saturation_e / amplified.saturation_e
            inside = [(share * more, factor) for share, factor in self.photon_transfer if share * more < 1]
            last = (1.0, self.variance_factor(amplified.saturation_e))
            amplified = replace(amplified, photon_transfer=(*inside, last))
        return amplified

    def fixed_pattern(self, shape: tuple[int, ...], seed: int) -> tuple[Tensor, Tensor]:
        """The sensor's fixed pattern: (gain, offset_e), float32 on the CPU, both of ``shape`` (C, H, W).

        gain is 1 + prnu N(0, 1) and multiplies the photo signal; offset_e is dsnu_e N(0, 1). Values of whole rows
        and columns of each plane of C are added likewise.
        """
        if not isinstance(shape, (tuple, list)) or len(shape) != 3:
            raise TypeError(f"shape = {shown(shape)}: must be (C, H, W)")
        planes = integer("shape, C", shape[0], 1, 3), *picture_size("shape, (H, W)", shape[1:])
        figures = tuple(getattr(self, name) for name in (*PRNU, *DSNU))
        return _fixed_pattern(figures, planes, *rng.item_seeds(seed, 1))


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
