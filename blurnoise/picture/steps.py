"""The picture's steps, one table in causal order: digital numbers to a picture, after the converter.

Domain: digital numbers until :data:`BLACK_LEVEL` makes them linear light (1: full scale), then a picture in [0, 1].
``STEPS`` is read wherever a frame is developed: a new entry is all that a new step needs. What a camera does not have
(a mosaic, JPEG) it passes over.
"""

from __future__ import annotations

from torch import Tensor

from blurnoise import tone
from blurnoise.camera import Camera
from blurnoise.picture.jpeg import Jpeg
from blurnoise.picture.mosaics import ColourMatrix, Demosaic, WhiteBalance
from blurnoise.picture.step import Development, PictureStep


class BlackLevel(PictureStep):
    """Digital numbers to linear light: 0 at the black level, 1 at full scale."""

    name = "black level"

    def apply(self, picture: Tensor, at: Development) -> Tensor:
        """(dn - black) / (full scale - black)."""
        return (picture - at.camera.black_level_dn) / (at.camera.full_scale_dn - at.camera.black_level_dn)


class DigitalGain(PictureStep):
    """A factor after the converter: brighter, and no less noisy."""

    name = "digital gain"

    def apply(self, picture: Tensor, at: Development) -> Tensor:
        """Times 10^(gain_db / 20)."""
        return picture if at.gain_db == 0 else picture * 10 ** (at.gain_db / 20)


class Tone(PictureStep):
    """Clipping to [0, 1], and where asked for the camera's curve, sRGB's by default."""

    name = "tone"

    def apply(self, picture: Tensor, at: Development) -> Tensor:
        """Coded."""
        return tone.coded(picture, at.camera.tone) if at.encoding == "srgb" else picture.clamp(0.0, 1.0)


BLACK_LEVEL, DIGITAL_GAIN, TONE, JPEG = BlackLevel(), DigitalGain(), Tone(), Jpeg()
WHITE_BALANCE, DEMOSAIC, COLOUR_MATRIX = WhiteBalance(), Demosaic(), ColourMatrix()
STEPS: tuple[PictureStep, ...] = (
    BLACK_LEVEL,
    WHITE_BALANCE,
    DEMOSAIC,
    COLOUR_MATRIX,
    DIGITAL_GAIN,
    TONE,
    JPEG,
)


def active(camera: Camera) -> tuple[PictureStep, ...]:
    """The steps that do something to this camera's frames, in order."""
    return tuple(step for step in STEPS if step.active(camera))
