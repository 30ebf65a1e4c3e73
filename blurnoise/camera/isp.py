"""The image signal processor (ISP): how a camera develops its digital numbers into a picture.

Strengths of noise reduction and sharpening follow the gain, analogue and digital: a table by gain in dB, linear
between its rows, constant beyond. Their DN are those of the developed picture of 8 bits, behind the tone curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Literal, TypeVar

import numpy as np
from annotated_types import Ge, Le

from blurnoise._core.checks import Limit, shown
from blurnoise._core.fields import Figure, check_fields, within
from blurnoise.camera import colour
from blurnoise.camera.colour import Matrix, ToneCurve, WhiteBalance
from blurnoise.camera.figures import GAIN_DB, SHARE

_PICTURE_DN = Limit(0.0, 255.0)


@dataclass(frozen=True)
class NoiseReduction:
    """Spatial noise reduction at a gain: a bilateral filter on Y'CbCr.

    luma_sigma_dn, chroma_sigma_dn: of the weights by difference; neighbours that differ by less are averaged; 0: the
    plane stays. strength: share of the filtered picture in the result, the rest is the picture itself. sigma_px: of
    the weights by distance, which end at 4/3 of it, rounded; 1.5 is a window of 5 x 5 pixels. There, 3.2 times the
    deviation of white noise leaves a third of it. Raises ``TypeError`` or ``ValueError``.

    >>> NoiseReduction(gain_db=12.0, luma_sigma_dn=6.0, chroma_sigma_dn=12.0).strength
    1.0
    """

    gain_db: Annotated[Figure, within(GAIN_DB)] = 0.0
    luma_sigma_dn: Annotated[Figure, within(_PICTURE_DN)] = 0.0
    chroma_sigma_dn: Annotated[Figure, within(_PICTURE_DN)] = 0.0
    strength: Annotated[Figure, within(SHARE)] = 1.0
    sigma_px: Annotated[Figure, within(Limit(0.5, 6.0))] = 1.5

    @property
    def reach_px(self) -> int:
        """Pixels from the middle of the window to its side.

        >>> NoiseReduction().reach_px, NoiseReduction(sigma_px=6.0).reach_px
        (2, 8)
        """
        return max(1, round(self.sigma_px * 4 / 3))

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class Sharpening:
    """Unsharp masking of luma at a gain.

    strength: how often the detail, luma less its Gaussian mean of sigma_px, is added. threshold_dn: taken off the
    detail's size before, so that noise below it stays. limit_dn: the most that a value changes. Raises ``TypeError``
    or ``ValueError``.

    >>> Sharpening(strength=1.0, threshold_dn=2.0, limit_dn=20.0).sigma_px
    1.0
    """

    gain_db: Annotated[Figure, within(GAIN_DB)] = 0.0
    strength: Annotated[Figure, within(Limit(0.0, 20.0))] = 0.0
    threshold_dn: Annotated[Figure, within(_PICTURE_DN)] = 0.0
    limit_dn: Annotated[Figure, within(_PICTURE_DN)] = 255.0
    sigma_px: Annotated[Figure, within(Limit(0.3, 20.0))] = 1.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class LocalTone:
    """Local tone mapping: contrast-limited adaptive histogram equalisation (CLAHE) of luma.

    clip_limit: how much steeper than equal the tone curve of a tile may be, at most. tiles: along each side of the
    picture. Raises ``TypeError`` or ``ValueError``.

    >>> LocalTone(clip_limit=2.0)
    LocalTone(clip_limit=2.0, tiles=8)
    """

    clip_limit: Annotated[Figure, within(Limit(0.0, 255.0, above=True))]
    tiles: Annotated[int, Ge(1), Le(64)] = 8

    def __post_init__(self) -> None:
        check_fields(self)


Row = TypeVar("Row", NoiseReduction, Sharpening)


def row_at(rows: Sequence[Row], gain_db: float) -> Row:
    """The row of a table by gain, at a gain: linear in dB between rows, constant beyond; of one row, that row.

    >>> row_at([NoiseReduction(0.0, 1.0, 2.0), NoiseReduction(24.0, 9.0, 18.0)], 6.0).luma_sigma_dn
    3.0
    """
    if len(rows) == 1:
        return rows[0]
    names, gains = [entry.name for entry in fields(rows[0])], [row.gain_db for row in rows]
    by_name = {name: np.interp(gain_db, gains, [getattr(row, name) for row in rows]) for name in names}
    return replace(rows[0], **by_name)


def _one_row(rows: Sequence[Row], gain_db: float) -> tuple[Row, ...]:
    return (row_at(rows, gain_db),) if rows else ()


@dataclass(frozen=True)
class Isp:
    """Settings of the development.

    white_balance: "auto" follows the light; or gains of red, green or clear, and blue.
    demosaic: interpolation of the colours between the pixels of a mosaic.
    ccm: camera colours after white balance to linear sRGB, rows sum to 1; None: they are the same.
    tone: curve from linear light to coded values, see :mod:`blurnoise.camera.colour`.
    noise_reduction, sharpening: by gain, in order; none: the step is left out.
    local_tone: after the tone curve and noise reduction, before sharpening; None: left out.
    jpeg_quality: of the compressed picture; None: not compressed. jpeg_subsampling: of its chroma.

    Raises ``ValueError`` or ``TypeError`` naming the field.

    >>> Isp(white_balance=(2.0, 1.0, 1.5), jpeg_quality=90).tone
    'srgb'
    """

    white_balance: Annotated[WhiteBalance, "must be 'auto' or three gains from 0.01 to 100"] = "auto"
    demosaic: Literal["bilinear", "edge"] = "bilinear"
    ccm: Annotated[Matrix | None, "must be three rows of three finite numbers"] = None
    tone: Annotated[
        ToneCurve, "must be 'srgb', 'filmic', 'typical' or points (light, value), two or more"
    ] = "srgb"
    noise_reduction: tuple[NoiseReduction, ...] = ()
    sharpening: tuple[Sharpening, ...] = ()
    local_tone: Annotated[LocalTone | None, "must be a LocalTone or None"] = None
    jpeg_quality: Annotated[int | None, Ge(1), Le(100)] = None
    jpeg_subsampling: Literal["4:4:4", "4:2:2", "4:2:0"] = "4:2:0"

    def __post_init__(self) -> None:
        check_fields(self)
        if not isinstance(self.tone, str):
            colour.check_points("tone", self.tone)
        for name in ("noise_reduction", "sharpening"):
            gains_db = [row.gain_db for row in getattr(self, name)]
            if gains_db != sorted({*gains_db}):
                raise ValueError(f"{name}: gain_db are {shown(gains_db)}; must increase")

    def at_gain(self, gain_db: float) -> Isp:
        """The ISP with the row of each table at a gain, analogue and digital, dB.

        >>> isp = Isp(sharpening=(Sharpening(0.0, strength=2.0), Sharpening(12.0, strength=1.0)))
        >>> [row.strength for row in isp.at_gain(6.0).sharpening]
        [1.5]
        """
        if max(len(self.noise_reduction), len(self.sharpening)) < 2:
            return self
        return replace(
            self,
            noise_reduction=_one_row(self.noise_reduction, gain_db),
            sharpening=_one_row(self.sharpening, gain_db),
        )
