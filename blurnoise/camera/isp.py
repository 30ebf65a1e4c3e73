"""The image signal processor (ISP): how a camera develops its digital numbers into a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le

from blurnoise._core.fields import check_fields
from blurnoise.camera import colour
from blurnoise.camera.colour import Matrix, ToneCurve, WhiteBalance


@dataclass(frozen=True)
class Isp:
    """Settings of the development.

    white_balance: "auto" follows the light; or gains of red, green or clear, and blue.
    demosaic: interpolation of the colours between the pixels of a mosaic.
    ccm: camera colours after white balance to linear sRGB, rows sum to 1; None: they are the same.
    tone: curve from linear light to coded values, see :mod:`blurnoise.camera.colour`.
    jpeg_quality: of the compressed picture; None: not compressed.

    Raises ``ValueError`` or ``TypeError`` naming the field.

    >>> Isp(white_balance=(2.0, 1.0, 1.5), jpeg_quality=90).tone
    'srgb'
    """

    white_balance: Annotated[WhiteBalance, "must be 'auto' or three gains from 0.01 to 100"] = "auto"
    demosaic: Literal["bilinear", "edge"] = "bilinear"
    ccm: Annotated[Matrix | None, "must be three rows of three finite numbers"] = None
    tone: Annotated[ToneCurve, "must be 'srgb', 'filmic' or points (light, value), at least two"] = "srgb"
    jpeg_quality: Annotated[int | None, Ge(1), Le(100)] = None

    def __post_init__(self) -> None:
        check_fields(self)
        if not isinstance(self.tone, str):
            colour.check_points("tone", self.tone)
