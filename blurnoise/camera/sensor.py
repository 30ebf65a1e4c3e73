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
from blurnoise._core.checks import LIMITS, Limit, in_range, integer, picture_size, shown
from blurnoise._core.fields import Figure, check_fields
from blurnoise.camera import colour, gain
from blurnoise.camera.captures import Capture
from blurnoise.camera.colour import Cfa, FilterCurves
from blurnoise.camera.figures import (
    GAIN_DB,
    GAIN_DN_PER_E,
    LEVEL_DN,
    NOISE_E,
    SHARE,
    WELL_E,
    CameraFigure,
    figures_of,
)
from blurnoise.camera.gain import ConversionGain, MeasuredGain
from blurnoise.camera.spectra import Curve

_Side = Annotated[int, Ge(1), Le(1 << 20)]
_Share = Annotated[float, Ge(0), Le(1)]
_VarianceFactor = Annotated[float, Ge(0), Le(100)]
PhotonTransfer = tuple[tuple[_Share, _VarianceFactor], ...]
PRNU = ("prnu", "prnu_row", "prnu_column")
DSNU = ("dsnu_e", "dsnu_row_e", "dsnu_column_e")
"""Figures of the fixed pattern: of single pixels, whole rows and whole columns."""


@dataclass(frozen=True)
class Sensor:
    """Pixels and converter of a camera. Raises ``ValueError`` or ``TypeError`` naming the field.

    >>> sensor = Sensor(3.45, 0.6, full_well_e=10500.0, system_gain_dn_per_e=0.39, read_noise_e=2.4)
    >>> sensor.full_scale_dn, round(sensor.snr_max_db, 1)
    (4095, 40.2)
    """

    pixel_pitch_um: Annotated[Figure, CameraFigure("Pixel pitch", "µm", Limit(0.1, 1000.0))]
    """Side of the square pixel."""
    quantum_efficiency: Figure | Curve | FilterCurves
    """Electrons per photon: a number over 400-700 nm, or a curve over its own range; of a mosaic one by filter."""
    full_well_e: Annotated[Figure, CameraFigure("Full well", "e-", WELL_E)]
    """Saturation capacity of a pixel."""
    system_gain_dn_per_e: Annotated[Figure, CameraFigure("System gain", "DN/e-", GAIN_DN_PER_E)]
    """K, digital numbers per electron."""
    read_noise_e: Annotated[
        Figure, CameraFigure("Read noise", "e-", NOISE_E, span=(0.0, 50.0), dark_noise=True)
    ]
    """Rms in the dark."""
    read_noise_post_share: Annotated[Figure, CameraFigure("Read noise behind the amplifier", "", SHARE)] = 0.0
    """Share of the read noise's variance that arises after the amplifier."""
    analogue_gain_max_db: Annotated[Figure, CameraFigure("Largest analogue gain", "dB", GAIN_DB)] = 0.0
    """Largest gain before the converter."""
    gain_max_db: Annotated[Figure, CameraFigure("Largest gain", "dB", GAIN_DB)] = 48.0
    """Largest gain, analogue and digital."""
    conversion_gains: tuple[ConversionGain, ...] = ()
    """Figures from the gain on at which the pixel switches to another conversion gain."""
    gains: tuple[MeasuredGain, ...] = ()
    """Figures measured at increasing gains, in place of conversion_gains and read_noise_post_share; a row at 0 dB
    repeats the sensor's own figures."""
    photon_transfer: Annotated[
        PhotonTransfer, "must be points (signal_share from 0 to 1, variance_factor from 0 to 100)"
    ] = ()
    """Points of increasing signal_share, the mean signal above black over clip_dn - black_level_dn: the variance of
    photo noise there relative to the linear model. Constant before the first and beyond the last point."""
    captures: tuple[Capture, ...] = ()
    """Captures of an HDR picture; none: one exposure."""
    dark_current_e_s: Annotated[
        Figure, CameraFigure("Dark current", "e-/s", Limit(0.0, 1e9), span=(0.0, 1000.0))
    ] = 0.0
    """At dark_reference_c."""
    dark_reference_c: Annotated[Figure, CameraFigure("Dark current at", "°C", LIMITS["temperature_c"])] = 20.0
    """Temperature of the sensor to which dark_current_e_s refers."""
    dark_doubling_c: Annotated[Figure, CameraFigure("Doubles every", "°C", Limit(1.0, 1000.0))] = 8.0
    """Rise of the temperature that doubles the dark current."""
    row_noise_e: Annotated[
        Figure, CameraFigure("Row noise", "e-", NOISE_E, span=(0.0, 50.0), dark_noise=True)
    ] = 0.0
    """Rms; one value for each row and frame, added to the read noise of its pixels."""
    column_noise_e: Annotated[
        Figure, CameraFigure("Column noise", "e-", NOISE_E, span=(0.0, 50.0), dark_noise=True)
    ] = 0.0
    """Rms; one value for each column and frame."""
    parity_noise_e: Annotated[
        Figure,
        CameraFigure("Noise of even and odd columns", "e-", NOISE_E, span=(0.0, 50.0), dark_noise=True),
    ] = 0.0
    """Rms; one value for each row and frame, added to its even columns and subtracted from its odd ones."""
    row_gain_noise: Annotated[Figure, CameraFigure("Row gain noise", "", SHARE, span=(0.0, 0.05))] = 0.0
    """Rms relative to the signal; a factor of each row and frame, of a lamp or a reference that varies while rows are
    read. The mean over the rows of a frame is 1."""
    row_gain_rows: Annotated[Figure, CameraFigure("Rows of one gain", "rows", Limit(0.0, 1e6))] = 0.0
    """Rows over which the correlation of row_gain_noise falls to 1/e; 0: each row has its own."""
    black_level_drift_dn: Annotated[
        Figure, CameraFigure("Black level drift", "DN", LEVEL_DN, span=(0.0, 50.0))
    ] = 0.0
    """Rms; one offset for each frame."""
    prnu: Annotated[Figure, CameraFigure("PRNU", "", SHARE, span=(0.0, 0.05))] = 0.0
    """Fixed gain of single pixels, rms relative to the mean."""
    prnu_row: Annotated[Figure, CameraFigure("PRNU of rows", "", SHARE, span=(0.0, 0.05))] = 0.0
    """Fixed gain of whole rows."""
    prnu_column: Annotated[Figure, CameraFigure("PRNU of columns", "", SHARE, span=(0.0, 0.05))] = 0.0
    """Fixed gain of whole columns."""
    dsnu_e: Annotated[Figure, CameraFigure("DSNU", "e-", NOISE_E, span=(0.0, 50.0))] = 0.0
    """Fixed offset of single pixels, rms."""
    dsnu_row_e: Annotated[Figure, CameraFigure("DSNU of rows", "e-", NOISE_E, span=(0.0, 50.0))] = 0.0
    """Fixed offset of whole rows."""
    dsnu_column_e: Annotated[Figure, CameraFigure("DSNU of columns", "e-", NOISE_E, span=(0.0, 50.0))] = 0.0
    """Fixed offset of whole columns."""
    black_level_dn: Figure = 0.0
    """Offset before rounding, from 0 to below full scale, DN."""
    bit_depth: Annotated[int, Ge(1), Le(16)] = 12
    """Bits of the converter."""
    cfa: Cfa = "none"
    """The mosaic of colour filters. "none": a sensor for each colour of a picture, all with the same quantum
    efficiency; "mono": one plane of light, which comes out grey."""
    width_px: _Side = 1920
    height_px: _Side = 1080
    """Size of the sensor. A picture of another size is the sensor's largest part of its shape."""
    row_time_s: Annotated[
        Figure, CameraFigure("Rolling shutter", "s", Limit(0.0, 1.0), span=(0.0, 100e-6))
    ] = 0.0
    """Time between the exposures of two rows; 0: all rows at once."""
    shutter: Literal["global", "rolling", "global-reset"] = "global"
    """Of "rolling", each row begins and ends row_time_s after the one before; of "global-reset", all begin
    together and each ends row_time_s after the one before, hence is brighter."""
    scan: Literal["down", "up"] = "down"
    """The direction in which the rows follow each other."""

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
        # Rounded: where K is full scale over the full well, their product may miss full scale by a last digit.
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
        # Where the well clips, noise that arises after it spreads saturated pixels below the well's level.
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
        """Variance of shot noise over the mean charge, electrons, by ``photon_transfer``.

        >>> from blurnoise import Camera
        >>> bent = Camera.preset("imx250").with_figures(photon_transfer=((0.5, 1.0), (1.0, 0.6)))
        >>> round(bent.sensor.variance_factor(0.75 * bent.sensor.saturation_e), 2)
        0.8
        """
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

        >>> from blurnoise import Camera
        >>> amplified = Camera.preset("imx250").sensor.amplified(20.0)
        >>> round(amplified.system_gain_dn_per_e, 2), round(amplified.saturation_e)
        (3.6, 1072)
        """
        if analogue_db == 0:
            return self
        at_0_db = self.at_0_db
        base = ConversionGain(0.0, self.full_well_e, self.read_noise_e, self.read_noise_post_share)
        switched = [row for row in (base, *self.conversion_gains) if row.from_db <= analogue_db][-1]
        at_gain = gain.by_law(at_0_db, switched, analogue_db)
        if self.gains:
            at_gain = gain.measured(at_0_db, self.gains, analogue_db)
        # Rows and columns are read through the same amplifier as the pixels, so their noise follows read noise.
        quieter = at_gain.read_noise_e / at_0_db.read_noise_e if at_0_db.read_noise_e else 1.0
        amplified = replace(
            self,
            system_gain_dn_per_e=at_gain.system_gain_dn_per_e,
            full_well_e=switched.full_well_e,
            read_noise_e=at_gain.read_noise_e,
            black_level_dn=at_gain.black_level_dn,
            row_noise_e=self.row_noise_e * quieter,
            column_noise_e=self.column_noise_e * quieter,
            parity_noise_e=self.parity_noise_e * quieter,
            read_noise_post_share=0.0,
            analogue_gain_max_db=0.0,
            conversion_gains=(),
            gains=(replace(at_gain, gain_db=0.0),) if self.gains else (),
        )
        if self.photon_transfer:  # the bend is the pixel's, so it stays at the same charge
            more = self.saturation_e / amplified.saturation_e
            inside = [(share * more, factor) for share, factor in self.photon_transfer if share * more < 1]
            last = (1.0, self.variance_factor(amplified.saturation_e))
            amplified = replace(amplified, photon_transfer=(*inside, last))
        return amplified

    def fixed_pattern(self, shape: tuple[int, ...], seed: int) -> tuple[Tensor, Tensor]:
        """The sensor's fixed pattern: (gain, offset_e), float32 on the CPU, both of ``shape`` (C, H, W).

        gain is 1 + prnu N(0, 1) and multiplies the photo signal; offset_e is dsnu_e N(0, 1). Values of whole rows
        and columns of each plane of C are added likewise.

        >>> from blurnoise import Camera
        >>> gain, offset_e = Camera.preset("imx250").sensor.fixed_pattern((1, 480, 640), seed=1)
        >>> gain.shape, bool((offset_e == 0).all())
        (torch.Size([1, 480, 640]), True)
        """
        if not isinstance(shape, (tuple, list)) or len(shape) != 3:
            raise TypeError(f"shape = {shown(shape)}: must be (C, H, W)")
        planes = integer("shape, C", shape[0], 1, 3), *picture_size("shape, (H, W)", shape[1:])
        figures = tuple(getattr(self, name) for name in (*PRNU, *DSNU))
        return _fixed_pattern(figures, planes, *rng.item_seeds(seed, 1))


DARK_NOISE = tuple(name for name, entry in figures_of(Sensor).items() if entry.dark_noise)
"""Figures of temporal noise that every pixel has whatever its charge, e- rms: what threshold and range rest on."""


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
